//! Stage `layers`: the surfels of a tile to cuts, as many as a pixel needs.
//!
//! A sample spans the depths from where it is seen to where its plane passes the pixel; a layer takes a pixel's
//! samples whose span comes within ε + 3σ_z of its first one's. Spans that meet are one surface: that is the
//! A-buffer test of Zwicker, Pfister, van Baar, Gross, *Surface splatting*, 2001. Without the plane a tilted
//! surface whose surfels are smaller than the pixel's filter would fall apart into layers.
//!
//! Layers are peeled, block by block: one pass over a block's records finds each pixel's first sample and keeps all that it
//! takes, one sums up what belongs to it, and what lies behind a layer's limit is left for the next. Nothing is sorted.
//! Records come roughly from near to far, in sixteens of neighbours, so that a block that is covered soon doesn't even look
//! at most of them.

mod list;
mod sums;

use crate::cuts::{Cut, Cuts, MAX_LAYERS};
use crate::footprint::Part;
use crate::raster::{BATCH, Column, Room, Surfaces, SurfelLens, Surfels};
use crate::simd::*;
use crate::tile::{HALF_BLOCK, PIXELS, Tile, pixels};
use list::{List, Listed};
use std::sync::atomic::{AtomicU32, Ordering};
use sums::{SeenThrough, Sums};

/// The layer that is being peeled from a block.
struct Peel<S: Simd> {
    /// z of the first sample; −∞ where nothing is looked for, ∞ where nothing was found.
    depth: W<S>,
    /// The layer takes samples that come nearer than this.
    limit: W<S>,
    /// The first sample's record and its cloud, or [`Cut::NO_NUMBER`].
    record: u32x16<S>,
    cloud: u32x16<S>,
    /// The limit of the layer before.
    previous: W<S>,
    /// The limit of the layer behind which nothing is seen; ∞ before there is one, −∞ beside the picture.
    end: W<S>,
    /// Whether the layer takes every sample that is left.
    takes_all: bool,
}

/// A block of pixels.
#[derive(Clone, Copy)]
struct Here<S: Simd> {
    /// Its first pixel, from the tile's.
    corner: [f32; 2],
    /// Columns and rows.
    pixels: [W<S>; 2],
}

/// Buffers of one thread.
#[derive(Default)]
pub(crate) struct LayerBuffers {
    /// A tile's surfels, and how many batches of them it has.
    batches: Vec<Surfels>,
    used: usize,
    /// The colour of the first, black where that is beyond white.
    usual: [f32; 3],
    /// Of a block: the records of each batch that may be of use.
    rest: Vec<u64>,
    /// Those that the layer may have samples of.
    listed: List,
    room: Room,
}

/// Where a layer is looked for.
struct Search<S: Simd> {
    /// The pixels that need it; whether there are layers before; the least depth at which one of those ends.
    is_open: mask32x16<S>,
    is_behind: bool,
    done: f32,
    /// The greatest of the layer's limits.
    farthest: f32,
    /// The least that this was when something was not looked at, since it begins behind.
    strictest: f32,
    /// Places in the list of first samples by which no limit has gone yet; [`u32::MAX`] where there are none.
    firsts: u32x16<S>,
}

impl<S: Simd> Search<S> {
    /// A set begins behind the limits there are so far.
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

/// Turns a tile's surface records into cuts. Behind a transmittance of `spent` nothing is kept.
pub(crate) struct LayerBuilder<'a> {
    pub(crate) surfaces: Surfaces<'a>,
    pub(crate) lens: SurfelLens,
    pub(crate) spent: f32,
}

