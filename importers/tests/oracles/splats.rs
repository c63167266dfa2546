//! Trained splats against what another reader says of them: over all of them, in whatever order, and one by one.

use crate::agreement::{Agreement, distance};
use glam::{DMat3, DQuat, DVec3};
use oblate_engine::color::linear_to_srgb;
use oblate_engine::{Splats, Strength};
use serde::Deserialize;
use std::collections::BTreeMap;

#[derive(Deserialize)]
pub(crate) struct Facts {
    format: String,
    count: usize,
    sh_degree: u8,
    bounds: [[f64; 3]; 2],
    /// xx, xy, xz, yy, yz, zz.
    mean_covariance: [f64; 6],
    mean_and_deviation: BTreeMap<String, [f64; 2]>,
    spots: Vec<Spot>,
}

/// A file that names the files of several levels.
#[derive(Deserialize)]
pub(crate) struct Levels {
    /// From the finest on.
    read: Vec<Level>,
}

#[derive(Deserialize)]
struct Level {
    count: usize,
}

#[derive(Deserialize)]
struct Spot {
    index: usize,
    position: [f64; 3],
    log_scales: [f64; 3],
    rotation_wxyz: [f64; 4],
    opacity: f64,
    dc: [f64; 3],
    /// Colours of the coefficients of degree 1.
    sh: Option<[[f64; 3]; 3]>,
}

/// How far numbers that are made of the same bits may be apart.
struct Tolerance {
    /// Relative to the largest coordinate.
    position: f64,
    log_scale: f64,
    /// Of the entries of rotations.
    axis: f64,
    opacity: f64,
    /// Display-encoded.
    color: f64,
    harmonic: f64,
}

/// Both readers see the same quantized numbers, so that what is left is single precision: a few roundings each, more where
/// a logarithm, a logistic function or the power of the display encoding lies between.
const ROUNDING: Tolerance =
    Tolerance { position: 5e-7, log_scale: 5e-6, axis: 2e-6, opacity: 1e-6, color: 3e-6, harmonic: 1e-6 };

fn tolerance(format: &str) -> Tolerance {
    match format {
        // A byte b of a rotation is (b − 128)/128 to the format's first viewer and b/127.5 − 1 to others: up to 1/128 apart.
        // An entry of a rotation is a sum of products of two, each up to 2, of four such numbers.
        "splat" => Tolerance { axis: 4.0 / 128.0, ..ROUNDING },
        _ => ROUNDING,
    }
}

/// A splat as trained scenes write it.
struct Row {
    position: [f64; 3],
    log_scales: [f64; 3],
    rotation: DMat3,
    opacity: f64,
    color: [f64; 3],
}

fn row(splats: &Splats, peaks: &[f32], i: usize) -> Row {
    let factor = splats.shapes.factor(i).as_dmat3();
    let columns = [factor.x_axis, factor.y_axis, factor.z_axis];
    let [x, y, z] = columns.map(|column| column / column.length());
    Row {
        position: splats.centers[i].as_dvec3().to_array(),
        log_scales: columns.map(|column| column.length().ln()),
        rotation: DMat3::from_cols(x, y, z),
        opacity: f64::from(peaks[i]),
        color: splats.colors[i].map(|channel| f64::from(linear_to_srgb(channel)).max(0.0)),
    }
}

fn covariance(rotation: DMat3, log_scales: [f64; 3]) -> [f64; 6] {
    let variances = log_scales.map(|s| (2.0 * s).exp());
    let matrix = rotation * DMat3::from_diagonal(variances.into()) * rotation.transpose();
    let [x, y, z] = matrix.to_cols_array_2d();
    [x[0], x[1], x[2], y[1], y[2], z[2]]
}

pub(crate) fn compare(agreement: &mut Agreement, splats: &Splats, facts: &Facts) {
    let count = splats.centers.len();
    agreement.same("count", count, facts.count);
    let degree = splats.harmonics.as_ref().map_or(0, |harmonics| harmonics.degree);
    agreement.same("degree of the harmonics", degree, facts.sh_degree);
    let Strength::Opacity { peaks, .. } = &splats.strength else {
        return agreement.problem("its strengths are not opacities");
    };
    if count != facts.count || degree != facts.sh_degree {
        return;
    }
    let tolerance = tolerance(&facts.format);
    compare_all(agreement, splats, peaks, (facts, &tolerance));
    for spot in &facts.spots {
        if let Err(problem) = find(splats, peaks, spot, (facts, &tolerance)) {
            agreement.problem(format!("splat {}: {problem}", spot.index));
        }
    }
}

/// Sums of a number of all splats, for its mean and its deviation.
#[derive(Clone, Copy, Default)]
struct Sums {
    of_values: f64,
    of_squares: f64,
}

impl Sums {
    fn add(&mut self, value: f64) {
        self.of_values += value;
        self.of_squares += value * value;
    }

    fn mean_and_deviation(self, count: usize) -> [f64; 2] {
        let mean = self.of_values / count as f64;
        [mean, (self.of_squares / count as f64 - mean * mean).max(0.0).sqrt()]
    }
}

