//! Surfels of a tile, many at once: which blocks meet them, and between what depths their samples lie.

use super::sides::Room;
use super::{SURFEL_REACH, Slant, Surfaces, Surfel, SurfelLens};
use crate::columns::LANES;
use crate::footprint::Part;
use crate::raster::offsets::HALF_LOG2_E;
use crate::raster::outline::{BATCH, BlockMasks, Column, Place, sixteen, sixteen_of};
use crate::simd::*;
use crate::tile::Tile;
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

/// Surfels of a tile, as many as go together, and what follows from them.
///
/// A tile has many of these, and writes all of them before it reads any: what isn't here needn't go through the cache.
#[repr(C, align(64))]
pub(crate) struct Surfels {
    mean: [Column; 2],
    depth: Column,
    depth_slope: [Column; 2],
    sigma_z: Column,
    tilt: [Column; 2],
    /// As in a [`Slant`].
    smallness: Column,
    /// In the exact form 1/d_z, and how much of d_z is left where den is largest.
    per_depth: Column,
    least_depth: Column,
    /// Of each sixteen, where the first span in the tile begins, at least.
    nearest: [f32; BATCH / 16],
    /// Those in the exact form.
    exact: u64,
    each: [Surfel; BATCH],
    /// Of those that aren't plain.
    looks: [Look; BATCH],
    /// Their numbers among all.
    indices: [u32; BATCH],
    /// Those that each block needs.
    pub(crate) masks: BlockMasks,
}

