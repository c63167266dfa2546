//! Surfels of a tile, many at once: which blocks meet them, and between what depths their samples lie.

use super::sides::{Room, Sides};
use super::{SURFEL_REACH, Slant, Surfaces, Surfel, SurfelLens};
use crate::columns::LANES;
use crate::footprint::Part;
use crate::raster::column::{BATCH, Column, Place, sixteen, sixteen_of};
use crate::raster::offsets::HALF_LOG2_E;
use crate::raster::outline::{BlockMasks, Outlines};
use crate::simd::*;
use crate::tile::{HALF_BLOCK, Tile};
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::Relaxed;

/// Surfels of a tile, as many as go together, and what follows from them.
///
/// A tile has many of these, and writes all of them before it reads any: what isn't here needn't go through the cache.
#[repr(C, align(64))]
pub(crate) struct Surfels {
    /// As in a [`Surfel`].
    line: [Column; 3],
    /// How much that changes from a block's middle to its farthest pixel; and how far before where it is seen a span begins at most.
    ranges: [Column; 2],
    /// In the exact form d_z, and how much of it is left where den is largest.
    center_depth: Column,
    least_depth: Column,
    /// Of each sixteen, where the first span in the tile begins, at least.
    nearest: [f32; BATCH / 16],
    /// Those in the exact form.
    exact: u64,
    each: [Surfel; BATCH],
    slants: [Slant; BATCH],
    /// Of those that aren't plain.
    looks: [Look; BATCH],
    /// Those that each block needs.
    pub(crate) masks: BlockMasks,
}

/// What is special about a surfel.
#[derive(Clone, Copy)]
pub(crate) struct Look {
    /// How far its colour is from the tile's usual one, times its opacity.
    pub(crate) tint: [f32; 3],
    pub(crate) opacity: f32,
    /// How even the coverage of a single sheet is there, at least: between this and as much above 1 as this is below.
    pub(crate) even: f32,
}

/// Records of a set by where their samples may be.
pub(crate) struct Between {
    /// Not behind the nearer depth.
    pub(crate) ahead: u64,
    /// Between the depths.
    pub(crate) within: u64,
}

