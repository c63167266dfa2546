//! Stage `composite`: fragments to runs. Between cuts things add, cuts fold with *over*.
//!
//! Order `Centers`: every splat is closed before the next opens. What is behind an opaque cut is left out, a kernel
//! between two cuts belongs to one run, and only where a cut goes through a kernel is it shared out between runs.

use crate::cuts::Cuts;
use crate::footprint::{Record, Rect};
use crate::raster::{BATCH, Fragments, KernelLens, Kernels, Places, REACH};
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

impl Seen {
    /// (C, T)∘(C', T') = (C + T·C', T·T'); gives T·α.
    #[inline(always)]
    fn blend<S: Simd>(&mut self, simd: S, alpha: W<S>, color: [f32; 3]) -> W<S> {
        let opacity = self.opacity.load(simd);
        let shown = (-opacity).mul_add(alpha, alpha);
        self.opacity.store(opacity + shown);
        for (plane, own) in self.color.iter_mut().zip(color) {
            plane.add_product(simd, shown, W::simd_from(simd, own));
        }
        shown
    }
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
    pub(crate) near: f32,
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

impl Compositor<'_> {
    /// Clears the runs and adds the records of a tile's list, which come from near to far. Gives the number of
    /// pixels that were evaluated.
    #[inline(always)]
    pub(crate) fn add<S: Simd>(
        &self,
        simd: S,
        (tile, list): (Tile, &[AtomicU32]),
        cuts: &Cuts,
        (kernels, runs): (&mut Kernels, &mut Runs),
    ) -> u64 {
        runs.clear(simd, tile, cuts.segments());
        let mut open: u64 = tile.visible_blocks().map(|block| 1 << block).sum();
        let mut count = 0;
        for list in list.chunks(BATCH) {
            let places = apart(
                simd,
                #[inline(always)]
                || self.fetch(simd, (tile, list), cuts, kernels),
            );
            let mut blocks = open;
            while blocks != 0 {
                let block = blocks.trailing_zeros() as usize % MAX_BLOCKS;
                blocks &= blocks - 1;
                let (added, is_open) =
                    self.add_batch(simd, Here { tile, block }, (cuts, kernels, &places), runs);
                count += u64::from(added);
                open &= !(u64::from(!is_open) << block);
            }
            if open == 0 {
                break;
            }
        }
        count * PIXELS as u64
    }

    /// Brings records together; says which are hidden in the whole tile, and which lie wholly behind the near plane.
    #[inline(always)]
    fn fetch<S: Simd>(
        &self,
        simd: S,
        (tile, list): (Tile, &[AtomicU32]),
        cuts: &Cuts,
        kernels: &mut Kernels,
    ) -> Places {
        let index = |number: usize| list[number].load(Ordering::Relaxed) as usize;
        let records = (0..list.len()).map(
            #[inline(always)]
            |number| &self.records[index(number)],
        );
        kernels.fill(simd, (tile, &self.lens), records, |number| &self.rects[index(number)]);
        kernels.places(simd, [self.near, cuts.hidden()])
    }

    /// Adds a batch to the runs of a block; gives the number of kernels, and whether the block still sees anything.
    #[inline(always)]
    fn add_batch<S: Simd>(
        &self,
        simd: S,
        here: Here,
        (cuts, kernels, places): (&Cuts, &Kernels, &Places),
        runs: &mut Runs,
    ) -> (u32, bool) {
        let mut todo = kernels.masks[here.block] & !places.hidden;
        if todo == 0 {
            return (0, true);
        }
        let own_cuts = cuts.block(here.block);
        let mut whole = places.whole;
        if own_cuts.layers > 0 {
            let limits = [self.near, own_cuts.nearest, own_cuts.hidden];
            let places = apart(
                simd,
                #[inline(always)]
                || kernels.places_in(simd, here.tile.corner_pixel(here.block), limits),
            );
            (todo, whole) = (todo & !places.hidden, places.whole);
        }
        // Those that the near plane or a cut may go through.
        let mut between = todo & !whole;
        let count = todo.count_ones();
        loop {
            let next = before(todo, between);
            todo ^= next;
            let is_open = self.plain(simd, here, (kernels, next), &mut runs.segments[0][here.block]);
            if todo == 0 || !is_open {
                return (count, is_open);
            }
            let number = between.trailing_zeros() as usize % BATCH;
            (todo, between) = (todo & (todo - 1), between & (between - 1));
            self.shared(simd, here, (kernels, number), (cuts, own_cuts.segments, runs));
        }
    }

