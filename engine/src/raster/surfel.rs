//! Surface records to samples with a plane at the pixels of a block.

mod batch;

use super::offsets::{Exact, HALF_LOG2_E, Offsets, Plane, ROOT_HALF_LOG2_E};
use crate::camera::Projection;
use crate::footprint::{Form, Lens, Record, Rect, SurfaceSample};
use crate::simd::*;
use crate::tile::Tile;

pub(crate) use batch::Surfels;

/// The steepest slope dz/dx that a surfel's plane is followed along: 86°. Steeper ones are followed as far, lest one seen edge-on before two
/// sheets makes one layer of both.
pub(crate) const STEEPEST: f32 = 15.0;

/// Spans begin as many σ_z before where a surfel is seen, or where its plane is.
pub(crate) const SURFEL_REACH: f64 = 3.0;

/// What surface records share.
#[derive(Clone, Copy)]
pub(crate) struct SurfelLens {
    near: f32,
    cutoff: f32,
    is_perspective: bool,
    /// The plane is followed no further than this, for a ζ of 1.
    farthest_offset: f32,
}

impl SurfelLens {
    pub(crate) fn new(lens: &Lens, near: f32, cutoff: f32) -> Self {
        let filter_reach = cutoff.sqrt() * (lens.low_pass / lens.focal.min_element()) as f32;
        let is_perspective = lens.projection == Projection::Perspective;
        Self { near, cutoff, is_perspective, farthest_offset: STEEPEST * filter_reach }
    }

    /// −kr where splats end.
    #[inline(always)]
    fn end(&self) -> f32 {
        -self.cutoff * HALF_LOG2_E
    }

    /// d_z, or 1 where rays are parallel.
    #[inline(always)]
    fn zeta<S: Simd>(&self, simd: S, depth: W<S>) -> W<S> {
        if self.is_perspective { depth } else { W::simd_from(simd, 1.0) }
    }
}

/// The surface records of a picture.
#[derive(Clone, Copy)]
pub(crate) struct Surfaces<'a> {
    pub(crate) records: &'a [Record],
    pub(crate) rects: &'a [Rect],
    pub(crate) samples: &'a [SurfaceSample],
    /// One a cloud.
    pub(crate) depth_tolerances: &'a [f32],
}

/// A surface record as the pixels of a tile see it. Blocks take few of a batch: what they need of one lies together.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Surfel {
    /// From the centre of the tile's first pixel.
    mean: [f32; 2],
    /// √k M.
    root: [f32; 3],
    plane: Plane,
    sigma_z: f32,
    /// n·v over the coverage floor; negative where the front is seen.
    facing: f32,
    /// Its change a pixel.
    facing_slope: [f32; 2],
    /// And over n·v at the mean; 0 where the surfel is seen edge-on.
    tilt: [f32; 2],
    /// Wherever it is seen in the tile its span begins at least so far before.
    pub(crate) least_reach: f32,
    pub(crate) tolerance: f32,
    pub(crate) index: u32,
    pub(crate) cloud: u32,
    /// How far its colour is from the tile's usual one, and whether it is.
    pub(crate) tint: [f32; 3],
    pub(crate) is_tinted: bool,
    /// Whether its back is seen: that of a plane is the same wherever it is before the eye.
    pub(crate) faces_away: bool,
    is_exact: bool,
    pub(crate) normal: [f32; 3],
    /// 1 − opacity.
    pub(crate) clear: f32,
}

/// A surface at pixels, seen by one splat.
pub(crate) struct Sample<S: Simd> {
    /// Where the pixel is within the cut-off and behind the near plane.
    pub(crate) inside: mask32x16<S>,
    /// z of the densest point.
    pub(crate) depth: W<S>,
    /// −kr.
    exponent: W<S>,
    /// 1/den in the exact form.
    per_den: Option<W<S>>,
}

/// The depths of samples, from where they are seen to where the surfel's plane passes the pixel.
pub(crate) struct Spans<S: Simd> {
    /// The near end, and 3σ_z before it.
    pub(crate) nearest: W<S>,
    /// The far end.
    pub(crate) farthest: W<S>,
}

impl Surfel {
    const NONE: Self = Self {
        mean: [0.0; 2],
        root: [1.0; 3],
        plane: Plane { depth: 1.0, slope: [0.0; 2], per_depth: 1.0, spread: 0.0 },
        sigma_z: 0.0,
        facing: 0.0,
        facing_slope: [0.0; 2],
        tilt: [0.0; 2],
        least_reach: 0.0,
        tolerance: 0.0,
        index: 0,
        cloud: 0,
        tint: [0.0; 3],
        is_tinted: false,
        faces_away: false,
        is_exact: false,
        normal: [0.0; 3],
        clear: 0.0,
    };

