//! The form of each splat: the cheapest whose error stays within its share of the tolerance.

use super::WideProjector;
use super::geometry::{Footprints, Placed};
use crate::closing::{Closing, Distances};
use crate::columns;
use crate::footprint::ewa::{MEAN_DEVIATION, OF_KAPPA, OF_LAMBDA};
use crate::scene::FootprintForm;
use crate::simd::*;
use std::f32::consts::FRAC_2_PI;

/// The forms of eight splats; what is neither is affine.
pub(super) struct Forms<S: Simd> {
    pub(super) point: M<S>,
    pub(super) exact: M<S>,
    pub(super) along: Along<S>,
}

/// Volume kernels along the rays that meet them, where there are slabs.
pub(super) struct Along<S: Simd> {
    /// Their distances from the eye, and the spread.
    pub(super) distance: V<S>,
    pub(super) sigma: V<S>,
    /// Of the distance, over the footprint.
    pub(super) variance: V<S>,
}

impl WideProjector<'_> {
    /// Distances of kernels in slabs; nothing of other splats.
    #[inline(always)]
    fn along<S: Simd>(
        &self,
        simd: S,
        is_surface: bool,
        placed: &Placed<S>,
        footprints: &Footprints<S>,
    ) -> Along<S> {
        let zero = splat(simd, 0.0);
        let slabs = match &self.scalar.view.closing {
            Closing::Slabs(slabs) if !is_surface => slabs,
            _ => return Along { distance: zero, sigma: zero, variance: zero },
        };
        let Footprints { mean, depth_slope, sigma_z, conic_root, .. } = footprints;
        let kernels = (placed.center[2], *depth_slope, *sigma_z);
        let Distances { center, slope, sigma } = slabs.distances(simd, *mean, kernels);
        // |M⁻ᵀ slope|².
        let [a, b, c] = *conic_root;
        let x = slope[0] * reciprocal(simd, a);
        let y = (slope[1] - b * x) * reciprocal(simd, c);
        Along { distance: center, sigma, variance: x.mul_add(x, y * y) }
    }

    /// Chooses forms; footprints of points become round.
    #[inline(always)]
    pub(super) fn forms<S: Simd>(
        &self,
        simd: S,
        is_surface: bool,
        placed: &Placed<S>,
        footprints: &mut Footprints<S>,
    ) -> Forms<S> {
        let mut along = self.along(simd, is_surface, placed, footprints);
        let [none, all] = [M::splat(simd, false), M::splat(simd, true)];
        let (point, exact) = match self.scalar.view.settings.footprint {
            FootprintForm::Point => (all, none),
            FootprintForm::Affine => (none, none),
            FootprintForm::Exact => (none, M::splat(simd, self.perspective)),
            FootprintForm::Auto => self.cheapest(simd, placed, footprints, &along),
        };
        if point.any_true() {
            footprints.round(simd, point);
            along.variance = point.select(splat(simd, 0.0), along.variance);
        }
        Forms { point, exact, along }
    }

    /// The points and the exact ones, by their errors.
    #[inline(always)]
    fn cheapest<S: Simd>(
        &self,
        simd: S,
        placed: &Placed<S>,
        footprints: &Footprints<S>,
        along: &Along<S>,
    ) -> (M<S>, M<S>) {
        let Footprints { along: z_along, depth_slope, sigma_z, variance, covariance, .. } = footprints;
        let zero = splat(simd, 0.0);
        // Of z, over the footprint.
        let of_depth = z_along[0].mul_add(depth_slope[0], z_along[1] * depth_slope[1]).max(zero);
        let mut error = zero;
        if self.perspective {
            let per_z = placed.inverse_z * placed.inverse_z;
            let kappa2 = of_depth * per_z;
            let lambda = sigma_z.mul_add(*sigma_z * per_z, kappa2);
            error = kappa2.sqrt().mul_add(splat(simd, OF_KAPPA as f32), lambda * OF_LAMBDA as f32);
            if self.scalar.columns.kind == columns::Kind::Extinction {
                let inverse_length2 = splat(simd, 1.0) / dot(placed.ray, placed.ray);
                let g = [0, 1].each(
                    #[inline(always)]
                    |i| placed.ray[i] * inverse_length2 * (1.0 / self.focal[i]),
                );
                let nu2 = (g[0] * g[0]).mul_add(
                    variance[0],
                    (g[1] * g[1]).mul_add(variance[1], g[0] * g[1] * *covariance * 2.0),
                );
                error = nu2.max(zero).sqrt().mul_add(splat(simd, MEAN_DEVIATION as f32), error);
            }
        }
        let share = splat(simd, self.tolerance / 4.0);
        let exact = error.simd_gt(share);
        let mut of_point = error + footprints.roundness_error(simd);
        match &self.scalar.view.closing {
            _ if matches!(self.scalar.columns.kind, columns::Kind::Surface(_)) => {}
            closing if closing.takes_whole(&self.scalar.columns.kind) => {}
            Closing::Slabs(slabs) => {
                let per_deviation = MEAN_DEVIATION as f32 / slabs.thickness();
                of_point = along.variance.sqrt().mul_add(splat(simd, per_deviation), of_point);
            }
            Closing::PerPixel => of_point = splat(simd, f32::INFINITY),
            Closing::Centers { .. } | Closing::Sheets(_) => {}
        }
        (of_point.simd_le(share), exact)
    }
}

impl<S: Simd> Footprints<S> {
    /// As [`crate::footprint::Footprint::roundness_error`].
    #[inline(always)]
    fn roundness_error(&self, simd: S) -> V<S> {
        let [a, _, c] = self.conic_root;
        let mean = (self.variance[0] + self.variance[1]) * 0.5;
        let half = (self.variance[0] - self.variance[1]) * 0.5;
        let epsilon = half.mul_add(half, self.covariance * self.covariance).sqrt() * reciprocal(simd, mean);
        let inverse_root = a * c * mean;
        epsilon * inverse_root * inverse_root * FRAC_2_PI
    }

    /// As [`crate::footprint::Footprint::round`], of a set.
    #[inline(always)]
    fn round(&mut self, simd: S, point: M<S>) {
        let [a, b, c] = self.conic_root;
        let zero = splat(simd, 0.0);
        let mean = (self.variance[0] + self.variance[1]) * 0.5;
        let root = splat(simd, 1.0) / mean.sqrt();
        let gain = root * root / (a * c);
        self.conic_root = [point.select(root, a), point.select(zero, b), point.select(root, c)];
        self.gain = point.select(gain, self.gain);
        self.unit_integral *= self.gain;
        self.attenuation *= self.gain;
        for axis in 0..2 {
            self.depth_slope[axis] = point.select(zero, self.depth_slope[axis]);
            self.variance[axis] = point.select(mean, self.variance[axis]);
        }
    }
}
