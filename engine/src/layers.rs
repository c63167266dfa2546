//! Stage `layers`: the surface records of a tile to cuts, as many as a pixel needs.
//!
//! A sample spans the depths from where it is seen to where its plane passes the pixel; a layer takes a pixel's
//! samples whose span comes within ε + 3σ_z of its first one's. Spans that meet are one surface: that is the
//! A-buffer test of Zwicker, Pfister, van Baar, Gross, *Surface splatting*, 2001. Without the plane a tilted
//! surface whose surfels are smaller than the pixel's filter would fall apart into layers.
//!
//! Layers are peeled, block by block: one pass over a block's records finds each pixel's first sample, one sums up what
//! belongs to it, and what lies behind a layer's limit is left for the next. Nothing is sorted or kept. Records come
//! roughly from near to far, so that a block that is covered soon needs most of them no more.

use crate::cloud::Cloud;
use crate::columns::Kind;
use crate::cuts::{Cut, Cuts, MAX_LAYERS};
use crate::raster::{BATCH, Surfaces, Surfel, SurfelLens, Surfels};
use crate::simd::*;
use crate::tile::{PIXELS, Tile, pixels};
use std::sync::atomic::{AtomicU32, Ordering};

/// The layer that is being peeled from a block.
struct Peel<S: Simd> {
    /// z of the first sample; −∞ where nothing is looked for, ∞ where nothing was found.
    depth: W<S>,
    /// The layer takes samples that come nearer than this.
    limit: W<S>,
    /// The first sample's record, or [`Cut::NO_RECORD`].
    record: u32x16<S>,
    /// The limit of the layer before.
    previous: W<S>,
    /// The limit of the layer behind which nothing is seen; ∞ before there is one, −∞ beside the picture.
    end: W<S>,
}

/// Sums over the samples of a layer.
struct Sums<S: Simd> {
    /// Of the splats that show their front, and of those that show their back. The two sides of a thin sheet would
    /// cancel, so their normals are never added.
    sides: [Side<S>; 2],
    /// Of how far colours are from the one that surfaces most often have all over.
    color: [W<S>; 3],
    usual: [f32; 3],
    /// Of depths behind the first sample's.
    depth: W<S>,
    /// Of 1 − opacity.
    clear: W<S>,
}

#[derive(Clone, Copy)]
struct Side<S: Simd> {
    weight: W<S>,
    normal: [W<S>; 3],
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    fn zero(simd: S, usual: [f32; 3]) -> Self {
        let zero = W::simd_from(simd, 0.0);
        Self {
            sides: [Side { weight: zero, normal: [zero; 3] }; 2],
            color: [zero; 3],
            usual,
            depth: zero,
            clear: zero,
        }
    }

    #[inline(always)]
    fn weight(&self) -> W<S> {
        self.sides[0].weight + self.sides[1].weight
    }

    /// Adds samples of a surfel, by their weights and how far they are behind the first ones.
    #[inline(always)]
    fn add(&mut self, simd: S, surfel: &Surfel, here: &Here<S>, [weight, behind]: [W<S>; 2]) {
        let Surfel { normal, color, opacity, .. } = *surfel;
        self.depth = behind.mul_add(weight, self.depth);
        if opacity < 1.0 {
            self.clear = weight.mul_add(W::simd_from(simd, 1.0 - opacity), self.clear);
        }
        if color != self.usual {
            for ((sum, own), usual) in self.color.iter_mut().zip(color).zip(self.usual) {
                *sum = weight.mul_add(W::simd_from(simd, own - usual), *sum);
            }
        }
        match surfel.faces_away(here.corner) {
            Some(false) => self.sides[0].add(simd, normal, weight),
            Some(true) => self.sides[1].add(simd, normal, weight),
            None => {
                let zero = W::simd_from(simd, 0.0);
                let facing = surfel.exact_facing(simd, here.pixels);
                let back = facing.simd_gt(zero).select(weight, zero);
                self.sides[0].add(simd, normal, weight - back);
                self.sides[1].add(simd, normal, back);
            }
        }
    }
}

/// How far one sees into a pixel past its layers so far.
///
/// Coverage is a share of the pixel's area. A layer covers what is left bare first, and only then what is
/// covered already: the parts of one surface that fall into two layers, at a crease or along a silhouette, lie
/// beside each other. Were they independent, every such pixel would let the background through.
#[derive(Clone, Copy)]
struct SeenThrough<S: Simd> {
    /// Share of the pixel that no layer covers.
    bare: W<S>,
    /// What the covered share lets through, as a share of the pixel.
    covered: W<S>,
}

