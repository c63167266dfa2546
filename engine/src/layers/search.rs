//! The first samples of a block's layer, and the records that it may have samples of.

use super::list::{List, Listed};
use super::{Here, LayerBuilder, Peel};
use crate::raster::{BATCH, CloudSurface, Column, Surfels};
use crate::simd::*;
use crate::tile::{HALF_BLOCK, PIXELS};

/// Where a layer is looked for.
struct Search<S: Simd> {
    /// The pixels that need it; whether there are layers before; the least depth at which one of those ends.
    is_open: mask32x16<S>,
    is_behind: bool,
    done: f32,
    /// The greatest of the layer's limits.
    farthest: f32,
    /// The least that this was when something that begins behind it was left out; ∞ where nothing was.
    strictest: f32,
    /// Places in the list of first samples by which no limit has gone yet; [`u32::MAX`] where there are none.
    firsts: u32x16<S>,
}

impl<S: Simd> Search<S> {
    /// Notes that a set is left out, since it begins behind the limits.
    #[inline(always)]
    fn leave_out(&mut self, set: u64) {
        if set != 0 && self.farthest < self.strictest {
            self.strictest = self.farthest;
        }
    }
}

/// What a block's search has found in a batch.
#[derive(Clone, Copy)]
struct Found<S: Simd> {
    /// As those of [`Peel`] and [`Search`].
    depth: W<S>,
    firsts: u32x16<S>,
    /// How many were listed, and which have nothing for this layer or any behind it.
    count: usize,
    gone: u64,
}

