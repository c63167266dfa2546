//! Stage `layers`: the surface records of a tile to cuts, at most four a pixel.
//!
//! A sample spans the depths from where it is seen to where its plane passes the pixel; a layer takes a pixel's
//! samples whose span comes within ε + 3σ_z of its first one's. Spans that meet are one surface: that is the
//! A-buffer test of Zwicker, Pfister, van Baar, Gross, *Surface splatting*, 2001. Without the plane a tilted
//! surface whose surfels are smaller than the pixel's filter would fall apart into layers.
//!
//! Layers are peeled: one pass over the records finds each pixel's first sample, one sums up what belongs to it, and
//! what lies behind a layer's limit is left for the next. Nothing is sorted or kept. Records come roughly from near to
//! far, so that a block of pixels that is covered soon tells which records it needs no more.

use crate::cloud::Cloud;
use crate::columns::{Kind, LANES, Lanes};
use crate::composite::Cut;
use crate::footprint::SurfaceSample;
use crate::raster::{Needs, Sample, SurfelRaster};
use crate::simd::*;
use crate::tile::{BLOCK_ROWS, MAX_SIDE, Tile};
use std::sync::atomic::{AtomicU32, Ordering};

/// Layers a pixel; the last takes whatever is left.
pub(crate) const MAX_LAYERS: usize = 4;

/// The first sample of the layer that is being peeled, at eight pixels.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
struct First {
    /// Its z; −∞ where nothing is looked for, ∞ where nothing was found.
    depth: Lanes,
    /// The layer takes samples that come nearer than this.
    limit: Lanes,
    /// Its record, or [`Cut::NO_RECORD`].
    record: [u32; LANES],
    /// The limit of the layer before.
    previous: Lanes,
}

/// Sums over the samples of a layer.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
struct Sums {
    /// Of the splats that show their front, and of those that show their back. The two sides of a thin sheet would
    /// cancel, so their normals are never added.
    sides: [Side; 2],
    color: [Lanes; 3],
    depth: Lanes,
    opacity: Lanes,
}

#[derive(Clone, Copy)]
#[repr(C, align(32))]
struct Side {
    weight: Lanes,
    normal: [Lanes; 3],
}

impl Side {
    #[inline(always)]
    fn add<S: Simd>(&mut self, simd: S, normal: V3<S>, weight: V<S>) {
        self.weight = (V::simd_from(simd, self.weight) + weight).into();
        for (lanes, normal) in self.normal.iter_mut().zip(normal) {
            add_product(simd, lanes, normal, weight);
        }
    }
}

impl Sums {
    const ZERO: Self = Self {
        sides: [Side { weight: [0.0; LANES], normal: [[0.0; LANES]; 3] }; 2],
        color: [[0.0; LANES]; 3],
        depth: [0.0; LANES],
        opacity: [0.0; LANES],
    };
}

/// How far one sees into a pixel past its layers so far.
///
/// Coverage is a share of the pixel's area. A layer covers what is left bare first, and only then what is
/// covered already: the parts of one surface that fall into two layers, at a crease or along a silhouette, lie
/// beside each other. Were they independent, every such pixel would let the background through.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
struct SeenThrough {
    /// Share of the pixel that no layer covers.
    bare: Lanes,
    /// What the covered share lets through, as a share of the pixel.
    covered: Lanes,
}

impl SeenThrough {
    const NOTHING_YET: Self = Self { bare: [1.0; LANES], covered: [0.0; LANES] };

    /// Puts a layer behind; gives the opacity with which it is composited, and what is still seen.
    #[inline(always)]
    fn cover<S: Simd>(&mut self, simd: S, coverage: V<S>, opacity: V<S>) -> [V<S>; 2] {
        let (bare, covered) = (V::simd_from(simd, self.bare), V::simd_from(simd, self.covered));
        let one = splat(simd, 1.0);
        let before = bare + covered;
        let beside = coverage.min(bare);
        let behind = keep(simd, bare.simd_lt(one), (coverage - beside) / (one - bare));
        let covered = covered * (one - opacity * behind) + beside * (one - opacity);
        let bare = bare - beside;
        (self.bare, self.covered) = (bare.into(), covered.into());
        let after = bare + covered;
        let alpha = before.simd_gt(splat(simd, 0.0)).select(one - after / before, one);
        [alpha, after]
    }
}

