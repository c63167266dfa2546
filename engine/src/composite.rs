//! Stage `composite`: fragments to runs. Between cuts things add, cuts fold with *over*.
//!
//! Order `Centers`: every splat is closed before the next opens. What is behind an opaque cut is left out, a kernel
//! between two cuts belongs to one run, and only where a cut goes through a kernel is it shared out between runs.

use crate::cuts::Cuts;
use crate::footprint::{Record, Rect};
use crate::raster::{BATCH, Fragments, KernelLens, Kernels, REACH};
use crate::simd::*;
use crate::tile::{MAX_BLOCKS, PIXELS, Plane, Tile, pixels};
use std::sync::atomic::{AtomicU32, Ordering};

/// What is seen of a block of pixels so far.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Seen {
    /// Red, green, blue, each times its contribution.
    pub(crate) color: [Plane; 3],
    /// What does not pass. Kept instead of the transmittance, of which 1 − α loses the thinnest media.
    pub(crate) opacity: Plane,
    /// z times its contribution; kept only where it is asked for.
    pub(crate) depth: Plane,
}

impl Seen {
    /// Nothing there.
    pub(crate) const CLEAR: Self = Self { color: [Plane::ZERO; 3], opacity: Plane::ZERO, depth: Plane::ZERO };
}

/// The runs of a tile: for each segment between cuts, near to far, its blocks.
pub(crate) struct Runs {
    segments: Vec<Vec<Seen>>,
}

impl Runs {
    pub(crate) fn new() -> Self {
        Self { segments: Vec::new() }
    }

    /// Clears as many segments as the cuts make.
    #[inline(always)]
    fn clear<S: Simd>(&mut self, simd: S, tile: Tile, segments: usize) {
        self.segments.resize_with(segments.max(self.segments.len()), Vec::new);
        for blocks in &mut self.segments[..segments] {
            blocks.clear();
            blocks.resize(tile.blocks(), Seen::CLEAR);
        }
        // What lies beside the picture is done.
        for (number, block) in self.segments[0].iter_mut().enumerate() {
            let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
            block.opacity.store(tile.inside(simd, number).select(zero, one));
        }
    }

    /// What the pixels of a block send and let through in a segment.
    pub(crate) fn block(&self, segment: usize, block: usize) -> &Seen {
        &self.segments[segment][block]
    }
}

/// Adds fragments to runs.
pub(crate) struct Compositor<'a> {
    pub(crate) records: &'a [Record],
    pub(crate) rects: &'a [Rect],
    pub(crate) lens: KernelLens,
    pub(crate) spent: f32,
    /// Whether the mean depth of what is seen is asked for.
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
const GROUP: usize = 4;

/// Buffers of one thread.
#[derive(Default)]
pub(crate) struct KernelBuffers {
    batches: Vec<Kernels>,
}