    /// Adds whole kernels to one run; says whether something is still seen through it.
    #[inline(always)]
    fn plain<S: Simd>(&self, simd: S, here: Here, (kernels, set): (&Kernels, u64), seen: &mut Seen) -> bool {
        if self.keeps_depth || !kernels.are_thin(set) {
            apart(
                simd,
                #[inline(always)]
                || self.any_kernels(simd, here, (kernels, set), seen),
            );
        } else {
            thin_kernels(simd, here, (kernels, set), seen);
        }
        seen.opacity.load(simd).simd_lt(W::simd_from(simd, 1.0 - self.spent)).any_true()
    }

    /// Adds kernels of any kind and form to one run.
    #[inline(always)]
    fn any_kernels<S: Simd>(&self, simd: S, here: Here, (kernels, set): (&Kernels, u64), seen: &mut Seen) {
        let pixels = here.pixels(simd);
        for number in numbers(set) {
            let Fragments { strength, depth, .. } =
                kernels.fragments(simd, number, pixels, (here.tile, &self.lens));
            let alpha = if kernels.is_opacity(number) { strength } else { opacity(simd, strength) };
            let shown = seen.blend(simd, alpha, kernels.color(number));
            if self.keeps_depth {
                seen.depth.add_product(simd, depth, shown);
            }
        }
    }

    /// Shares a kernel out between the runs of a block:
    /// share_j = Φ((z_{j+1} − z)/σ_z) − Φ((z_j − z)/σ_z).
    #[inline(always)]
    fn shared<S: Simd>(
        &self,
        simd: S,
        here: Here,
        (kernels, number): (&Kernels, usize),
        (cuts, segments, runs): (&Cuts, usize, &mut Runs),
    ) {
        apart(
            simd,
            #[inline(always)]
            || {
                let Fragments { strength, depth, sigma_z } =
                    kernels.fragments(simd, number, here.pixels(simd), (here.tile, &self.lens));
                let color = kernels.color(number);
                let is_opacity = kernels.is_opacity(number);
                let tau = if is_opacity { optical_depth(simd, strength) } else { strength };
                let inverse = W::simd_from(simd, 1.0) / sigma_z.max(W::simd_from(simd, 1e-20));
                let mut from = W::simd_from(simd, self.near);
                let mut before_from = share_before(simd, (from - depth) * inverse);
                for (segment, blocks) in runs.segments[..segments].iter_mut().enumerate() {
                    let seen = &mut blocks[here.block];
                    let to = cuts.depth(segment, here.block).load(simd);
                    let before_to = share_before(simd, (to - depth) * inverse);
                    let share = (before_to - before_from).max(W::simd_from(simd, 0.0));
                    let alpha = kernels.opacity(simd, number, tau * share);
                    let shown = seen.blend(simd, alpha, color);
                    if self.keeps_depth {
                        seen.depth.add_product(simd, shown, depth.max(from).min(to));
                    }
                    (from, before_from) = (to, before_to);
                }
            },
        );
    }
}

/// Adds thin kernels to one run. What is seen stays in registers meanwhile.
#[inline(always)]
fn thin_kernels<S: Simd>(simd: S, here: Here, (kernels, set): (&Kernels, u64), seen: &mut Seen) {
    let mut opacity = seen.opacity.load(simd);
    let [mut red, mut green, mut blue] = seen.color.each_ref().each(
        #[inline(always)]
        |plane| plane.load(simd),
    );
    let pixels = here.pixels(simd);
    for number in numbers(set) {
        let alpha = kernels.thin_alpha(simd, number, pixels);
        let shown = (-opacity).mul_add(alpha, alpha);
        opacity += shown;
        let color: [W<S>; 3] = splat3(simd, kernels.color(number));
        red = shown.mul_add(color[0], red);
        green = shown.mul_add(color[1], green);
        blue = shown.mul_add(color[2], blue);
    }
    seen.opacity.store(opacity);
    for (color, plane) in [red, green, blue].into_iter().zip(&mut seen.color) {
        plane.store(color);
    }
}

/// The numbers of a set's bits.
#[inline(always)]
fn numbers(mut set: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(
        #[inline(always)]
        move || {
            let number = (set != 0).then_some(set.trailing_zeros() as usize % BATCH)?;
            set &= set - 1;
            Some(number)
        },
    )
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
