//! Stage `layers`: the surface records of a tile to cuts, at most four a pixel.
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
use crate::columns::{Kind, LANES};
use crate::cuts::{Cut, Cuts, MAX_LAYERS, inside};
use crate::footprint::{Record, Rect, SurfaceSample};
use crate::raster::{BATCH, Sample, SurfelLens, Surfels};
use crate::simd::*;
use crate::tile::{BLOCK_SIDE, Block, Plane, Tile, add_products, first_pixels, load, store};
use std::sync::atomic::{AtomicU32, Ordering};

/// The layer that is being peeled from a block.
struct Peel<S: Simd> {
    /// z of the first sample; −∞ where nothing is looked for, ∞ where nothing was found.
    depth: Block<S>,
    /// The layer takes samples that come nearer than this.
    limit: Block<S>,
    /// The first sample's record, or [`Cut::NO_RECORD`].
    record: [u32x16<S>; 4],
    /// The limit of the layer before.
    previous: Block<S>,
}

/// Sums over the samples of a layer.
#[repr(C, align(64))]
struct Sums {
    /// Of the splats that show their front, and of those that show their back. The two sides of a thin sheet would
    /// cancel, so their normals are never added.
    sides: [Side; 2],
    color: [Plane; 3],
    depth: Plane,
    /// Of 1 − opacity.
    clear: Plane,
}

#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Side {
    weight: Plane,
    normal: [Plane; 3],
}

const ZERO: Plane = [[0.0; LANES]; BLOCK_SIDE];