impl Compositor<'_> {
    /// Clears the runs and adds the records of a tile's list, which come from near to far. Gives the number of
    /// pixels that were evaluated.
    #[inline(always)]
    pub(crate) fn add<S: Simd>(
        &self,
        simd: S,
        (tile, list): (Tile, &[AtomicU32]),
        cuts: &Cuts,
        (buffers, runs): (&mut KernelBuffers, &mut Runs),
    ) -> u64 {
        runs.clear(simd, tile, cuts.segments());
        buffers.batches.resize_with(GROUP, || Kernels::NONE);
        let mut open: u64 = tile.visible_blocks().map(|block| 1 << block).sum();
        let mut count = 0;
        for list in list.chunks(GROUP * BATCH) {
            let batches = &mut buffers.batches[..list.len().div_ceil(BATCH)];
            for (list, kernels) in list.chunks(BATCH).zip(batches.iter_mut()) {
                apart(
                    simd,
                    #[inline(always)]
                    || self.fetch(simd, (tile, list), cuts, kernels),
                );
            }
            let mut blocks = open;
            while blocks != 0 {
                let here = Here { tile, block: blocks.trailing_zeros() as usize % MAX_BLOCKS };
                blocks &= blocks - 1;
                let (added, is_open) = if self.keeps_depth {
                    self.add_group::<S, true>(simd, here, (cuts, batches), runs)
                } else {
                    self.add_group::<S, false>(simd, here, (cuts, batches), runs)
                };
                count += u64::from(added);
                open &= !(u64::from(!is_open) << here.block);
            }
            if open == 0 {
                break;
            }
        }
        count * PIXELS as u64
    }

    /// Brings records together.
    #[inline(always)]
    fn fetch<S: Simd>(
        &self,
        simd: S,
        (tile, list): (Tile, &[AtomicU32]),
        cuts: &Cuts,
        kernels: &mut Kernels,
    ) {
        let index = |number: usize| list[number].load(Ordering::Relaxed) as usize;
        let records = (0..list.len()).map(
            #[inline(always)]
            |number| &self.records[index(number)],
        );
        kernels.fill(simd, (tile, &self.lens, cuts.hidden()), records, |number| &self.rects[index(number)]);
    }

    /// Adds batches to the runs of a block; gives the number of kernels, and whether the block still sees anything.
    #[inline(always)]
    fn add_group<S: Simd, const DEPTH: bool>(
        &self,
        simd: S,
        here: Here,
        (cuts, batches): (&Cuts, &[Kernels]),
        runs: &mut Runs,
    ) -> (u32, bool) {
        let own_cuts = cuts.block(here.block);
        let (mut count, mut is_open) = (0, true);
        let mut seen = Seeing::load(simd, &runs.segments[0][here.block]);
        for kernels in batches {
            let mut todo = kernels.masks.of(here.block);
            let mut whole = kernels.whole;
            if todo != 0 && own_cuts.layers > 0 {
                let limits = [self.lens.near, own_cuts.nearest, own_cuts.hidden];
                let places = apart(
                    simd,
                    #[inline(always)]
                    || kernels.places_in(simd, here.tile.corner_pixel(here.block), limits),
                );
                (todo, whole) = (todo & !places.hidden, places.whole);
            }
            count += todo.count_ones();
            if todo & !(whole & kernels.plain) == 0 {
                seen.add::<DEPTH>(simd, here, (kernels, todo));
            } else {
                seen.store(&mut runs.segments[0][here.block]);
                apart(
                    simd,
                    #[inline(always)]
                    || {
                        let batch = (kernels, todo, whole);
                        self.add_mixed::<S, DEPTH>(simd, here, batch, (cuts, runs));
                    },
                );
                seen = Seeing::load(simd, &runs.segments[0][here.block]);
            }
            is_open = seen.opacity.simd_lt(W::simd_from(simd, 1.0 - self.spent)).any_true();
            if !is_open {
                break;
            }
        }
        seen.store(&mut runs.segments[0][here.block]);
        (count, is_open)
    }

    /// Adds kernels of which some are not plain, or not whole, in their order.
    #[inline(always)]
    fn add_mixed<S: Simd, const DEPTH: bool>(
        &self,
        simd: S,
        here: Here,
        (kernels, mut todo, whole): (&Kernels, u64, u64),
        (cuts, runs): (&Cuts, &mut Runs),
    ) {
        let pixels = here.pixels(simd);
        while todo != 0 {
            let next = before(todo, todo & !(whole & kernels.plain));
            todo ^= next;
            let first_run = &mut runs.segments[0][here.block];
            let mut seen = Seeing::load(simd, first_run);
            seen.add::<DEPTH>(simd, here, (kernels, next));
            if todo != 0 {
                let number = todo.trailing_zeros() as usize % BATCH;
                todo &= todo - 1;
                if whole >> number & 1 != 0 {
                    let alpha = kernels.alpha(simd, number, pixels, (here.tile, &self.lens));
                    let shown = seen.blend(simd, alpha, kernels.color(number));
                    if DEPTH {
                        seen.depth = shown.mul_add(kernels.depth_at(simd, number, pixels), seen.depth);
                    }
                } else {
                    seen.store(first_run);
                    self.add_shares(simd, here, (kernels, number), (cuts, runs));
                    continue;
                }
            }
            seen.store(first_run);
        }
    }

    /// Shares a kernel of any kind and form out between the runs of a block:
    /// share_j = Φ((z_{j+1} − z)/σ_z) − Φ((z_j − z)/σ_z).
    #[inline(always)]
    fn add_shares<S: Simd>(
        &self,
        simd: S,
        here: Here,
        (kernels, number): (&Kernels, usize),
        (cuts, runs): (&Cuts, &mut Runs),
    ) {
        let Fragments { strength, depth, sigma_z } =
            kernels.fragments(simd, number, here.pixels(simd), (here.tile, &self.lens));
        let color = kernels.color(number);
        let is_opacity = kernels.is_opacity(number);
        let tau = if is_opacity { optical_depth(simd, strength) } else { strength };
        let inverse = reciprocal(simd, sigma_z.max(W::simd_from(simd, 1e-20)));
        let mut from = W::simd_from(simd, self.lens.near);
        let mut before_from = share_before(simd, (from - depth) * inverse);
        let segments = cuts.block(here.block).segments;
        for (segment, blocks) in runs.segments[..segments].iter_mut().enumerate() {
            let seen = &mut blocks[here.block];
            let to = cuts.depth(segment, here.block).load(simd);
            let before_to = share_before(simd, (to - depth) * inverse);
            let own_tau = tau * (before_to - before_from);
            let zero = W::simd_from(simd, 0.0);
            if own_tau.simd_gt(zero).any_true() {
                let alpha = kernels.opacity(simd, number, own_tau.max(zero));
                let mut open = Seeing::load(simd, seen);
                let shown = open.blend(simd, alpha, color);
                open.store(seen);
                if self.keeps_depth {
                    seen.depth.add_product(simd, shown, depth.max(from).min(to));
                }
            }
            (from, before_from) = (to, before_to);
        }
    }
}