    /// A record, its sample, its number among all, and its cloud's depth tolerance, in a tile with a usual colour.
    #[inline(always)]
    fn new(
        (tile, usual): (Tile, [f32; 3]),
        record: &Record,
        sample: &SurfaceSample,
        (index, tolerance): (u32, f32),
    ) -> Self {
        let per_facing = 1.0 / record.amplitude;
        let per_facing = if per_facing.is_finite() { per_facing } else { 0.0 };
        Self {
            mean: [0, 1].each(
                #[inline(always)]
                |axis| record.mean[axis] - (tile.origin[axis] as f32 + 0.5),
            ),
            root: record.conic_root.each(
                #[inline(always)]
                |root| root * ROOT_HALF_LOG2_E,
            ),
            plane: Plane::new(record.depth, record.depth_slope, record.sigma_z),
            sigma_z: record.sigma_z,
            facing: record.amplitude,
            facing_slope: record.amplitude_slope_or_slabs,
            tilt: record.amplitude_slope_or_slabs.each(
                #[inline(always)]
                |slope| slope * per_facing,
            ),
            least_reach: 0.0,
            tolerance,
            index,
            cloud: record.tag.cloud.into(),
            tint: [0, 1, 2].each(
                #[inline(always)]
                |i| record.color[i] - usual[i],
            ),
            is_tinted: record.color != usual,
            faces_away: record.amplitude * record.depth > 0.0,
            is_exact: record.tag.form == Form::Exact,
            normal: sample.normal,
            clear: 1.0 - sample.opacity,
        }
    }

    #[inline(always)]
    fn offsets<S: Simd>(&self, simd: S, pixels: [W<S>; 2]) -> Offsets<S> {
        Offsets::new(simd, pixels, (self.mean, self.root))
    }

    /// What pixels see of it.
    #[inline(always)]
    pub(crate) fn sample<S: Simd>(&self, simd: S, pixels: [W<S>; 2], lens: &SurfelLens) -> Sample<S> {
        let offsets = self.offsets(simd, pixels);
        let (exponent, depth, per_den) = if self.is_exact {
            let Exact { exponent, depth, per_den, .. } = Exact::new(simd, &offsets, &self.plane);
            (exponent, depth, Some(per_den))
        } else {
            (offsets.exponent, offsets.linear(simd, self.plane.depth, self.plane.slope), None)
        };
        let (end, near) = (W::simd_from(simd, lens.end()), W::simd_from(simd, lens.near));
        Sample { inside: exponent.simd_ge(end) & depth.simd_gt(near), depth, exponent, per_den }
    }

    /// z less 3σ_z. Spans begin there or nearer.
    #[inline(always)]
    fn begins<S: Simd>(&self, simd: S, sample: &Sample<S>) -> W<S> {
        let reach = W::simd_from(simd, -(SURFEL_REACH as f32) * self.sigma_z);
        match sample.per_den {
            Some(per_den) => per_den.sqrt().mul_add(reach, sample.depth),
            None => sample.depth + reach,
        }
    }

    /// Where the plane is. For a surfel that fills the pixel's filter it is where the sample is; a smaller one the
    /// filter sees where it is, and its plane somewhere else.
    #[inline(always)]
    pub(crate) fn spans<S: Simd>(
        &self,
        simd: S,
        sample: &Sample<S>,
        pixels: [W<S>; 2],
        lens: &SurfelLens,
    ) -> Spans<S> {
        let depth = W::simd_from(simd, self.plane.depth);
        let zeta = lens.zeta(simd, depth);
        let limit = zeta.abs() * lens.farthest_offset;
        let zero = W::simd_from(simd, 0.0);
        // n·v at the pixel less that at the mean, over that at the pixel; over that at the mean where rays are parallel.
        let change = if sample.per_den.is_some() {
            let facing = self.offsets(simd, pixels).linear(simd, self.facing, self.facing_slope);
            (facing - self.facing) * reciprocal(simd, facing)
        } else {
            let change = self.offsets(simd, pixels).linear(simd, 0.0, self.tilt);
            if lens.is_perspective { change * reciprocal(simd, change + 1.0) } else { change }
        };
        let offset = change.mul_add(-zeta, depth - sample.depth).max(-limit).min(limit);
        Spans {
            nearest: self.begins(simd, sample) + offset.min(zero),
            farthest: sample.depth + offset.max(zero),
        }
    }

    /// Coverage over the cloud's floor; of meaning where a pixel is inside.
    #[inline(always)]
    pub(crate) fn weight<S: Simd>(&self, simd: S, sample: &Sample<S>, lens: &SurfelLens) -> W<S> {
        // n·v where it is seen: of all places x on a plane n·x is the same.
        let peak = match sample.per_den {
            Some(per_den) => {
                reciprocal(simd, sample.depth) * per_den.sqrt() * (self.facing * self.plane.depth).abs()
            }
            None => W::simd_from(simd, self.facing.abs()),
        };
        exp2_from(simd, sample.exponent, lens.end()) * peak
    }
}
