//! Surfels to samples with a plane at the pixels of a block.

mod batch;
mod sides;

use super::offsets::{HALF_LOG2_E, divisible};
use crate::camera::Projection;
use crate::cloud::Cloud;
use crate::columns::{Kind, LANES};
use crate::footprint::{Lens, Octet, Rect};
use crate::simd::*;
use bytemuck::{Pod, Zeroable};

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
        let thickness = (lens.filter_sigma / lens.focal.min_element()) as f32;
        let is_perspective = lens.projection == Projection::Perspective;
        let filter_area = lens.filter_sigma.powi(2) as f32;
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
    /// Whether neighbours face the same way in all of the clouds that are surfaces.
    pub(crate) all_have_sides: bool,
}

/// What the layers of a cloud's surfels ask for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct CloudSurface {
    /// In the world.
    pub(crate) depth_tolerance: f32,
    pub(crate) coverage_floor: f32,
    /// Whether neighbours face the same way.
    pub(crate) has_sides: bool,
}

impl CloudSurface {
    /// Nothing of volumes.
    pub(crate) fn of(cloud: &Cloud) -> Self {
        match &cloud.columns().kind {
            // A scaled cloud scales its radii; the cube root is exact for uniform scales.
            Kind::Surface(surface) => {
                let scale = cloud.cloud_to_world().matrix3.determinant().abs().cbrt();
                let depth_tolerance = surface.depth_tolerance * scale as f32;
                Self {
                    depth_tolerance,
                    coverage_floor: surface.coverage_floor,
                    has_sides: surface.closed.has_sides(),
                }
            }
            _ => Self::default(),
        }
    }
}

/// A surfel as the pixels of a tile see it: what each of its samples needs, in one line of the cache.
///
/// All that is linear in a pixel's place is kept as a value at the centre of the tile's first pixel and the changes along a row and a column.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
pub(crate) struct Surfel {
    /// The first number of √k Mu, and the second, which doesn't change along rows.
    along: [f32; 3],
    across: [f32; 2],
    /// z of the densest point; t in the exact form.
    line: [f32; 3],
    /// d_z and (κσ₀)²/k in the exact form.
    center_depth: f32,
    spread: f32,
    /// n·v over the coverage floor; negative where the front is seen.
    facing: f32,
    pub(crate) normal: [f32; 3],
    /// Wherever it is seen in the tile its span begins at least so far before.
    pub(crate) least_reach: f32,
    /// Those below, and the number of its cloud from [`CLOUD`] on.
    flags: u32,
}

/// Its back is seen: that of a plane is the same wherever it is before the eye.
const FACES_AWAY: u32 = 1;

/// It is opaque and has the tile's usual colour.
const IS_PLAIN: u32 = 2;

/// It is in the exact form.
const IS_EXACT: u32 = 4;

/// The first bit of its cloud's number.
const CLOUD: u32 = 8;

/// How a surfel lies, which only spans ask for.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(32))]
pub(crate) struct Slant {
    /// n·v over that at the mean, which is linear in a pixel's place; where rays are parallel z of the plane.
    plane: [f32; 3],
    center_depth: f32,
    sigma_z: f32,
    /// How far the plane is followed, and how much thicker layers are that begin with it.
    farthest_offset: f32,
    thickness: f32,
    /// Its number among all.
    pub(crate) index: u32,
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

/// A function that is linear in a pixel's place.
#[inline(always)]
fn linear<S: Simd>(simd: S, [x, y]: [W<S>; 2], [at_first, along, down]: &[f32; 3]) -> W<S> {
    let down = y.mul_add(W::simd_from(simd, *down), W::simd_from(simd, *at_first));
    x.mul_add(W::simd_from(simd, *along), down)
}

impl Surfel {
    const NONE: Self = Self {
        along: [0.0; 3],
        across: [0.0; 2],
        line: [1.0, 0.0, 0.0],
        center_depth: 1.0,
        spread: 0.0,
        facing: 0.0,
        normal: [0.0; 3],
        least_reach: 0.0,
        flags: IS_PLAIN,
    };

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

    /// Its cloud's number.
    #[inline(always)]
    pub(crate) fn cloud(&self) -> u32 {
        self.flags >> CLOUD
    }

