//! Surfels to samples with a plane at the pixels of a block.

mod batch;
mod sides;

use super::offsets::{Exact, HALF_LOG2_E, Offsets, Plane};
use crate::camera::Projection;
use crate::cloud::Cloud;
use crate::columns::{Kind, LANES};
use crate::footprint::{Lens, Octet, Rect};
use crate::simd::*;

pub(crate) use batch::{Look, Surfels};
pub(crate) use sides::Room;

/// The steepest slope dz/dx that a surfel's plane is followed along: 86°. Steeper ones are followed as far, lest one seen edge-on before two
/// sheets makes one layer of both.
pub(crate) const STEEPEST: f32 = 15.0;

/// The same of a surfel much smaller than the pixel's filter, 45°: of one seen edge-on before all else in a pixel, the plane would make one layer of
/// all that lies far behind. Two sheets so near each other are not told apart there.
const STEEPEST_OF_SMALL: f32 = 1.0;

/// Spans begin as many σ_z before where a surfel is seen, or where its plane is.
pub(crate) const SURFEL_REACH: f64 = 3.0;

/// What surfels share.
#[derive(Clone, Copy)]
pub(crate) struct SurfelLens {
    near: f32,
    cutoff: f32,
    is_perspective: bool,
    /// The plane is followed no further than this, for a ζ of 1.
    farthest_offset: f32,
    /// As much thicker are layers that begin with surfels much smaller than the filter: its σ, for a ζ of 1.
    thickness: f32,
    /// The variance of the filter in squared pixels.
    filter_area: f32,
}

impl SurfelLens {
    pub(crate) fn new(lens: &Lens, near: f32, cutoff: f32) -> Self {
        let thickness = (lens.low_pass / lens.focal.min_element()) as f32;
        let is_perspective = lens.projection == Projection::Perspective;
        let filter_area = lens.low_pass.powi(2) as f32;
        let farthest_offset = STEEPEST * cutoff.sqrt() * thickness;
        Self { near, cutoff, is_perspective, farthest_offset, thickness, filter_area }
    }

    /// −kr where splats end.
    #[inline(always)]
    fn end(&self) -> f32 {
        -self.cutoff * HALF_LOG2_E
    }

    /// The filter's share of the areas of footprints, by the diagonal of √k M, whose product is k over such an area.
    #[inline(always)]
    fn of_filter<S: Simd>(&self, simd: S, a: W<S>, c: W<S>) -> W<S> {
        // Without a filter nothing is, however small a footprint is.
        (a * (self.filter_area / HALF_LOG2_E) * c).min(W::simd_from(simd, 1.0))
    }

    /// How far planes are followed.
    #[inline(always)]
    fn farthest_offset<S: Simd>(&self, simd: S, smallness: W<S>, zeta: W<S>) -> W<S> {
        const LESS: f32 = 1.0 - STEEPEST_OF_SMALL / STEEPEST;
        let follows = smallness.mul_add(W::simd_from(simd, -LESS), W::simd_from(simd, 1.0));
        zeta.abs() * self.farthest_offset * follows
    }

    /// d_z, or 1 where rays are parallel.
    #[inline(always)]
    fn zeta<S: Simd>(&self, simd: S, depth: W<S>) -> W<S> {
        if self.is_perspective { depth } else { W::simd_from(simd, 1.0) }
    }
}

/// The surfels of a picture, whose numbers are those of their octets times eight and on.
#[derive(Clone, Copy)]
pub(crate) struct Surfaces<'a> {
    pub(crate) octets: &'a [Octet],
    pub(crate) own_rects: &'a [[Rect; LANES]],
    pub(crate) clouds: &'a [CloudSurface],
}

/// What the layers of a cloud's surfels ask for.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CloudSurface {
    /// In the world.
    pub(crate) depth_tolerance: f32,
    pub(crate) coverage_floor: f32,
}

impl CloudSurface {
    /// Nothing of volumes.
    pub(crate) fn of(cloud: &Cloud) -> Self {
        match &cloud.columns().kind {
            // A scaled cloud scales its radii; the cube root is exact for uniform scales.
            Kind::Surface(surface) => {
                let scale = cloud.cloud_to_world().matrix3.determinant().abs().cbrt();
                let depth_tolerance = surface.depth_tolerance * scale as f32;
                Self { depth_tolerance, coverage_floor: surface.coverage_floor }
            }
            _ => Self::default(),
        }
    }
}

/// A surfel as the pixels of a tile see it: what each of its samples needs, in one line of the cache.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Surfel {
    /// From the centre of the tile's first pixel.
    mean: [f32; 2],
    /// √k M.
    root: [f32; 3],
    plane: Plane,
    /// n·v over the coverage floor; negative where the front is seen.
    facing: f32,
    pub(crate) normal: [f32; 3],
    /// Wherever it is seen in the tile its span begins at least so far before.
    pub(crate) least_reach: f32,
    flags: u32,
}

/// Its back is seen: that of a plane is the same wherever it is before the eye.
const FACES_AWAY: u32 = 1;

/// It is opaque and has the tile's usual colour.
const IS_PLAIN: u32 = 2;

/// It is in the exact form.
const IS_EXACT: u32 = 4;

const _: () = assert!(size_of::<Surfel>() == 64);

