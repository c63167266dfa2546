//! How surfels face the viewer, how near that lets their layers begin, and where they are seen.

use super::bounds::Sight;
use super::looked::Looked;
use super::sheet::{Shown, sampled};
use crate::cloud::Cloud;
use crate::columns::{Columns, Factors, LANES};
use crate::cull::VisibleRange;
use crate::footprint::Rect;
use crate::levels;
use crate::raster::SURFEL_REACH;
use crate::simd::*;
use glam::{DMat3, Mat3, Vec3};

/// What rounding may do to a cosine.
const ROUNDING: f32 = 1e-4;

/// A cloud's surfels in camera space.
pub(super) struct Facing<'a> {
    sight: &'a Sight,
    levels: &'a [levels::Level],
    columns: &'a Columns,
    /// Turns places, and e₁ × e₂ into normals in camera space that are as long as areas grow.
    to_camera: Mat3,
    cofactors: Mat3,
    is_closed: bool,
}

impl<'a> Facing<'a> {
    pub(super) fn new(sight: &'a Sight, cloud: &'a Cloud, range: &VisibleRange) -> Self {
        let to_camera = sight.world_to_camera * cloud.cloud_to_world();
        let linear = to_camera.matrix3;
        let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
        let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * linear.determinant().signum();
        Self {
            sight,
            levels: cloud.levels(),
            columns: &cloud.levels()[range.level].columns,
            to_camera: linear.as_mat3(),
            cofactors: cofactors.as_mat3(),
            is_closed: range.hides_backs,
        }
    }

    /// What the surfels of a block of a range show, those that are drawn and face the viewer.
    pub(super) fn block(
        &self,
        range: &VisibleRange,
        block: usize,
        least_transmittance: f64,
    ) -> [Shown; LANES] {
        let (chosen, numbers) = dispatch!(Level::best(), simd => {
            let numbers = self.block_wide(simd, range, block).map(
                #[inline(always)]
                |numbers| numbers.into()
            );
            (range.chosen(simd, self.levels, block * LANES), numbers)
        });
        let [area, whole, x, y, z]: [[f32; LANES]; 5] = numbers;
        let opacities = self.columns.opacities.as_ref().map(|opacities| &opacities.block(block)[0]);
        std::array::from_fn(|lane| {
            if chosen >> lane & 1 == 0 {
                return Shown::default();
            }
            let opacity = opacities.map_or(1.0, |opacities| opacities[lane]);
            let opaque = if opacity < 1.0 {
                ((-opacity).ln_1p() / least_transmittance.ln() as f32).min(1.0)
            } else {
                1.0
            };
            Shown {
                area: area[lane],
                opaque: area[lane] * opaque,
                whole: whole[lane],
                moment: area[lane] * Vec3::new(x[lane], y[lane], z[lane]),
            }
        })
    }

    /// How many pixels a range covers, as told by few of its surfels.
    pub(super) fn area(&self, range: &VisibleRange, least_transmittance: f64) -> f64 {
        let blocks = sampled(range, 2);
        let share = range.splats.len() as f64 / (LANES * blocks.clone().count()).max(1) as f64;
        let shown = blocks.flat_map(|block| self.block(range, block, least_transmittance));
        let area: f64 = shown.map(|shown| f64::from(shown.opaque)).sum();
        area * share * self.sight.pixels_at(range.center_in_camera)
    }

