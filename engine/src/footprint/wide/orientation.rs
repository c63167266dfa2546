//! Which side surfels show: of one that stands for others by how their normals are spread, see [`Orientation`].
//!
//! [`Orientation`]: crate::levels::Orientation

use super::WideProjector;
use super::geometry::lanes;
use crate::columns::Lanes;
use crate::levels::{LEAST_WIDTH, Shown};
use crate::simd::*;

/// As [`crate::levels::Orientation::side`], in cloud space.
pub(super) struct Spread<S: Simd> {
    pub(super) area: V3<S>,
    pub(super) kept: V<S>,
    pub(super) shift: V3<S>,
}

impl WideProjector<'_> {
    /// The vector areas of what is seen of a block's surfels, as shares of their areas and in camera space: of those that stand for no others
    /// their unit normals, longer or shorter where the cloud's areas grow unevenly.
    #[inline(always)]
    pub(super) fn areas<S: Simd, const UNEVEN: bool>(
        &self,
        simd: S,
        block: usize,
        [a, b, _]: &[V3<S>; 3],
        spread: Option<&Spread<S>>,
    ) -> V3<S> {
        let in_cloud = match spread {
            Some(spread) => spread.area,
            None if UNEVEN => {
                let [a, b] = self.flat_in_cloud(simd, block);
                direction_or_zero(simd, cross(a, b))
            }
            None => {
                return direction_or_zero(simd, cross(*a, *b)).each(
                    #[inline(always)]
                    |n| n * self.handedness,
                );
            }
        };
        Self::transform(simd, &self.normal_to_camera, in_cloud).each(
            #[inline(always)]
            |n| n * self.per_normal_scale,
        )
    }

    /// Of a block's surfels that stand for others what is seen along unit vectors from the eye.
    #[inline(always)]
    pub(super) fn spread<S: Simd>(&self, simd: S, block: usize, towards: V3<S>) -> Option<Spread<S>> {
        let orientations = self.scalar.columns.orientations.as_ref()?;
        let [x, y, z, xx, xy, xz, yy, yz, zz] = *orientations.block(block);
        let mean = lanes(simd, [x, y, z]);
        let u = self.seen_along(simd, towards).each(
            #[inline(always)]
            |n| -n,
        );
        let by = |row: [Lanes; 3]| dot(lanes(simd, row), u);
        let along = [by([xx, xy, xz]), by([xy, yy, yz]), by([xz, yz, zz])];
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let c = dot(mean, u);
        let w = (dot(u, along) * 3.0).max(zero).sqrt().max(splat(simd, LEAST_WIDTH as f32));
        let inverse_w = one / w;
        let gradient = along.each(
            #[inline(always)]
            |s| s * (inverse_w * 3.0),
        );
        let sign = if self.scalar.shown == Shown::OneSide { c.simd_lt(zero).select(-one, one) } else { one };
        let q = (c * sign * inverse_w).max(-one);
        let h = ((q + 1.0) * 0.5).min(one);
        let between = h * (one - h);
        let [of_mean, of_gradient, kept, moved] = if self.scalar.shown != Shown::Both {
            let within = (splat(simd, 2.0) - q) * (1.0 / 3.0);
            let moved = q.simd_lt(one).select(within, one / (q * 3.0));
            [h, between * sign, sign, moved]
        } else {
            let q = c * inverse_w;
            let within = w * 0.5 * q.mul_add(q, one);
            let inverse_shown = one / q.abs().simd_lt(one).select(within, c.abs());
            let front = h.simd_lt(splat(simd, 0.5)).select(-one, one);
            let moved = w * inverse_shown * (1.0 / 3.0);
            [front * (h * 2.0 - 1.0), front * between * 2.0, c * inverse_shown, moved]
        };
        Some(Spread {
            area: [0, 1, 2].each(
                #[inline(always)]
                |i| of_mean.mul_add(mean[i], of_gradient * gradient[i]),
            ),
            kept,
            shift: gradient.each(
                #[inline(always)]
                |g| g * moved,
            ),
        })
    }
}