impl LayerBuilder<'_> {
    /// Fills the cuts of a tile from its records. Gives the number of pixels that were evaluated.
    #[inline(always)]
    pub(crate) fn build<S: Simd>(
        &self,
        simd: S,
        (tile, list): (Tile, &[AtomicU32]),
        buffers: &mut LayerBuffers,
        cuts: &mut Cuts,
    ) -> u64 {
        cuts.clear();
        if list.is_empty() {
            return 0;
        }
        apart(
            simd,
            #[inline(always)]
            || self.fetch(simd, (tile, list), buffers),
        );
        let mut samples = 0;
        for block in tile.visible_blocks() {
            samples += self.peel(simd, (tile, block), buffers, cuts);
        }
        cuts.sum_up(simd, tile, self.spent);
        samples * PIXELS as u64
    }

    /// Brings the records of a tile together.
    #[inline(always)]
    fn fetch<S: Simd>(&self, simd: S, (tile, list): (Tile, &[AtomicU32]), buffers: &mut LayerBuffers) {
        let LayerBuffers { batches, used, usual, room, .. } = buffers;
        // Differences from what is too bright would have few digits left.
        let is_within = |color: &[f32; 3]| color.iter().all(|c| (0.0..=1.0).contains(c));
        let color = |entry: &AtomicU32| {
            let part = Part(entry.load(Ordering::Relaxed));
            let octet = &self.surfaces.octets[part.place() as usize];
            let [color @ .., _] = octet.look(part.lane().unwrap_or(octet.seen.trailing_zeros() as usize));
            color
        };
        *usual = list.first().map(color).filter(is_within).unwrap_or([0.0; 3]);
        let mut left = list;
        *used = 0;
        while !left.is_empty() {
            if *used == batches.len() {
                batches.push(Surfels::NONE);
            }
            let taken = batches[*used].fill(simd, (tile, *usual, &self.lens), (left, self.surfaces), room);
            left = &left[taken..];
            *used += 1;
        }
    }

    /// Peels the layers of a block; gives the number of times that a record was evaluated.
    #[inline(always)]
    fn peel<S: Simd>(
        &self,
        simd: S,
        (tile, block): (Tile, usize),
        buffers: &mut LayerBuffers,
        cuts: &mut Cuts,
    ) -> u64 {
        let corner = tile.corner_pixel(block);
        let here = Here { corner, pixels: pixels(simd, corner) };
        let LayerBuffers { batches, used, usual, rest, listed, .. } = buffers;
        let batches = &batches[..*used];
        rest.clear();
        rest.extend(batches.iter().map(|surfels| surfels.masks.of(block)));
        if rest.iter().all(|set| *set == 0) {
            return 0;
        }
        let infinity = W::simd_from(simd, f32::INFINITY);
        let wanted = tile.inside(simd, block).select(infinity, -infinity);
        let no_number = u32x16::simd_from(simd, Cut::NO_NUMBER);
        let mut peel = Peel {
            depth: wanted,
            limit: wanted,
            record: no_number,
            cloud: no_number,
            previous: -infinity,
            end: wanted,
            takes_all: false,
        };
        let mut seen_through =
            SeenThrough { bare: W::simd_from(simd, 1.0), covered: W::simd_from(simd, 0.0) };
        let mut evaluated = 0;
        for layer in 0..MAX_LAYERS {
            peel.takes_all = layer + 1 == MAX_LAYERS;
            evaluated += apart(
                simd,
                #[inline(always)]
                || self.find_first(simd, (batches, here), (rest, listed), &mut peel),
            );
            if listed.all().is_empty() {
                break;
            }
            if peel.takes_all {
                peel.limit = peel.depth.simd_gt(-infinity).select(infinity, -infinity);
            }
            let mut sums = Sums::zero(simd);
            evaluated += apart(
                simd,
                #[inline(always)]
                || self.sum_up(simd, (batches, here), (rest, listed.all()), (&peel, &mut sums)),
            );
            let cut = cuts.next();
            let [found, goes_on] = apart(
                simd,
                #[inline(always)]
                || self.close(simd, (&mut peel, &sums, *usual), &mut seen_through, cut),
            );
            if found {
                cuts.keep(simd, block);
            }
            if !goes_on {
                break;
            }
        }
        cuts.end(block, peel.end.reduce_max());
        evaluated
    }

    /// Finds the first sample of each pixel behind the layers so far, and lists the records that may have samples of the layer.
    /// Leaves those in the rest that may have samples there or farther.
    #[inline(always)]
    fn find_first<S: Simd>(
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
            let tolerance = self.surfaces.clouds[cloud as usize].depth_tolerance;
            peel.limit = own.select(farthest + tolerance, peel.limit);
            peel.record = own.select(u32x16::simd_from(simd, slant.index), peel.record);
            peel.cloud = own.select(u32x16::simd_from(simd, cloud), peel.cloud);
        }
        if !peel.takes_all {
            search.farthest = peel.limit.reduce_max();
        }
    }

    /// Sums up the samples that belong to the layer, and says how many were evaluated again. Takes records out of the rest that have none
    /// behind it.
    #[inline(always)]
    fn sum_up<S: Simd>(
        &self,
        simd: S,
        (batches, here): (&[Surfels], Here<S>),
        (rest, listed): (&mut [u64], &[Listed]),
        (peel, sums): (&Peel<S>, &mut Sums<S>),
    ) -> u64 {
        let (zero, infinity) = (W::simd_from(simd, 0.0), W::simd_from(simd, f32::INFINITY));
        let is_open = peel.record.simd_ne(u32x16::simd_from(simd, Cut::NO_NUMBER));
        let farthest = is_open.select(peel.limit, -infinity).reduce_max();
        let mut evaluated = 0;
        // All sums stay in registers where there are enough. Where there aren't they had better stay where they are.
        let mut own_sums = *sums;
        let adding = if holds_sixteen::<S>() { &mut own_sums } else { &mut *sums };
        for candidate in listed.iter().filter(|candidate| candidate.nearest <= farthest) {
            let (surfels, number) = candidate.of(batches);
            let surfel = surfels.get(number);
            let depth = candidate.depth.load(simd);
            let mut weight = candidate.weight.load(simd);
            // Only where what is seen begins behind the limit it matters where the plane is: spans begin there or before.
            let is_seen = weight.simd_gt(zero);
            let mut has_others = false;
            let is_own = depth.simd_le(peel.limit + surfel.least_reach);
            if (is_seen & !is_own).any_true() {
                evaluated += 1;
                let sample = surfel.sample(simd, here.pixels, &self.lens);
                let nearest = surfels.slant(number).nearest(simd, here.pixels, (&sample, &self.lens));
                let own = is_own | nearest.simd_le(peel.limit);
                has_others = (is_seen & !own).any_true();
                weight = own.select(weight, zero);
            }
            if !has_others {
                rest[candidate.batch as usize] &= !(1 << candidate.number);
            }
            // Where nothing is seen the difference may be infinite.
            let behind = is_seen.select(depth - peel.depth, zero);
            adding.add(simd, (surfel, surfels.look(number)), [weight, behind]);
        }
        if holds_sixteen::<S>() {
            *sums = own_sums;
        }
        evaluated
    }

    /// Turns the sums of a layer into a cut and makes ready for the next; says whether any pixel has a sample, and
    /// whether another layer is needed.
    #[inline(always)]
    fn close<S: Simd>(
        &self,
        simd: S,
        (peel, sums, usual): (&mut Peel<S>, &Sums<S>, [f32; 3]),
        seen_through: &mut SeenThrough<S>,
        cut: &mut Cut,
    ) -> [bool; 2] {
        let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
        let infinity = W::simd_from(simd, f32::INFINITY);
        let no_number = u32x16::simd_from(simd, Cut::NO_NUMBER);
        let (front, back) = (&sums.front, &sums.back);
        let weight = sums.weight();
        let found = peel.record.simd_ne(no_number);
        // Seen exactly edge-on a plane covers nothing, and hides nothing.
        let inverse = weight.simd_gt(W::simd_from(simd, 1e-30)).select(one / weight, zero);
        let mut opacity = one - (sums.clear * inverse).min(one);
        // A layer may be several sheets, one behind the other: as many as it covers the pixel times. But what a single one may cover too much by
        // unevenness is none, and twice that is as much.
        let even = sums.even / sums.clear;
        let more = weight.mul_sub(even, one);
        let beyond_one = more - (one - even);
        let is_many = beyond_one.simd_gt(zero) & opacity.simd_gt(zero);
        if is_many.any_true() {
            let sheets = (beyond_one + beyond_one).min(more) + one;
            let deep = crate::simd::opacity(simd, optical_depth(simd, opacity) * sheets);
            opacity = is_many.select(deep, opacity);
        }
        let coverage = found.select(weight.min(one), zero);
        let [alpha, seen] = seen_through.cover(simd, coverage, found.select(opacity, zero));
        // On the side that is seen.
        let shows_front = front.weight.simd_ge(back.weight);
        let of_side = shows_front.select(front.weight, back.weight);
        let inverse_of_side = of_side.simd_gt(W::simd_from(simd, 1e-30)).select(one / of_side, zero);
        let normal = [0, 1, 2].each(
            #[inline(always)]
            |axis| shows_front.select(front.normal[axis], -back.normal[axis]) * inverse_of_side,
        );
        cut.depth.store(found.select(sums.depth.mul_add(inverse, peel.depth), infinity));
        cut.alpha.store(found.select(alpha, zero));
        for ((plane, sum), usual) in cut.color.iter_mut().zip(sums.tint).zip(usual) {
            plane.store(sum.mul_add(inverse, W::simd_from(simd, usual)));
        }
        for (plane, normal) in cut.normal.iter_mut().zip(normal) {
            plane.store(found.select(normal, zero));
        }
        (cut.record, cut.cloud) = (peel.record.into(), peel.cloud.into());
        let goes_on = found & seen.simd_gt(W::simd_from(simd, self.spent));
        peel.end = (found & !goes_on).select(peel.limit, peel.end);
        peel.previous = peel.limit;
        peel.depth = goes_on.select(infinity, -infinity);
        peel.limit = peel.depth;
        (peel.record, peel.cloud) = (no_number, no_number);
        [found.any_true(), goes_on.any_true() && !peel.takes_all]
    }
}
