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
mod parted;
mod search;
mod sums;

use crate::cuts::{Cut, Cuts, MAX_LAYERS};
use crate::footprint::Part;
use crate::raster::{Room, Surfaces, SurfelLens, Surfels};
use crate::simd::*;
use crate::tile::{PIXELS, Tile, pixels};
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
    /// How thick a layer is that begins with the first sample's cloud, and that cloud's coverage floor.
    tolerance: W<S>,
    floor: W<S>,
    /// Whether the layer takes every sample that is left.
    takes_all: bool,
}

/// What a layer takes of a record: weights, how far behind the first samples they are, whether it leaves any, and how often that asked for spans.
struct Own<S: Simd> {
    weight: W<S>,
    behind: W<S>,
    has_others: bool,
    asks: u64,
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

/// Turns a tile's surface records into cuts. Behind a transmittance of `least_transmittance` nothing is kept.
pub(crate) struct LayerBuilder<'a> {
    pub(crate) surfaces: Surfaces<'a>,
    pub(crate) lens: SurfelLens,
    pub(crate) least_transmittance: f32,
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
        cuts.sum_up(simd, tile, self.least_transmittance);
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
            tolerance: infinity,
            floor: infinity,
            takes_all: false,
        };
        let mut seen_through = SeenThrough::all(simd);
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
            if self.may_be_two(simd, &peel, &sums).any_true() {
                apart(
                    simd,
                    #[inline(always)]
                    || self.part(simd, (batches, here), listed.all(), (&peel, &mut sums)),
                );
            }
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
        let infinity = W::simd_from(simd, f32::INFINITY);
        let is_open = peel.record.simd_ne(u32x16::simd_from(simd, Cut::NO_NUMBER));
        let farthest = is_open.select(peel.limit, -infinity).reduce_max();
        let mut evaluated = 0;
        // All sums stay in registers where there are enough. Where there aren't they had better stay where they are.
        let mut own_sums = *sums;
        let adding = if holds_sixteen::<S>() { &mut own_sums } else { &mut *sums };
        for candidate in listed.iter().filter(|candidate| candidate.nearest <= farthest) {
            let (surfels, number) = candidate.of(batches);
            let Own { weight, behind, has_others, asks } = self.own(simd, (batches, here), candidate, peel);
            evaluated += asks;
            if !has_others {
                rest[candidate.batch as usize] &= !(1 << candidate.number);
            }
            adding.add(simd, (surfels.get(number), surfels.look(number)), [weight, behind]);
        }
        if holds_sixteen::<S>() {
            *sums = own_sums;
        }
        evaluated
    }

    /// What the layer takes of a record.
    #[inline(always)]
    fn own<S: Simd>(
        &self,
        simd: S,
        (batches, here): (&[Surfels], Here<S>),
        candidate: &Listed,
        peel: &Peel<S>,
    ) -> Own<S> {
        let zero = W::simd_from(simd, 0.0);
        let (surfels, number) = candidate.of(batches);
        let surfel = surfels.get(number);
        let depth = candidate.depth.load(simd);
        let weight = candidate.weight.load(simd);
        let is_seen = weight.simd_gt(zero);
        // Where nothing is seen the difference may be infinite.
        let behind = is_seen.select(depth - peel.depth, zero);
        // Only where what is seen begins behind the limit it matters where the plane is: spans begin there or before.
        let is_own = depth.simd_le(peel.limit + surfel.least_reach);
        if !(is_seen & !is_own).any_true() {
            return Own { weight, behind, has_others: false, asks: 0 };
        }
        let sample = surfel.sample(simd, here.pixels, &self.lens);
        let nearest = surfels.slant(number).nearest(simd, here.pixels, (&sample, &self.lens));
        let own = is_own | nearest.simd_le(peel.limit);
        let has_others = (is_seen & !own).any_true();
        Own { weight: own.select(weight, zero), behind, has_others, asks: 1 }
    }

    /// What fronts and what backs cover of a layer, by its sums and cloud; of one without sides all counts as fronts.
    #[inline(always)]
    fn coverage<S: Simd>(&self, simd: S, (sums, cloud): (&Sums<S>, u32x16<S>)) -> [W<S>; 2] {
        let has_sides = self.have_sides(simd, cloud);
        let zero = W::simd_from(simd, 0.0);
        [has_sides.select(sums.front.weight, sums.weight()), has_sides.select(sums.back.weight, zero)]
    }

    /// Of which pixels the layer's cloud has sides.
    #[inline(always)]
    fn have_sides<S: Simd>(&self, simd: S, clouds: u32x16<S>) -> mask32x16<S> {
        if self.surfaces.all_have_sides {
            return mask32x16::splat(simd, true);
        }
        let clouds: [u32; PIXELS] = clouds.into();
        let has_sides =
            |cloud: u32| self.surfaces.clouds.get(cloud as usize).is_some_and(|cloud| cloud.has_sides);
        let bits = clouds.iter().rev().fold(0, |bits, cloud| bits << 1 | u64::from(has_sides(*cloud)));
        mask32x16::from_bitmask(simd, bits)
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
        let coverage = self.coverage(simd, (sums, peel.cloud));
        let [opacity, inverse_of_shown] = sums.opacity(simd, coverage[0].max(coverage[1]).min(one), inverse);
        let coverage = coverage.each(
            #[inline(always)]
            |of_side| found.select(of_side, zero),
        );
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
            plane.store(sum.mul_add(inverse_of_shown, W::simd_from(simd, usual)));
        }
        for (plane, normal) in cut.normal.iter_mut().zip(normal) {
            plane.store(found.select(normal, zero));
        }
        (cut.record, cut.cloud) = (peel.record.into(), peel.cloud.into());
        let goes_on = found & seen.simd_gt(W::simd_from(simd, self.least_transmittance));
        peel.end = (found & !goes_on).select(peel.limit, peel.end);
        peel.previous = peel.limit;
        peel.depth = goes_on.select(infinity, -infinity);
        peel.limit = peel.depth;
        (peel.record, peel.cloud) = (no_number, no_number);
        [found.any_true(), goes_on.any_true() && !peel.takes_all]
    }
}