    /// The areas of a block of surfels along the ray through the middle of their range, as a share of z², their whole ones, and
    /// where they are; of those that face away nothing.
    #[inline(always)]
    fn block_wide<S: Simd>(&self, simd: S, range: &VisibleRange, block: usize) -> [V<S>; 5] {
        let zero = splat(simd, 0.0);
        let ray = splat3(simd, self.sight.ray(range.center_in_camera).as_vec3().to_array());
        let (place, across) = self.surfels(simd, range, block);
        let cofactors = [self.cofactors.row(0), self.cofactors.row(1), self.cofactors.row(2)];
        // How large surfels are is not to matter.
        let across = direction_or_zero(simd, across);
        let mut areas = V::simd_from(simd, self.columns.strengths.block(block, &mut Default::default())[0]);
        // Of merged ones the vector area, which is less than what is seen.
        if let Some(orientations) = &self.columns.orientations {
            let [x, y, z, ..] = *orientations.block(block);
            let mean = [x, y, z].each(
                #[inline(always)]
                |row| V::simd_from(simd, row),
            );
            areas *= dot(mean, mean).sqrt();
        }
        let normal = turn(simd, &cofactors, across);
        let facing = dot(normal, ray);
        let area = facing.abs() * areas;
        let area = if self.is_closed { facing.simd_lt(zero).select(area, zero) } else { area };
        let whole = area.simd_gt(zero).select(dot(normal, normal).sqrt() * areas, zero);
        let [x, y, z] = place;
        [area, whole, x, y, z]
    }