/// How a surfel lies, which only spans ask for.
#[derive(Clone, Copy)]
pub(crate) struct Slant {
    /// The change of n·v a pixel over n·v at the mean; 0 where the surfel is seen edge-on.
    tilt: [f32; 2],
    sigma_z: f32,
    /// How small it is beside the filter, from 0 to 1: the fourth power of that one's share of its footprint.
    smallness: f32,
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
    /// The far end; and a σ of the filter behind it, of surfels much smaller than that.
    pub(crate) farthest: W<S>,
}

impl Surfel {
    const NONE: Self = Self {
        mean: [0.0; 2],
        root: [1.0; 3],
        plane: Plane { depth: 1.0, slope: [0.0; 2], per_depth: 0.0, spread: 0.0 },
        facing: 0.0,
        normal: [0.0; 3],
        least_reach: 0.0,
        flags: IS_PLAIN,
    };

    /// Its numbers in their order.
    #[inline(always)]
    fn set(&mut self, [place, depth, look, rest]: [&[f32; 4]; 4]) {
        self.mean[0] = place[0];
        self.mean[1] = place[1];
        self.root[0] = place[2];
        self.root[1] = place[3];
        self.root[2] = depth[0];
        self.plane.depth = depth[1];
        self.plane.slope[0] = depth[2];
        self.plane.slope[1] = depth[3];
        self.plane.per_depth = look[0];
        self.plane.spread = look[1];
        self.facing = look[2];
        self.normal[0] = look[3];
        self.normal[1] = rest[0];
        self.normal[2] = rest[1];
        self.least_reach = rest[2];
        self.flags = rest[3].to_bits();
    }

    #[inline(always)]
    pub(crate) fn faces_away(&self) -> bool {
        self.flags & FACES_AWAY != 0
    }

    #[inline(always)]
    pub(crate) fn is_plain(&self) -> bool {
        self.flags & IS_PLAIN != 0
    }

    #[inline(always)]
    fn is_exact(&self) -> bool {
        self.flags & IS_EXACT != 0
    }

    #[inline(always)]
    fn offsets<S: Simd>(&self, simd: S, pixels: [W<S>; 2]) -> Offsets<S> {
        Offsets::new(simd, pixels, (self.mean, self.root))
    }

    /// What pixels see of it.
    #[inline(always)]
    pub(crate) fn sample<S: Simd>(&self, simd: S, pixels: [W<S>; 2], lens: &SurfelLens) -> Sample<S> {
        let offsets = self.offsets(simd, pixels);
        let (exponent, depth, per_den) = if self.is_exact() {
            let Exact { exponent, depth, per_den, .. } = Exact::new(simd, &offsets, &self.plane);
            (exponent, depth, Some(per_den))
        } else {
            (offsets.exponent, offsets.linear(simd, self.plane.depth, self.plane.slope), None)
        };
        let (end, near) = (W::simd_from(simd, lens.end()), W::simd_from(simd, lens.near));
        Sample { inside: exponent.simd_ge(end) & depth.simd_gt(near), depth, exponent, per_den }
    }

    /// Where the plane is. For a surfel that fills the pixel's filter it is where the sample is; a smaller one the
    /// filter sees where it is, and its plane somewhere else.
    #[inline(always)]
    pub(crate) fn spans<S: Simd>(
        &self,
        simd: S,
        sample: &Sample<S>,
        (pixels, slant): ([W<S>; 2], Slant),
        lens: &SurfelLens,
    ) -> Spans<S> {
        let depth = W::simd_from(simd, self.plane.depth);
        let zeta = lens.zeta(simd, depth);
        let smallness = W::simd_from(simd, slant.smallness);
        let limit = lens.farthest_offset(simd, smallness, zeta);
        let zero = W::simd_from(simd, 0.0);
        // n·v at the pixel less that at the mean, over that at the pixel; over that at the mean where rays are parallel.
        let change = self.offsets(simd, pixels).linear(simd, 0.0, slant.tilt);
        let change = if lens.is_perspective { change * reciprocal(simd, change + 1.0) } else { change };
        let offset = change.mul_add(-zeta, depth - sample.depth).max(-limit).min(limit);
        let reach = W::simd_from(simd, -(SURFEL_REACH as f32) * slant.sigma_z);
        let begin = match sample.per_den {
            Some(per_den) => per_den.sqrt().mul_add(reach, sample.depth),
            None => sample.depth + reach,
        };
        let end = (zeta.abs() * lens.thickness).mul_add(smallness, sample.depth);
        Spans { nearest: begin + offset.min(zero), farthest: end + offset.max(zero) }
    }

    /// Coverage over the cloud's floor; of meaning where a pixel is inside.
    #[inline(always)]
    pub(crate) fn weight<S: Simd>(&self, simd: S, sample: &Sample<S>) -> W<S> {
        // n·v where it is seen: of all places x on a plane n·x is the same.
        let peak = match sample.per_den {
            Some(per_den) => {
                reciprocal(simd, sample.depth) * per_den.sqrt() * (self.facing * self.plane.depth).abs()
            }
            None => W::simd_from(simd, self.facing.abs()),
        };
        exp2_roughly(simd, sample.exponent) * peak
    }
}
