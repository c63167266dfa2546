//! Cuts: the surface layers of a tile's pixels, as the compositor and the resolver see them.

mod kept;

use crate::frame::LEAST_VISIBLE;
use crate::simd::*;
use crate::tile::{MAX_BLOCKS, PIXELS, Plane, Tile};

pub(crate) use kept::KeptCuts;
use std::borrow::Cow;

/// The most layers of a pixel; the last takes whatever is left. Meshes end at eight, along their silhouettes: this is
/// for clouds of points so far away that hundreds of them share a pixel, each at a depth of its own.
pub(crate) const MAX_LAYERS: usize = 64;

/// Layers a block that there is room for from the start.
const USUAL_LAYERS: usize = 4;

/// A surface layer at the pixels of a block.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Cut {
    /// ∞ where there is none.
    pub(crate) depth: Plane,
    /// The opacity with which it is composited.
    pub(crate) alpha: Plane,
    /// Base colour in the blend space; shaded when the pixel is resolved.
    pub(crate) color: [Plane; 3],
    /// Mean normal in camera space, on the side that is seen; as much shorter than 1 as its samples differ.
    pub(crate) normal: [Plane; 3],
    /// The front-most record, and its cloud, whose material shades the layer; [`Cut::NO_NUMBER`] where there is none.
    pub(crate) record: [u32; PIXELS],
    pub(crate) cloud: [u32; PIXELS],
}

impl Cut {
    pub(crate) const NO_NUMBER: u32 = u32::MAX;

    /// No surface.
    pub(crate) const NONE: Self = Self {
        depth: Plane([f32::INFINITY; PIXELS]),
        alpha: Plane::ZERO,
        color: [Plane::ZERO; 3],
        normal: [Plane::ZERO; 3],
        record: [Self::NO_NUMBER; PIXELS],
        cloud: [Self::NO_NUMBER; PIXELS],
    };

    /// Takes what another is at a pixel.
    fn take(&mut self, other: &Self, pixel: usize) {
        let Self { depth, alpha, color, normal, record, cloud } = self;
        depth.0[pixel] = other.depth.0[pixel];
        alpha.0[pixel] = other.alpha.0[pixel];
        for (own, other) in color.iter_mut().chain(normal).zip(other.color.iter().chain(&other.normal)) {
            own.0[pixel] = other.0[pixel];
        }
        (record[pixel], cloud[pixel]) = (other.record[pixel], other.cloud[pixel]);
    }
}

/// What the cuts of a block mean for a volume.
#[derive(Clone, Copy)]
pub(crate) struct BlockCuts {
    /// Where the first of them is.
    first: usize,
    /// How many there are in the pixel that has most.
    pub(crate) layers: usize,
    /// The nearest cut.
    pub(crate) nearest: f32,
    /// Behind this nothing is seen in any of its pixels.
    pub(crate) hidden: f32,
    /// Segments that anything is seen of.
    pub(crate) segments: usize,
    /// Where the last layer ends that anything is seen of: samples whose spans begin behind it change nothing.
    pub(crate) ends: f32,
}

impl BlockCuts {
    const OPEN: Self = Self {
        first: 0,
        layers: 0,
        nearest: f32::INFINITY,
        hidden: f32::INFINITY,
        segments: 1,
        ends: f32::INFINITY,
    };
}

/// What the cuts of a tile mean for a volume.
#[derive(Clone, Copy)]
struct TileCuts {
    blocks: [BlockCuts; MAX_BLOCKS],
    hidden: f32,
    segments: usize,
}

impl TileCuts {
    const OPEN: Self = Self { blocks: [BlockCuts::OPEN; MAX_BLOCKS], hidden: f32::INFINITY, segments: 1 };
}

/// The cuts of a tile's pixels, near to far.
pub(crate) struct Cuts {
    /// Block by block, and what earlier tiles had.
    cuts: Vec<Cut>,
    used: usize,
    sums: TileCuts,
}

impl Cuts {
    pub(crate) fn new() -> Self {
        let cuts = Vec::with_capacity(USUAL_LAYERS * MAX_BLOCKS);
        Self { cuts, used: 0, sums: TileCuts::OPEN }
    }

    pub(crate) fn clear(&mut self) {
        (self.used, self.sums) = (0, TileCuts::OPEN);
    }