    /// The centres of a block of splats in camera space, and their e₁ × e₂ in the cloud's.
    #[inline(always)]
    fn surfels<S: Simd>(&self, simd: S, range: &VisibleRange, block: usize) -> (V3<S>, V3<S>) {
        let rows = [self.to_camera.row(0), self.to_camera.row(1), self.to_camera.row(2)];
        let origin = range.center_in_camera.as_vec3().to_array();
        let centers = self.columns.centers.block(block);
        let from_middle = [0, 1, 2].each(
            #[inline(always)]
            |i| V::simd_from(simd, centers[i]) - range.center.to_array()[i],
        );
        let turned = turn(simd, &rows, from_middle);
        let place = [0, 1, 2].each(
            #[inline(always)]
            |i| turned[i] + origin[i],
        );
        let [a, b] = match &self.columns.factors {
            Factors::Shared(factor) => {
                [splat3(simd, factor.x_axis.to_array()), splat3(simd, factor.y_axis.to_array())]
            }
            Factors::Each { flat, .. } => {
                let rows = flat.block(block);
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
        (place, cross(a, b))
    }

    /// Whether none of a range's surfels is drawn, since all of them face away.
    pub(super) fn is_turned_away(&self, range: &VisibleRange) -> bool {
        self.is_closed
            && dispatch!(Level::best(), simd => {
                let mut blocks = blocks_of(range);
                blocks.all(
                    #[inline(always)]
                    |block| self.places(simd, range, block).1.simd_eq(splat(simd, f32::INFINITY)).all_true(),
                )
            })
    }

    /// The cells in which a range's surfels take part in layers, as far as can be told from where they are and how they face.
    pub(super) fn cells_that_show(&self, range: &VisibleRange, looked: &Looked) -> Vec<u32> {
        let mut cells = Vec::new();
        dispatch!(Level::best(), simd => self.cells_that_show_wide(simd, range, looked, &mut cells));
        cells.sort_unstable();
        cells.dedup();
        cells
    }

    #[inline(always)]
    fn cells_that_show_wide<S: Simd>(
        &self,
        simd: S,
        range: &VisibleRange,
        looked: &Looked,
        cells: &mut Vec<u32>,
    ) {
        for block in blocks_of(range) {
            let chosen = range.chosen(simd, self.levels, block * LANES);
            let (place, near) = self.places(simd, range, block);
            let pixels = self.pixels(simd, range, place);
            let near: [f32; LANES] = near.into();
            let of_lane = |lane: usize| {
                let pixel = |end: usize, axis: usize| pixels[2 * axis + end][lane] as u16;
                Rect { min: [pixel(0, 0), pixel(0, 1)], max: [pixel(1, 0), pixel(1, 1)] }
            };
            let is_seen = |lane: &usize| chosen >> lane & 1 == 1 && near[*lane] < f32::INFINITY;
            let seen = || (0..LANES).filter(is_seen);
            // Neighbours are most often hidden together.
            let around = seen().map(of_lane).reduce(|a, b| Rect {
                min: [a.min[0].min(b.min[0]), a.min[1].min(b.min[1])],
                max: [a.max[0].max(b.max[0]), a.max[1].max(b.max[1])],
            });
            let nearest = seen().map(|lane| near[lane]).fold(f32::INFINITY, f32::min);
            if around.is_none_or(|rect| looked.hides_surface(&rect, nearest)) {
                continue;
            }
            for lane in seen() {
                cells.extend(looked.cells_that_show(&of_lane(lane), near[lane]).map(|cell| cell as u32));
            }
        }
    }

    /// Between which pixels a block of splats is seen, at most: along x from and to, along y from and to.
    #[inline(always)]
    fn pixels<S: Simd>(&self, simd: S, range: &VisibleRange, place: V3<S>) -> [[f32; LANES]; 4] {
        let Sight { lens, size, .. } = self.sight;
        let reach = (self.sight.root_cutoff * range.filtered(self.sight)) as f32;
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let inner = place[2] - reach;
        let mut ends = [[0.0; LANES]; 4];
        for axis in 0..2 {
            let [focal, principal] = [lens.focal[axis], lens.principal[axis]].map(|length| length as f32);
            let (middle, half) = if self.sight.is_perspective() {
                // With ρ = r/z, a sphere's tangents have slopes within ρ √(1 + s²)/(1 − ρ) of its middle's s; the affine
                // form's ellipse is within that, too.
                let slope = place[axis] / place[2];
                let half = slope.mul_add(slope, one).sqrt() * reach / inner;
                (slope, inner.simd_gt(zero).select(half, splat(simd, f32::INFINITY)))
            } else {
                (place[axis], splat(simd, reach))
            };
            let (middle, half) = (middle * focal + principal, half * focal + 1.0);
            let most = splat(simd, size[axis] as f32);
            let from = (middle - half).max(zero).min(most);
            let to = (middle + half).max(zero).min(most);
            ends[2 * axis] = from.floor().into();
            ends[2 * axis + 1] = to.ceil().into();
        }
        ends
    }

    /// Where the centres of a block of splats are, and the z where the spans of their samples begin, at the nearest; ∞ if they
    /// face away.
    #[inline(always)]
    fn places<S: Simd>(&self, simd: S, range: &VisibleRange, block: usize) -> (V3<S>, V<S>) {
        let is_perspective = self.sight.is_perspective();
        let filtered = range.filtered(self.sight) as f32;
        let reach = self.sight.root_cutoff as f32 * filtered;
        let plane_reach = self.sight.plane_reach as f32;
        let infinity = splat(simd, f32::INFINITY);
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        let cofactors = [self.cofactors.row(0), self.cofactors.row(1), self.cofactors.row(2)];
        let (place, across) = self.surfels(simd, range, block);
        let z = place[2];
        let (ray, zeta) = if is_perspective {
            let inverse = one / z;
            ([place[0] * inverse, place[1] * inverse, one], z)
        } else {
            ([zero, zero, one], one)
        };
        let normal = direction_or_zero(simd, turn(simd, &cofactors, across));
        // A shape that is no disc could face any way.
        let mut facing = dot(normal, ray);
        // Nor is it known of merged ones which way that faces which is seen of them.
        if self.columns.orientations.is_some() {
            facing = zero;
        }
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
        let margin = SURFEL_REACH as f32 * filtered + self.sight.slack(range) as f32;
        (place, is_seen.select(near - margin, infinity))
    }
}

/// The blocks of eight splats of a range.
fn blocks_of(range: &VisibleRange) -> std::ops::Range<usize> {
    range.splats.start / LANES..range.splats.end.div_ceil(LANES)
}

#[inline(always)]
fn turn<S: Simd>(simd: S, rows: &[Vec3; 3], v: V3<S>) -> V3<S> {
    rows.each_ref().each(
        #[inline(always)]
        |row| dot(splat3(simd, row.to_array()), v),
    )
}