impl LayerBuilder<'_> {
    /// Finds the first sample of each pixel behind the layers so far, and lists the records that may have samples of the layer.
    /// Leaves those in the rest that may have samples there or farther.
    #[inline(always)]
    pub(super) fn find_first<S: Simd>(
        &self,
        simd: S,
        (batches, here): (&[Surfels], Here<S>),
        (rest, listed): (&mut [u64], &mut List),
        peel: &mut Peel<S>,
    ) -> u64 {
        let infinity = W::simd_from(simd, f32::INFINITY);
        let is_open = peel.depth.simd_gt(-infinity);
        let mut search = Search {
            is_open,
            is_behind: peel.previous.simd_gt(-infinity).any_true(),
            done: is_open.select(peel.previous, infinity).reduce_min(),
            farthest: peel.limit.reduce_max(),
            strictest: f32::INFINITY,
            firsts: u32x16::simd_from(simd, u32::MAX),
        };
        let mut evaluated = 0;
        // Again where a nearer first sample has a farther limit than those by which others were left out.
        for _ in 0..2 {
            listed.used = 0;
            search.strictest = f32::INFINITY;
            for batch in 0..batches.len() {
                if rest[batch] != 0 {
                    evaluated +=
                        self.look_through(simd, (batches, here, batch), (rest, listed), (&mut search, peel));
                }
            }
            self.limit(simd, (batches, here), (listed.all(), &mut search), peel);
            if search.farthest <= search.strictest {
                break;
            }
        }
        evaluated
    }

    /// Looks for first samples among the records of a batch.
    #[inline(always)]
    fn look_through<S: Simd>(
        &self,
        simd: S,
        (batches, here, batch): (&[Surfels], Here<S>, usize),
        (rest, listed): (&mut [u64], &mut List),
        (search, peel): (&mut Search<S>, &mut Peel<S>),
    ) -> u64 {
        let surfels = &batches[batch];
        let all = rest[batch];
        let set = surfels.begin_before(all, search.farthest);
        search.leave_out(all & !set);
        if set == 0 {
            return 0;
        }
        let middle = here.corner.each(
            #[inline(always)]
            |x| x + HALF_BLOCK,
        );
        let mut nearest = [0.0; BATCH];
        // While a pixel has found nothing all may be first: bounds would leave nothing out.
        let between = if search.is_behind || search.farthest < f32::INFINITY {
            surfels.between(simd, (middle, set), [search.done, search.farthest], &mut nearest)
        } else {
            surfels.all_of(set, &mut nearest)
        };
        rest[batch] &= !between.ahead;
        search.leave_out(set & !between.ahead & !between.within);
        let first = listed.used;
        let room = listed.room(BATCH);
        let mut found = Found { depth: peel.depth, firsts: search.firsts, count: 0, gone: 0 };
        // Those of one form together: no processor foresees which form comes next.
        let sets = (surfels, surfels.by_form(between.within), (batch as u32, first as u32));
        let block = (here, search.is_open, peel.previous);
        // Compiled for both: what layers behind the first need takes registers.
        found = if search.is_behind {
            self.look_at::<S, true>(simd, block, sets, (&nearest, room, found))
        } else {
            self.look_at::<S, false>(simd, block, sets, (&nearest, room, found))
        };
        rest[batch] &= !found.gone;
        listed.used += found.count;
        (peel.depth, search.firsts) = (found.depth, found.firsts);
        // While a pixel has found nothing there is no limit to what is looked at.
        if !(search.is_open & found.depth.simd_eq(W::simd_from(simd, f32::INFINITY))).any_true() {
            self.limit(simd, (batches, here), (listed.all(), search), peel);
        }
        u64::from(between.within.count_ones())
    }

    /// Looks for first samples among sets of a batch's records, and lists them.
    #[inline(always)]
    fn look_at<S: Simd, const BEHIND: bool>(
        &self,
        simd: S,
        (here, is_open, previous): (Here<S>, mask32x16<S>, W<S>),
        (surfels, sets, (batch, first)): (&Surfels, [u64; 2], (u32, u32)),
        (nearest, room, mut found): (&Column, &mut [Listed], Found<S>),
    ) -> Found<S> {
        let zero = W::simd_from(simd, 0.0);
        for mut set in sets {
            while set != 0 {
                let number = set.trailing_zeros() as usize % BATCH;
                set &= set - 1;
                let surfel = surfels.get(number);
                let sample = surfel.sample(simd, here.pixels, &self.lens);
                let mut inside = sample.inside & is_open;
                if BEHIND {
                    // What layers took without asking for spans is not taken again.
                    inside &= sample.depth.simd_gt(previous + surfel.least_reach);
                    if inside.any_true() {
                        let nearest = surfels.slant(number).nearest(simd, here.pixels, (&sample, &self.lens));
                        inside &= nearest.simd_gt(previous);
                    }
                    if !inside.any_true() {
                        // Nor is it of use to a later layer, which is farther.
                        found.gone |= 1 << number;
                        continue;
                    }
                }
                let weight = inside.select(surfel.weight(simd, &sample), zero);
                let nearer = inside & sample.depth.simd_lt(found.depth);
                found.depth = nearer.select(sample.depth, found.depth);
                let place = u32x16::simd_from(simd, first + found.count as u32);
                found.firsts = nearer.select(place, found.firsts);
                let entry = &mut room[found.count % BATCH];
                found.count += 1;
                entry.depth.store(sample.depth);
                entry.weight.store(weight);
                (entry.batch, entry.number) = (batch, number as u32);
                entry.nearest = nearest[number];
            }
        }
        found
    }

    /// Where the layer ends, by the pixels' first samples since it was last asked.
    #[inline(always)]
    fn limit<S: Simd>(
        &self,
        simd: S,
        (batches, here): (&[Surfels], Here<S>),
        (listed, search): (&[Listed], &mut Search<S>),
        peel: &mut Peel<S>,
    ) {
        let no_place = u32x16::simd_from(simd, u32::MAX);
        let firsts = std::mem::replace(&mut search.firsts, no_place);
        let places: [u32; PIXELS] = firsts.into();
        let mut open = firsts.simd_ne(no_place).to_bitmask();
        if open == 0 {
            return;
        }
        while open != 0 {
            let place = places[open.trailing_zeros() as usize % PIXELS];
            let own = firsts.simd_eq(u32x16::simd_from(simd, place));
            open &= !own.to_bitmask();
            let (surfels, number) = listed[place as usize].of(batches);
            let (slant, cloud) = (surfels.slant(number), surfels.get(number).cloud());
            let farthest = slant.farthest(simd, here.pixels, (peel.depth, &self.lens));
            let CloudSurface { depth_tolerance, coverage_floor, .. } = self.surfaces.clouds[cloud as usize];
            peel.limit = own.select(farthest + depth_tolerance, peel.limit);
            peel.tolerance = own.select(W::simd_from(simd, depth_tolerance), peel.tolerance);
            peel.floor = own.select(W::simd_from(simd, coverage_floor), peel.floor);
            peel.record = own.select(u32x16::simd_from(simd, slant.index), peel.record);
            peel.cloud = own.select(u32x16::simd_from(simd, cloud), peel.cloud);
        }
        if !peel.takes_all {
            search.farthest = peel.limit.reduce_max();
        }
    }
}
