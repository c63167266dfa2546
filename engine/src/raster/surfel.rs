//! Surface records to samples with a plane at the pixels of a block.

use super::offsets::{Exact, HALF_LOG2_E};
use super::outline::{BATCH, BlockMasks, Column, Outlines, sixteen, sixteen_of};
use crate::camera::Projection;
use crate::footprint::{Lens, Record, Rect};
use crate::simd::*;
use crate::tile::{BLOCK_SIDE, HALF_BLOCK, Tile};

/// The steepest slope dz/dx that a surfel's plane is followed along: 88°.
const STEEPEST: f32 = 30.0;

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

    /// d_z, or 1 where rays are parallel.
    #[inline(always)]
    fn zeta<S: Simd>(&self, simd: S, depth: W<S>) -> W<S> {
        if self.is_perspective { depth } else { W::simd_from(simd, 1.0) }
    }
}

/// Surface records of a tile, as many as go together, and what follows from them.
#[repr(C, align(64))]
pub(crate) struct Surfels {
    outlines: Outlines,
    /// n·v over the coverage floor; negative where the front is seen.
    facing: Column,
    /// Change of n·v a pixel, over n·v at the mean; 0 where the surfel is seen edge-on.
    tilt: [Column; 2],
    /// And not divided, for the exact form.
    facing_slope: [Column; 2],
    pub(crate) tolerance: Column,
    pub(crate) index: [u32; BATCH],
    /// Those that each block needs.
    pub(crate) masks: BlockMasks,
}

/// A surface at pixels, seen by one splat.
pub(crate) struct Sample<S: Simd> {
    /// Where the pixel is within the cut-off and behind the near plane.
    pub(crate) inside: mask32x16<S>,
    /// z of the densest point.
    pub(crate) depth: W<S>,
    /// −kr.
    exponent: W<S>,
    /// In the exact form.
    den: Option<W<S>>,
}

/// The depths of samples, from where they are seen to where the surfel's plane passes the pixel.
pub(crate) struct Spans<S: Simd> {
    /// The near end, and 3σ_z before it.
    pub(crate) nearest: W<S>,
    /// The far end.
    pub(crate) farthest: W<S>,
}

impl Surfels {
    pub(crate) const NONE: Self = Self {
        outlines: Outlines::NONE,
        facing: [0.0; BATCH],
        tilt: [[0.0; BATCH]; 2],
        facing_slope: [[0.0; BATCH]; 2],
        tolerance: [0.0; BATCH],
        index: [0; BATCH],
        masks: BlockMasks::NONE,
    };

    /// Takes in up to [`BATCH`] records of a tile, with their rectangles and depth tolerances.
    #[inline(always)]
    pub(crate) fn fill<'a, S: Simd>(
        &mut self,
        simd: S,
        (tile, lens): (Tile, &SurfelLens),
        records: impl Iterator<Item = (u32, &'a Record, f32)> + Clone,
        rects: &[Rect],
    ) {
        self.outlines.begin(records.clone().map(
            #[inline(always)]
            |(_, record, _)| record,
        ));
        self.outlines.end = [lens.cutoff * HALF_LOG2_E; BATCH];
        for (number, (index, record, tolerance)) in records.enumerate().take(BATCH) {
            self.outlines.set(number, record);
            for axis in 0..2 {
                self.facing_slope[axis][number] = record.amplitude_slope[axis];
                let tilt = record.amplitude_slope[axis] / record.amplitude;
                self.tilt[axis][number] = if tilt.is_finite() { tilt } else { 0.0 };
            }
            self.facing[number] = record.amplitude;
            self.tolerance[number] = tolerance;
            self.index[number] = index;
        }
        self.outlines.prepare(simd, tile);
        let index = &self.index;
        self.masks = self.outlines.blocks(simd, tile, u64::MAX, |number| &rects[index[number] as usize]);
    }

