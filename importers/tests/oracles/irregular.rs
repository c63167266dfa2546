//! Curvilinear grids against what other readers say of them.

use crate::agreement::Agreement;
use oblate_volumes::IrregularVolume;
use serde::Deserialize;
use std::collections::HashMap;

#[derive(Deserialize)]
pub(crate) struct Facts {
    dims: [usize; 3],
    bounds: [[f64; 3]; 2],
    /// The first is the one that is read.
    arrays: Vec<Array>,
    spots: Vec<Spot>,
}

#[derive(Deserialize)]
struct Array {
    name: String,
    range: [f64; 2],
}

#[derive(Deserialize)]
struct Spot {
    index: [usize; 3],
    xyz: [f64; 3],
    /// Of each array.
    #[serde(flatten)]
    values: HashMap<String, f64>,
}

pub(crate) fn compare(agreement: &mut Agreement, volume: &IrregularVolume, facts: &Facts) {
    let samples = volume.samples();
    agreement.same("dims", samples.dims(), facts.dims);
    if samples.dims() != facts.dims {
        return;
    }
    // Nine digits tell every number of single precision.
    let single = |numbers: [f64; 3]| numbers.map(|x| x as f32);
    agreement.same("bounds", volume.bounds().map(|b| single(b.to_array())), facts.bounds.map(single));
    let array = &facts.arrays[0];
    agreement.same("range", samples.value_range(), Some(array.range.map(|v| v as f32)));
    for spot in &facts.spots {
        let [i, j, k] = spot.index;
        let number = (k * facts.dims[1] + j) * facts.dims[0] + i;
        let name = format!("sample {:?}", spot.index);
        agreement.same(&name, samples.value(spot.index), spot.values[&array.name] as f32);
        agreement.same(&name, single(volume.points()[number].to_array()), single(spot.xyz));
    }
}
