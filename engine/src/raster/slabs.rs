//! How a batch of volume records lies in slabs.

use super::column::{BATCH, Column, sixteen, sixteen_of};
use super::kernel::Kernels;
use super::offsets::ROOT_HALF_LOG2_E;
use crate::closing::{BOX, Distances, Slabs, Spread, share_before, share_of_box};
use crate::simd::*;
use crate::tile::{HALF_BLOCK, Tile};

/// The slabs of a batch of records, or of pieces of them.
#[repr(C, align(64))]
pub(crate) struct SlabColumns {
    /// Slabs that may be touched. The last is a whole number, but of records that are composited at their centres: see
    /// [`Closing::center_among_slabs`](crate::closing::Closing::center_among_slabs).
    pub(crate) first: [u32; BATCH],
    last: Column,
    /// See [`Distances`].
    distance: Column,
    slope: [Column; 2],
    /// Change of the share before a distance, of a box.
    share_slope: [Column; 2],
    /// See [`Spread`].
    inverse: Column,
    half: Column,
    normal_part: Column,
    /// Boxes that touch no more than two slabs: shared out between the first and the next.
    pub(crate) narrow: u64,
    /// Whole records that touch three slabs.
    in_three: u64,
    /// Those that are composited at their centres.
    pub(crate) at_centers: u64,
    /// Those of optical depths that touch two slabs, and three, of which all pixels see the same shares.
    pub(crate) level: [u64; 2],
    /// What these have in their slabs where w = e^{−r/2} is 1.
    in_slabs: [Heap; 3],
    /// Pieces that begin, and that end, their records.
    begin: u64,
    end: u64,
}

/// Of a slab, the optical depths of level kernels, and those times colours and z at their means.
#[repr(C, align(64))]
struct Heap {
    optical_depth: Column,
    color: [Column; 3],
    depth: Column,
}

/// What a level kernel has in a slab where w = e^{−r/2} is 1.
pub(crate) struct Grain {
    pub(crate) optical_depth: f32,
    /// Times the optical depth, as is z at the mean.
    pub(crate) color: [f32; 3],
    pub(crate) depth: f32,
}

impl Heap {
    const NONE: Self = Self { optical_depth: [0.0; BATCH], color: [[0.0; BATCH]; 3], depth: [0.0; BATCH] };
}

impl SlabColumns {
    pub(super) const NONE: Self = Self {
        first: [0; BATCH],
        last: [0.0; BATCH],
        distance: [0.0; BATCH],
        slope: [[0.0; BATCH]; 2],
        share_slope: [[0.0; BATCH]; 2],
        inverse: [0.0; BATCH],
        half: [0.0; BATCH],
        normal_part: [0.0; BATCH],
        narrow: 0,
        in_three: 0,
        at_centers: 0,
        level: [0; 2],
        in_slabs: [Heap::NONE; 3],
        begin: 0,
        end: 0,
    };

    /// Takes in records as a whole, by their first slabs and how many follow, with fractions; false if one touches more than `most`.
    #[inline(always)]
    pub(crate) fn set_whole<S: Simd>(
        &mut self,
        simd: S,
        [firsts, followers]: &[Column; 2],
        most: u32,
    ) -> bool {
        let [one, two, most] = [1.0, 2.0, most as f32].each(
            #[inline(always)]
            |count| W::simd_from(simd, count),
        );
        let (mut narrow, mut in_three, mut wide) = (0, 0, 0);
        for start in (0..BATCH).step_by(16) {
            let (first, reach) = (sixteen(simd, firsts, start), sixteen(simd, followers, start).floor());
            narrow |= reach.simd_le(one).to_bitmask() << start;
            in_three |= reach.simd_eq(two).to_bitmask() << start;
            wide |= reach.simd_ge(most).to_bitmask();
            first.to_int::<u32x16<S>>().store_slice(&mut self.first[start..start + 16]);
            (first + reach).store_slice(&mut self.last[start..start + 16]);
        }
        (self.narrow, self.in_three, self.begin, self.end) = (narrow, in_three, u64::MAX, u64::MAX);
        wide == 0
    }