    /// Whether a record shows its back in the block with a corner; `None` where it shows both sides.
    #[inline(always)]
    pub(crate) fn faces_away(&self, number: usize, corner: [f32; 2]) -> Option<bool> {
        let facing = self.facing[number];
        if !self.outlines.is_exact(number) {
            return Some(facing > 0.0);
        }
        let at = |axis: usize| {
            let slope = self.facing_slope[axis][number];
            let middle = corner[axis] + HALF_BLOCK - self.outlines.mean[axis][number];
            [slope * middle, slope.abs() * BLOCK_SIDE as f32 / 2.0]
        };
        let [[rise_x, half_x], [rise_y, half_y]] = [at(0), at(1)];
        let (middle, half) = (facing + rise_x + rise_y, half_x + half_y);
        (middle.abs() > half).then_some(middle > 0.0)
    }

    /// A record at pixels.
    #[inline(always)]
    pub(crate) fn sample<S: Simd>(
        &self,
        simd: S,
        number: usize,
        pixels: [W<S>; 2],
        lens: &SurfelLens,
    ) -> Sample<S> {
        let offsets = self.outlines.offsets(simd, number, pixels);
        let plane = self.outlines.plane(number);
        let (exponent, depth, den) = if self.outlines.is_exact(number) {
            let Exact { exponent, depth, den } = Exact::new(simd, &offsets, plane);
            (exponent, depth, Some(den))
        } else {
            (offsets.exponent, offsets.linear(simd, plane.0, plane.1), None)
        };
        let (end, near) = (W::simd_from(simd, -self.outlines.end[number]), W::simd_from(simd, lens.near));
        Sample { inside: exponent.simd_ge(end) & depth.simd_gt(near), depth, exponent, den }
    }

    /// z less 3σ_z. Spans begin there or nearer.
    #[inline(always)]
    pub(crate) fn begins<S: Simd>(&self, simd: S, number: usize, sample: &Sample<S>) -> W<S> {
        let reach = W::simd_from(simd, -3.0 * self.outlines.sigma_z[number]);
        match sample.den {
            Some(den) => inverse_root(simd, den).mul_add(reach, sample.depth),
            None => sample.depth + reach,
        }
    }

    /// n·v over the coverage floor in the exact form.
    #[inline(always)]
    pub(crate) fn exact_facing<S: Simd>(&self, simd: S, number: usize, pixels: [W<S>; 2]) -> W<S> {
        let slope = [self.facing_slope[0][number], self.facing_slope[1][number]];
        self.outlines.offsets(simd, number, pixels).linear(simd, self.facing[number], slope)
    }

    /// Where the plane is. For a surfel that fills the pixel's filter it is where the sample is; a smaller one the
    /// filter sees where it is, and its plane somewhere else.
    #[inline(always)]
    pub(crate) fn spans<S: Simd>(
        &self,
        simd: S,
        (number, sample): (usize, &Sample<S>),
        pixels: [W<S>; 2],
        lens: &SurfelLens,
    ) -> Spans<S> {
        let depth = W::simd_from(simd, self.outlines.depth[number]);
        let zeta = lens.zeta(simd, depth);
        let limit = zeta.abs() * lens.farthest_offset;
        let zero = W::simd_from(simd, 0.0);
        // n·v at the pixel less that at the mean, over that at the pixel; over that at the mean where rays are parallel.
        let change = if sample.den.is_some() {
            let facing = self.exact_facing(simd, number, pixels);
            (facing - self.facing[number]) * reciprocal(simd, facing)
        } else {
            let tilt = [self.tilt[0][number], self.tilt[1][number]];
            let change = self.outlines.offsets(simd, number, pixels).linear(simd, 0.0, tilt);
            if lens.is_perspective { change * reciprocal(simd, change + 1.0) } else { change }
        };
        let offset = change.mul_add(-zeta, depth - sample.depth).max(-limit).min(limit);
        Spans {
            nearest: self.begins(simd, number, sample) + offset.min(zero),
            farthest: sample.depth + offset.max(zero),
        }
    }

    /// Coverage over the cloud's floor; of meaning where a pixel is inside.
    #[inline(always)]
    pub(crate) fn weight<S: Simd>(
        &self,
        simd: S,
        (number, sample): (usize, &Sample<S>),
        pixels: [W<S>; 2],
    ) -> W<S> {
        let peak = match sample.den {
            Some(den) => self.exact_facing(simd, number, pixels).abs() * inverse_root(simd, den),
            None => W::simd_from(simd, self.facing[number].abs()),
        };
        exp2_from(simd, sample.exponent, -self.outlines.end[number]) * peak
    }