impl Surfels {
    pub(crate) const NONE: Self = Self {
        line: [[1.0; BATCH]; 3],
        ranges: [[0.0; BATCH]; 2],
        center_depth: [1.0; BATCH],
        least_depth: [1.0; BATCH],
        nearest: [f32::NEG_INFINITY; BATCH / 16],
        exact: 0,
        each: [Surfel::NONE; BATCH],
        slants: [Slant::NONE; BATCH],
        looks: [Look { tint: [0.0; 3], opacity: 1.0, even: 1.0 }; BATCH],
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
            count += one.map_or(some.to_bitmask().count_ones() as usize, |_| 1);
        }
        outlines.begin_with(count, sides.exact(count));
        outlines.end = [lens.cutoff * HALF_LOG2_E; BATCH];
        outlines.prepare(simd, tile);
        self.exact = outlines.exact;
        for first in outlines.sixteens() {
            self.make(simd, lens, first, (outlines, sides));
        }
        let rect = |number: usize| {
            let index = sides.number(number) as usize;
            &surfaces.own_rects[index / LANES][index % LANES]
        };
        self.masks = outlines.blocks(simd, tile, u64::MAX, rect);
        for first in (0..count).step_by(LANES) {
            let made = (&mut self.each, &mut self.slants, &mut self.looks);
            sides.set(simd, lens, (first, outlines, &self.line), made);
        }
        taken
    }

    /// Finds what follows from sixteen surfels' numbers.
    #[inline(always)]
    fn make<S: Simd>(
        &mut self,
        simd: S,
        lens: &SurfelLens,
        first: usize,
        (outlines, sides): (&Outlines, &mut Sides),
    ) {
        let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
        let infinity = W::simd_from(simd, f32::INFINITY);
        let mean = sixteen_of(simd, &outlines.mean, first);
        let [a, b, c] = sixteen_of(simd, &outlines.root, first);
        let depth = sixteen(simd, &outlines.depth, first);
        let slope = sixteen_of(simd, &outlines.depth_slope, first);
        // The change of n·v a pixel over n·v at the mean; 0 where the surfel is seen edge-on.
        let per_facing = one / sixteen(simd, &sides.facing, first);
        let per_facing = per_facing.abs().simd_lt(infinity).select(per_facing, zero);
        let tilt = sixteen_of(simd, &sides.tilt, first).each(
            #[inline(always)]
            |tilt| tilt * per_facing,
        );
        let of_filter = lens.of_filter(simd, a, c);
        sides.even_out(simd, first, of_filter);
        // How small it is beside the filter, from 0 to 1.
        let smallness = (of_filter * of_filter) * (of_filter * of_filter);
        let zeta = lens.zeta(simd, depth);
        let farthest_offset = lens.farthest_offset(simd, smallness, zeta);
        let plane = if lens.is_perspective {
            linear(mean, one, tilt)
        } else {
            linear(mean, depth, [-tilt[0], -tilt[1]])
        };

        // How far the plane may be before where the surfel is seen: of both the slopes are known, and all is in the box around its outline.
        let half_sides = outlines.reaches(simd, first);
        let (tilted, rise) = (change(half_sides, tilt), change(half_sides, slope));
        let parted = [zeta.mul_add(tilt[0], slope[0]), zeta.mul_add(tilt[1], slope[1])];
        let mut offset = change(half_sides, parted);
        let mut reach = sixteen(simd, &outlines.sigma_z, first) * SURFEL_REACH as f32;
        let (mut line, mut nearest) = (linear(mean, depth, slope), depth - rise);
        let mut least_reach = reach;
        let exact = mask32x16::from_bitmask(simd, outlines.exact >> first);
        if exact.any_true() {
            // z is d/t but for den, which is at most t²/(1 − (σ₀/d)²ρ) inside the cut-off.
            let spread = sixteen(simd, &outlines.spread, first);
            let share = (one + spread * lens.end()).max(zero);
            let t_slope = sixteen_of(simd, &outlines.t_slope, first);
            let t_change = change(half_sides, t_slope);
            let [least_t, most_t] = [one - t_change, one + t_change];
            let t = linear(mean, one, t_slope);
            let is_bound = depth.simd_gt(zero) & least_t.simd_gt(W::simd_from(simd, LEAST_DIVISOR));
            let of_exact =
                [depth * share / most_t, offset / least_t, reach / least_t, reach * share.sqrt() / most_t];
            let [own_nearest, own_offset, own_reach, own_least_reach] = of_exact;
            for (line, t) in line.iter_mut().zip(t) {
                *line = exact.select(t, *line);
            }
            nearest = exact.select(is_bound.select(own_nearest, -infinity), nearest);
            offset = exact.select(is_bound.select(own_offset, infinity), offset);
            reach = exact.select(is_bound.select(own_reach, infinity), reach);
            least_reach = exact.select(is_bound.select(own_least_reach, zero), least_reach);
            depth.store_slice(&mut self.center_depth[first..first + 16]);
            (depth * share).store_slice(&mut self.least_depth[first..first + 16]);
        }
        if lens.is_perspective {
            // d/(1 + c) is at least d − dc, and of the exact form's d/t as much nearer as 1 + c is less than 1.
            let least = one - tilted;
            let is_bound = least.simd_gt(W::simd_from(simd, LEAST_DIVISOR)) & depth.simd_gt(zero);
            offset = is_bound.select(exact.select(offset / least, offset), infinity);
        }
        let offset = offset.simd_lt(farthest_offset).select(offset, farthest_offset);
        // Roundings are less than a thousandth.
        let before = (offset + reach) * 1.001;
        let nearest = nearest - before;
        let nearest = nearest.simd_gt(-infinity).select(nearest, -infinity);
        let used = mask32x16::from_bitmask(simd, outlines.all() >> first);
        self.nearest[first / 16] = used.select(nearest, infinity).reduce_min();

        store(&mut self.line, first, line);
        let half_block = W::simd_from(simd, HALF_BLOCK);
        store(&mut self.ranges, first, [change([half_block; 2], [line[1], line[2]]), before]);
        store(&mut sides.along, first, [-a.mul_add(mean[0], b * mean[1]), a, b]);
        store(&mut sides.across, first, [-(c * mean[1]), c]);
        store(&mut sides.plane, first, plane);
        let thickness = zeta.abs() * smallness * lens.thickness;
        // Half a thousandth is more than roundings.
        store(&mut sides.reaches, first, [least_reach * 0.9995, farthest_offset, thickness]);
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

    #[inline(always)]
    pub(crate) fn slant(&self, number: usize) -> &Slant {
        &self.slants[number % BATCH]
    }

    /// Those of a set that are in sixteens whose spans may begin before a depth.
    #[inline(always)]
    pub(crate) fn begin_before(&self, set: u64, depth: f32) -> u64 {
        let mut others = 0;
        for (sixteen, nearest) in self.nearest.iter().enumerate() {
            others |= if *nearest > depth { 0xffff << (16 * sixteen) } else { 0 };
        }
        set & !others
    }

    /// All of a set; puts down before what depth no span of theirs begins in the tile.
    #[inline(always)]
    pub(crate) fn all_of(&self, set: u64, nearest: &mut Column) -> Between {
        for (nearest, of_sixteen) in nearest.chunks_exact_mut(16).zip(self.nearest) {
            nearest.fill(of_sixteen);
        }
        Between { ahead: 0, within: set }
    }

    /// Which of a set may have samples between two depths in the block around a middle. Puts down before what depth no span
    /// of theirs begins.
    #[inline(always)]
    pub(crate) fn between<S: Simd>(
        &self,
        simd: S,
        (middle, set): ([f32; 2], u64),
        [done, farthest]: [f32; 2],
        nearest: &mut Column,
    ) -> Between {
        let mut between = Between { ahead: 0, within: 0 };
        for first in (0..BATCH).step_by(16).filter(|first| set >> first & 0xffff != 0) {
            let [begin, end] = self.bounds(simd, first, middle);
            begin.store_slice(&mut nearest[first..first + 16]);
            let own = mask32x16::from_bitmask(simd, set >> first);
            let ahead = own & end.simd_le(W::simd_from(simd, done));
            let behind = own & !ahead & begin.simd_gt(W::simd_from(simd, farthest));
            between.ahead |= ahead.to_bitmask() << first;
            between.within |= (own & !ahead & !behind).to_bitmask() << first;
        }
        between
    }

    /// For sixteen surfels, in the block around a middle: before what depth no span of a sample begins, and behind what depth none is
    /// seen.
    #[inline(always)]
    fn bounds<S: Simd>(&self, simd: S, first: usize, [x, y]: [f32; 2]) -> [W<S>; 2] {
        let infinity = W::simd_from(simd, f32::INFINITY);
        let [at_first, along, down] = sixteen_of(simd, &self.line, first);
        let [most, before] = sixteen_of(simd, &self.ranges, first);
        let middle = along.mul_add(W::simd_from(simd, x), down.mul_add(W::simd_from(simd, y), at_first));
        let mut seen = [middle - most, middle + most];
        if self.exact >> first & 0xffff != 0 {
            let exact = mask32x16::from_bitmask(simd, self.exact >> first);
            let depth = sixteen(simd, &self.center_depth, first);
            let least_depth = sixteen(simd, &self.least_depth, first);
            let is_bound =
                depth.simd_gt(W::simd_from(simd, 0.0)) & seen[0].simd_gt(W::simd_from(simd, LEAST_DIVISOR));
            let low = is_bound.select(least_depth * reciprocal(simd, seen[1]), -infinity);
            let high = is_bound.select(depth * reciprocal(simd, seen[0]), infinity);
            seen = [exact.select(low, seen[0]), exact.select(high, seen[1])];
        }
        let begin = seen[0] - before;
        // What f32 can't say, NaN among it, is no bound.
        [
            begin.simd_gt(-infinity).select(begin, -infinity),
            seen[1].simd_lt(infinity).select(seen[1], infinity),
        ]
    }
}