    /// Takes in a piece of a record that reaches from its first to its last slab, or one that is composited at its centre.
    #[inline(always)]
    pub(crate) fn set(&mut self, number: usize, (first, last): (u32, f32), [begin, end]: [bool; 2]) {
        let number = number % BATCH;
        let (is_whole, reach) = (begin && end, last as u32 - first);
        let put = |set: u64, is_in: bool| set & !(1 << number) | u64::from(is_in) << number;
        self.narrow = put(self.narrow, is_whole && reach <= 1);
        self.in_three = put(self.in_three, is_whole && reach == 2);
        (self.first[number], self.last[number]) = (first, last);
        self.begin = put(self.begin, begin);
        self.end = put(self.end, end);
    }

    /// What a level kernel has in its first slab, or in one of the next two.
    #[inline(always)]
    pub(crate) fn grain(&self, number: usize, slab: usize) -> Grain {
        let Heap { optical_depth, color: [red, green, blue], depth } = &self.in_slabs[slab];
        Grain {
            optical_depth: optical_depth[number],
            color: [red[number], green[number], blue[number]],
            depth: depth[number],
        }
    }

    /// The slab in which the centre of a record lies, and the part of that before it, below 1.
    #[inline(always)]
    pub(crate) fn center(&self, number: usize) -> (u32, f32) {
        let slab = self.first[number];
        (slab, self.last[number] - slab as f32)
    }

    /// See [`Spread`].
    #[inline(always)]
    pub(crate) fn inverse(&self, number: usize) -> f32 {
        self.inverse[number]
    }

    /// How a record's piece is shared out between its slabs.
    #[inline(always)]
    pub(crate) fn share(&self, number: usize) -> SlabShare {
        let has = |set: u64| set >> number & 1 != 0;
        SlabShare { normal_part: self.normal_part[number], goes_on: !has(self.begin), ends: has(self.end) }
    }
}

/// See [`SlabColumns::share`].
pub(crate) struct SlabShare {
    /// See [`Spread`].
    pub(crate) normal_part: f32,
    /// Whether slabs before the piece's first one have had their share.
    pub(crate) goes_on: bool,
    /// Whether the last slab gets what is left.
    pub(crate) ends: bool,
}

impl Kernels {
    /// Finds how sixteen records are spread over slabs; only boxes may be narrow.
    #[inline(always)]
    pub(super) fn prepare_slabs<S: Simd>(&mut self, simd: S, (tile, slabs): (Tile, &Slabs), first: usize) {
        let outlines = &self.outlines;
        let range = first..first + 16;
        let mean = [0, 1].each(
            #[inline(always)]
            |axis| sixteen(simd, &outlines.mean[axis], first) + (tile.origin[axis] as f32 + 0.5),
        );
        let slope = sixteen_of(simd, &outlines.depth_slope, first);
        let (depth, sigma_z) =
            (sixteen(simd, &outlines.depth, first), sixteen(simd, &outlines.sigma_z, first));
        let Distances { center, slope, sigma } = slabs.distances(simd, mean, (depth, slope, sigma_z));
        let point = mask32x16::from_bitmask(simd, outlines.points >> first);
        let slope = slope.each(
            #[inline(always)]
            |slope| point.select(W::simd_from(simd, 0.0), slope),
        );
        let Spread { inverse, half, normal_part } = slabs.spread(simd, sigma);
        let per_pixel = inverse * (-1.0 / BOX);
        let SlabColumns {
            distance,
            slope: slopes,
            share_slope,
            inverse: inverses,
            half: halves,
            normal_part: normal_parts,
            narrow,
            at_centers,
            ..
        } = &mut self.slabs;
        center.store_slice(&mut distance[range.clone()]);
        slope[0].store_slice(&mut slopes[0][range.clone()]);
        slope[1].store_slice(&mut slopes[1][range.clone()]);
        (slope[0] * per_pixel).store_slice(&mut share_slope[0][range.clone()]);
        (slope[1] * per_pixel).store_slice(&mut share_slope[1][range.clone()]);
        normal_part.store_slice(&mut normal_parts[range.clone()]);
        inverse.store_slice(&mut inverses[range.clone()]);
        half.store_slice(&mut halves[range]);
        let wider = normal_part.simd_gt(W::simd_from(simd, 0.0)).to_bitmask();
        *narrow &= !(wider << first | *at_centers);
        // The change over a σ of the footprint, as in `prepare`.
        let [a, b, c] = sixteen_of(simd, &outlines.root, first);
        let x = slope[0] * reciprocal(simd, a);
        let y = (slope[1] - b * x) * reciprocal(simd, c);
        let deviation = x.mul_add(x, y * y).sqrt() * ROOT_HALF_LOG2_E;
        let amplitude = sixteen(simd, &self.amplitude, first);
        let narrow = mask32x16::from_bitmask(simd, *narrow >> first);
        let planes = narrow.select(W::simd_from(simd, 1.0), W::simd_from(simd, 2.0));
        let level = slabs.are_level(simd, (deviation, inverse, planes), amplitude).to_bitmask() << first;
        self.prepare_level(simd, slabs, (first, level));
    }