    /// Segments of the pixel that has most that anything is seen of.
    pub(crate) fn segments(&self) -> usize {
        self.sums.segments
    }

    /// The cuts of a block, layer by layer; where a pixel has none its depth is ∞ and α is 0.
    pub(crate) fn layers(&self, block: usize) -> impl Iterator<Item = &Cut> {
        let BlockCuts { first, layers, .. } = self.sums.blocks[block];
        self.cuts[first..first + layers].iter()
    }

    /// Of each pixel of a block the first cut that shows.
    pub(crate) fn first_shown(&self, block: usize) -> Cow<'_, Cut> {
        let first = self.layers(block).next().unwrap_or(&Cut::NONE);
        let is_clear =
            |pixel: &usize| first.alpha.0[*pixel] < LEAST_VISIBLE && first.depth.0[*pixel] < f32::INFINITY;
        let mut shown = Cow::Borrowed(first);
        for pixel in (0..PIXELS).filter(is_clear) {
            let behind = self.layers(block).find(|cut| cut.alpha.0[pixel] >= LEAST_VISIBLE);
            shown.to_mut().take(behind.unwrap_or(&Cut::NONE), pixel);
        }
        shown
    }

    /// The depths at which a segment of a block ends.
    pub(crate) fn depth(&self, segment: usize, block: usize) -> &Plane {
        let BlockCuts { first, layers, .. } = self.sums.blocks[block];
        if segment < layers { &self.cuts[first + segment].depth } else { &Cut::NONE.depth }
    }

    pub(crate) fn block(&self, block: usize) -> BlockCuts {
        self.sums.blocks[block]
    }

    /// Behind this depth nothing is seen in the tile.
    pub(crate) fn hidden(&self) -> f32 {
        self.sums.hidden
    }

    /// Says where the last layer of a block ends that anything is seen of; ∞ where there is none such.
    pub(crate) fn end(&mut self, block: usize, depth: f32) {
        self.sums.blocks[block].ends = depth;
    }

    /// Where the next layer goes, with whatever was there before.
    pub(crate) fn next(&mut self) -> &mut Cut {
        if self.used == self.cuts.len() {
            self.cuts.push(Cut::NONE);
        }
        &mut self.cuts[self.used]
    }

    /// Keeps what was put there as a layer behind those that a block has. Blocks come one after the other.
    #[inline(always)]
    pub(crate) fn keep<S: Simd>(&mut self, simd: S, block: usize) {
        let own = &mut self.sums.blocks[block];
        if own.layers == 0 {
            own.first = self.used;
        } else if let [before, cut] = &mut self.cuts[self.used - 1..=self.used] {
            // Means of spans that overlap need not be in order; cuts are.
            cut.depth.store(cut.depth.load(simd).max(before.depth.load(simd)));
        }
        own.layers += 1;
        self.used += 1;
    }

    /// Looks at the finished cuts of all blocks. Behind a transmittance of `least_transmittance` nothing is seen.
    #[inline(always)]
    pub(crate) fn sum_up<S: Simd>(&mut self, simd: S, tile: Tile, least_transmittance: f32) {
        self.sums.hidden = f32::NEG_INFINITY;
        let infinity = W::simd_from(simd, f32::INFINITY);
        for block in tile.visible_blocks() {
            let mut sum = self.sums.blocks[block];
            // What lies beside the picture hides everything.
            let mut hidden = tile.inside(simd, block).select(infinity, -infinity);
            let mut through = W::simd_from(simd, 1.0);
            for (layer, cut) in self.layers(block).enumerate() {
                let (depth, alpha) = (cut.depth.load(simd), cut.alpha.load(simd));
                sum.nearest = sum.nearest.min(depth.reduce_min());
                through = (-through).mul_add(alpha, through);
                let is_open = hidden.simd_eq(infinity);
                let ends = is_open & through.simd_le(W::simd_from(simd, least_transmittance));
                if (is_open & !ends & depth.simd_lt(infinity)).any_true() {
                    sum.segments = layer + 2;
                }
                hidden = ends.select(depth, hidden);
            }
            sum.hidden = hidden.reduce_max();
            self.sums.blocks[block] = sum;
            self.sums.hidden = self.sums.hidden.max(sum.hidden);
            self.sums.segments = self.sums.segments.max(sum.segments);
        }
    }
}