    /// For each record of a set, at least, between which depths the spans of samples begin in the block with a corner, less
    /// 3σ_z, and how deep samples are at least.
    #[inline(always)]
    pub(crate) fn bounds<S: Simd>(
        &self,
        simd: S,
        (corner, set): ([f32; 2], u64),
        lens: &SurfelLens,
        [nearest, seen_from, farthest]: [&mut Column; 3],
    ) {
        let infinity = W::simd_from(simd, f32::INFINITY);
        let one = W::simd_from(simd, 1.0);
        for first in (0..BATCH).step_by(16).filter(|first| set >> first & 0xffff != 0) {
            let [x, y] = sixteen_of(simd, &self.outlines.mean, first);
            let middle = [
                W::simd_from(simd, corner[0] + HALF_BLOCK) - x,
                W::simd_from(simd, corner[1] + HALF_BLOCK) - y,
            ];
            let (depth, sigma_z) =
                (sixteen(simd, &self.outlines.depth, first), sixteen(simd, &self.outlines.sigma_z, first));
            let rise = range(sixteen_of(simd, &self.outlines.depth_slope, first), middle);
            let mut seen = [depth + rise[0], depth + rise[1]];
            let mut reach = sigma_z * 3.0;
            let exact = mask32x16::from_bitmask(simd, self.outlines.exact >> first);
            if exact.any_true() {
                // z is d/t but for den, which is at most t²/(1 − (σ₀/d)²ρ) inside the cut-off.
                let per_depth = one / depth;
                let spread = sigma_z * per_depth;
                let share = (one - spread * spread * lens.cutoff).max(W::simd_from(simd, 0.0));
                let inverse_t = inverse(simd, [one - rise[1] * per_depth, one - rise[0] * per_depth]);
                let is_ahead = depth.simd_gt(W::simd_from(simd, 0.0));
                let low = is_ahead.select(depth * share * inverse_t[0], -infinity);
                let high = is_ahead.select(depth * inverse_t[1], infinity);
                seen = [exact.select(low, seen[0]), exact.select(high, seen[1])];
                reach = exact.select(reach * inverse_t[1], reach);
            }
            // Where the plane is.
            let tilt = range(sixteen_of(simd, &self.tilt, first), middle);
            let plane = if lens.is_perspective {
                depth * inverse(simd, [one + tilt[0], one + tilt[1]])[0]
            } else {
                depth - tilt[1]
            };
            let limit = lens.zeta(simd, depth).abs() * lens.farthest_offset;
            let begin = seen[0].min(plane).max(seen[0] - limit) - reach;
            // What f32 can't say, NaN among it, is no bound.
            begin.simd_gt(-infinity).select(begin, -infinity).store_slice(&mut nearest[first..first + 16]);
            seen[0]
                .simd_gt(-infinity)
                .select(seen[0], -infinity)
                .store_slice(&mut seen_from[first..first + 16]);
            seen[1].simd_lt(infinity).select(seen[1], infinity).store_slice(&mut farthest[first..first + 16]);
        }
    }
}

/// The range over a block of what changes with a slope a pixel, `middle` pixels from where it is 0.
#[inline(always)]
fn range<S: Simd>(slope: [W<S>; 2], middle: [W<S>; 2]) -> [W<S>; 2] {
    let middle = slope[0].mul_add(middle[0], slope[1] * middle[1]);
    let half = (slope[0].abs() + slope[1].abs()) * HALF_BLOCK;
    [middle - half, middle + half]
}

/// 1/x of a range; without bounds where it comes near zero.
#[inline(always)]
fn inverse<S: Simd>(simd: S, [low, high]: [W<S>; 2]) -> [W<S>; 2] {
    let (one, infinity) = (W::simd_from(simd, 1.0), W::simd_from(simd, f32::INFINITY));
    let is_positive = low.simd_gt(W::simd_from(simd, 0.05));
    [is_positive.select(one / high, -infinity), is_positive.select(one / low, infinity)]
}
