//! The tiles of a picture, on all threads.

use super::watched;
use crate::composite::{Compositor, KernelBuffers, Runs};
use crate::cuts::{Cuts, KeptCuts};
use crate::footprint::Rect;
use crate::frame::{Clear, FrameRows};
use crate::lattice::{Lattice, STEP};
use crate::layers::{LayerBuffers, LayerBuilder};
use crate::observer::{Observer, Stage};
use crate::occlusion::Looked;
use crate::resolve::{Resolved, Resolver};
use crate::simd::{Level, dispatch};
use crate::tile::{BLOCK_SIDE, Tile};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

/// Buffers of one thread.
pub(super) struct TileBuffers {
    layers: LayerBuffers,
    cuts: Cuts,
    kernels: KernelBuffers,
    runs: Runs,
    /// What of a longer list touches a tile.
    list: Vec<AtomicU32>,
    resolved: Resolved,
}

impl TileBuffers {
    fn new() -> Self {
        Self {
            layers: LayerBuffers::default(),
            cuts: Cuts::new(),
            kernels: KernelBuffers::default(),
            runs: Runs::new(),
            list: Vec::new(),
            resolved: Resolved::default(),
        }
    }
}

/// Does something for each number up to a count, with the buffers of the thread that does it.
pub(super) fn for_each(
    threads: &mut Vec<Mutex<TileBuffers>>,
    count: usize,
    run: impl Fn(usize, &mut TileBuffers) + Sync,
) {
    let own = rayon::current_num_threads().max(1);
    threads.resize_with(own.max(threads.len()), || Mutex::new(TileBuffers::new()));
    let next = AtomicUsize::new(0);
    threads[..own].par_iter().with_max_len(1).for_each(|buffers| {
        let mut buffers = buffers.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            let index = next.fetch_add(1, Relaxed);
            if index >= count {
                break;
            }
            run(index, &mut buffers);
        }
    });
}

/// Where a tile is written.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    /// Its number.
    pub(super) index: usize,
    /// The frame from its first rows on.
    pub(super) bands: &'a [Mutex<FrameRows<'a>>],
    pub(super) clear: &'a Clear,
}

/// Draws tiles.
pub(super) struct TileDrawer<'a> {
    pub(super) layers: LayerBuilder<'a>,
    pub(super) compositor: Compositor<'a>,
    pub(super) resolver: Resolver<'a>,
    pub(super) looked: &'a Looked,
    pub(super) observer: &'a dyn Observer,
    pub(super) level: Level,
}