/// What the cuts of a block of 8×8 pixels mean for a volume.
#[derive(Clone, Copy)]
pub(crate) struct BlockCuts {
    /// The nearest cut.
    pub(crate) nearest: f32,
    /// Behind this nothing is seen in any of its pixels.
    pub(crate) hidden: f32,
    /// Segments that anything is seen of.
    pub(crate) segments: usize,
}

/// The cuts of a tile's pixels, near to far.
pub(crate) struct Cuts {
    layers: usize,
    cuts: [Vec<Cut>; MAX_LAYERS],
    blocks: [BlockCuts; BLOCKS],
    hidden: f32,
}

/// Blocks of the largest tile.
const BLOCKS: usize = (MAX_SIDE / LANES) * (MAX_SIDE / BLOCK_ROWS);

impl Cuts {
    pub(crate) fn new() -> Self {
        let open = BlockCuts { nearest: f32::INFINITY, hidden: f32::INFINITY, segments: 1 };
        let cuts = std::array::from_fn(|_| Vec::new());
        Self { layers: 0, cuts, blocks: [open; BLOCKS], hidden: f32::INFINITY }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.layers == 0
    }

    /// Segments of the pixel that has most.
    pub(crate) fn segments(&self) -> usize {
        self.layers + 1
    }

    /// The cuts of a cell, layer by layer; where a pixel has none its depth is ∞ and α is 0.
    pub(crate) fn cell(&self, cell: usize) -> impl Iterator<Item = &Cut> {
        self.cuts[..self.layers].iter().map(move |cuts| &cuts[cell])
    }

    /// The depths at which a segment of a cell ends.
    pub(crate) fn depth(&self, segment: usize, cell: usize) -> Lanes {
        if segment < self.layers { self.cuts[segment][cell].depth } else { [f32::INFINITY; LANES] }
    }

    pub(crate) fn block(&self, tile: Tile, strip: usize, block: usize) -> BlockCuts {
        self.blocks[strip * (tile.side / BLOCK_ROWS) + block]
    }

    /// Whether all that lies behind a depth is hidden everywhere in the tile.
    #[inline(always)]
    pub(crate) fn hide(&self, depth: f32) -> bool {
        depth > self.hidden
    }

    /// Looks at the finished cuts block by block.
    #[inline(always)]
    fn sum_up<S: Simd>(&mut self, simd: S, tile: Tile) {
        self.hidden = f32::NEG_INFINITY;
        for strip in 0..tile.strips() {
            for block in 0..tile.size[1].div_ceil(BLOCK_ROWS) {
                let mut sum = BlockCuts { nearest: f32::INFINITY, hidden: f32::NEG_INFINITY, segments: 1 };
                let first = block * BLOCK_ROWS;
                for cell in tile.strip(strip).skip(first).take(BLOCK_ROWS) {
                    let mut hidden = splat(simd, f32::INFINITY);
                    for (layer, cut) in self.cuts[..self.layers].iter().map(|cuts| &cuts[cell]).enumerate() {
                        let (depth, alpha) = (V::simd_from(simd, cut.depth), V::simd_from(simd, cut.alpha));
                        sum.nearest = sum.nearest.min(depth.reduce_min());
                        let is_open = hidden.simd_eq(splat(simd, f32::INFINITY));
                        if (is_open & alpha.simd_gt(splat(simd, 0.0)) & alpha.simd_lt(splat(simd, 1.0)))
                            .any_true()
                        {
                            sum.segments = sum.segments.max(layer + 2);
                        }
                        let ends = is_open & alpha.simd_ge(splat(simd, 1.0));
                        hidden = ends.select(depth, hidden);
                    }
                    // What lies beside the picture hides everything.
                    let inside = lane_numbers(simd).simd_lt(splat(simd, tile.columns(strip) as f32));
                    let hidden = inside.select(hidden, splat(simd, f32::NEG_INFINITY));
                    sum.hidden = sum.hidden.max(hidden.reduce_max());
                }
                self.blocks[strip * (tile.side / BLOCK_ROWS) + block] = sum;
                self.hidden = self.hidden.max(sum.hidden);
            }
        }
    }
}

