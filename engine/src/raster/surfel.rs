//! Surface records to samples with a plane at the pixels of a block.

use super::offsets::{ExactBlock, HALF_LOG2_E, ROOT_HALF_LOG2_E};
use super::outline::{BATCH, BlockMasks, Column, Outlines, add_rect};
use crate::camera::Projection;
use crate::footprint::{Form, Lens, Record, Rect};
use crate::simd::*;
use crate::tile::{BLOCK_SIDE, Block, MAX_BLOCKS, Tile};

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
    depth: Column,
    depth_slope: [Column; 2],
    sigma_z: Column,
    /// n·v over the coverage floor; negative where the front is seen.
    facing: Column,
    /// Change of n·v a pixel, over n·v at the mean; 0 where the surfel is seen edge-on.
    tilt: [Column; 2],
    /// And not divided, for the exact form.
    facing_slope: [Column; 2],
    pub(crate) tolerance: Column,
    pub(crate) index: [u32; BATCH],
    /// Those in the exact form.
    exact: u64,
    /// Those that each block needs.
    pub(crate) masks: BlockMasks,
}

/// Surfaces at the pixels of a block, seen by one splat.
pub(crate) struct Sample<S: Simd> {
    /// Where the pixel is within the cut-off and behind the near plane.
    pub(crate) inside: [mask32x16<S>; 4],
    /// z of the densest point.
    pub(crate) depth: Block<S>,
    /// −kr.
    exponent: Block<S>,
    /// 1/√den.
    scale: Option<Block<S>>,
}

/// The depths of samples, from where they are seen to where the surfel's plane passes the pixel.
pub(crate) struct Spans<S: Simd> {
    /// The near end, and 3σ_z before it.
    pub(crate) nearest: Block<S>,
    /// The far end.
    pub(crate) farthest: Block<S>,
}

impl Surfels {
    pub(crate) const NONE: Self = Self {
        outlines: Outlines::NONE,
        depth: [1.0; BATCH],
        depth_slope: [[0.0; BATCH]; 2],
        sigma_z: [0.0; BATCH],
        facing: [0.0; BATCH],
        tilt: [[0.0; BATCH]; 2],
        facing_slope: [[0.0; BATCH]; 2],
        tolerance: [0.0; BATCH],
        index: [0; BATCH],
        exact: 0,
        masks: [0; MAX_BLOCKS],
    };

    /// Takes in up to [`BATCH`] records of a tile, with their rectangles and depth tolerances.
    #[inline(always)]
    pub(crate) fn fill<'a, S: Simd>(
        &mut self,
        simd: S,
        (tile, lens): (Tile, &SurfelLens),
        records: impl Iterator<Item = (u32, &'a Record, f32)>,
        rects: &[Rect],
    ) {
        let origin = tile.origin.each(
            #[inline(always)]
            |pixel| pixel as f32 + 0.5,
        );
        self.exact = 0;
        self.outlines.end = [lens.cutoff * HALF_LOG2_E; BATCH];
        let mut count = 0;
        for (number, (index, record, tolerance)) in records.enumerate().take(BATCH) {
            for axis in 0..2 {
                self.outlines.mean[axis][number] = record.mean[axis] - origin[axis];
                self.depth_slope[axis][number] = record.depth_slope[axis];
                self.facing_slope[axis][number] = record.amplitude_slope[axis];
                let tilt = record.amplitude_slope[axis] / record.amplitude;
                self.tilt[axis][number] = if tilt.is_finite() { tilt } else { 0.0 };
            }
            for (column, root) in self.outlines.root.iter_mut().zip(record.conic_root) {
                column[number] = root * ROOT_HALF_LOG2_E;
            }
            self.depth[number] = record.depth;
            self.sigma_z[number] = record.sigma_z;
            self.facing[number] = record.amplitude;
            self.tolerance[number] = tolerance;
            self.index[number] = index;
            self.exact |= u64::from(record.tag.form == Form::Exact) << number;
            count = number + 1;
        }
        self.masks = self.outlines.meet(simd, tile, count);
        let listed = u64::MAX.checked_shr((BATCH - count) as u32).unwrap_or(0);
        for mask in &mut self.masks {
            *mask &= listed & !self.exact;
        }
        for number in (0..count).filter(|number| self.exact >> number & 1 != 0) {
            add_rect(&mut self.masks, number, &rects[self.index[number] as usize], tile);
        }
    }

