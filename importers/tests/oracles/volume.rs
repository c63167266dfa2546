//! Volumes against what other readers say of them.

use crate::agreement::Agreement;
use oblate_volumes::Volume;
use serde::Deserialize;

#[derive(Deserialize)]
pub(crate) struct Facts {
    dims: [usize; 3],
    sample_type: String,
    range: [f64; 2],
    mean: f64,
    /// Rows; to the frame that files of this format name.
    index_to_world: [[f64; 4]; 4],
    /// x, y, z, value.
    spots: Vec<[f64; 4]>,
}

/// The type that samples of a file are kept in.
fn kept_type(sample_type: &str) -> &str {
    match sample_type {
        "u8" | "u16" | "i16" => sample_type,
        "i8" => "i16",
        _ => "f32",
    }
}

pub(crate) fn compare(agreement: &mut Agreement, volume: &Volume, facts: &Facts) {
    agreement.same("dims", volume.dims(), facts.dims);
    agreement.same("sample type", volume.voxels().type_name(), kept_type(&facts.sample_type));
    if volume.dims() != facts.dims {
        return;
    }
    let voxels = volume.voxels();
    let (mut low, mut high, mut sum) = (f32::INFINITY, f32::NEG_INFINITY, 0.0_f64);
    for value in (0..voxels.len()).map(|i| voxels.get(i)) {
        (low, high, sum) = (low.min(value), high.max(value), sum + f64::from(value));
    }
    // Samples of 8 and 16 bits and of single precision are the same numbers to everyone.
    agreement.same("range", [low, high], facts.range.map(|v| v as f32));
    // Sums of 2^25 doubles are right to 2^25 · 2^-53 of the sum of magnitudes, that is, of the largest.
    let largest = f64::from(low.abs().max(high.abs()));
    agreement.near("mean", &[sum / voxels.len() as f64], &[facts.mean], 4e-9 * largest);
    for [x, y, z, value] in &facts.spots {
        let index = [x, y, z].map(|i| *i as usize);
        // Nine digits tell every number of single precision.
        agreement.same(&format!("sample {index:?}"), volume.value(index), *value as f32);
    }
    let matrix = volume.index_to_world();
    let rows = (0..3).flat_map(|row| {
        let columns = matrix.matrix3.to_cols_array_2d();
        [columns[0][row], columns[1][row], columns[2][row], matrix.translation[row]]
    });
    let expected = facts.index_to_world[..3].concat();
    // Lengths of axes are divided out and multiplied in again; a quaternion's real part is a root of a difference.
    let largest = expected.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    agreement.near("index to world", &rows.collect::<Vec<_>>(), &expected, 1e-9 * largest);
}