/// Buffers of one thread.
pub(crate) struct LayerBuffers {
    firsts: Vec<First>,
    sums: Vec<Sums>,
    seen_through: Vec<SeenThrough>,
    /// What each block needs.
    needs: [Needs; BLOCKS],
    /// Records that may have samples in the layer.
    candidates: Vec<u32>,
}

impl LayerBuffers {
    pub(crate) fn new() -> Self {
        Self {
            firsts: Vec::new(),
            sums: Vec::new(),
            seen_through: Vec::new(),
            needs: [Needs { rows: 0, done: f32::NEG_INFINITY, farthest: f32::INFINITY }; BLOCKS],
            candidates: Vec::new(),
        }
    }
}

/// Turns a tile's surface records into cuts. Behind a transmittance of `spent` nothing is kept.
pub(crate) struct LayerBuilder<'a> {
    pub(crate) raster: SurfelRaster<'a>,
    pub(crate) samples: &'a [SurfaceSample],
    pub(crate) depth_tolerances: &'a [f32],
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

/// Records after which it is found anew what the blocks need.
const RECORDS_A_CHECK: usize = 32;

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
        cuts.layers = 0;
        cuts.hidden = f32::INFINITY;
        if list.is_empty() {
            return 0;
        }
        let cells = Tile::cells(tile.side);
        buffers.seen_through.clear();
        buffers.seen_through.resize(cells, SeenThrough::NOTHING_YET);
        begin(tile, buffers);
        let mut lanes = 0;
        for layer in 0..MAX_LAYERS {
            lanes += self.find_first(simd, (tile, list), buffers);
            if buffers.candidates.is_empty() {
                break;
            }
            if layer + 1 == MAX_LAYERS {
                take_the_rest(simd, tile, &mut buffers.firsts);
            }
            buffers.sums.clear();
            buffers.sums.resize(cells, Sums::ZERO);
            lanes += self.sum_up(simd, tile, buffers);
            cuts.cuts[layer].clear();
            cuts.cuts[layer].resize(cells, Cut::NONE);
            cuts.layers = layer + 1;
            if !self.close(simd, tile, buffers, cuts) {
                break;
            }
        }
        cuts.sum_up(simd, tile);
        lanes
    }

    /// Finds the first sample of each pixel behind the layers so far, and the records that may belong to its layer.
    #[inline(always)]
    fn find_first<S: Simd>(
        &self,
        simd: S,
        (tile, list): (Tile, &[AtomicU32]),
        buffers: &mut LayerBuffers,
    ) -> u64 {
        let LayerBuffers { firsts, needs, candidates, .. } = buffers;
        candidates.clear();
        let mut lanes = 0;
        for list in list.chunks(RECORDS_A_CHECK) {
            find_needs(simd, tile, firsts, needs);
            for entry in list {
                let index = entry.load(Ordering::Relaxed);
                let surfel = self.raster.surfel(index);
                let tolerance = self.depth_tolerances[surfel.record.tag.cloud as usize];
                let own_index = u32x8::simd_from(simd, index);
                let drawn = surfel.draw(
                    simd,
                    tile,
                    needs,
                    #[inline(always)]
                    |cell, sample: Sample<S>| {
                        let first = &mut firsts[cell];
                        let unseen = sample.nearest().simd_gt(V::simd_from(simd, first.previous));
                        let depth = V::simd_from(simd, first.depth);
                        let nearer = sample.inside & unseen & sample.depth.simd_lt(depth);
                        let limit = sample.farthest() + tolerance;
                        let record = u32x8::simd_from(simd, first.record);
                        first.depth = nearer.select(sample.depth, depth).into();
                        first.limit = nearer.select(limit, V::simd_from(simd, first.limit)).into();
                        first.record = nearer.select(own_index, record).into();
                    },
                );
                lanes += drawn;
                if drawn > 0 {
                    candidates.push(index);
                }
            }
        }
        lanes
    }

    /// Sums up the samples that belong to the layer.
    #[inline(always)]
    fn sum_up<S: Simd>(&self, simd: S, tile: Tile, buffers: &mut LayerBuffers) -> u64 {
        let LayerBuffers { firsts, sums, needs, candidates, .. } = buffers;
        find_needs(simd, tile, firsts, needs);
        let mut lanes = 0;
        for index in candidates.iter() {
            let surfel = self.raster.surfel(*index);
            let SurfaceSample { normal, opacity, .. } = self.samples[*index as usize];
            let (color, normal) = (splat3(simd, surfel.record.color), splat3(simd, normal));
            let opacity = splat(simd, opacity);
            lanes += surfel.draw(
                simd,
                tile,
                needs,
                #[inline(always)]
                |cell, sample: Sample<S>| {
                    let (first, sums) = (&firsts[cell], &mut sums[cell]);
                    let nearest = sample.nearest();
                    let inside = sample.inside
                        & nearest.simd_gt(V::simd_from(simd, first.previous))
                        & nearest.simd_le(V::simd_from(simd, first.limit));
                    let weight = sample.weight(simd, inside);
                    add_product(
                        simd,
                        &mut sums.depth,
                        sample.depth - V::simd_from(simd, first.depth),
                        weight,
                    );
                    add_product(simd, &mut sums.opacity, opacity, weight);
                    for (lanes, color) in sums.color.iter_mut().zip(color) {
                        add_product(simd, lanes, color, weight);
                    }
                    // In the affine form a splat shows one side.
                    let back = keep(simd, sample.faces_away, weight);
                    let [front_side, back_side] = &mut sums.sides;
                    if surfel.shows_front() {
                        front_side.add(simd, normal, weight - back);
                    }
                    if surfel.shows_back() {
                        back_side.add(simd, normal, back);
                    }
                },
            );
        }
        lanes
    }

    /// Turns the sums into cuts and makes ready for the next layer; says whether one is needed.
    #[inline(always)]
    fn close<S: Simd>(&self, simd: S, tile: Tile, buffers: &mut LayerBuffers, cuts: &mut Cuts) -> bool {
        let LayerBuffers { firsts, sums, seen_through, .. } = buffers;
        let layer = cuts.layers - 1;
        let last = cuts.layers == MAX_LAYERS;
        let (before, from_here) = cuts.cuts.split_at_mut(layer);
        let mut any = false;
        let one = splat(simd, 1.0);
        for cell in (0..tile.strips()).flat_map(|strip| tile.strip(strip)) {
            let (first, sum, cut) = (&mut firsts[cell], &sums[cell], &mut from_here[0][cell]);
            let record = u32x8::simd_from(simd, first.record);
            let found = !record.simd_eq(u32x8::simd_from(simd, Cut::NO_RECORD));
            if !found.any_true() {
                *first = First::DONE;
                continue;
            }
            let [front, back] = &sum.sides;
            let [front_weight, back_weight] = [front, back].each(
                #[inline(always)]
                |side| V::simd_from(simd, side.weight),
            );
            let weight = front_weight + back_weight;
            let mean = |lanes: Lanes| V::simd_from(simd, lanes) / weight;
            // On the side that is seen.
            let shows_front = front_weight.simd_ge(back_weight);
            let normal = [0, 1, 2].each(
                #[inline(always)]
                |axis| {
                    let [front, back] = [front, back].each(
                        #[inline(always)]
                        |side| V::simd_from(simd, side.normal[axis]),
                    );
                    shows_front.select(front, -back)
                },
            );
            let mut opacity = mean(sum.opacity).min(one);
            if last {
                // The last layer may be several sheets, one behind the other.
                let through: [f32; LANES] = (one - opacity).into();
                let sheets: [f32; LANES] = weight.max(one).into();
                let through: [f32; LANES] = std::array::from_fn(|i| through[i].powf(sheets[i]));
                opacity = one - V::simd_from(simd, through);
            }
            let [alpha, seen] = seen_through[cell].cover(
                simd,
                keep(simd, found, weight.min(one)),
                keep(simd, found, opacity),
            );
            let mut depth = V::simd_from(simd, first.depth) + mean(sum.depth);
            if let Some(before) = before.last() {
                // Means of spans that overlap need not be in order; cuts are.
                depth = depth.max(V::simd_from(simd, before[cell].depth));
            }
            let infinity = splat(simd, f32::INFINITY);
            *cut = Cut {
                depth: found.select(depth, infinity).into(),
                alpha: keep(simd, found, alpha).into(),
                color: sum.color.each(
                    #[inline(always)]
                    |lanes| keep(simd, found, mean(lanes)).into(),
                ),
                normal: normalize_or_zero(simd, normal).each(
                    #[inline(always)]
                    |lanes| keep(simd, found, lanes).into(),
                ),
                record: first.record,
            };
            let goes_on = found & seen.simd_gt(splat(simd, self.spent));
            any |= goes_on.any_true();
            first.previous = first.limit;
            first.depth = goes_on.select(infinity, -infinity).into();
            first.limit = goes_on.select(infinity, -infinity).into();
            first.record = [Cut::NO_RECORD; LANES];
        }
        any && !last
    }
}