    /// Whether a record is in the exact form.
    #[inline(always)]
    pub(crate) fn is_exact(&self, number: usize) -> bool {
        self.exact >> number & 1 != 0
    }

    /// Whether its centre shows the back.
    #[inline(always)]
    pub(crate) fn faces_away(&self, number: usize) -> bool {
        self.facing[number] > 0.0
    }

    /// A record at a block's pixels.
    #[inline(always)]
    pub(crate) fn sample<S: Simd>(
        &self,
        simd: S,
        number: usize,
        pixels: [W<S>; 2],
        lens: &SurfelLens,
    ) -> Sample<S> {
        let offsets = self.outlines.offsets(simd, number, pixels);
        let slope = [self.depth_slope[0][number], self.depth_slope[1][number]];
        let (exponent, depth, scale) = if self.is_exact(number) {
            let plane = (self.depth[number], slope, self.sigma_z[number]);
            let ExactBlock { exponent, depth, scale } = ExactBlock::new(simd, &offsets, plane);
            (exponent, depth, Some(scale))
        } else {
            let exponent = [0, 1, 2, 3].each(
                #[inline(always)]
                |i| offsets.exponent(i),
            );
            (exponent, offsets.linear(simd, self.depth[number], slope), None)
        };
        let (end, near) = (W::simd_from(simd, -self.outlines.end[number]), W::simd_from(simd, lens.near));
        let mut inside = [0, 1, 2, 3].each(
            #[inline(always)]
            |i| exponent[i].simd_ge(end) & depth[i].simd_gt(near),
        );
        if scale.is_some() {
            // Seen exactly edge-on a plane covers nothing.
            for (inside, facing) in inside.iter_mut().zip(self.exact_facing(simd, number, pixels)) {
                *inside &= facing.simd_ne(W::simd_from(simd, 0.0));
            }
        }
        Sample { inside, depth, exponent, scale }
    }

    /// n·v over the coverage floor in the exact form.
    #[inline(always)]
    pub(crate) fn exact_facing<S: Simd>(&self, simd: S, number: usize, pixels: [W<S>; 2]) -> Block<S> {
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
        let depth = W::simd_from(simd, self.depth[number]);
        let zeta = lens.zeta(simd, depth);
        let limit = zeta.abs() * lens.farthest_offset;
        let zero = W::simd_from(simd, 0.0);
        // n·v at the pixel less that at the mean, over that at the pixel; over that at the mean where rays are parallel.
        let changes = match sample.scale {
            Some(_) => self.exact_facing(simd, number, pixels).each(
                #[inline(always)]
                |facing| (facing - self.facing[number]) / facing,
            ),
            None => {
                let tilt = [self.tilt[0][number], self.tilt[1][number]];
                let changes = self.outlines.offsets(simd, number, pixels).linear(simd, 0.0, tilt);
                if lens.is_perspective {
                    changes.each(
                        #[inline(always)]
                        |change| change * reciprocal(simd, change + 1.0),
                    )
                } else {
                    changes
                }
            }
        };
        let mut spans = Spans { nearest: sample.depth, farthest: sample.depth };
        for i in 0..4 {
            let offset = changes[i].mul_add(-zeta, depth - sample.depth[i]).max(-limit).min(limit);
            let sigma_z = match &sample.scale {
                Some(scale) => scale[i] * self.sigma_z[number],
                None => W::simd_from(simd, self.sigma_z[number]),
            };
            spans.nearest[i] = sigma_z.mul_add(W::simd_from(simd, -3.0), sample.depth[i] + offset.min(zero));
            spans.farthest[i] = sample.depth[i] + offset.max(zero);
        }
        spans
    }