/// [`Seen`] in registers: what a block of rays sends towards the camera, and does not let through.
#[derive(Clone, Copy)]
pub(crate) struct Seeing<S: Simd> {
    pub(crate) opacity: W<S>,
    pub(crate) color: [W<S>; 3],
    pub(crate) depth: W<S>,
}

impl<S: Simd> Seeing<S> {
    #[inline(always)]
    pub(crate) fn load(simd: S, seen: &Seen) -> Self {
        let Seen { opacity, color: [red, green, blue], depth } = seen;
        Self {
            opacity: opacity.load(simd),
            color: [red.load(simd), green.load(simd), blue.load(simd)],
            depth: depth.load(simd),
        }
    }

    #[inline(always)]
    fn store(&self, seen: &mut Seen) {
        seen.opacity.store(self.opacity);
        for (plane, color) in seen.color.iter_mut().zip(self.color) {
            plane.store(color);
        }
        seen.depth.store(self.depth);
    }

    /// One layer alone.
    #[inline(always)]
    pub(crate) fn layer(color: [W<S>; 3], depth: W<S>, alpha: W<S>) -> Self {
        let color = color.each(
            #[inline(always)]
            |c| c * alpha,
        );
        Self { opacity: alpha, color, depth: depth * alpha }
    }

    /// (C, T)∘(C', T') = (C + T·C', T·T').
    #[inline(always)]
    pub(crate) fn over(self, simd: S, behind: Self) -> Self {
        let through = W::simd_from(simd, 1.0) - self.opacity;
        Self {
            opacity: behind.opacity.mul_add(through, self.opacity),
            color: [0, 1, 2].each(
                #[inline(always)]
                |i| behind.color[i].mul_add(through, self.color[i]),
            ),
            depth: behind.depth.mul_add(through, self.depth),
        }
    }

    /// The same with an opacity and a colour of one splat behind; gives T·α.
    #[inline(always)]
    fn blend(&mut self, simd: S, alpha: W<S>, color: [f32; 3]) -> W<S> {
        let shown = (-self.opacity).mul_add(alpha, alpha);
        self.opacity += shown;
        for (sum, own) in self.color.iter_mut().zip(color) {
            *sum = shown.mul_add(W::simd_from(simd, own), *sum);
        }
        shown
    }

    /// Adds plain kernels.
    #[inline(always)]
    fn add<const DEPTH: bool>(&mut self, simd: S, here: Here, (kernels, mut set): (&Kernels, u64)) {
        let pixels = here.pixels(simd);
        while set != 0 {
            let number = set.trailing_zeros() as usize % BATCH;
            set &= set - 1;
            let alpha = kernels.plain_alpha(simd, number, pixels);
            let shown = self.blend(simd, alpha, kernels.color(number));
            if DEPTH {
                self.depth = shown.mul_add(kernels.depth_at(simd, number, pixels), self.depth);
            }
        }
    }
}

/// The bits of a set below the lowest of another one.
fn before(set: u64, other: u64) -> u64 {
    if other == 0 { set } else { set & ((1 << other.trailing_zeros()) - 1) }
}

/// Φ(x): the share of a kernel before a depth that lies xσ_z behind its middle.
#[inline(always)]
fn share_before<S: Simd>(simd: S, x: W<S>) -> W<S> {
    if x.abs().simd_lt(W::simd_from(simd, REACH)).any_true() {
        return normal_cdf(simd, x);
    }
    let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
    x.simd_gt(zero).select(one, zero)
}
