//! Stage `composite`: fragments to runs. Between cuts things add, cuts fold with *over*.
//!
//! Order `Centers`: every splat is closed before the next opens. What is behind an opaque cut is left out, a kernel
//! between two cuts belongs to one run, and only where a cut goes through a kernel is it shared out between runs.

use crate::columns::LANES;
use crate::cuts::Cuts;
use crate::footprint::{Record, Rect};
use crate::raster::{BATCH, Fragments, KernelLens, Kernels, Places, REACH};
use crate::simd::*;
use crate::tile::{BLOCK_SIDE, Block, Plane, Tile, add_products, first_pixels, load, store};
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
    pub(crate) const CLEAR: Self = Self {
        color: [[[0.0; LANES]; BLOCK_SIDE]; 3],
        opacity: [[0.0; LANES]; BLOCK_SIDE],
        depth: [[0.0; LANES]; BLOCK_SIDE],
    };
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
    fn clear(&mut self, tile: Tile, segments: usize) {
        self.segments.resize_with(segments.max(self.segments.len()), Vec::new);
        for blocks in &mut self.segments[..segments] {
            blocks.clear();
            blocks.resize(tile.blocks(), Seen::CLEAR);
        }
        // What lies beside the picture is done.
        for (number, block) in self.segments[0].iter_mut().enumerate() {
            let [columns, rows] = tile.visible(number);
            for (row, lanes) in block.opacity.iter_mut().enumerate() {
                lanes[if row < rows { columns } else { 0 }..].fill(1.0);
            }
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
struct Here<S: Simd> {
    tile: Tile,
    block: usize,
    /// Columns and rows, from the tile's first pixel, of its first two rows.
    pixels: [W<S>; 2],
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
        runs.clear(tile, cuts.segments());
        let mut open: u32 = tile.visible_blocks().map(|block| 1 << block).sum();
        let mut count = 0;
        for list in list.chunks(BATCH) {
            let places = apart(
                simd,
                #[inline(always)]
                || {
                    let index = |number: usize| list[number].load(Ordering::Relaxed) as usize;
                    let records = (0..list.len()).map(
                        #[inline(always)]
                        |number| &self.records[index(number)],
                    );
                    kernels.fill(simd, (tile, &self.lens), records, |number| &self.rects[index(number)]);
                    kernels.places(simd, [self.near, cuts.hidden()])
                },
            );
            let mut blocks = open;
            while blocks != 0 {
                let block = blocks.trailing_zeros() as usize;
                blocks &= blocks - 1;
                let here = Here { tile, block, pixels: first_pixels(simd, tile.corner_pixel(block)) };
                count += self.add_batch(simd, here, (cuts, kernels, &places), runs);
                let opacity = load(simd, &runs.segments[0][block].opacity);
                let least = opacity[0].min(opacity[1]).min(opacity[2].min(opacity[3]));
                if !least.simd_lt(W::simd_from(simd, 1.0 - self.spent)).any_true() {
                    open &= !(1 << block);
                }
            }
            if open == 0 {
                break;
            }
        }
        u64::from(count) * (BLOCK_SIDE * BLOCK_SIDE) as u64
    }

    /// Adds a batch to the runs of a block; gives the number of kernels.
    #[inline(always)]
    fn add_batch<S: Simd>(
        &self,
        simd: S,
        here: Here<S>,
        (cuts, kernels, places): (&Cuts, &Kernels, &Places),
        runs: &mut Runs,
    ) -> u32 {
        let mut todo = kernels.masks[here.block] & !places.hidden;
        let own_cuts = cuts.block(here.block);
        let mut whole = places.whole;
        if todo != 0 && own_cuts.layers > 0 {
            let limits = [self.near, own_cuts.nearest, own_cuts.hidden];
            let places = kernels.places_in(simd, here.tile.corner_pixel(here.block), limits);
            (todo, whole) = (todo & !places.hidden, places.whole);
        }
        // Those that the near plane or a cut may go through.
        let mut between = todo & !whole;
        let count = todo.count_ones();
        while todo != 0 {
            let next = before(todo, between);
            if next != 0 {
                self.plain(simd, here, (kernels, next), &mut runs.segments[0][here.block]);
                todo ^= next;
            }
            if between != 0 {
                let number = between.trailing_zeros() as usize % BATCH;
                between &= between - 1;
                todo &= todo - 1;
                self.shared(simd, here, (kernels, number), (cuts, own_cuts.segments, runs));
            }
        }
        count
    }

    /// Adds whole kernels to one run. What is seen stays in registers meanwhile.
    #[inline(always)]
    fn plain<S: Simd>(&self, simd: S, here: Here<S>, (kernels, set): (&Kernels, u64), seen: &mut Seen) {
        apart(
            simd,
            #[inline(always)]
            || {
                let mut opacity = load(simd, &seen.opacity);
                let [mut red, mut green, mut blue] = seen.color.each_ref().each(
                    #[inline(always)]
                    |plane| load(simd, plane),
                );
                let mut rest = set;
                while rest != 0 {
                    let number = rest.trailing_zeros() as usize % BATCH;
                    rest &= rest - 1;
                    let alpha = kernels.alpha(simd, number, here.pixels, (here.tile, &self.lens));
                    let color = kernels.color(number);
                    let mut shown = alpha;
                    for i in 0..4 {
                        shown[i] = (-opacity[i]).mul_add(alpha[i], alpha[i]);
                        opacity[i] += shown[i];
                        red[i] = shown[i].mul_add(W::simd_from(simd, color[0]), red[i]);
                        green[i] = shown[i].mul_add(W::simd_from(simd, color[1]), green[i]);
                        blue[i] = shown[i].mul_add(W::simd_from(simd, color[2]), blue[i]);
                    }
                    if self.keeps_depth {
                        self.add_depths(simd, here, (kernels, number), (&shown, &mut seen.depth));
                    }
                }
                store(opacity, &mut seen.opacity);
                for (color, plane) in [red, green, blue].into_iter().zip(&mut seen.color) {
                    store(color, plane);
                }
            },
        );
    }

    #[inline(always)]
    fn add_depths<S: Simd>(
        &self,
        simd: S,
        here: Here<S>,
        (kernels, number): (&Kernels, usize),
        (shown, plane): (&Block<S>, &mut Plane),
    ) {
        apart(
            simd,
            #[inline(always)]
            || {
                let fragments = kernels.fragments(simd, number, here.pixels, (here.tile, &self.lens));
                add_products(simd, plane, (fragments.depth, *shown));
            },
        );
    }

    /// Shares a kernel out between the runs of a block:
    /// share_j = Φ((z_{j+1} − z)/σ_z) − Φ((z_j − z)/σ_z).
    #[inline(always)]
    fn shared<S: Simd>(
        &self,
        simd: S,
        here: Here<S>,
        (kernels, number): (&Kernels, usize),
        (cuts, segments, runs): (&Cuts, usize, &mut Runs),
    ) {
        apart(
            simd,
            #[inline(always)]
            || {
                let fragments = kernels.fragments(simd, number, here.pixels, (here.tile, &self.lens));
                let color = kernels.color(number);
                let Fragments { strength: mut tau, depth, sigma_z } = fragments;
                let mut inverse = sigma_z;
                for i in 0..4 {
                    if kernels.is_opacity(number) {
                        tau[i] = optical_depth(simd, tau[i]);
                    }
                    inverse[i] = W::simd_from(simd, 1.0) / sigma_z[i].max(W::simd_from(simd, 1e-20));
                }
                let mut from = [W::simd_from(simd, self.near); 4];
                let mut before_from = shares_before(simd, &from, (&depth, &inverse));
                for (segment, blocks) in runs.segments[..segments].iter_mut().enumerate() {
                    let seen = &mut blocks[here.block];
                    let to = load(simd, cuts.depth(segment, here.block));
                    let before_to = shares_before(simd, &to, (&depth, &inverse));
                    let mut opacity = load(simd, &seen.opacity);
                    let (mut shown, mut middle) = (to, to);
                    for i in 0..4 {
                        let share = (before_to[i] - before_from[i]).max(W::simd_from(simd, 0.0));
                        let alpha = kernels.opacity(simd, number, tau[i] * share);
                        shown[i] = (-opacity[i]).mul_add(alpha, alpha);
                        opacity[i] += shown[i];
                        middle[i] = depth[i].max(from[i]).min(to[i]);
                    }
                    store(opacity, &mut seen.opacity);
                    for (plane, own) in seen.color.iter_mut().zip(color) {
                        add_products(simd, plane, ([W::simd_from(simd, own); 4], shown));
                    }
                    if self.keeps_depth {
                        add_products(simd, &mut seen.depth, (middle, shown));
                    }
                    (from, before_from) = (to, before_to);
                }
            },
        );
    }
}

/// The bits of a set below the lowest of another one.
fn before(set: u64, other: u64) -> u64 {
    if other == 0 { set } else { set & ((1 << other.trailing_zeros()) - 1) }
}

/// The shares of a kernel before some depths: Φ((depth − z)/σ_z), given z and 1/σ_z.
#[inline(always)]
fn shares_before<S: Simd>(simd: S, depths: &Block<S>, (z, inverse): (&Block<S>, &Block<S>)) -> Block<S> {
    let reach = W::simd_from(simd, REACH);
    let mut away = *depths;
    for i in 0..4 {
        away[i] = (depths[i] - z[i]) * inverse[i];
    }
    let near = away.each(
        #[inline(always)]
        |x| x.abs().simd_lt(reach),
    );
    if ((near[0] | near[1]) | (near[2] | near[3])).any_true() {
        return away.each(
            #[inline(always)]
            |x| normal_cdf(simd, x),
        );
    }
    let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
    away.each(
        #[inline(always)]
        |x| x.simd_gt(zero).select(one, zero),
    )
}