    /// What pixels see of it.
    #[inline(always)]
    pub(crate) fn sample<S: Simd>(&self, simd: S, pixels: [W<S>; 2], lens: &SurfelLens) -> Sample<S> {
        let along = linear(simd, pixels, &self.along);
        let [at_first, down] = self.across;
        let across = pixels[1].mul_add(W::simd_from(simd, down), W::simd_from(simd, at_first));
        let exponent = (-along).mul_sub(along, across * across);
        let line = linear(simd, pixels, &self.line);
        let (exponent, depth, per_den) = if self.is_exact() {
            // As in [`Exact`].
            let den = (-exponent).mul_add(W::simd_from(simd, self.spread), line * line);
            let per_den = reciprocal(simd, divisible(simd, den));
            (exponent * per_den, line * self.center_depth * per_den, Some(per_den))
        } else {
            (exponent, line, None)
        };
        let (end, near) = (W::simd_from(simd, lens.end()), W::simd_from(simd, lens.near));
        Sample { inside: exponent.simd_ge(end) & depth.simd_gt(near), depth, exponent, per_den }
    }

    /// Coverage over the cloud's floor; of meaning where a pixel is inside.
    #[inline(always)]
    pub(crate) fn weight<S: Simd>(&self, simd: S, sample: &Sample<S>) -> W<S> {
        // n·v where it is seen: of all places x on a plane n·x is the same.
        let peak = match sample.per_den {
            Some(per_den) => {
                reciprocal(simd, sample.depth) * per_den.sqrt() * (self.facing * self.center_depth).abs()
            }
            None => W::simd_from(simd, self.facing.abs()),
        };
        exp2_roughly(simd, sample.exponent) * peak
    }
}

impl Slant {
    const NONE: Self = Self {
        plane: [1.0, 0.0, 0.0],
        center_depth: 1.0,
        sigma_z: 0.0,
        farthest_offset: 0.0,
        thickness: 0.0,
        index: 0,
    };

    /// Where the span of a sample ends, seen at a depth. For a surfel that fills the pixel's filter the plane is where the sample is; a smaller one the
    /// filter sees where it is, and its plane somewhere else.
    #[inline(always)]
    pub(crate) fn farthest<S: Simd>(
        &self,
        simd: S,
        pixels: [W<S>; 2],
        (depth, lens): (W<S>, &SurfelLens),
    ) -> W<S> {
        let offset = self.offset(simd, pixels, (depth, lens));
        depth + self.thickness + offset.max(W::simd_from(simd, 0.0))
    }

    /// Where it begins.
    #[inline(always)]
    pub(crate) fn nearest<S: Simd>(
        &self,
        simd: S,
        pixels: [W<S>; 2],
        (sample, lens): (&Sample<S>, &SurfelLens),
    ) -> W<S> {
        let offset = self.offset(simd, pixels, (sample.depth, lens)).min(W::simd_from(simd, 0.0));
        let reach = W::simd_from(simd, -(SURFEL_REACH as f32) * self.sigma_z);
        let begin = match sample.per_den {
            Some(per_den) => per_den.sqrt().mul_add(reach, sample.depth),
            None => sample.depth + reach,
        };
        begin + offset
    }

    /// Where the plane of a sample at a depth passes the pixel, as far as it is followed.
    #[inline(always)]
    pub(crate) fn plane<S: Simd>(
        &self,
        simd: S,
        pixels: [W<S>; 2],
        (depth, lens): (W<S>, &SurfelLens),
    ) -> W<S> {
        depth + self.offset(simd, pixels, (depth, lens))
    }

    /// How far behind a sample the plane passes the pixel, as far as it is followed.
    #[inline(always)]
    fn offset<S: Simd>(&self, simd: S, pixels: [W<S>; 2], (depth, lens): (W<S>, &SurfelLens)) -> W<S> {
        let plane = linear(simd, pixels, &self.plane);
        // Of all places x on a plane n·x is the same.
        let plane = if lens.is_perspective { reciprocal(simd, plane) * self.center_depth } else { plane };
        let limit = W::simd_from(simd, self.farthest_offset);
        (plane - depth).max(-limit).min(limit)
    }
}
