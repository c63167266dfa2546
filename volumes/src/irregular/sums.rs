//! What kernels add up to: at their centres, and on an even grid.

use fearless_simd::f32x8;
use fearless_simd::prelude::*;
use glam::{Mat3, Vec3};
use rayon::prelude::*;
use std::ops::Range;

use oblate_engine::simd::{Level, dispatch, exp};

use super::local::{Local, cofactors};
use super::supports::Supports;
use crate::kernels::KERNEL_SIGMA;

/// Squared distance in σ beyond which a kernel is left out of sums: e^{−9} of its peak.
const CUTOFF: f32 = 18.0;

/// Squared steps from which on kernels of an even grid are left out, and the most steps along an axis of those that aren't.
const FAR: usize = 9;
const REACH: isize = 2;

/// Centres at which sums are found at once: neighbours, which most of the same kernels reach.
const GROUP: usize = 8;

/// Kernels on an even grid.
pub(super) struct EvenGrid {
    /// What a kernel has of its peak, by the squared steps to its centre.
    falloff: [f32; FAR],
}

impl EvenGrid {
    pub(super) fn new() -> Self {
        let falloff = |squared| (-0.5 * squared as f64 / KERNEL_SIGMA.powi(2)).exp() as f32;
        Self { falloff: std::array::from_fn(falloff) }
    }

    /// What kernels add up to at a sample, in peaks of one, if there are those so many steps along the axes from it that `is_there` says.
    pub(super) fn sum(&self, is_there: impl Fn([isize; 3]) -> bool) -> f32 {
        let along = || -REACH..=REACH;
        let all = along().flat_map(|z| along().flat_map(move |y| along().map(move |x| [x, y, z])));
        let kernel = |steps: [isize; 3]| {
            let squared: isize = steps.iter().map(|steps| steps * steps).sum();
            self.falloff.get(squared as usize).filter(|_| is_there(steps))
        };
        all.filter_map(kernel).sum()
    }
}

/// Sums of kernels at the centres of all.
pub(super) struct Sums {
    supports: Supports,
    /// In the supports' order.
    kernels: Vec<Ellipsoid>,
}

/// Where a kernel is, and what takes differences to units of its σ.
struct Ellipsoid {
    center: Vec3,
    to_units: Mat3,
}

impl Sums {
    /// Of samples at `centers`.
    pub(super) fn new(locals: &[Local], centers: &[Vec3]) -> Self {
        let reach = |local: &Local| {
            let rows = local.steps.transpose().as_mat3();
            let along = Vec3::new(rows.x_axis.length(), rows.y_axis.length(), rows.z_axis.length());
            along * (KERNEL_SIGMA as f32 * CUTOFF.sqrt())
        };
        let boxes: Vec<(Vec3, Vec3)> =
            locals.par_iter().zip(centers).map(|(local, center)| (*center, reach(local))).collect();
        let supports = Supports::new(&boxes);
        let ellipsoid = |number: &u32| {
            let steps = locals[*number as usize].steps;
            let to_units = cofactors(steps).transpose() * (KERNEL_SIGMA * steps.determinant()).recip();
            Ellipsoid { center: centers[*number as usize], to_units: to_units.as_mat3() }
        };
        let kernels = supports.order.par_iter().map(ellipsoid).collect();
        Self { supports, kernels }
    }

    /// What the kernels add up to at each centre, where the volume of each is multiplied by its share, in peaks of one whose share is 1: these
    /// are the same for all, a volume |det J| over the kernel's (2π)^{3/2} σ³ |det J|.
    pub(super) fn at_centers(&self, shares: &[f32]) -> Vec<f32> {
        let order = &self.supports.order;
        let shares: Vec<f32> = order.par_iter().map(|number| shares[*number as usize]).collect();
        let level = Level::best();
        let group = |found: &mut Vec<Range<usize>>, kernels: &[Ellipsoid]| {
            let points = std::array::from_fn(|lane| kernels[lane.min(kernels.len() - 1)].center);
            found.clear();
            self.supports.around(&points, &mut |range| match found.last_mut() {
                Some(last) if last.end == range.start => last.end = range.end,
                _ => found.push(range),
            });
            dispatch!(level, simd => {
                let mut sum = f32x8::splat(simd, 0.0);
                for range in found {
                    let kernels = self.kernels[range.clone()].iter().zip(&shares[range.clone()]);
                    sum += sums(simd, kernels, &points);
                }
                sum.into()
            })
        };
        let sums: Vec<[f32; GROUP]> = self.kernels.par_chunks(GROUP).map_init(Vec::new, group).collect();
        let mut of_kernels = vec![0.0; order.len()];
        for (number, sum) in order.iter().zip(sums.as_flattened()) {
            of_kernels[*number as usize] = *sum;
        }
        of_kernels
    }
}

/// What kernels with their shares add up to at points.
#[inline(always)]
fn sums<'a, S: Simd>(
    simd: S,
    kernels: impl Iterator<Item = (&'a Ellipsoid, &'a f32)>,
    points: &[Vec3; GROUP],
) -> f32x8<S> {
    let (mut x, mut y, mut z) = ([0.0; GROUP], [0.0; GROUP], [0.0; GROUP]);
    for (lane, point) in points.iter().enumerate() {
        (x[lane], y[lane], z[lane]) = (point.x, point.y, point.z);
    }
    let (x, y, z) = (f32x8::simd_from(simd, x), f32x8::simd_from(simd, y), f32x8::simd_from(simd, z));
    let (mut sum, none) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 0.0));
    for (Ellipsoid { center, to_units }, share) in kernels {
        let (dx, dy, dz) = (x - center.x, y - center.y, z - center.z);
        let [a, b, c] = [to_units.x_axis, to_units.y_axis, to_units.z_axis];
        let u = dx * a.x + dy * b.x + dz * c.x;
        let v = dx * a.y + dy * b.y + dz * c.y;
        let w = dx * a.z + dy * b.z + dz * c.z;
        let squared = u * u + v * v + w * w;
        let falloff = exp(simd, squared * -0.5) * *share;
        sum += squared.simd_lt(CUTOFF).select(falloff, none);
    }
    sum
}
