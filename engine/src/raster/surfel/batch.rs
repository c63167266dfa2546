//! Surface records of a tile, many at once: which blocks meet them, and between what depths their samples lie.

use super::{SURFEL_REACH, Surfaces, Surfel, SurfelLens};
use crate::footprint::SurfaceSample;
use crate::raster::offsets::HALF_LOG2_E;
use crate::raster::outline::{BATCH, BlockMasks, Column, Outlines, sixteen, sixteen_of};
use crate::simd::*;
use crate::tile::Tile;

/// Surface records of a tile, as many as go together, and what follows from them.
#[repr(C, align(64))]
pub(crate) struct Surfels {
    outlines: Outlines,
    tilt: [Column; 2],
    /// 1/d_z, and in the exact form how much of d_z is left where den is largest.
    per_depth: Column,
    least_depth: Column,
    /// Of each sixteen, where the first span in the tile begins, at least.
    nearest: [f32; BATCH / 16],
    each: [Surfel; BATCH],
    /// Those that each block needs.
    pub(crate) masks: BlockMasks,
}

/// Records of a set by where their samples may be.
pub(crate) struct Between {
    /// Not behind the nearer depth.
    pub(crate) ahead: u64,
    /// Between the depths.
    pub(crate) within: u64,
    /// What begins behind the farther depth begins no nearer than here.
    pub(crate) next: f32,
}

impl Surfels {
    pub(crate) const NONE: Self = Self {
        outlines: Outlines::NONE,
        tilt: [[0.0; BATCH]; 2],
        per_depth: [1.0; BATCH],
        least_depth: [1.0; BATCH],
        nearest: [f32::NEG_INFINITY; BATCH / 16],
        each: [Surfel::NONE; BATCH],
        masks: BlockMasks::NONE,
    };

    /// Takes in up to [`BATCH`] records of a tile with a usual colour, by their numbers, with their clouds' depth tolerances.
    #[inline(always)]
    pub(crate) fn fill<S: Simd>(
        &mut self,
        simd: S,
        (tile, usual, lens): (Tile, [f32; 3], &SurfelLens),
        numbers: impl Iterator<Item = u32> + Clone,
        surfaces: Surfaces,
    ) {
        self.outlines.begin(numbers.clone().map(
            #[inline(always)]
            |index| &surfaces.records[index as usize],
        ));
        // As records, samples are not in the cache.
        let mut samples = [SurfaceSample::default(); BATCH];
        for (sample, index) in samples.iter_mut().zip(numbers.clone()) {
            *sample = surfaces.samples[index as usize];
        }
        self.outlines.end = [lens.cutoff * HALF_LOG2_E; BATCH];
        for (number, (index, sample)) in numbers.zip(&samples).enumerate() {
            let record = &surfaces.records[index as usize];
            let tolerance = surfaces.depth_tolerances[record.tag.cloud as usize];
            self.outlines.set(number, record);
            let surfel = Surfel::new((tile, usual), record, sample, (index, tolerance));
            for (column, tilt) in self.tilt.iter_mut().zip(surfel.tilt) {
                column[number] = tilt;
            }
            self.each[number] = surfel;
        }
        self.outlines.prepare(simd, tile);
        let half = (tile.side - 1) as f32 / 2.0;
        for first in self.outlines.sixteens() {
            let one = W::simd_from(simd, 1.0);
            let depth = sixteen(simd, &self.outlines.depth, first);
            let per_depth = one / depth;
            // z is d/t but for den, which is at most t²/(1 − (σ₀/d)²ρ) inside the cut-off.
            let spread = sixteen(simd, &self.outlines.sigma_z, first) * per_depth;
            let share = (one - spread * spread * lens.cutoff).max(W::simd_from(simd, 0.0));
            per_depth.store_slice(&mut self.per_depth[first..first + 16]);
            (depth * share).store_slice(&mut self.least_depth[first..first + 16]);
            let exact = mask32x16::from_bitmask(simd, self.outlines.exact >> first);
            let [low, high] = self.rise(simd, first, ([half; 2], half));
            let most = (one - low * per_depth).abs().max((one - high * per_depth).abs());
            // Less by half a thousandth, which is more than roundings.
            let reach = sixteen(simd, &self.outlines.sigma_z, first) * (0.9995 * SURFEL_REACH as f32);
            // 1/√den at least.
            let of_exact = reach * share.sqrt() / most;
            let is_bound = of_exact.simd_lt(W::simd_from(simd, f32::INFINITY));
            let of_exact = is_bound.select(of_exact, W::simd_from(simd, 0.0));
            let reach: [f32; 16] = exact.select(of_exact, reach).into();
            for (surfel, reach) in self.each[first..first + 16].iter_mut().zip(reach) {
                surfel.least_reach = reach;
            }
        }
        let rect = |number: usize| &surfaces.rects[self.each[number].index as usize];
        self.masks = self.outlines.blocks(simd, tile, u64::MAX, rect);
        let used = u64::MAX.checked_shr((BATCH - self.outlines.count()) as u32).unwrap_or(0);
        for first in self.outlines.sixteens() {
            let [begin, _] = self.bounds(simd, first, ([half; 2], half), lens);
            let used = mask32x16::from_bitmask(simd, used >> first);
            let begin = used.select(begin, W::simd_from(simd, f32::INFINITY));
            self.nearest[first / 16] = begin.reduce_min();
        }
    }

