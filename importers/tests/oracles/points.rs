//! Point clouds against what other readers say of them.

use crate::agreement::Agreement;
use glam::{DVec3, Vec3};
use oblate_engine::color::linear_to_srgb;
use serde::Deserialize;

#[derive(Deserialize)]
pub(crate) struct Facts {
    count: usize,
    bounds: [[f64; 3]; 2],
    mean: [f64; 3],
    intensity: Intensity,
    rgb16: Option<Colors>,
    spots: Vec<Spot>,
}

#[derive(Deserialize)]
struct Intensity {
    range: [f64; 2],
    mean: f64,
}

#[derive(Deserialize)]
struct Colors {
    /// Least and most of each channel.
    ranges: [[f64; 3]; 2],
}

#[derive(Deserialize)]
struct Spot {
    index: usize,
    xyz: [f64; 3],
    intensity: f64,
    rgb16: Option<[f64; 3]>,
}

/// What a reader gives; arrays have an entry for each point.
pub(crate) struct Points<'a> {
    pub(crate) origin: DVec3,
    /// Relative to the origin.
    pub(crate) positions: &'a [Vec3],
    /// Linear Rec. 709.
    pub(crate) colors: Option<&'a [[f32; 3]]>,
    /// As the file has them.
    pub(crate) intensities: Option<&'a [f32]>,
}

pub(crate) fn compare(agreement: &mut Agreement, points: &Points<'_>, facts: &Facts) {
    let count = points.positions.len();
    agreement.same("count", count, facts.count);
    if count != facts.count {
        return;
    }
    let position = |i: usize| points.origin + points.positions[i].as_dvec3();
    let all = || (0..count).map(position);
    let low = all().fold(DVec3::INFINITY, DVec3::min);
    let high = all().fold(DVec3::NEG_INFINITY, DVec3::max);
    // Positions relative to an origin among them are rounded to single precision.
    let rounding = f64::from(f32::EPSILON) * (high - low).max_element();
    agreement.near("lower bound", &low.to_array(), &facts.bounds[0], rounding);
    agreement.near("upper bound", &high.to_array(), &facts.bounds[1], rounding);
    let mean = all().sum::<DVec3>() / count as f64;
    agreement.near("mean", &mean.to_array(), &facts.mean, rounding);

    match &points.intensities {
        Some(intensities) => {
            let range = intensities
                .iter()
                .fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], &v| [low.min(v), high.max(v)]);
            agreement.same("range of intensities", range.map(f64::from), facts.intensity.range);
            let mean = intensities.iter().map(|v| f64::from(*v)).sum::<f64>() / count as f64;
            // Whole numbers, whose sums are exact; one division rounds.
            agreement.near("mean intensity", &[mean], &[facts.intensity.mean], 1e-12 * facts.intensity.mean);
        }
        None => agreement.problem("has no intensities"),
    }
    agreement.same("whether it has colours", points.colors.is_some(), facts.rgb16.is_some());

    // Files have 16 bits for a channel, and many writers put 8 there.
    let largest = facts.rgb16.as_ref().map(|colors| colors.ranges[1].into_iter().fold(0.0, f64::max));
    let white = if largest.is_some_and(|most| most <= 255.0) { 255.0 } else { 65535.0 };
    for spot in &facts.spots {
        let what = |name: &str| format!("{name} of point {}", spot.index);
        agreement.near(&what("position"), &position(spot.index).to_array(), &spot.xyz, rounding);
        if let Some(intensities) = &points.intensities {
            agreement.same(&what("intensity"), f64::from(intensities[spot.index]), spot.intensity);
        }
        if let (Some(colors), Some(rgb16)) = (&points.colors, spot.rgb16) {
            let encoded = colors[spot.index].map(|channel| f64::from(linear_to_srgb(channel)));
            // To linear and back, with a power each way.
            agreement.near(&what("colour"), &encoded, &rgb16.map(|channel| channel / white), 2e-6);
        }
    }
}