impl First {
    const DONE: Self = Self {
        depth: [f32::NEG_INFINITY; LANES],
        limit: [f32::NEG_INFINITY; LANES],
        record: [Cut::NO_RECORD; LANES],
        previous: [f32::INFINITY; LANES],
    };
}

/// Looks for first samples in all pixels of the picture.
fn begin(tile: Tile, buffers: &mut LayerBuffers) {
    buffers.firsts.clear();
    buffers.firsts.resize(Tile::cells(tile.side), First::DONE);
    for strip in 0..tile.strips() {
        let columns = tile.columns(strip);
        for first in &mut buffers.firsts[tile.strip(strip)] {
            first.depth[..columns].fill(f32::INFINITY);
            first.limit[..columns].fill(f32::INFINITY);
            first.previous[..columns].fill(f32::NEG_INFINITY);
        }
    }
}

/// Lets the layer take every sample that is left in the pixels that it looks at.
#[inline(always)]
fn take_the_rest<S: Simd>(simd: S, tile: Tile, firsts: &mut [First]) {
    let infinity = splat(simd, f32::INFINITY);
    for cell in (0..tile.strips()).flat_map(|strip| tile.strip(strip)) {
        let first = &mut firsts[cell];
        let wanted = V::simd_from(simd, first.depth).simd_gt(-infinity);
        first.limit = wanted.select(infinity, -infinity).into();
    }
}

/// Finds what each block needs of the samples behind the layers so far.
#[inline(always)]
fn find_needs<S: Simd>(simd: S, tile: Tile, firsts: &[First], needs: &mut [Needs; BLOCKS]) {
    let blocks = tile.side / BLOCK_ROWS;
    let infinity = splat(simd, f32::INFINITY);
    for strip in 0..tile.strips() {
        for block in 0..tile.size[1].div_ceil(BLOCK_ROWS) {
            let first = strip * tile.side + block * BLOCK_ROWS;
            let (mut rows, mut farthest, mut done) = (0, -infinity, infinity);
            for (row, first) in firsts[first..first + BLOCK_ROWS].iter().enumerate() {
                let wanted = V::simd_from(simd, first.depth).simd_gt(-infinity);
                rows |= u8::from(wanted.any_true()) << row;
                farthest = farthest.max(V::simd_from(simd, first.limit));
                done = done.min(wanted.select(V::simd_from(simd, first.previous), infinity));
            }
            let (done, farthest) = (done.reduce_min(), farthest.reduce_max());
            needs[strip * blocks + block] = Needs { rows, done, farthest };
        }
    }
}
