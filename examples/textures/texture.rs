//! Textures on the unit square in closed form, and their texels.

use glam::{DVec2, Vec3};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Linear colours of the points of the unit square, from 0 to 1.
pub(crate) type Texture = fn(DVec2) -> [f32; 3];

/// Black and white stripes that bend, the widest three times as wide as the narrowest.
pub(crate) fn zebra(at: DVec2) -> [f32; 3] {
    let (u, v) = (at.x, at.y);
    let bend = 1.4 * (5.0 * v + 1.1 * (6.0 * u).sin()).sin() + 0.5 * (13.0 * v - 9.0 * u).sin();
    let phase = 30.0 * u + 24.0 * v + bend;
    let width = 0.55 * (0.9 * phase + 4.0 * u).sin();
    [if (TAU * phase).sin() > width { 1.0 } else { 0.0 }; 3]
}

/// A checker of 24 by 24 in four colours, two of which change along rings around the middle, 56 from it to a distance of 1.
pub(crate) fn rings(at: DVec2) -> [f32; 3] {
    let is_dark = ((24.0 * at.x).floor() + (24.0 * at.y).floor()).rem_euclid(2.0) == 0.0;
    let is_crest = (TAU * 56.0 * at.distance(DVec2::splat(0.5))).cos() > 0.0;
    match (is_dark, is_crest) {
        (true, true) => [0.02, 0.05, 0.2],
        (true, false) => [0.1, 0.3, 0.75],
        (false, true) => [0.9, 0.85, 0.7],
        (false, false) => [0.75, 0.25, 0.05],
    }
}

/// Means of a texture over the cells of a grid on the unit square.
pub(crate) struct Texels {
    /// Cells along u and v, at least 1.
    pub(crate) size: [usize; 2],
    /// Their colours, rows along u.
    pub(crate) colors: Vec<[f32; 3]>,
}

/// σ of a kernel in distances of texels, along each axis: that of volume kernels in oblate.
pub(crate) const SIGMA: f64 = 0.7;

/// Samples of a cell along each side.
pub(crate) const PER_SIDE: usize = 3;

impl Texels {
    /// Takes the means of nine samples a cell.
    pub(crate) fn new(texture: impl Fn(DVec2) -> [f32; 3] + Sync, size: [usize; 2]) -> Self {
        let cells = Self { size, colors: Vec::new() };
        let mean = |cell: usize| {
            let offsets = (0..PER_SIDE * PER_SIDE).map(|i| {
                let offset = DVec2::new((i % PER_SIDE) as f64, (i / PER_SIDE) as f64) + 0.5;
                offset / PER_SIDE as f64 - 0.5
            });
            mean(offsets.map(|offset| texture(cells.place(cell) + offset * cells.step())))
        };
        Self { size, colors: (0..size[0] * size[1]).into_par_iter().map(mean).collect() }
    }

    /// The middle of a texel in the unit square.
    pub(crate) fn place(&self, index: usize) -> DVec2 {
        let cell = DVec2::new((index % self.size[0]) as f64, (index / self.size[0]) as f64);
        (cell + 0.5) * self.step()
    }

    /// The distances of texels along u and v.
    pub(crate) fn step(&self) -> DVec2 {
        1.0 / DVec2::new(self.size[0] as f64, self.size[1] as f64)
    }

    /// Bilinear interpolation between the four nearest texels; the outermost ones go on.
    pub(crate) fn bilinear(&self, at: DVec2) -> [f32; 3] {
        self.weighted::<2>(at, |distance| 1.0 - distance.abs())
    }

    /// The mean of the texels as their kernels weigh them at a point.
    pub(crate) fn by_kernels(&self, at: DVec2) -> [f32; 3] {
        self.weighted::<6>(at, |distance| (-0.5 * (distance / SIGMA as f32).powi(2)).exp())
    }

    /// A mean of the N² nearest texels with weights by their distances, in texels, along each axis.
    fn weighted<const N: usize>(&self, at: DVec2, weight: impl Fn(f32) -> f32) -> [f32; 3] {
        let axis = |at: f64, count: usize| {
            let at = at * count as f64 - 0.5;
            let first = at.floor() - (N / 2 - 1) as f64;
            let weights: [f32; N] = std::array::from_fn(|i| weight((first - at) as f32 + i as f32));
            let texel = |i: usize| (first + i as f64).clamp(0.0, (count - 1) as f64) as usize;
            (weights, std::array::from_fn::<usize, N, _>(texel))
        };
        let ((across, columns), (down, rows)) = (axis(at.x, self.size[0]), axis(at.y, self.size[1]));
        let mut sum = Vec3::ZERO;
        for (row, down) in rows.iter().zip(&down) {
            let mut line = Vec3::ZERO;
            for (column, across) in columns.iter().zip(&across) {
                line += Vec3::from(self.colors[row * self.size[0] + column]) * *across;
            }
            sum += line * *down;
        }
        (sum / (across.iter().sum::<f32>() * down.iter().sum::<f32>())).into()
    }
}

/// The mean of colours.
pub(crate) fn mean(colors: impl ExactSizeIterator<Item = [f32; 3]>) -> [f32; 3] {
    let count = colors.len() as f32;
    (colors.map(Vec3::from).sum::<Vec3>() / count).into()
}