impl Sums {
    const ZERO: Self = Self {
        sides: [Side { weight: ZERO, normal: [ZERO; 3] }; 2],
        color: [ZERO; 3],
        depth: ZERO,
        clear: ZERO,
    };
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

/// Buffers of one thread.
#[derive(Default)]
pub(crate) struct LayerBuffers {
    /// A tile's records, and how many batches of them it has.
    batches: Vec<Surfels>,
    used: usize,
    /// Of a block: its records, by their place in the tile, and between which depths their spans begin.
    listed: Vec<Listed>,
}

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
    pub(crate) records: &'a [Record],
    pub(crate) rects: &'a [Rect],
    pub(crate) samples: &'a [SurfaceSample],
    pub(crate) lens: SurfelLens,
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
        samples * (BLOCK_SIDE * BLOCK_SIDE) as u64
    }

    /// Brings the records of a tile together.
    #[inline(always)]
    fn fetch<S: Simd>(&self, simd: S, (tile, list): (Tile, &[AtomicU32]), buffers: &mut LayerBuffers) {
        let LayerBuffers { batches, used, .. } = buffers;
        *used = list.len().div_ceil(BATCH);
        batches.resize_with((*used).max(batches.len()), || Surfels::NONE);
        for (list, batch) in list.chunks(BATCH).zip(batches) {
            let records = list.iter().map(
                #[inline(always)]
                |entry| {
                    let index = entry.load(Ordering::Relaxed);
                    let record = &self.records[index as usize];
                    (index, record, self.depth_tolerances[record.tag.cloud as usize])
                },
            );
            batch.fill(simd, (tile, &self.lens), records, self.rects);
        }
    }

    /// Lists the records that a block needs.
    #[inline(always)]
    fn list<S: Simd>(&self, simd: S, (block, corner): (usize, [f32; 2]), buffers: &mut LayerBuffers) {
        let LayerBuffers { batches, used, listed } = buffers;
        listed.clear();
        let (mut nearest, mut seen_from, mut farthest) = ([0.0; BATCH], [0.0; BATCH], [0.0; BATCH]);
        for (batch, surfels) in batches[..*used].iter().enumerate() {
            let mut rest = surfels.masks[block];
            if rest == 0 {
                continue;
            }
            surfels.bounds(simd, corner, &self.lens, [&mut nearest, &mut seen_from, &mut farthest]);
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
        let pixels = first_pixels(simd, corner);
        apart(
            simd,
            #[inline(always)]
            || self.list(simd, (block, corner), buffers),
        );
        let LayerBuffers { batches, listed, .. } = buffers;
        let infinity = W::simd_from(simd, f32::INFINITY);
        let wanted = load(simd, &inside(tile, block));
        let mut peel = Peel {
            depth: wanted,
            limit: wanted,
            record: [u32x16::simd_from(simd, Cut::NO_RECORD); 4],
            previous: [-infinity; 4],
        };
        let nothing_yet = SeenThrough { bare: W::simd_from(simd, 1.0), covered: W::simd_from(simd, 0.0) };
        let mut seen_through = [nothing_yet; 4];
        let mut evaluated = 0;
        for layer in 0..MAX_LAYERS {
            evaluated += apart(
                simd,
                #[inline(always)]
                || self.find_first(simd, (batches, pixels), listed, &mut peel),
            );
            if listed.is_empty() {
                break;
            }
            let last = layer + 1 == MAX_LAYERS;
            if last {
                // The last layer takes every sample that is left.
                for (limit, depth) in peel.limit.iter_mut().zip(peel.depth) {
                    *limit = depth.simd_gt(-infinity).select(infinity, -infinity);
                }
            }
            let mut sums = Sums::ZERO;
            evaluated += apart(
                simd,
                #[inline(always)]
                || self.sum_up(simd, (batches, corner, pixels), (listed, &peel), &mut sums),
            );
            let closed = apart(
                simd,
                #[inline(always)]
                || close(simd, &mut peel, &sums, (&mut seen_through, last), self.spent),
            );
            let Some((cut, goes_on)) = closed else { break };
            let depth_before = cuts.layers(block).last().map(|cut| cut.depth);
            cuts.push((tile, block), cut.behind(simd, depth_before));
            if !goes_on {
                break;
            }
        }
        evaluated
    }

    /// Finds the first sample of each pixel behind the layers so far. Leaves those records in the list that may have
    /// samples there.
    #[inline(always)]
    fn find_first<S: Simd>(
        &self,
        simd: S,
        (batches, pixels): (&[Surfels], [W<S>; 2]),
        listed: &mut Vec<Listed>,
        peel: &mut Peel<S>,
    ) -> u64 {
        let infinity = W::simd_from(simd, f32::INFINITY);
        let mut deepest = greatest(peel.depth);
        let done = -greatest([0, 1, 2, 3].each(
            #[inline(always)]
            |i| peel.depth[i].simd_gt(-infinity).select(-peel.previous[i], -infinity),
        ));
        let is_first_layer = done == f32::NEG_INFINITY;
        let (mut kept, mut evaluated) = (0, 0);
        for place in 0..listed.len() {
            let candidate = listed[place];
            if candidate.farthest <= done {
                continue;
            }
            // It may be of use to a later layer.
            listed[kept] = candidate;
            kept += 1;
            if candidate.seen_from > deepest {
                continue;
            }
            evaluated += 1;
            let (surfels, number) = (&batches[candidate.batch as usize], candidate.number as usize % BATCH);
            let sample: Sample<S> = surfels.sample(simd, number, pixels, &self.lens);
            let mut nearer = [0, 1, 2, 3].each(
                #[inline(always)]
                |i| sample.inside[i] & sample.depth[i].simd_lt(peel.depth[i]),
            );
            if !any(nearer) {
                continue;
            }
            let spans = surfels.spans(simd, (number, &sample), pixels, &self.lens);
            if !is_first_layer {
                for i in 0..4 {
                    nearer[i] &= spans.nearest[i].simd_gt(peel.previous[i]);
                }
            }
            let record = u32x16::simd_from(simd, surfels.index[number]);
            for i in 0..4 {
                peel.depth[i] = nearer[i].select(sample.depth[i], peel.depth[i]);
                let limit = spans.farthest[i] + surfels.tolerance[number];
                peel.limit[i] = nearer[i].select(limit, peel.limit[i]);
                peel.record[i] = nearer[i].select(record, peel.record[i]);
            }
            deepest = greatest(peel.depth);
        }
        listed.truncate(kept);
        evaluated
    }

    /// Sums up the samples that belong to the layer.
    #[inline(always)]
    fn sum_up<S: Simd>(
        &self,
        simd: S,
        (batches, corner, pixels): (&[Surfels], [f32; 2], [W<S>; 2]),
        (listed, peel): (&[Listed], &Peel<S>),
        sums: &mut Sums,
    ) -> u64 {
        let infinity = W::simd_from(simd, f32::INFINITY);
        let farthest = greatest(peel.limit);
        let mut evaluated = 0;
        for candidate in listed.iter().filter(|candidate| candidate.nearest <= farthest) {
            let (surfels, number) = (&batches[candidate.batch as usize], candidate.number as usize % BATCH);
            evaluated += 1;
            let mut sample = surfels.sample(simd, number, pixels, &self.lens);
            // Only where what is seen lies behind the limit it matters where the plane is.
            let begins = surfels.begins(simd, number, &sample);
            let mut open = sample.inside;
            for i in 0..4 {
                open[i] &= begins[i].simd_gt(peel.limit[i]) | peel.previous[i].simd_gt(-infinity);
            }
            if any(open) {
                let spans = surfels.spans(simd, (number, &sample), pixels, &self.lens);
                for i in 0..4 {
                    sample.inside[i] &=
                        spans.nearest[i].simd_gt(peel.previous[i]) & spans.nearest[i].simd_le(peel.limit[i]);
                }
                if !any(sample.inside) {
                    continue;
                }
            }
            let index = surfels.index[number] as usize;
            let SurfaceSample { normal, opacity, .. } = self.samples[index];
            let weights = surfels.weights(simd, (number, &sample), pixels);
            let mut depths = sample.depth;
            for i in 0..4 {
                // Where no sample was found the difference is infinite.
                let zero = W::simd_from(simd, 0.0);
                depths[i] = sample.inside[i].select(depths[i] - peel.depth[i], zero);
            }
            add_products(simd, &mut sums.depth, (depths, weights));
            if opacity < 1.0 {
                add_products(simd, &mut sums.clear, ([W::simd_from(simd, 1.0 - opacity); 4], weights));
            }
            for (plane, own) in sums.color.iter_mut().zip(self.records[index].color) {
                add_products(simd, plane, ([W::simd_from(simd, own); 4], weights));
            }
            let Some(faces_away) = surfels.faces_away(number, corner) else {
                let facing = surfels.exact_facing(simd, number, pixels);
                for (side, sign) in sums.sides.iter_mut().zip([-1.0, 1.0]) {
                    let mut own = weights;
                    for (own, facing) in own.iter_mut().zip(facing) {
                        let zero = W::simd_from(simd, 0.0);
                        *own = (facing * sign).simd_gt(zero).select(*own, zero);
                    }
                    side.add(simd, normal, own);
                }
                continue;
            };
            sums.sides[usize::from(faces_away)].add(simd, normal, weights);
        }
        evaluated
    }
}

