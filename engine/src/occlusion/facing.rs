//! How surfels face the viewer, and how near that lets their layers begin.

use super::bounds::Sight;
use crate::cloud::Cloud;
use crate::columns::{Columns, Factors, Kind, LANES};
use crate::cull::VisibleRange;
use crate::raster::SURFEL_REACH;
use crate::simd::*;
use glam::{DMat3, DVec3, Mat3, Vec3};

/// What rounding may do to a cosine.
const ROUNDING: f32 = 1e-4;

/// A cloud's surfels in camera space.
pub(super) struct Facing<'a> {
    sight: &'a Sight,
    columns: &'a Columns,
    /// Turns places, and e₁ × e₂ into normals in camera space that are as long as areas grow.
    to_camera: Mat3,
    cofactors: Mat3,
    is_closed: bool,
}

impl<'a> Facing<'a> {
    pub(super) fn new(sight: &'a Sight, cloud: &'a Cloud, range: &VisibleRange) -> Self {
        let linear = (sight.world_to_camera * cloud.cloud_to_world()).matrix3;
        let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
        let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * linear.determinant().signum();
        Self {
            sight,
            columns: &cloud.levels()[range.level].columns,
            to_camera: linear.as_mat3(),
            cofactors: cofactors.as_mat3(),
            is_closed: matches!(cloud.columns().kind, Kind::Surface(surface) if surface.closed),
        }
    }

    /// The area that a block of surfels shows along a ray, as a share of z², times their opacities.
    pub(super) fn area(&self, block: usize, ray: DVec3, opaque: impl Fn(f32) -> f32) -> f64 {
        let areas = self.columns.strengths.block(block)[0];
        let opacities = self.columns.opacities.as_ref().map(|opacities| opacities.block(block)[0]);
        let mut sum = 0.0;
        for (lane, area) in areas.into_iter().enumerate() {
            let factor = self.columns.factor((block * LANES + lane).min(self.columns.len - 1));
            let across = factor.x_axis.cross(factor.y_axis).normalize_or_zero();
            let facing = (self.cofactors * across).dot(ray.as_vec3());
            if facing < 0.0 || !self.is_closed {
                sum += facing.abs() * area * opacities.map_or(1.0, |opacities| opaque(opacities[lane]));
            }
        }
        f64::from(sum)
    }

    /// Where the spans of a range's samples begin, at the nearest, by where its surfels are and how they face; ∞ if all of them
    /// are turned away.
    pub(super) fn nearest(&self, range: &VisibleRange) -> f32 {
        let filtered = ((range.reach - range.radius) / self.sight.root_cutoff) as f32;
        dispatch!(Level::best(), simd => self.nearest_wide(simd, range, filtered))
    }

    #[inline(always)]
    fn nearest_wide<S: Simd>(&self, simd: S, range: &VisibleRange, filtered: f32) -> f32 {
        let is_perspective = self.sight.is_perspective();
        let reach = self.sight.root_cutoff as f32 * filtered;
        let plane_reach = self.sight.plane_reach as f32;
        let infinity = splat(simd, f32::INFINITY);
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let [to_camera, cofactors] = [self.to_camera, self.cofactors].map(|m| [m.row(0), m.row(1), m.row(2)]);
        let origin = range.center_in_camera.as_vec3().to_array();
        let mut nearest = infinity;
        for block in range.splats.start / LANES..range.splats.end.div_ceil(LANES) {
            let centers = self.columns.centers.block(block);
            let from_middle = [0, 1, 2].each(
                #[inline(always)]
                |i| V::simd_from(simd, centers[i]) - range.center.to_array()[i],
            );
            let turned = turn(simd, &to_camera, from_middle);
            let place = [0, 1, 2].each(
                #[inline(always)]
                |i| turned[i] + origin[i],
            );
            let z = place[2];
            let (ray, zeta) = if is_perspective {
                let inverse = one / z;
                ([place[0] * inverse, place[1] * inverse, one], z)
            } else {
                ([zero, zero, one], one)
            };
            let [a, b] = match &self.columns.factors {
                Factors::Shared(factor) => {
                    [splat3(simd, factor.x_axis.to_array()), splat3(simd, factor.y_axis.to_array())]
                }
                Factors::Each(factors) => {
                    let rows = factors.block(block);
                    [0, 3].each(
                        #[inline(always)]
                        |k| {
                            [0, 1, 2].each(
                                #[inline(always)]
                                |i| V::simd_from(simd, rows[k + i]),
                            )
                        },
                    )
                }
            };
            let normal = turn(simd, &cofactors, cross(a, b));
            let length = dot(normal, normal).sqrt();
            // A shape that is no disc could face any way.
            let facing = length.simd_gt(splat(simd, 1e-18)).select(dot(normal, ray) / length, zero);
            // A plane changes by n·δ over n·v at the pixel, and is followed so far only.
            let (own, limit) = if is_perspective {
                let inner = z - reach;
                let own = dot(ray, ray).sqrt() * reach / inner;
                (inner.simd_gt(zero).select(own, infinity), z * plane_reach)
            } else {
                (splat(simd, reach), splat(simd, plane_reach))
            };
            let under = facing.abs() - own - ROUNDING;
            let limit = limit + reach;
            let offset =
                (under.simd_gt(zero) & own.simd_lt(infinity)).select((zeta * own / under).min(limit), limit);
            let near = z - offset.max(splat(simd, reach));
            let is_seen = if self.is_closed { facing.simd_lt(splat(simd, ROUNDING)) } else { z.simd_eq(z) };
            nearest = nearest.min(is_seen.select(near, infinity));
        }
        nearest.reduce_min() - SURFEL_REACH as f32 * filtered - self.sight.slack(range) as f32
    }
}

#[inline(always)]
fn turn<S: Simd>(simd: S, rows: &[Vec3; 3], v: V3<S>) -> V3<S> {
    rows.each_ref().each(
        #[inline(always)]
        |row| dot(splat3(simd, row.to_array()), v),
    )
}
