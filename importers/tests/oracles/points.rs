//! Point clouds against what other readers say of them.

use crate::agreement::Agreement;
use glam::DVec3;
use oblate_engine::color::linear_to_srgb;
use oblate_surfels::PointCloud;
use serde::Deserialize;

#[derive(Deserialize)]
pub(crate) struct Facts {
    count: usize,
    bounds: [[f64; 3]; 2],
    mean: [f64; 3],
    intensity: Option<Intensity>,
    rgb: Option<Colors>,
    spots: Vec<Spot>,
}

#[derive(Deserialize)]
struct Intensity {
    /// Least and most.
    range: [[f64; 1]; 2],
    mean: [f64; 1],
}

#[derive(Deserialize)]
struct Colors {
    /// Least and most of each channel.
    range: [[f64; 3]; 2],
}

#[derive(Deserialize)]
struct Spot {
    index: usize,
    xyz: [f64; 3],
    intensity: Option<f64>,
    /// Of 8 or 16 bits.
    rgb: Option<[f64; 3]>,
}

pub(crate) fn compare(agreement: &mut Agreement, points: &PointCloud, facts: &Facts) {
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

    agreement.same("whether it has intensities", points.intensities.is_some(), facts.intensity.is_some());
    if let (Some(intensities), Some(expected)) = (&points.intensities, &facts.intensity) {
        let low = intensities.iter().copied().fold(f32::INFINITY, f32::min);
        let high = intensities.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        agreement.same("range of intensities", [low, high].map(f64::from), expected.range.map(|[v]| v));
        let mean = intensities.iter().map(|v| f64::from(*v)).sum::<f64>() / count as f64;
        // Whole numbers, whose sums are exact; one division rounds.
        agreement.near("mean intensity", &[mean], &expected.mean, 1e-12 * expected.mean[0]);
    }
    agreement.same("whether it has colours", points.colors.is_some(), facts.rgb.is_some());

    // Files have 16 bits for a channel, and many writers put 8 there.
    let largest = facts.rgb.as_ref().map(|colors| colors.range[1].into_iter().fold(0.0, f64::max));
    let white = if largest.is_some_and(|most| most <= 255.0) { 255.0 } else { 65535.0 };
    for spot in &facts.spots {
        let what = |name: &str| format!("{name} of point {}", spot.index);
        agreement.near(&what("position"), &position(spot.index).to_array(), &spot.xyz, rounding);
        if let (Some(intensities), Some(expected)) = (&points.intensities, spot.intensity) {
            agreement.same(&what("intensity"), f64::from(intensities[spot.index]), expected);
        }
        if let (Some(colors), Some(rgb)) = (&points.colors, spot.rgb) {
            let encoded = colors[spot.index].map(|channel| f64::from(linear_to_srgb(channel)));
            // To linear and back, with a power each way.
            agreement.near(&what("colour"), &encoded, &rgb.map(|channel| channel / white), 2e-6);
        }
    }
}