fn compare_all(
    agreement: &mut Agreement,
    splats: &Splats,
    peaks: &[f32],
    (facts, tolerance): (&Facts, &Tolerance),
) {
    let per_splat = splats.harmonics.as_ref().map_or(0, |harmonics| harmonics.per_splat());
    let named = |prefix: &str, ends: [&str; 3]| ends.map(|end| format!("{prefix}{end}"));
    // What a splat has, with how far it may be off, in the order of `values` below.
    let size = facts.bounds.iter().flatten().fold(0.0_f64, |most, v| most.max(v.abs()));
    let mut names: Vec<(String, f64)> = Vec::new();
    let mut name = |three: [String; 3], tolerance: f64| names.extend(three.map(|name| (name, tolerance)));
    name(named("", ["x", "y", "z"]), tolerance.position * size);
    name(named("log_scale_", ["0", "1", "2"]), tolerance.log_scale);
    (0..3).for_each(|axis| name(named(&format!("axis_{axis}_"), ["x", "y", "z"]), tolerance.axis));
    name(named("color_", ["r", "g", "b"]), tolerance.color);
    (0..per_splat).for_each(|k| name(named(&format!("sh_{k}_"), ["r", "g", "b"]), tolerance.harmonic));
    names.push(("opacity".to_owned(), tolerance.opacity));

    let mut sums = vec![Sums::default(); names.len()];
    let mut covariances = [0.0; 6];
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for i in 0..splats.centers.len() {
        let row = row(splats, peaks, i);
        let harmonics = splats.harmonics.iter().flat_map(|h| &h.coefficients[i * per_splat..][..per_splat]);
        let values = (row.position.into_iter())
            .chain(row.log_scales)
            .chain(row.rotation.to_cols_array())
            .chain(row.color)
            .chain(harmonics.flatten().map(|v| f64::from(*v)))
            .chain([row.opacity]);
        sums.iter_mut().zip(values).for_each(|(sums, value)| sums.add(value));
        let covariance = covariance(row.rotation, row.log_scales);
        covariances.iter_mut().zip(covariance).for_each(|(sum, v)| *sum += v);
        let position = DVec3::from(row.position);
        (low, high) = (low.min(position), high.max(position));
    }
    let bounds = [low.to_array(), high.to_array()];
    agreement.near("bounds", &bounds.concat(), &facts.bounds.concat(), tolerance.position * size);
    for ((name, tolerance), sums) in names.iter().zip(sums) {
        let Some(expected) = facts.mean_and_deviation.get(name) else {
            agreement.problem(format!("nothing is said of {name}"));
            continue;
        };
        let found = sums.mean_and_deviation(splats.centers.len());
        agreement.near(&format!("mean of {name}"), &found[..1], &expected[..1], *tolerance);
        // What is off by as much for all splats does not show in the deviation, and nothing shows more than the square root of
        // what sums of doubles lose of the squares.
        let lost = (1e-12 * (expected[0].powi(2) + expected[1].powi(2))).sqrt();
        agreement.near(&format!("deviation of {name}"), &found[1..], &expected[1..], tolerance.max(lost));
    }
    let mean = covariances.map(|sum| sum / splats.centers.len() as f64);
    let largest = [0, 3, 5].map(|i| facts.mean_covariance[i]).into_iter().fold(0.0, f64::max);
    // Variances are off by twice what log scales are, relatively, and turned by what rotations are.
    let relative = 2.0 * tolerance.log_scale + 2.0 * tolerance.axis;
    agreement.near("mean covariance", &mean, &facts.mean_covariance, relative * largest);
}

/// The splat wherever it is: one of those at its place is as it is.
fn find(
    splats: &Splats,
    peaks: &[f32],
    spot: &Spot,
    (facts, tolerance): (&Facts, &Tolerance),
) -> Result<(), String> {
    let size = facts.bounds.iter().flatten().fold(0.0_f64, |most, v| most.max(v.abs()));
    let apart = |i: usize| distance(&splats.centers[i].as_dvec3().to_array(), &spot.position);
    let here = (0..splats.centers.len()).filter(|i| apart(*i) <= tolerance.position * size);
    let mut nearest = Err(format!("nothing is at {:?}", spot.position));
    for i in here {
        let differences = differences(splats, &row(splats, peaks, i), (i, spot), tolerance);
        if differences.is_empty() {
            return Ok(());
        }
        nearest = Err(differences.join("; "));
    }
    nearest
}

fn differences(splats: &Splats, row: &Row, (i, spot): (usize, &Spot), tolerance: &Tolerance) -> Vec<String> {
    let mut differences = Vec::new();
    let mut near = |what: &str, found: &[f64], expected: &[f64], tolerance: f64| {
        if distance(found, expected) > tolerance {
            differences.push(format!("{what} {found:?}, others say {expected:?}"));
        }
    };
    // Axes may be named in any order.
    let sorted = |mut values: [f64; 3]| {
        values.sort_by(f64::total_cmp);
        values
    };
    near("log scales", &sorted(row.log_scales), &sorted(spot.log_scales), tolerance.log_scale);
    let [w, x, y, z] = spot.rotation_wxyz;
    let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let expected = covariance(rotation, spot.log_scales);
    let largest = spot.log_scales.into_iter().fold(f64::NEG_INFINITY, f64::max);
    let relative = 2.0 * tolerance.log_scale + 2.0 * tolerance.axis;
    near(
        "covariance",
        &covariance(row.rotation, row.log_scales),
        &expected,
        relative * (2.0 * largest).exp(),
    );
    near("opacity", &[row.opacity], &[spot.opacity], tolerance.opacity);
    let color = spot.dc.map(|dc| (0.5 + (0.25 / std::f64::consts::PI).sqrt() * dc).max(0.0));
    near("colour", &row.color, &color, tolerance.color);
    if let (Some(harmonics), Some(expected)) = (&splats.harmonics, &spot.sh) {
        let found = &harmonics.coefficients[i * harmonics.per_splat()..][..3];
        let found: Vec<f64> = found.iter().flatten().map(|v| f64::from(*v)).collect();
        near("harmonics", &found, &expected.concat(), tolerance.harmonic);
    }
    differences
}

pub(crate) fn compare_levels(agreement: &mut Agreement, splats: &Splats, levels: &Levels) {
    agreement.same("count of the finest level", splats.centers.len(), levels.read[0].count);
}