/// What is special about a surfel.
#[derive(Clone, Copy)]
pub(crate) struct Look {
    /// How far its colour is from the tile's usual one.
    pub(crate) tint: [f32; 3],
    /// 1 − opacity.
    pub(crate) clear: f32,
    /// How even the coverage of a single sheet is there, at least: between this and as much above 1 as this is below.
    pub(crate) even: f32,
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
        mean: [[0.0; BATCH]; 2],
        depth: [1.0; BATCH],
        depth_slope: [[0.0; BATCH]; 2],
        sigma_z: [0.0; BATCH],
        tilt: [[0.0; BATCH]; 2],
        smallness: [0.0; BATCH],
        per_depth: [1.0; BATCH],
        least_depth: [1.0; BATCH],
        nearest: [f32::NEG_INFINITY; BATCH / 16],
        exact: 0,
        each: [Surfel::NONE; BATCH],
        looks: [Look { tint: [0.0; 3], clear: 0.0, even: 1.0 }; BATCH],
        indices: [0; BATCH],
        masks: BlockMasks::NONE,
    };

    /// Takes in what a tile with a usual colour needs of the parts in its list, until there may be no room for another; gives how many
    /// parts that are.
    #[inline(always)]
    pub(crate) fn fill<S: Simd>(
        &mut self,
        simd: S,
        (tile, usual, lens): (Tile, [f32; 3], &SurfelLens),
        (list, surfaces): (&[AtomicU32], Surfaces),
        Room { outlines, sides }: &mut Room,
    ) -> usize {
        let (mut count, mut taken) = (0, 0);
        for entry in list {
            if count + LANES > BATCH {
                break;
            }
            let part = Part(entry.load(Relaxed));
            let octet = &surfaces.octets[part.place() as usize];
            // One alone is listed because it touches the tile.
            let one = part.lane();
            let some = match one {
                Some(_) => M::splat(simd, true),
                None => lens.touching(simd, tile, octet),
            };
            taken += 1;
            if !some.any_true() {
                continue;
            }
            let place = Place { first: count, some, one };
            outlines.put(simd, place, octet);
            let floor = surfaces.clouds[octet.cloud as usize].coverage_floor;
            sides.put(simd, place, (part.place(), octet, floor), usual);
            for (tilt, slope) in self.tilt.iter_mut().zip(&octet.amplitude_slope) {
                place.put(simd, tilt, slope);
            }
            count += one.map_or(some.to_bitmask().count_ones() as usize, |_| 1);
        }
        outlines.begin_with(count, sides.exact(count));
        outlines.end = [lens.cutoff * HALF_LOG2_E; BATCH];
        outlines.prepare(simd, tile);
        (self.mean, self.depth, self.depth_slope) = (outlines.mean, outlines.depth, outlines.depth_slope);
        (self.sigma_z, self.exact) = (outlines.sigma_z, outlines.exact);
        self.indices = sides.numbers();
        let half = (tile.side - 1) as f32 / 2.0;
        let (zero, infinity) = (W::simd_from(simd, 0.0), W::simd_from(simd, f32::INFINITY));
        for first in outlines.sixteens() {
            let per_facing = W::simd_from(simd, 1.0) / sixteen(simd, &sides.facing, first);
            let per_facing = per_facing.abs().simd_lt(infinity).select(per_facing, zero);
            for column in &mut self.tilt {
                let tilt = sixteen(simd, column, first) * per_facing;
                tilt.store_slice(&mut column[first..first + 16]);
            }
            let [a, c] = [0, 2].map(|i| sixteen(simd, &outlines.root[i], first));
            let of_filter = lens.of_filter(simd, a, c);
            let squared = of_filter * of_filter;
            (squared * squared).store_slice(&mut self.smallness[first..first + 16]);
            sides.even_out(simd, first, of_filter);
            let reach = self.least_reach(simd, first, half, lens);
            reach.store_slice(&mut sides.least_reach[first..first + 16]);
            let [begin, _] = self.bounds(simd, first, ([half; 2], half), lens);
            let used = mask32x16::from_bitmask(simd, outlines.all() >> first);
            self.nearest[first / 16] = used.select(begin, infinity).reduce_min();
        }
        let rect = |number: usize| {
            let index = self.indices[number] as usize;
            &surfaces.own_rects[index / LANES][index % LANES]
        };
        self.masks = outlines.blocks(simd, tile, u64::MAX, rect);
        for first in (0..count).step_by(LANES) {
            sides.set(simd, (first, outlines), &mut self.each, &mut self.looks);
        }
        taken
    }

    /// How far before where they are seen in the tile the spans of sixteen surfels begin at least, less half a thousandth, which is more
    /// than roundings.
    #[inline(always)]
    fn least_reach<S: Simd>(&mut self, simd: S, first: usize, half: f32, lens: &SurfelLens) -> W<S> {
        let sigma_z = sixteen(simd, &self.sigma_z, first);
        let reach = sigma_z * (0.9995 * SURFEL_REACH as f32);
        if self.exact >> first & 0xffff == 0 {
            return reach;
        }
        let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
        let depth = sixteen(simd, &self.depth, first);
        let per_depth = one / depth;
        // z is d/t but for den, which is at most t²/(1 − (σ₀/d)²ρ) inside the cut-off.
        let spread = sigma_z * per_depth;
        let share = (one - spread * spread * lens.cutoff).max(zero);
        per_depth.store_slice(&mut self.per_depth[first..first + 16]);
        (depth * share).store_slice(&mut self.least_depth[first..first + 16]);
        let [low, high] = self.rise(simd, first, ([half; 2], half));
        let most = (one - low * per_depth).abs().max((one - high * per_depth).abs());
        // 1/√den at least.
        let of_exact = reach * share.sqrt() / most;
        let is_bound = of_exact.simd_lt(W::simd_from(simd, f32::INFINITY));
        let exact = mask32x16::from_bitmask(simd, self.exact >> first);
        exact.select(is_bound.select(of_exact, zero), reach)
    }

    /// Those of a set in the exact form, and the others.
    #[inline(always)]
    pub(crate) fn by_form(&self, set: u64) -> [u64; 2] {
        [set & self.exact, set & !self.exact]
    }

    #[inline(always)]
    pub(crate) fn get(&self, number: usize) -> &Surfel {
        &self.each[number % BATCH]
    }

    /// Of one that isn't plain.
    #[inline(always)]
    pub(crate) fn look(&self, number: usize) -> &Look {
        &self.looks[number % BATCH]
    }

    /// Its number among all.
    #[inline(always)]
    pub(crate) fn index(&self, number: usize) -> u32 {
        self.indices[number % BATCH]
    }

    #[inline(always)]
    pub(crate) fn slant(&self, number: usize) -> Slant {
        let number = number % BATCH;
        let tilt = [self.tilt[0][number], self.tilt[1][number]];
        Slant { tilt, sigma_z: self.sigma_z[number], smallness: self.smallness[number] }
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
        let mean = sixteen_of(simd, &self.mean, first);
        [W::simd_from(simd, x) - mean[0], W::simd_from(simd, y) - mean[1]]
    }

    /// How much deeper than at their means sixteen records are in the affine form, in the square of pixels around a middle.
    #[inline(always)]
    fn rise<S: Simd>(&self, simd: S, first: usize, (middle, half): ([f32; 2], f32)) -> [W<S>; 2] {
        let slope = sixteen_of(simd, &self.depth_slope, first);
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
        let (depth, sigma_z) = (sixteen(simd, &self.depth, first), sixteen(simd, &self.sigma_z, first));
        let rise = self.rise(simd, first, (middle, half));
        let mut seen = [depth + rise[0], depth + rise[1]];
        let mut reach = sigma_z * SURFEL_REACH as f32;
        let exact = mask32x16::from_bitmask(simd, self.exact >> first);
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
        let smallness = sixteen(simd, &self.smallness, first);
        let limit = lens.farthest_offset(simd, smallness, lens.zeta(simd, depth));
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
    use crate::footprint::{Form, Octet, Record, Rect, SurfaceSample, Tag};
    use crate::raster::CloudSurface;
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
            let lens = SurfelLens { near: 0.1, cutoff: 12.25, is_perspective, farthest_offset: 0.5, thickness: 0.01, filter_area: 0.3 };
            let tile = Tile::new([0, 0], 8, [8, 8]);
            let own_rects = [[Rect { min: [0; 2], max: [8; 2] }; LANES]];
            let octets = [Octet::of_one(record, SurfaceSample::default())];
            let surfaces = Surfaces { octets: &octets, own_rects: &own_rects, clouds: &[CloudSurface::default()] };
            for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
                let [depth, nearest, reach]: [[f32; 16]; 3] = dispatch!(level, simd => {
                    let mut surfels = Surfels::NONE;
                    surfels.fill(simd, (tile, [0.0; 3], &lens), (&[AtomicU32::new(0)], surfaces), &mut Room::default());
                    let surfel = surfels.get(0);
                    let pixels = crate::tile::pixels(simd, [0.0; 2]);
                    let sample = surfel.sample(simd, pixels, &lens);
                    let inside = sample.inside;
                    let nearest = surfel.spans(simd, &sample, (pixels, surfels.slant(0)), &lens).nearest;
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
