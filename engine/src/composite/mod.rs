//! Stage `composite`: fragments to runs. Between cuts things add, cuts fold with *over*.
//!
//! What is behind an opaque cut is left out, a kernel between two cuts belongs to one run, and only where a cut goes through
//! a kernel is it shared out between runs. When what is open is closed is the affair of the policies ([`Opening`]).

mod centers;
mod coming;
mod ends;
mod opening;
mod seen;
mod shares;
mod slabs;
mod spread;
mod sums;
mod window;

pub(crate) use ends::lead;
use seen::Through;
pub(crate) use seen::{Runs, Seeing, Seen};

use crate::closing::Closing;
use crate::cuts::Cuts;
use crate::footprint::{Record, Rect};
use crate::raster::{BATCH, Fragments, KernelLens, Kernels, Spans};
use crate::simd::*;
use crate::tile::{MAX_BLOCKS, PIXELS, Tile, pixels};
use centers::Centers;
use coming::Coming;
use opening::{Fragment, Opening, Plain};
use shares::Segment;
use slabs::Slabbed;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use sums::OpenSlabs;
use window::{Window, Windowed};

/// Adds fragments to runs.
#[derive(Clone, Copy)]
pub(crate) struct Compositor<'a> {
    pub(crate) records: &'a [Record],
    pub(crate) rects: &'a [Rect],
    pub(crate) lens: KernelLens,
    pub(crate) least_transmittance: f32,
    /// See [`lead`].
    pub(crate) lead: f32,
    /// Whether the depth of what is seen is asked for.
    pub(crate) keeps_depth: bool,
}

/// A block of a tile.
#[derive(Clone, Copy)]
struct Here {
    tile: Tile,
    block: usize,
}

impl Here {
    #[inline(always)]
    fn pixels<S: Simd>(self, simd: S) -> [W<S>; 2] {
        pixels(simd, self.tile.corner_pixel(self.block))
    }
}

/// Batches that are fetched before their kernels are added: a block's pixels come into registers once for all.
const GROUP: usize = 8;

/// Buffers of one thread.
#[derive(Default)]
pub(crate) struct KernelBuffers {
    batches: Vec<Kernels>,
    coming: Coming,
    /// By segments and blocks.
    windows: Vec<Vec<Window>>,
    slabs: Vec<Vec<OpenSlabs>>,
    none: Vec<Vec<()>>,
}

/// Buffers for batches, for what is open, and for what is seen.
type Buffers<'a, O> = ((&'a mut Vec<Kernels>, &'a mut Coming), &'a mut Vec<Vec<O>>, &'a mut Runs);