impl<S: Simd> SeenThrough<S> {
    /// Puts a layer behind; gives the opacity with which it is composited, and what is still seen.
    #[inline(always)]
    fn cover(&mut self, simd: S, coverage: W<S>, opacity: W<S>) -> [W<S>; 2] {
        let Self { bare, covered } = *self;
        let (one, zero) = (W::simd_from(simd, 1.0), W::simd_from(simd, 0.0));
        let before = bare + covered;
        let beside = coverage.min(bare);
        let behind = bare.simd_lt(one).select((coverage - beside) / (one - bare), zero);
        self.covered = covered * (one - opacity * behind) + beside * (one - opacity);
        self.bare = bare - beside;
        let after = self.bare + self.covered;
        let alpha = before.simd_gt(zero).select(one - after / before, one);
        [alpha, after]
    }
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
    /// A tile's records, and how many batches of them it has.
    batches: Vec<Surfels>,
    used: usize,
    /// Of a block: its records, by their place in the tile, and between which depths their spans begin.
    listed: Vec<Listed>,
}

/// Records after which it is asked how deep the first samples are.
const LOOKED_AT_TOGETHER: u64 = 8;

/// A record of a block.
#[derive(Clone, Copy)]
struct Listed {
    batch: u32,
    number: u32,
    nearest: f32,
    /// Its samples are at least this deep.
    seen_from: f32,
    farthest: f32,
}

/// Turns a tile's surface records into cuts. Behind a transmittance of `spent` nothing is kept.
pub(crate) struct LayerBuilder<'a> {
    pub(crate) surfaces: Surfaces<'a>,
    pub(crate) lens: SurfelLens,
    pub(crate) spent: f32,
}