    /// Those of a set in the exact form, and the others.
    #[inline(always)]
    pub(crate) fn by_form(&self, set: u64) -> [u64; 2] {
        [set & self.outlines.exact, set & !self.outlines.exact]
    }

    #[inline(always)]
    pub(crate) fn get(&self, number: usize) -> &Surfel {
        &self.each[number % BATCH]
    }

    /// Those of a set that are in sixteens whose spans may begin before a depth; says how near the others come.
    #[inline(always)]
    pub(crate) fn begin_before(&self, mut set: u64, depth: f32, nearest_of_others: &mut f32) -> u64 {
        if depth == f32::INFINITY {
            return set;
        }
        for (sixteen, nearest) in self.nearest.iter().enumerate() {
            let own = 0xffff << (16 * sixteen);
            if *nearest > depth && set & own != 0 {
                if *nearest < *nearest_of_others {
                    *nearest_of_others = *nearest;
                }
                set &= !own;
            }
        }
        set
    }

    /// All of a set; puts down before what depth no span of theirs begins in the tile.
    #[inline(always)]
    pub(crate) fn all_of(&self, set: u64, nearest: &mut Column) -> Between {
        for (nearest, of_sixteen) in nearest.chunks_exact_mut(16).zip(self.nearest) {
            nearest.fill(of_sixteen);
        }
        Between { ahead: 0, within: set, next: f32::INFINITY }
    }

    /// Which of a set may have samples between two depths in the square of pixels around a middle. Puts down before what
    /// depth no span of theirs begins.
    #[inline(always)]
    pub(crate) fn between<S: Simd>(
        &self,
        simd: S,
        (square, set): (([f32; 2], f32), u64),
        (lens, [done, farthest]): (&SurfelLens, [f32; 2]),
        nearest: &mut Column,
    ) -> Between {
        let mut between = Between { ahead: 0, within: 0, next: f32::INFINITY };
        for first in (0..BATCH).step_by(16).filter(|first| set >> first & 0xffff != 0) {
            let [begin, end] = self.bounds(simd, first, square, lens);
            begin.store_slice(&mut nearest[first..first + 16]);
            let own = mask32x16::from_bitmask(simd, set >> first);
            let ahead = own & end.simd_le(W::simd_from(simd, done));
            let behind = own & !ahead & begin.simd_gt(W::simd_from(simd, farthest));
            between.ahead |= ahead.to_bitmask() << first;
            between.within |= (own & !ahead & !behind).to_bitmask() << first;
            if behind.any_true() {
                let begin = behind.select(begin, W::simd_from(simd, f32::INFINITY));
                between.next = between.next.min(begin.reduce_min());
            }
        }
        between
    }

    /// Where a pixel is from the means of sixteen records.
    #[inline(always)]
    fn offsets_of<S: Simd>(&self, simd: S, first: usize, [x, y]: [f32; 2]) -> [W<S>; 2] {
        let mean = sixteen_of(simd, &self.outlines.mean, first);
        [W::simd_from(simd, x) - mean[0], W::simd_from(simd, y) - mean[1]]
    }

    /// How much deeper than at their means sixteen records are in the affine form, in the square of pixels around a middle.
    #[inline(always)]
    fn rise<S: Simd>(&self, simd: S, first: usize, (middle, half): ([f32; 2], f32)) -> [W<S>; 2] {
        let slope = sixteen_of(simd, &self.outlines.depth_slope, first);
        range(slope, self.offsets_of(simd, first, middle), half)
    }