impl Side {
    #[inline(always)]
    fn add<S: Simd>(&mut self, simd: S, normal: [f32; 3], weights: Block<S>) {
        add_products(simd, &mut self.weight, ([W::simd_from(simd, 1.0); 4], weights));
        for (plane, normal) in self.normal.iter_mut().zip(normal) {
            add_products(simd, plane, ([W::simd_from(simd, normal); 4], weights));
        }
    }
}

/// Turns the sums of a layer into a cut and makes ready for the next; says whether one is needed. `None` where no pixel
/// has a sample.
#[inline(always)]
fn close<S: Simd>(
    simd: S,
    peel: &mut Peel<S>,
    sums: &Sums,
    (seen_through, last): (&mut [SeenThrough<S>; 4], bool),
    spent: f32,
) -> Option<(Cut, bool)> {
    let no_record = u32x16::simd_from(simd, Cut::NO_RECORD);
    let found = peel.record.each(
        #[inline(always)]
        |record| record.simd_ne(no_record),
    );
    if !any(found) {
        return None;
    }
    let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
    let infinity = W::simd_from(simd, f32::INFINITY);
    let [front, back] = &sums.sides;
    let [front_weight, back_weight] = [load(simd, &front.weight), load(simd, &back.weight)];
    let mut cut = Cut::NONE;
    let (mut depth, mut alpha) = (load(simd, &sums.depth), load(simd, &sums.clear));
    let mut color = load3(simd, &sums.color);
    let (mut normal, back_normal) = (load3(simd, &front.normal), load3(simd, &back.normal));
    let mut goes_on = [zero.simd_lt(zero); 4];
    for i in 0..4 {
        let weight = front_weight[i] + back_weight[i];
        // Seen exactly edge-on a plane covers nothing.
        let found = found[i] & weight.simd_gt(zero);
        let inverse = found.select(one / weight, zero);
        let mut opacity = one - (alpha[i] * inverse).min(one);
        if last {
            // The last layer may be several sheets, one behind the other.
            let (through, sheets) = (one - opacity, weight.max(one));
            opacity =
                one - W::from_slice(simd, &std::array::from_fn::<f32, 16, _>(|k| through[k].powf(sheets[k])));
        }
        let coverage = found.select(weight.min(one), zero);
        let [own, seen] = seen_through[i].cover(simd, coverage, found.select(opacity, zero));
        alpha[i] = found.select(own, zero);
        depth[i] = found.select(depth[i].mul_add(inverse, peel.depth[i]), infinity);
        // On the side that is seen.
        let shows_front = front_weight[i].simd_ge(back_weight[i]);
        let side = [0, 1, 2].each(
            #[inline(always)]
            |axis| shows_front.select(normal[axis][i], -back_normal[axis][i]),
        );
        let unit = normalize_or_zero(simd, side);
        for axis in 0..3 {
            normal[axis][i] = found.select(unit[axis], zero);
            color[axis][i] *= inverse;
        }
        let record = found.select(peel.record[i], no_record);
        cut.record.as_flattened_mut()[16 * i..16 * i + 16].copy_from_slice(record.as_slice());
        goes_on[i] = found & seen.simd_gt(W::simd_from(simd, spent));
        peel.previous[i] = peel.limit[i];
        peel.depth[i] = goes_on[i].select(infinity, -infinity);
        peel.limit[i] = peel.depth[i];
        peel.record[i] = no_record;
    }
    store(depth, &mut cut.depth);
    store(alpha, &mut cut.alpha);
    for axis in 0..3 {
        store(color[axis], &mut cut.color[axis]);
        store(normal[axis], &mut cut.normal[axis]);
    }
    Some((cut, any(goes_on) && !last))
}

impl Cut {
    /// Means of spans that overlap need not be in order; cuts are.
    #[inline(always)]
    fn behind<S: Simd>(mut self, simd: S, depth_before: Option<Plane>) -> Self {
        if let Some(before) = depth_before {
            let (mut depth, before) = (load(simd, &self.depth), load(simd, &before));
            for i in 0..4 {
                depth[i] = depth[i].max(before[i]);
            }
            store(depth, &mut self.depth);
        }
        self
    }
}

#[inline(always)]
fn load3<S: Simd>(simd: S, planes: &[Plane; 3]) -> [Block<S>; 3] {
    [load(simd, &planes[0]), load(simd, &planes[1]), load(simd, &planes[2])]
}

#[inline(always)]
fn any<S: Simd>([a, b, c, d]: [mask32x16<S>; 4]) -> bool {
    ((a | b) | (c | d)).any_true()
}

#[inline(always)]
fn greatest<S: Simd>([a, b, c, d]: Block<S>) -> f32 {
    a.max(b).max(c.max(d)).reduce_max()
}