/// The depth tolerance of each cloud in the world; 0 for volumes.
pub(crate) fn depth_tolerances(clouds: &[Cloud]) -> impl Iterator<Item = f32> {
    clouds.iter().map(|cloud| match cloud.columns().kind {
        // A scaled cloud scales its radii; the cube root is exact for uniform scales.
        Kind::Surface(surface) => {
            let scale = cloud.cloud_to_world().matrix3.determinant().abs().cbrt();
            surface.depth_tolerance * scale as f32
        }
        _ => 0.0,
    })
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
        let LayerBuffers { batches, used, .. } = buffers;
        *used = list.len().div_ceil(BATCH);
        batches.resize_with((*used).max(batches.len()), || Surfels::NONE);
        for (list, batch) in list.chunks(BATCH).zip(batches) {
            let numbers = list.iter().map(
                #[inline(always)]
                |entry| entry.load(Ordering::Relaxed),
            );
            batch.fill(simd, (tile, &self.lens), numbers, self.surfaces);
        }
    }

    /// Lists the records that a block needs.
    #[inline(always)]
    fn list<S: Simd>(&self, simd: S, (block, corner): (usize, [f32; 2]), buffers: &mut LayerBuffers) {
        let LayerBuffers { batches, used, listed } = buffers;
        listed.clear();
        let (mut nearest, mut seen_from, mut farthest) = ([0.0; BATCH], [0.0; BATCH], [0.0; BATCH]);
        for (batch, surfels) in batches[..*used].iter().enumerate() {
            let rest = surfels.masks.of(block);
            if rest == 0 {
                continue;
            }
            let bounds = [&mut nearest, &mut seen_from, &mut farthest];
            surfels.bounds(simd, (corner, rest), &self.lens, bounds);
            // Those of one form together: no processor foresees which form comes next.
            for mut rest in surfels.by_form(rest) {
                while rest != 0 {
                    let number = rest.trailing_zeros() as usize % BATCH;
                    rest &= rest - 1;
                    listed.push(Listed {
                        batch: batch as u32,
                        number: number as u32,
                        nearest: nearest[number],
                        seen_from: seen_from[number],
                        farthest: farthest[number],
                    });
                }
            }
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
        apart(
            simd,
            #[inline(always)]
            || self.list(simd, (block, corner), buffers),
        );
        let LayerBuffers { batches, listed, .. } = buffers;
        if listed.is_empty() {
            return 0;
        }
        let infinity = W::simd_from(simd, f32::INFINITY);
        let wanted = tile.inside(simd, block).select(infinity, -infinity);
        let no_record = u32x16::simd_from(simd, Cut::NO_RECORD);
        let mut peel =
            Peel { depth: wanted, limit: wanted, record: no_record, previous: -infinity, end: wanted };
        let mut seen_through =
            SeenThrough { bare: W::simd_from(simd, 1.0), covered: W::simd_from(simd, 0.0) };
        let mut evaluated = 0;
        for layer in 0..MAX_LAYERS {
            evaluated += apart(
                simd,
                #[inline(always)]
                || self.find_first(simd, (batches, here), listed, &mut peel),
            );
            let Some(any) = listed.first() else { break };
            let last = layer + 1 == MAX_LAYERS;
            if last {
                // The last layer takes every sample that is left.
                peel.limit = peel.depth.simd_gt(-infinity).select(infinity, -infinity);
            }
            let mut sums = Sums::zero(simd, any.of(batches).color);
            evaluated += apart(
                simd,
                #[inline(always)]
                || self.sum_up(simd, (batches, here), (listed, &peel), &mut sums),
            );
            let cut = cuts.next();
            let [found, goes_on] = apart(
                simd,
                #[inline(always)]
                || self.close(simd, (&mut peel, &sums), (&mut seen_through, last), cut),
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

    /// Finds the first sample of each pixel behind the layers so far. Leaves those records in the list that may have
    /// samples there.
    #[inline(always)]
    fn find_first<S: Simd>(
        &self,
        simd: S,
        (batches, here): (&[Surfels], Here<S>),
        listed: &mut Vec<Listed>,
        peel: &mut Peel<S>,
    ) -> u64 {
        let infinity = W::simd_from(simd, f32::INFINITY);
        let is_behind = peel.previous.simd_gt(-infinity).any_true();
        let mut deepest = peel.depth.reduce_max();
        let is_open = peel.depth.simd_gt(-infinity);
        let done = is_open.select(peel.previous, infinity).reduce_min();
        let none = u32x16::simd_from(simd, u32::MAX);
        let (mut kept, mut evaluated, mut firsts) = (0, 0, none);
        for place in 0..listed.len() {
            let candidate = listed[place];
            if candidate.farthest <= done {
                continue;
            }
            // It may be of use, if not to this layer.
            if kept < place {
                listed[kept] = candidate;
            }
            kept += 1;
            if candidate.seen_from > deepest {
                continue;
            }
            evaluated += 1;
            let surfel = candidate.of(batches);
            let sample = surfel.sample(simd, here.pixels, &self.lens);
            let mut inside = sample.inside;
            if is_behind {
                inside &= is_open;
                if inside.any_true() {
                    let spans = surfel.spans(simd, &sample, here.pixels, &self.lens);
                    inside &= spans.nearest.simd_gt(peel.previous);
                }
                if !inside.any_true() {
                    // Nor of use to a later layer, which is farther.
                    kept -= 1;
                    continue;
                }
            }
            let nearer = inside & sample.depth.simd_lt(peel.depth);
            peel.depth = nearer.select(sample.depth, peel.depth);
            firsts = nearer.select(u32x16::simd_from(simd, kept as u32 - 1), firsts);
            if evaluated % LOOKED_AT_TOGETHER == 0 {
                deepest = peel.depth.reduce_max();
            }
        }
        listed.truncate(kept);
        self.limit(simd, (batches, here), (listed, firsts), peel);
        evaluated
    }

    /// Where the layer ends, by the places in the list of each pixel's first sample.
    #[inline(always)]
    fn limit<S: Simd>(
        &self,
        simd: S,
        (batches, here): (&[Surfels], Here<S>),
        (listed, firsts): (&[Listed], u32x16<S>),
        peel: &mut Peel<S>,
    ) {
        let places: [u32; PIXELS] = firsts.into();
        let mut open = firsts.simd_ne(u32x16::simd_from(simd, u32::MAX)).to_bitmask();
        while open != 0 {
            let place = places[open.trailing_zeros() as usize % PIXELS];
            let own = firsts.simd_eq(u32x16::simd_from(simd, place));
            open &= !own.to_bitmask();
            let surfel = listed[place as usize].of(batches);
            let sample = surfel.sample(simd, here.pixels, &self.lens);
            let spans = surfel.spans(simd, &sample, here.pixels, &self.lens);
            peel.limit = own.select(spans.farthest + surfel.tolerance, peel.limit);
            peel.record = own.select(u32x16::simd_from(simd, surfel.index), peel.record);
        }
    }

    /// Sums up the samples that belong to the layer.
    #[inline(always)]
    fn sum_up<S: Simd>(
        &self,
        simd: S,
        (batches, here): (&[Surfels], Here<S>),
        (listed, peel): (&[Listed], &Peel<S>),
        sums: &mut Sums<S>,
    ) -> u64 {
        let (zero, infinity) = (W::simd_from(simd, 0.0), W::simd_from(simd, f32::INFINITY));
        let farthest = peel.limit.reduce_max();
        let is_open = peel.limit.simd_gt(-infinity);
        let is_behind = peel.previous.simd_gt(-infinity);
        let mut evaluated = 0;
        for candidate in listed.iter().filter(|candidate| candidate.nearest <= farthest) {
            let surfel = candidate.of(batches);
            evaluated += 1;
            let mut sample = surfel.sample(simd, here.pixels, &self.lens);
            sample.inside &= is_open;
            // Only where what is seen lies behind the limit it matters where the plane is: spans begin before.
            if (sample.inside & (sample.depth.simd_gt(peel.limit) | is_behind)).any_true() {
                let spans = surfel.spans(simd, &sample, here.pixels, &self.lens);
                sample.inside &= spans.nearest.simd_gt(peel.previous) & spans.nearest.simd_le(peel.limit);
            }
            let weight = sample.inside.select(surfel.weight(simd, &sample, here.pixels, &self.lens), zero);
            // Where no sample was found the difference is infinite.
            let behind = sample.inside.select(sample.depth - peel.depth, zero);
            sums.add(simd, surfel, &here, [weight, behind]);
        }
        evaluated
    }

    /// Turns the sums of a layer into a cut and makes ready for the next; says whether any pixel has a sample, and
    /// whether another layer is needed.
    #[inline(always)]
    fn close<S: Simd>(
        &self,
        simd: S,
        (peel, sums): (&mut Peel<S>, &Sums<S>),
        (seen_through, last): (&mut SeenThrough<S>, bool),
        cut: &mut Cut,
    ) -> [bool; 2] {
        let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
        let infinity = W::simd_from(simd, f32::INFINITY);
        let no_record = u32x16::simd_from(simd, Cut::NO_RECORD);
        let [front, back] = &sums.sides;
        let weight = sums.weight();
        let found = peel.record.simd_ne(no_record);
        // Seen exactly edge-on a plane covers nothing, and hides nothing.
        let inverse = weight.simd_gt(W::simd_from(simd, 1e-30)).select(one / weight, zero);
        let mut opacity = one - (sums.clear * inverse).min(one);
        if last {
            // The last layer may be several sheets, one behind the other.
            let (through, sheets): ([f32; PIXELS], [f32; PIXELS]) =
                ((one - opacity).into(), weight.max(one).into());
            let through: [f32; PIXELS] = std::array::from_fn(|i| through[i].powf(sheets[i]));
            opacity = one - W::simd_from(simd, through);
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
        for ((plane, sum), usual) in cut.color.iter_mut().zip(sums.color).zip(sums.usual) {
            plane.store(sum.mul_add(inverse, W::simd_from(simd, usual)));
        }
        for (plane, normal) in cut.normal.iter_mut().zip(normal) {
            plane.store(found.select(normal, zero));
        }
        cut.record = found.select(peel.record, no_record).into();
        let goes_on = found & seen.simd_gt(W::simd_from(simd, self.spent));
        peel.end = (found & !goes_on).select(peel.limit, peel.end);
        peel.previous = peel.limit;
        peel.depth = goes_on.select(infinity, -infinity);
        peel.limit = peel.depth;
        peel.record = no_record;
        [found.any_true(), goes_on.any_true() && !last]
    }
}

impl Listed {
    #[inline(always)]
    fn of(self, batches: &[Surfels]) -> &Surfel {
        batches[self.batch as usize].get(self.number as usize)
    }
}

impl<S: Simd> Side<S> {
    #[inline(always)]
    fn add(&mut self, simd: S, normal: [f32; 3], weight: W<S>) {
        self.weight += weight;
        for (sum, normal) in self.normal.iter_mut().zip(normal) {
            *sum = weight.mul_add(W::simd_from(simd, normal), *sum);
        }
    }
}
