//! Analytic volumes: what they show is known exactly.

use std::f64::consts::PI;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use crate::volume::{GridFrame, Volume, VolumeError, Voxels};

/// An ellipsoid of [`shepp_logan`]: half-axes, centre, rotation about z in degrees, added density.
type Ellipsoid = ([f64; 3], [f64; 3], f64, f64);

const SHEPP_LOGAN: [Ellipsoid; 10] = [
    ([0.69, 0.92, 0.9], [0.0, 0.0, 0.0], 0.0, 1.0),
    ([0.6624, 0.874, 0.88], [0.0, 0.0, 0.0], 0.0, -0.8),
    ([0.41, 0.16, 0.21], [-0.22, 0.0, -0.25], 108.0, -0.2),
    ([0.31, 0.11, 0.22], [0.22, 0.0, -0.25], 72.0, -0.2),
    ([0.21, 0.25, 0.5], [0.0, 0.35, -0.25], 0.0, 0.2),
    ([0.046, 0.046, 0.046], [0.0, 0.1, -0.25], 0.0, 0.2),
    ([0.046, 0.023, 0.02], [-0.08, -0.65, -0.25], 0.0, 0.1),
    ([0.046, 0.023, 0.02], [0.06, -0.65, -0.25], 90.0, 0.1),
    ([0.056, 0.04, 0.1], [0.06, -0.105, 0.625], 90.0, 0.2),
    ([0.056, 0.056, 0.1], [0.0, 0.1, 0.625], 0.0, -0.2),
];

/// The three-dimensional Shepp–Logan head phantom on `n`³ samples, f32, filling the cube from −1 to 1: skull
/// 1, brain 0.2, ventricles 0, lesions up to 0.4.
///
/// Geometry: Kak, Slaney, *Principles of Computerized Tomographic Imaging*, 1988, p. 102. Densities: raised
/// to a contrast that shows, as Toft, *The Radon Transform*, 1996, does in two dimensions (skull 1, brain
/// 0.2, details ten times their own). The edges of the ellipsoids are ramps two samples wide instead of steps,
/// so that gradients and iso-surfaces are those of ellipsoids and not of cubes.
///
/// # Errors
/// When `n` is 0.
pub fn shepp_logan(n: usize) -> Result<Volume, VolumeError> {
    let spacing = 2.0 / n as f64;
    let rotations = SHEPP_LOGAN.map(|(_, _, degrees, _)| DMat3::from_rotation_z(-degrees.to_radians()));
    let density = |p: DVec3| {
        let shares = SHEPP_LOGAN.iter().zip(&rotations).map(|((axes, center, _, density), rotation)| {
            let axes = DVec3::from(*axes);
            let q = *rotation * (p - DVec3::from(*center));
            let radius = (q / axes).length();
            // To first order: the level set's value over its gradient.
            let slope = (q / (axes * axes)).length() / radius.max(f64::MIN_POSITIVE);
            let outside = (radius - 1.0) / slope.max(f64::MIN_POSITIVE);
            density * (0.5 - 0.5 * outside / spacing).clamp(0.0, 1.0)
        });
        shares.sum::<f64>()
    };
    let frame = GridFrame {
        spacing: DVec3::splat(spacing),
        origin: DVec3::splat(0.5 * spacing - 1.0),
        ..GridFrame::default()
    };
    sampled(n, frame, density)
}

/// The test signal of Marschner and Lobb (*An Evaluation of Reconstruction Filters for Volume Rendering*,
/// 1994) with f_M = 6 and α = 0.25, at a point of the cube from −1 to 1; its values are from 0 to 1.
fn marschner_lobb_at(point: DVec3) -> f64 {
    const FREQUENCY: f64 = 6.0;
    const ALPHA: f64 = 0.25;
    let radius = point.x.hypot(point.y);
    let ripple = (2.0 * PI * FREQUENCY * (0.5 * PI * radius).cos()).cos();
    (1.0 - (0.5 * PI * point.z).sin() + ALPHA * (1.0 + ripple)) / (2.0 * (1.0 + ALPHA))
}

/// The test signal of Marschner and Lobb (*An Evaluation of Reconstruction Filters for Volume Rendering*, 1994) with f_M = 6 and α = 0.25 on `n`³
/// samples, f32, whose values are from 0 to 1, on the cube from −1 to 1 with samples on its faces.
/// At 40, the size that its authors chose, the ripple's frequency reaches 0.48 cycles a sample: just below
/// what the lattice can hold.
///
/// # Errors
/// When `n` is below 2.
pub fn marschner_lobb(n: usize) -> Result<Volume, VolumeError> {
    let frame = GridFrame {
        spacing: DVec3::splat(2.0 / (n as f64 - 1.0)),
        origin: DVec3::NEG_ONE,
        ..GridFrame::default()
    };
    sampled(n, frame, marschner_lobb_at)
}

fn sampled(n: usize, frame: GridFrame, field: impl Fn(DVec3) -> f64 + Sync) -> Result<Volume, VolumeError> {
    let at = |index: usize| {
        let index = DVec3::new((index % n) as f64, (index / n % n) as f64, (index / (n * n)) as f64);
        field(frame.origin + frame.spacing * index) as f32
    };
    let samples = (0..n * n * n).into_par_iter().map(at).collect();
    Volume::new([n; 3], Voxels::F32(samples), frame)
}