    /// Finds what level kernels among sixteen records have in their slabs.
    #[inline(always)]
    fn prepare_level<S: Simd>(&mut self, simd: S, slabs: &Slabs, (first, level): (usize, u64)) {
        let own = 0xffff << first;
        let SlabColumns { narrow, in_three, .. } = self.slabs;
        let level = level & (narrow | in_three) & !self.opacities & !self.outlines.exact & own;
        let by_count = [level & narrow, level & in_three];
        for (all, level) in self.slabs.level.iter_mut().zip(by_count) {
            *all = *all & !own | level;
        }
        if level == 0 {
            return;
        }
        let mut ends = [0.0; 16];
        for (end, slab) in ends.iter_mut().zip(&self.slabs.first[first..]) {
            *end = slabs.begin(slab + 1);
        }
        let (end_of_first, thickness) = (W::simd_from(simd, ends), slabs.thickness());
        let (distance, inverse) =
            (sixteen(simd, &self.slabs.distance, first), sixteen(simd, &self.slabs.inverse, first));
        let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
        let amplitude = sixteen(simd, &self.amplitude, first);
        let normal_part = sixteen(simd, &self.slabs.normal_part, first);
        let are_boxes = by_count[1] == 0;
        // The mean z of what is in a slab is that of a box with the σ of the spread.
        let half = W::simd_from(simd, 0.5 * BOX) / inverse;
        let per_distance = if slabs.is_parallel() {
            W::simd_from(simd, 0.5)
        } else {
            sixteen(simd, &self.outlines.depth, first) * 0.5 / distance.max(W::simd_from(simd, 1e-20))
        };
        let colors = sixteen_of(simd, &self.color, first);
        let (mut begin, mut passed) = (end_of_first - thickness, zero);
        let is_last = [0, narrow, in_three].each(
            #[inline(always)]
            |set| mask32x16::from_bitmask(simd, set >> first),
        );
        let count = if are_boxes { 2 } else { 3 };
        for (slab, heap) in self.slabs.in_slabs[..count].iter_mut().enumerate() {
            let end = begin + thickness;
            // The last slab gets what is left.
            let x = (end - distance) * inverse;
            let until = if are_boxes { share_of_box(simd, x) } else { share_before(simd, x, normal_part) };
            let until = is_last[slab].select(one, until);
            let optical_depth = amplitude * (until - passed).max(zero);
            let ends = (distance - half).max(begin).min(end) + (distance + half).max(begin).min(end);
            let range = first..first + 16;
            optical_depth.store_slice(&mut heap.optical_depth[range.clone()]);
            (optical_depth * per_distance * ends).store_slice(&mut heap.depth[range.clone()]);
            for (column, color) in heap.color.iter_mut().zip(colors) {
                (optical_depth * color).store_slice(&mut column[range.clone()]);
            }
            (begin, passed) = (end, until);
        }
    }

