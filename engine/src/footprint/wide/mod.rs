//! Eight splats to records at once.
//!
//! A kernel that reaches the camera plane, or has no area that f32 can hold, is left to [`super::scalar`].

mod blocks;
mod forms;
mod geometry;
mod hidden;
mod looks;
mod orientation;
mod write;

use super::scalar::{LEAST_OPACITY, Projector};
use super::{Places, cutoff_gain};
use crate::camera::Projection;
use crate::columns::{self, Factors, LANES, Lanes};
use crate::cull::VisibleRange;
use crate::simd::*;
pub(super) use blocks::Blocks;
use geometry::Placed;
use glam::{DMat3, Vec3};
use hidden::Hiding;

/// What the splats of a cloud share, in f32.
pub(super) struct WideProjector<'a> {
    scalar: &'a Projector<'a>,
    perspective: bool,
    focal: [f32; 2],
    principal: [f32; 2],
    /// The linear part of cloud to camera, and its cofactors with the sign of its determinant, times a power of two.
    to_camera: Rows,
    normal_to_camera: Rows,
    /// The half-axes of all splats in camera space, where they share them.
    shared_axes: Rows,
    /// −1 where the cloud is mirrored.
    handedness: f32,
    /// What strengths are multiplied by: the volume's or area's scale, and the cut-off's gain.
    strength_scale: f32,
    /// 1 over what strengths have of how areas grow, and over that power.
    per_normal_scale: f32,
    /// Whether each surfel's area grows by another factor, since the cloud is stretched unevenly. Vector areas have it then, not strengths.
    grows_unevenly: bool,
    cutoff: f32,
    low_pass: f32,
    near: f32,
    tolerance: f32,
    least_opacity: f32,
    /// Of the picture's left and right, its top and bottom: a point of camera space is inside where a x + b z + c ≥ 0, or a y + b z + c.
    sides: [[[f32; 3]; 2]; 2],
}

/// The rows of a matrix, each number for every lane: instructions read eight numbers, or one for each of eight lanes
/// after another instruction has made them eight.
type Rows = [[Lanes; 3]; 3];

fn rows(m: DMat3) -> Rows {
    [m.row(0), m.row(1), m.row(2)].map(|row| row.as_vec3().to_array().map(|number| [number; LANES]))
}

/// Whether lengths and angles keep their proportions.
fn is_similarity(m: DMat3) -> bool {
    let product = m.transpose() * m;
    let scale = product.x_axis.x;
    let off = product - DMat3::from_diagonal(glam::DVec3::splat(scale));
    off.to_cols_array().iter().all(|x| x.abs() <= 1e-6 * scale)
}

impl<'a> WideProjector<'a> {
    pub(super) fn new(scalar: &'a Projector<'a>) -> Self {
        let lens = &scalar.view.lens;
        let settings = scalar.view.settings;
        let cutoff = settings.cutoff_of(&scalar.columns.kind);
        let gain = cutoff_gain(cutoff);
        let linear = scalar.cloud_to_camera.matrix3;
        // Squares of normals are within single precision then, and nothing is rounded.
        let largest =
            scalar.normal_to_camera.to_cols_array().into_iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        let unit = largest.clamp(1e-60, 1e60).log2().floor().exp2().recip();
        let grows_unevenly = !is_similarity(linear);
        let area_scale = if grows_unevenly { unit.recip() } else { scalar.determinant.cbrt().powi(2) };
        let strength_scale = match scalar.columns.kind {
            columns::Kind::Extinction => scalar.determinant * gain,
            columns::Kind::Opacity { .. } => 1.0,
            columns::Kind::Surface(_) => area_scale * gain,
        };
        Self {
            scalar,
            perspective: lens.projection == Projection::Perspective,
            focal: lens.focal.as_vec2().to_array(),
            principal: lens.principal.as_vec2().to_array(),
            to_camera: rows(linear),
            normal_to_camera: rows(scalar.normal_to_camera * unit),
            shared_axes: match scalar.columns.factors {
                Factors::Shared(factor) => rows((linear * factor.as_dmat3()).transpose()),
                Factors::Each { .. } => Rows::default(),
            },
            handedness: linear.determinant().signum() as f32,
            strength_scale: strength_scale as f32,
            per_normal_scale: (unit * area_scale.max(f64::MIN_POSITIVE)).recip() as f32,
            grows_unevenly,
            cutoff: cutoff as f32,
            low_pass: lens.filter_sigma.powi(2) as f32,
            near: scalar.view.camera.near() as f32,
            tolerance: settings.tolerance as f32,
            least_opacity: settings.least_opacity().max(LEAST_OPACITY) as f32,
            sides: [0, 1].map(|axis| {
                let sides = &scalar.view.frustum.sides;
                [2 * axis, 2 * axis + 1]
                    .map(|side| [sides[side][axis], sides[side].z, sides[side].w].map(|n| n as f32))
            }),
        }
    }