    /// For sixteen records, in the square of pixels around a middle: before what depth no span of a sample begins, and behind
    /// what depth none does.
    #[inline(always)]
    fn bounds<S: Simd>(
        &self,
        simd: S,
        first: usize,
        (middle, half): ([f32; 2], f32),
        lens: &SurfelLens,
    ) -> [W<S>; 2] {
        let infinity = W::simd_from(simd, f32::INFINITY);
        let one = W::simd_from(simd, 1.0);
        let (depth, sigma_z) =
            (sixteen(simd, &self.outlines.depth, first), sixteen(simd, &self.outlines.sigma_z, first));
        let rise = self.rise(simd, first, (middle, half));
        let mut seen = [depth + rise[0], depth + rise[1]];
        let mut reach = sigma_z * SURFEL_REACH as f32;
        let exact = mask32x16::from_bitmask(simd, self.outlines.exact >> first);
        if exact.any_true() {
            let per_depth = sixteen(simd, &self.per_depth, first);
            let least_depth = sixteen(simd, &self.least_depth, first);
            let inverse_t = inverse(simd, [one - rise[1] * per_depth, one - rise[0] * per_depth]);
            let is_ahead = depth.simd_gt(W::simd_from(simd, 0.0)) & inverse_t[0].simd_gt(-infinity);
            let low = is_ahead.select(least_depth * inverse_t[0], -infinity);
            let high = is_ahead.select(depth * inverse_t[1], infinity);
            seen = [exact.select(low, seen[0]), exact.select(high, seen[1])];
            reach = exact.select(reach * inverse_t[1], reach);
        }
        // Where the plane is.
        let middle = self.offsets_of(simd, first, middle);
        let tilt = range(sixteen_of(simd, &self.tilt, first), middle, half);
        let plane = if lens.is_perspective {
            depth * inverse(simd, [one + tilt[0], one + tilt[1]])[0]
        } else {
            depth - tilt[1]
        };
        let limit = lens.zeta(simd, depth).abs() * lens.farthest_offset;
        let begin = seen[0].min(plane).max(seen[0] - limit) - reach;
        // What f32 can't say, NaN among it, is no bound.
        [
            begin.simd_gt(-infinity).select(begin, -infinity),
            seen[1].simd_lt(infinity).select(seen[1], infinity),
        ]
    }
}

/// The range over a square of what changes with a slope a pixel, `middle` pixels from where it is 0.
#[inline(always)]
fn range<S: Simd>(slope: [W<S>; 2], middle: [W<S>; 2], half: f32) -> [W<S>; 2] {
    let middle = slope[0].mul_add(middle[0], slope[1] * middle[1]);
    let half = (slope[0].abs() + slope[1].abs()) * half;
    [middle - half, middle + half]
}

/// 1/x of a range; without bounds where it comes near zero.
#[inline(always)]
fn inverse<S: Simd>(simd: S, [low, high]: [W<S>; 2]) -> [W<S>; 2] {
    let infinity = W::simd_from(simd, f32::INFINITY);
    let is_positive = low.simd_gt(W::simd_from(simd, 0.05));
    [
        is_positive.select(reciprocal(simd, high), -infinity),
        is_positive.select(reciprocal(simd, low), infinity),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::footprint::{Form, Record, Rect, Tag};
    use crate::simd::{Level, dispatch};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        /// Spans begin at least as far before where a surfel is seen as is said without looking at pixels.
        #[test]
        fn spans_begin_no_later_than_their_least_reach(
            mean in prop::array::uniform2(-4.0..8.0f32),
            slopes in prop::array::uniform4(-0.2..0.2f32),
            sigma_z in 0.0..0.2f32,
            facing in prop_oneof![-1.0..-0.05f32, 0.05..1.0f32],
            form in prop_oneof![Just(Form::Affine), Just(Form::Exact)],
            is_perspective in any::<bool>(),
        ) {
            let [x, y, across, down] = slopes;
            let record = Record {
                mean,
                conic_root: [0.8, 0.1, 0.6],
                depth: 3.0,
                depth_slope: [x, y],
                sigma_z,
                amplitude: facing,
                amplitude_slope_or_slabs: [across * facing, down * facing],
                tag: Tag { form, ..Record::BLANK.tag },
                ..Record::BLANK
            };
            let lens = SurfelLens { near: 0.1, cutoff: 12.25, is_perspective, farthest_offset: 0.5 };
            let tile = Tile::new([0, 0], 8, [8, 8]);
            let rects = [Rect { min: [0; 2], max: [8; 2] }];
            let (records, samples) = ([record], [SurfaceSample::default()]);
            let surfaces = Surfaces { records: &records, rects: &rects, samples: &samples, depth_tolerances: &[0.0] };
            for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
                let [depth, nearest, reach]: [[f32; 16]; 3] = dispatch!(level, simd => {
                    let mut surfels = Surfels::NONE;
                    surfels.fill(simd, (tile, [0.0; 3], &lens), [0].into_iter(), surfaces);
                    let surfel = surfels.get(0);
                    let pixels = crate::tile::pixels(simd, [0.0; 2]);
                    let sample = surfel.sample(simd, pixels, &lens);
                    let inside = sample.inside;
                    let nearest = surfel.spans(simd, &sample, pixels, &lens).nearest;
                    let zero = W::simd_from(simd, 0.0);
                    // Beside the splat nothing is asked.
                    let beside = zero - surfel.least_reach;
                    [inside.select(sample.depth, zero).into(), inside.select(nearest, beside).into(), [surfel.least_reach; 16]]
                });
                for ((depth, nearest), reach) in depth.into_iter().zip(nearest).zip(reach) {
                    // Two roundings of numbers of this size.
                    let rounding = 2.0 * f32::EPSILON * (depth.abs() + nearest.abs());
                    prop_assert!(depth - nearest >= reach - rounding, "{level:?}: {depth}, {nearest}, {reach}");
                }
            }
        }
    }
}