    /// w = e^{−r/2} of a plain kernel in the affine form at pixels; and, where depth is asked for, that times how much farther its z is there than
    /// at its mean.
    #[inline(always)]
    pub(crate) fn plain_weight<S: Simd, const DEPTH: bool>(
        &self,
        simd: S,
        number: usize,
        pixels: [W<S>; 2],
    ) -> [W<S>; 2] {
        let offsets = self.outlines.offsets(simd, number, pixels);
        let weight = self.weight(simd, number, offsets.exponent);
        let slope = [0, 1].map(|axis| self.outlines.depth_slope[axis][number]);
        [weight, if DEPTH { weight * offsets.linear(simd, 0.0, slope) } else { weight }]
    }

    /// The optical depth of a plain kernel that is spread as a box at pixels, and its share before a distance.
    #[inline(always)]
    pub(crate) fn plain_share_before<S: Simd>(
        &self,
        simd: S,
        number: usize,
        pixels: [W<S>; 2],
        plane: f32,
    ) -> (W<S>, W<S>) {
        let offsets = self.outlines.offsets(simd, number, pixels);
        let optical_depth = self.affine_optical_depth(simd, number, offsets.exponent);
        let SlabColumns { distance, share_slope: [x, y], inverse, .. } = &self.slabs;
        let at_mean = (plane - distance[number]).mul_add(inverse[number] * (1.0 / BOX), 0.5);
        let share = offsets.linear(simd, at_mean, [x[number], y[number]]);
        (optical_depth, share.max(W::simd_from(simd, 0.0)).min(W::simd_from(simd, 1.0)))
    }

    /// The distance of a kernel in the affine form at pixels.
    #[inline(always)]
    pub(crate) fn affine_distance<S: Simd>(&self, simd: S, number: usize, pixels: [W<S>; 2]) -> W<S> {
        let SlabColumns { distance, slope: [x, y], .. } = &self.slabs;
        self.outlines.offsets(simd, number, pixels).linear(simd, distance[number], [x[number], y[number]])
    }

    /// The distance of a kernel of any form at pixels, `exact` if it is in the exact form.
    #[inline(always)]
    pub(crate) fn distance<S: Simd>(&self, simd: S, number: usize, pixels: [W<S>; 2], exact: W<S>) -> W<S> {
        if self.outlines.is_exact(number) { exact } else { self.affine_distance(simd, number, pixels) }
    }

    /// 1/σ of the spread of a kernel of any form at pixels, whose σ along rays is `exact` if it is in the exact form.
    #[inline(always)]
    pub(crate) fn inverse_spread<S: Simd>(
        &self,
        simd: S,
        number: usize,
        (slabs, exact): (&Slabs, W<S>),
    ) -> W<S> {
        if self.outlines.is_exact(number) {
            // Never 0: what is infinitely far away would have no share that is a number.
            slabs.spread(simd, exact).inverse.max(W::simd_from(simd, 1e-30))
        } else {
            W::simd_from(simd, self.slabs.inverse[number])
        }
    }

    /// The slabs that a record, or a piece of one, may touch in the block with a corner.
    #[inline(always)]
    pub(crate) fn slabs_in(&self, number: usize, corner: [f32; 2], slabs: &Slabs) -> [u32; 2] {
        let SlabColumns { first, last, distance, slope, half, .. } = &self.slabs;
        let (first, last) = (first[number], last[number] as u32);
        // A piece that another follows has all until its end: the other one has what is behind that.
        let goes_on = self.slabs.end >> number & 1 == 0;
        if self.outlines.is_exact(number) || goes_on {
            return [first, last];
        }
        let [x, y] = [0, 1].map(|axis| corner[axis] + HALF_BLOCK - self.outlines.mean[axis][number]);
        let slope = [slope[0][number], slope[1][number]];
        let middle = slope[0].mul_add(x, slope[1].mul_add(y, distance[number]));
        let half = (slope[0].abs() + slope[1].abs()).mul_add(HALF_BLOCK, half[number]);
        slabs.numbers_at([middle - half, middle + half]).map(|number| number.clamp(first, last))
    }
}