    /// Coverage over the cloud's floor, where a pixel is inside.
    #[inline(always)]
    pub(crate) fn weights<S: Simd>(
        &self,
        simd: S,
        (number, sample): (usize, &Sample<S>),
        pixels: [W<S>; 2],
    ) -> Block<S> {
        let peaks = match &sample.scale {
            Some(scale) => {
                let mut peaks = self.exact_facing(simd, number, pixels);
                for (peak, scale) in peaks.iter_mut().zip(scale) {
                    *peak = peak.abs() * *scale;
                }
                peaks
            }
            None => [W::simd_from(simd, self.facing[number].abs()); 4],
        };
        [0, 1, 2, 3].each(
            #[inline(always)]
            |i| {
                let weight = exp2_within(simd, sample.exponent[i]) * peaks[i];
                sample.inside[i].select(weight, W::simd_from(simd, 0.0))
            },
        )
    }

    /// Between which depths the spans of samples begin in the block with a corner, less 3σ_z, for each record of the
    /// batch.
    #[inline(always)]
    pub(crate) fn bounds<S: Simd>(
        &self,
        simd: S,
        corner: [f32; 2],
        lens: &SurfelLens,
        [nearest, farthest]: [&mut Column; 2],
    ) {
        let zero = W::simd_from(simd, 0.0);
        let infinity = W::simd_from(simd, f32::INFINITY);
        const HALF: f32 = (BLOCK_SIDE - 1) as f32 / 2.0;
        for first in (0..BATCH).step_by(16) {
            let read = |column: &Column| W::from_slice(simd, &column[first..first + 16]);
            let x = -(read(&self.outlines.mean[0]) - (corner[0] + HALF));
            let y = -(read(&self.outlines.mean[1]) - (corner[1] + HALF));
            let depth = read(&self.depth);
            let zeta = lens.zeta(simd, depth);
            let slope = [read(&self.depth_slope[0]), read(&self.depth_slope[1])];
            let tilt = [read(&self.tilt[0]), read(&self.tilt[1])];
            let middle = |slope: [W<S>; 2]| slope[0].mul_add(x, slope[1] * y);
            let range = |slope: [W<S>; 2]| (slope[0].abs() + slope[1].abs()) * HALF;
            // To first order the plane rises by −ζ t, t the change of n·v; the rest is at most ζ t²/(1 − |t|).
            let offset_slope = [-zeta * tilt[0] - slope[0], -zeta * tilt[1] - slope[1]];
            let most = middle(tilt).abs() + range(tilt);
            let rest = most.simd_lt(W::simd_from(simd, 0.5)).select(zeta.abs() * most * most * 2.0, infinity);
            let offset = (middle(offset_slope) - range(offset_slope) - rest)
                .min(zero)
                .max(zeta.abs() * -lens.farthest_offset);
            let seen = read(&self.sigma_z).mul_add(W::simd_from(simd, -3.0), depth + middle(slope));
            let range = range(slope);
            let exact = mask32x16::from_bitmask(simd, self.exact >> first);
            exact.select(-infinity, seen - range + offset).store_slice(&mut nearest[first..first + 16]);
            exact.select(infinity, seen + range).store_slice(&mut farthest[first..first + 16]);
        }
    }
}

/// 1/x within 2e-7 of itself.
#[inline(always)]
fn reciprocal<S: Simd>(simd: S, x: W<S>) -> W<S> {
    // The hardware's guess has eight correct bits at least; each step doubles them.
    let two = W::simd_from(simd, 2.0);
    let mut guess = x.approximate_recip();
    for _ in 0..2 {
        guess *= (-x).mul_add(guess, two);
    }
    guess
}