impl Compositor<'_> {
    /// The same for a picture of every second pixel, or of still fewer.
    pub(crate) fn of_every(self, step: usize) -> Self {
        Self { lens: self.lens.of_every(step), ..self }
    }

    /// Adds the records of a tile's list, which come from near to far, to the runs of a set of its blocks, which are clear. Gives
    /// the numbers of pixels that were evaluated, and of those where a kernel came later than its place in a window.
    #[inline(always)]
    pub(crate) fn add<S: Simd>(
        &self,
        simd: S,
        tile: (Tile, &[AtomicU32], u64),
        cuts: &Cuts,
        (buffers, runs): (&mut KernelBuffers, &mut Runs),
    ) -> [u64; 2] {
        let KernelBuffers { batches, coming, windows, slabs, none } = buffers;
        let fetched = (batches, coming);
        let count = match (&self.lens.closing, self.keeps_depth) {
            (Closing::Centers { .. }, false) => {
                self.add_to::<S, Centers<S>, false>(simd, tile, (cuts, ()), (fetched, none, runs))
            }
            (Closing::Centers { .. }, true) => {
                self.add_to::<S, Centers<S>, true>(simd, tile, (cuts, ()), (fetched, none, runs))
            }
            (Closing::PerPixel, _) => {
                self.add_to::<S, Windowed<S>, true>(simd, tile, (cuts, ()), (fetched, windows, runs))
            }
            (closing, false) => {
                self.add_to::<S, Slabbed<S>, false>(simd, tile, (cuts, closing), (fetched, slabs, runs))
            }
            (closing, true) => {
                self.add_to::<S, Slabbed<S>, true>(simd, tile, (cuts, closing), (fetched, slabs, runs))
            }
        };
        let late = windows.iter_mut().flatten().map(|window| std::mem::take(&mut window.late)).sum();
        [count, late]
    }

    #[inline(always)]
    fn add_to<S: Simd, O: Opening<S>, const DEPTH: bool>(
        &self,
        simd: S,
        (tile, list, drawn): (Tile, &[AtomicU32], u64),
        (cuts, policy): (&Cuts, O::Policy<'_>),
        ((batches, coming), opens, runs): Buffers<O::Open>,
    ) -> u64 {
        let segments = cuts.segments();
        opens.resize_with(segments.max(opens.len()), Vec::new);
        for blocks in &mut opens[..segments] {
            blocks.resize_with(tile.blocks().max(blocks.len()), O::Open::default);
        }
        batches.resize_with(GROUP, || Kernels::NONE);
        coming.clear();
        let mut list = list.iter();
        let mut open = drawn;
        let hidden_from = self.hidden_from(tile, cuts);
        let hidden_from = hidden_from.as_ref();
        let mut seeing = self.seeing(simd, (tile, list.as_slice(), coming), hidden_from);
        let mut count = 0;
        while open != 0 {
            open &= seeing;
            let mut used = 0;
            while used < GROUP
                && open & seeing != 0
                && apart(
                    simd,
                    #[inline(always)]
                    || {
                        let all = (self.records, &self.lens.closing);
                        coming.gather(simd, &mut list, all, &mut batches[used].slabs)
                    },
                )
            {
                apart(
                    simd,
                    #[inline(always)]
                    || self.fetch(simd, (tile, &coming.records), cuts, &mut batches[used]),
                );
                used += 1;
                seeing = self.seeing(simd, (tile, list.as_slice(), coming), hidden_from);
            }
            if used == 0 {
                break;
            }
            let mut blocks = open;
            while blocks != 0 {
                let here = Here { tile, block: blocks.trailing_zeros() as usize % MAX_BLOCKS };
                blocks &= blocks - 1;
                let batches = (cuts, &batches[..used]);
                let (added, is_open) =
                    self.add_group::<S, O, DEPTH>(simd, (here, policy), batches, (opens, runs));
                count += u64::from(added);
                open &= !(u64::from(!is_open) << here.block);
            }
        }
        if let Some(next) = list.as_slice().first() {
            // Lists that go on in another way from here on are the same until here, batch by batch.
            let records = coming.records.iter().copied().chain([next.load(Relaxed)]);
            runs.reached = records.map(|record| self.reach(tile, record)).fold(0.0, f32::max);
        }
        if O::KEEPS_OPEN {
            for block in tile.visible_blocks().filter(|block| drawn >> block & 1 != 0) {
                let mut through = Through::all(simd);
                let cuts = cuts.layers(block).map(Some).chain(std::iter::repeat(None));
                for ((blocks, opens), cut) in runs.segments[..segments].iter_mut().zip(&mut *opens).zip(cuts)
                {
                    let (seen, open) = (&mut blocks[block], &mut opens[block]);
                    if DEPTH {
                        through.tell(simd, seen);
                    }
                    let mut opening = O::load(simd, seen, open);
                    opening.finish::<DEPTH>(simd, policy, open);
                    opening.store(seen, open);
                    if DEPTH {
                        through = through.pass(simd, seen.opacity.load(simd), cut);
                    }
                }
            }
        }
        count * PIXELS as u64
    }

    /// Brings records together.
    #[inline(always)]
    fn fetch<S: Simd>(&self, simd: S, (tile, list): (Tile, &[u32]), cuts: &Cuts, kernels: &mut Kernels) {
        kernels.fill(simd, (tile, &self.lens, cuts.hidden()), list, (self.records, self.rects));
    }

    /// Adds batches to the runs of a block; gives the number of kernels, and whether the block still sees anything.
    #[inline(always)]
    fn add_group<S: Simd, O: Opening<S>, const DEPTH: bool>(
        &self,
        simd: S,
        (here, policy): (Here, O::Policy<'_>),
        (cuts, batches): (&Cuts, &[Kernels]),
        (opens, runs): (&mut [Vec<O::Open>], &mut Runs),
    ) -> (u32, bool) {
        let own_cuts = cuts.block(here.block);
        let (mut count, mut is_open) = (0, true);
        let corner = here.tile.corner_pixel(here.block);
        let pixels = here.pixels(simd);
        let open = &mut opens[0][here.block];
        let mut opening = O::load(simd, &runs.segments[0][here.block], open);
        for kernels in batches {
            let mut todo = kernels.masks.of(here.block);
            if todo == 0 {
                continue;
            }
            let mut whole = kernels.whole;
            let mut spans = None;
            if own_cuts.layers > 0 {
                let own = apart(
                    simd,
                    #[inline(always)]
                    || kernels.spans_in(simd, (corner, self.lens.reach_to_cuts)),
                );
                let end = [own_cuts.nearest, own_cuts.hidden];
                let visible = kernels.places(simd, Some(&own), (None, end));
                (todo, whole) = (todo & visible.touched, visible.whole());
                spans = Some(own);
            }
            count += todo.count_ones();
            runs.rough |= u64::from(todo & kernels.rough != 0) << here.block;
            if todo & !(whole & kernels.plain) == 0 {
                let ray_length = self.plain_ray_lengths::<S, O, DEPTH>(simd, kernels, pixels, here);
                let plain = Plain { kernels, set: todo, corner, pixels, ray_length, segment: None };
                opening.add_plain::<DEPTH>(simd, plain, policy, &mut opens[0][here.block]);
            } else {
                opening.store(&mut runs.segments[0][here.block], &mut opens[0][here.block]);
                apart(
                    simd,
                    #[inline(always)]
                    || {
                        let batch = (kernels, todo, spans.as_ref());
                        self.add_mixed::<S, O, DEPTH>(simd, (here, policy), batch, (cuts, opens, runs));
                    },
                );
                opening = O::load(simd, &runs.segments[0][here.block], &mut opens[0][here.block]);
            }
            is_open =
                opening.seen().opacity.simd_lt(W::simd_from(simd, 1.0 - self.least_transmittance)).any_true();
            if !is_open {
                break;
            }
        }
        opening.store(&mut runs.segments[0][here.block], &mut opens[0][here.block]);
        (count, is_open)
    }

    /// Adds kernels of which some are not plain, or not whole, to the segments of a block, in their order.
    #[inline(always)]
    fn add_mixed<S: Simd, O: Opening<S>, const DEPTH: bool>(
        &self,
        simd: S,
        (here, policy): (Here, O::Policy<'_>),
        (kernels, todo, spans): (&Kernels, u64, Option<&Spans>),
        (cuts, opens, runs): (&Cuts, &mut [Vec<O::Open>], &mut Runs),
    ) {
        let layers = cuts.layers(here.block).map(Some).chain(std::iter::repeat(None));
        let runs = runs.segments.iter_mut().zip(opens).take(cuts.block(here.block).segments);
        let mut through = Through::all(simd);
        let mut before = None;
        for (number, ((seen, open), cut)) in runs.zip(layers).enumerate() {
            let (seen, open) = (&mut seen[here.block], &mut open[here.block]);
            let to = cuts.depth(number, here.block).load(simd);
            let segment = Segment::behind(simd, (before, self.lens.near), to, (kernels, spans));
            before = Some(segment);
            let set = todo & segment.touched();
            if DEPTH {
                through.tell(simd, seen);
            }
            if set != 0 {
                let mut opening = O::load(simd, seen, open);
                self.add_share::<S, O, DEPTH>(
                    simd,
                    (here, policy),
                    (kernels, set, segment),
                    (&mut opening, open),
                );
                opening.store(seen, open);
            }
            if DEPTH {
                through = through.pass(simd, seen.opacity.load(simd), cut);
            }
        }
    }

    /// |v| of a block's rays where plain kernels, or how they are closed, ask for it, else 1.
    #[inline(always)]
    fn plain_ray_lengths<S: Simd, O: Opening<S>, const DEPTH: bool>(
        &self,
        simd: S,
        kernels: &Kernels,
        pixels: [W<S>; 2],
        here: Here,
    ) -> W<S> {
        // What is closed before a centre is told by distances, and where what is closed lies.
        if O::KEEPS_OPEN && (DEPTH || self.lens.closing.is_mixed()) {
            self.lens.ray_lengths(simd, pixels, here.tile)
        } else {
            kernels.plain_ray_lengths(simd, pixels, (here.tile, &self.lens))
        }
    }

    /// Adds what a segment has of kernels of any kind and form.
    #[inline(always)]
    fn add_share<S: Simd, O: Opening<S>, const DEPTH: bool>(
        &self,
        simd: S,
        (here, policy): (Here, O::Policy<'_>),
        (kernels, mut todo, segment): (&Kernels, u64, Segment<S>),
        (opening, open): (&mut O, &mut O::Open),
    ) {
        let (corner, pixels) = (here.tile.corner_pixel(here.block), here.pixels(simd));
        let mut plain_here = segment.whole() & kernels.plain;
        if O::CUTS_PLAIN {
            plain_here |= kernels.plain_media();
        }
        let ray_length = self.plain_ray_lengths::<S, O, DEPTH>(simd, kernels, pixels, here);
        loop {
            let set = before(todo, todo & !plain_here);
            let plain = Plain { kernels, set, corner, pixels, ray_length, segment: Some(segment) };
            opening.add_plain::<DEPTH>(simd, plain, policy, open);
            todo ^= set;
            if todo == 0 {
                break;
            }
            let number = todo.trailing_zeros() as usize % BATCH;
            todo &= todo - 1;
            let Fragments { strength, depth, sigma_z } =
                kernels.fragments(simd, number, pixels, (here.tile, &self.lens));
            let [alpha, optical_depth] = if kernels.is_opacity(number) {
                [strength, optical_depth(simd, strength)]
            } else {
                [kernels.opacity(simd, number, strength), strength]
            };
            let ray_length = self.lens.ray_lengths(simd, pixels, here.tile);
            let distance = kernels.distance(simd, number, pixels, depth * ray_length);
            let mut fragment = Fragment {
                kernels,
                number,
                corner,
                alpha,
                optical_depth,
                depth,
                sigma_z,
                distance,
                ray_length,
                color: kernels.color(number),
                segment: None,
            };
            if segment.whole() >> number & 1 == 0 {
                segment.cut(simd, &mut fragment);
            }
            opening.add::<DEPTH>(simd, fragment, policy, open);
        }
    }
}

/// The bits of a set below the lowest of another one.
fn before(set: u64, other: u64) -> u64 {
    if other == 0 { set } else { set & ((1 << other.trailing_zeros()) - 1) }
}