impl TileDrawer<'_> {
    /// Draws what volumes alone send at the pixels of a lattice's tile; where there are surfaces it stays unknown. Gives what
    /// [`Self::draw`] gives.
    pub(super) fn sample(
        &self,
        (lattice, index): (&Lattice, usize),
        (volumes, has_surfaces): (&[AtomicU32], bool),
        buffers: &mut TileBuffers,
    ) -> [u64; 2] {
        let TileBuffers { cuts, kernels, runs, .. } = buffers;
        let (tile, reached) = lattice.tile(index);
        let mut counts = [0; 2];
        watched(self.observer, Stage::Composite, || {
            cuts.clear();
            dispatch!(self.level, simd => {
                runs.clear(simd, tile, cuts.segments());
                if !has_surfaces {
                    let list = (tile, volumes, tile.visible_set());
                    counts = self.compositor.of_every(STEP).add(simd, list, cuts, (kernels, runs));
                }
            });
            lattice.store(tile, (!has_surfaces).then_some(&*runs));
            // Where nothing is drawn the picture's own tiles say how far they look.
            let looked = if has_surfaces { 0.0 } else { runs.reached };
            reached.store(looked.to_bits(), Relaxed);
        });
        counts
    }

    /// Finds the cuts of a tile from its list of surfaces, and says how far it looked; gives the number of pixels that were evaluated.
    fn cut(
        &self,
        (tile, surfaces): (Tile, &[AtomicU32]),
        (layers, cuts): (&mut LayerBuffers, &mut Cuts),
    ) -> u64 {
        let Self { layers: builder, looked, observer, level, .. } = self;
        if surfaces.is_empty() {
            // What a frame begins with says that all is seen.
            cuts.clear();
            return 0;
        }
        let count = watched(
            *observer,
            Stage::Layers,
            || dispatch!(*level, simd => builder.build(simd, (tile, surfaces), layers, cuts)),
        );
        looked.store_cuts(tile, cuts);
        count
    }

    /// Finds a tile's cuts for when its volumes are drawn; gives the number of pixels that were evaluated.
    pub(super) fn keep_cuts(
        &self,
        (tile, surfaces): (Tile, &[AtomicU32]),
        TileBuffers { layers, cuts, .. }: &mut TileBuffers,
        (kept, index): (&KeptCuts, usize),
    ) -> u64 {
        let count = self.cut((tile, surfaces), (layers, cuts));
        kept.keep(index, cuts);
        count
    }

    /// Draws a tile of which there are surfaces alone; gives the number of pixels that were evaluated.
    pub(super) fn draw_surfaces(
        &self,
        (tile, surfaces): (Tile, &[AtomicU32]),
        TileBuffers { layers, cuts, resolved, .. }: &mut TileBuffers,
        place: Place,
    ) -> u64 {
        let count = self.cut((tile, surfaces), (layers, cuts));
        if !place.clear.stays(place.index, surfaces.is_empty()) {
            self.resolve(tile, (cuts, None), (resolved, place.bands));
        }
        count
    }

    /// Draws a tile from its cuts, or its list of surfaces where these were not kept, and its list of volumes, that of the lattice's
    /// tile that it is in if there is one; gives the numbers of pixels that were evaluated, and where kernels came late.
    pub(super) fn draw(
        &self,
        (tile, [surfaces, volumes]): (Tile, [&[AtomicU32]; 2]),
        buffers: &mut TileBuffers,
        (kept, lattice, place): (&KeptCuts, &Lattice, Place),
    ) -> [u64; 2] {
        let Self { compositor, resolver, looked, observer, level, .. } = self;
        let TileBuffers { layers, cuts, kernels, runs, list, resolved } = buffers;
        if surfaces.is_empty() || !kept.restore(place.index, cuts) {
            self.cut((tile, surfaces), (layers, cuts));
        }
        let mut found = [0; 2];
        let has_runs = !volumes.is_empty();
        let mut reached = f32::INFINITY;
        if has_runs {
            found = watched(*observer, Stage::Composite, || {
                let mut open = tile.visible_set();
                dispatch!(*level, simd => runs.clear(simd, tile, cuts.segments()));
                let mut volumes = volumes;
                if lattice.is_used() {
                    let tolerance = resolver.settings.tolerance as f32;
                    if surfaces.is_empty() {
                        open = dispatch!(*level, _simd => lattice.fill(tile, tolerance, runs));
                    }
                    reached = lattice.reached(tile);
                    if open == 0 {
                        return [0; 2];
                    }
                    list.clear();
                    list.extend(touching(volumes, compositor.rects, (tile, open)));
                    volumes = list;
                }
                let found = dispatch!(*level, simd => compositor.add(simd, (tile, volumes, open), cuts, (kernels, runs)));
                reached = if lattice.is_used() { reached.max(runs.reached) } else { runs.reached };
                found
            });
        }
        looked.store_reached(tile, reached);
        if !place.clear.stays(place.index, surfaces.is_empty() && !has_runs) {
            self.resolve(tile, (cuts, has_runs.then_some(&*runs)), (resolved, place.bands));
        }
        found
    }

    fn resolve(
        &self,
        tile: Tile,
        (cuts, runs): (&Cuts, Option<&Runs>),
        (resolved, bands): (&mut Resolved, &[Mutex<FrameRows>]),
    ) {
        let Self { resolver, observer, level, .. } = self;
        watched(*observer, Stage::Resolve, || {
            dispatch!(*level, simd => resolver.tile(simd, tile, (cuts, runs), (resolved, bands)));
        });
    }
}

/// Those of a list whose rectangles touch a set of a tile's blocks.
fn touching(
    list: &[AtomicU32],
    rects: &[Rect],
    (tile, blocks): (Tile, u64),
) -> impl Iterator<Item = AtomicU32> {
    // First by the rectangle around them, which most are beside.
    let mut around = [[usize::MAX, 0]; 2];
    for block in tile.visible_blocks().filter(|block| blocks >> block & 1 != 0) {
        for (axis, [first, end]) in around.iter_mut().enumerate() {
            let from = tile.origin[axis] + tile.corner(block)[axis];
            (*first, *end) = ((*first).min(from), (*end).max(from + BLOCK_SIDE));
        }
    }
    let touches = move |record: &u32| {
        let rect @ Rect { min, max } = &rects[*record as usize];
        (0..2)
            .all(|axis| usize::from(min[axis]) < around[axis][1] && usize::from(max[axis]) > around[axis][0])
            && tile.blocks_of(rect) & blocks != 0
    };
    list.iter().map(|entry| entry.load(Relaxed)).filter(touches).map(AtomicU32::new)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn what_touches_blocks_is_listed_in_order(
            rects in prop::collection::vec((0..120_u16, 0..120_u16, 1..40_u16, 1..40_u16), 0..100),
            blocks in any::<u64>(),
            few in any::<u64>(),
            side in prop_oneof![Just(8_usize), Just(16), Just(32)],
        ) {
            // The picture ends in the tile.
            let tile = Tile::new([1, 2], side, [side + 7, 2 * side + 5]);
            let blocks = blocks & few & tile.visible_set();
            let rects: Vec<Rect> =
                rects.into_iter().map(|(x, y, w, h)| Rect { min: [x, y], max: [x + w, y + h] }).collect();
            let list: Vec<AtomicU32> = (0..rects.len() as u32).rev().map(AtomicU32::new).collect();
            let touches = |i: &u32| tile.blocks_of(&rects[*i as usize]) & blocks != 0;
            let expected: Vec<u32> = (0..rects.len() as u32).rev().filter(touches).collect();
            let found: Vec<u32> =
                touching(&list, &rects, (tile, blocks)).map(|entry| entry.into_inner()).collect();
            prop_assert_eq!(found, expected);
        }
    }
}