    /// Projects blocks of a range, with the instructions of a level.
    #[inline(never)]
    pub(super) fn project(&self, level: Level, (range, blocks): (&VisibleRange, &Blocks), out: &mut Places) {
        // Compiled for each.
        match Hiding::new(self, range) {
            Some(hiding) => {
                dispatch!(level, simd => self.project_wide::<_, false>(simd, (range, blocks), Some(&hiding), out));
            }
            None if range.is_surface && self.grows_unevenly => {
                dispatch!(level, simd => self.project_wide::<_, true>(simd, (range, blocks), None, out));
            }
            None => dispatch!(level, simd => self.project_wide::<_, false>(simd, (range, blocks), None, out)),
        }
    }

    #[inline(always)]
    fn project_wide<S: Simd, const UNEVEN: bool>(
        &self,
        simd: S,
        (range, blocks): (&VisibleRange, &Blocks),
        hiding: Option<&Hiding>,
        out: &mut Places,
    ) {
        let from = self.from(range);
        let eye = self.scalar.camera_to_cloud.translation - from[1].as_dvec3();
        let mut ends = [f32::INFINITY, f32::NEG_INFINITY].each(
            #[inline(always)]
            |end| splat(simd, end),
        );
        for first in blocks.each(range) {
            let chosen = range.chosen(simd, self.scalar.levels, first);
            let block = first / LANES;
            let (placed, offset) = self.placed(simd, block, from);
            let towards = [0, 1, 2].each(
                #[inline(always)]
                |i| offset[i] - eye.to_array()[i] as f32,
            );
            let half_axes = self.half_axes(simd, block);
            let spread = self.spread(simd, block, towards);
            let areas = if range.is_surface {
                self.areas::<S, UNEVEN>(simd, block, &half_axes, spread.as_ref())
            } else {
                [splat(simd, 0.0); 3]
            };
            if self.scalar.hides_backs && self.all_face_away(simd, &placed, areas) {
                continue;
            }
            let colors = self.colors(simd, block, &placed, (towards, spread.as_ref()));
            let mut footprints = self.footprints(simd, &placed, half_axes);
            let forms = self.forms(simd, range.is_surface, &placed, &mut footprints);
            let looks = self.looks::<S, UNEVEN>(simd, block, (&placed, &footprints), (colors, areas));
            let seen = (&placed, &footprints, &looks, &forms);
            self.push(simd, (range, first, chosen), seen, (out, &mut ends, hiding));
        }
        out.run.include([ends[0].reduce_min(), ends[1].reduce_max()]);
    }

    /// What places of a range are told from, in camera space and in cloud space: single precision knows differences to a share of themselves. Where the
    /// range is around the eye, or near it, that is the eye, so that splats keep their places however far others lie astray; else its middle.
    fn from(&self, range: &VisibleRange) -> [Vec3; 2] {
        let is_near = self.perspective && range.center_in_camera.length() < 2.0 * range.radius;
        let from = if is_near { self.scalar.camera_to_cloud.translation.as_vec3() } else { range.center };
        let in_camera = self.scalar.cloud_to_camera.transform_point3(from.as_dvec3());
        [in_camera.as_vec3(), from]
    }

    /// A block of a range, and where its splats are in cloud space, from where they are told.
    #[inline(always)]
    fn placed<S: Simd>(&self, simd: S, block: usize, [in_camera, from]: [Vec3; 2]) -> (Placed<S>, V3<S>) {
        let center = self.scalar.columns.centers.block(block);
        let offset = [0, 1, 2].each(
            #[inline(always)]
            |i| V::simd_from(simd, center[i]) - from.to_array()[i],
        );
        (self.place(simd, in_camera, offset), offset)
    }

    /// How far splats of a range reach beyond the picture's sides, in every form: the affine one is as wide as if all of a splat
    /// were as near as its centre, longer by the length of the ray. And what rounding may move them by.
    fn reach(&self, range: &VisibleRange) -> f32 {
        let (center, radius) = (range.center_in_camera, range.radius);
        let farthest = center.length() + radius;
        let longest_ray = if self.perspective { farthest / (center.z - radius).max(0.0) } else { 1.0 };
        ((range.reach - radius) * longest_ray + 1e-5 * farthest) as f32
    }

    /// Whether surfels show their backs, all of a block.
    #[inline(always)]
    fn all_face_away<S: Simd>(&self, simd: S, placed: &Placed<S>, areas: V3<S>) -> bool {
        let zero = splat(simd, 0.0);
        // Behind the eye, where rays are turned round, too.
        let to_center = if self.perspective { placed.center } else { placed.ray };
        dot(areas, to_center).simd_ge(zero).all_true()
    }

    /// Projects some surfels of a block, each by itself.
    fn put_scalar(&self, (first, chosen): (usize, u32), out: &mut Places) {
        for lane in (0..LANES).filter(|lane| chosen >> lane & 1 != 0) {
            if let Some(surfel) = self.scalar.project_splat(first + lane) {
                out.put(lane, &surfel);
            }
        }
        out.bound(self.scalar.view.tile_side);
    }
}