/// What is less is no bound when it divides.
const LEAST_DIVISOR: f32 = 0.05;

/// A function of a pixel's place by its value at means and its slopes: its value at the first pixel, and the slopes.
#[inline(always)]
fn linear<S: Simd>([x, y]: [W<S>; 2], at_mean: W<S>, [along, down]: [W<S>; 2]) -> [W<S>; 3] {
    [at_mean - along.mul_add(x, down * y), along, down]
}

/// How much a function with these slopes changes, at most, from the middle of a box.
#[inline(always)]
fn change<S: Simd>([right, down]: [W<S>; 2], slopes: [W<S>; 2]) -> W<S> {
    slopes[0].abs().mul_add(right, slopes[1].abs() * down)
}

/// Puts numbers of sixteen surfels in columns.
#[inline(always)]
fn store<S: Simd, const N: usize>(columns: &mut [Column; N], first: usize, numbers: [W<S>; N]) {
    for (column, numbers) in columns.iter_mut().zip(numbers) {
        numbers.store_slice(&mut column[first..first + 16]);
    }
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

        /// Spans begin at least as far before where a surfel is seen as is said without looking at pixels, and no nearer than is said of
        /// blocks and of the tile; nor is a surfel seen farther.
        #[test]
        fn spans_are_where_they_are_said_to_be(
            mean in prop::array::uniform2(-4.0..8.0f32),
            slopes in prop::array::uniform4(-0.2..0.2f32),
            sigma_z in 0.0..0.2f32,
            facing in prop_oneof![-1.0..-0.05f32, 0.05..1.0f32],
            form in prop_oneof![Just(Form::Affine), Just(Form::Exact)],
            is_perspective in any::<bool>(),
        ) {
            // Where rays are parallel nothing is in the exact form.
            let is_perspective = is_perspective || form == Form::Exact;
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
            let surfaces = Surfaces { octets: &octets, own_rects: &own_rects, clouds: &[CloudSurface::default()], all_have_sides: true };
            let mut least_reach = 0.0;
            for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
                let (is_met, sides, [begin, end]): (bool, [[f32; 16]; 2], [f32; 2]) = dispatch!(level, simd => {
                    let mut surfels = Surfels::NONE;
                    surfels.fill(simd, (tile, [0.0; 3], &lens), (&[AtomicU32::new(0)], surfaces), &mut Room::default());
                    let surfel = surfels.get(0);
                    let pixels = crate::tile::pixels(simd, [0.0; 2]);
                    let sample = surfel.sample(simd, pixels, &lens);
                    let nearest = surfels.slant(0).nearest(simd, pixels, (&sample, &lens));
                    let not_seen = W::simd_from(simd, f32::NAN);
                    let sides = [sample.depth, nearest].map(|depth| sample.inside.select(depth, not_seen).into());
                    let [begin, end]: [[f32; 16]; 2] = surfels.bounds(simd, 0, [HALF_BLOCK; 2]).map(Into::into);
                    least_reach = surfel.least_reach;
                    (surfels.masks.of(0) != 0, sides, [begin[0].max(surfels.nearest[0]), end[0]])
                });
                // Beside the tile it isn't taken in.
                if !is_met {
                    continue;
                }
                for (depth, nearest) in sides[0].into_iter().zip(sides[1]).filter(|(depth, _)| !depth.is_nan()) {
                    // Roundings of numbers of this size.
                    let rounding = 4.0 * f32::EPSILON * (depth.abs() + nearest.abs());
                    prop_assert!(depth - nearest >= least_reach - rounding, "{level:?}: {depth}, {nearest}, {least_reach}");
                    prop_assert!(nearest >= begin - rounding, "{level:?}: {nearest} before {begin}");
                    prop_assert!(depth <= end + rounding, "{level:?}: {depth} behind {end}");
                }
            }
        }
    }
}
