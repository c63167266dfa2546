//! Which blocks of a tile the ellipses of records meet.

use super::column::{BATCH, Column, Place, sixteen, sixteen_of};
use super::offsets::{HALF_LOG2_E, Offsets, Plane, ROOT_HALF_LOG2_E};
use super::sixteen::Sixteen;
use crate::footprint::{Form, Octet, Rect};
use crate::simd::*;
use crate::tile::{BLOCK_SIDE, MAX_BLOCKS, Tile};
use std::ops::Range;

/// The footprints of a batch of records, from the centre of the tile's first pixel.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Outlines {
    pub(crate) mean: [Column; 2],
    /// √k M, with kq = |√k Mu|².
    pub(crate) root: [Column; 3],
    /// Where kr ends.
    pub(crate) end: Column,
    pub(crate) depth: Column,
    pub(crate) depth_slope: [Column; 2],
    pub(crate) sigma_z: Column,
    /// The slopes of t and (σ₀/d_z)²/k where any is in the exact form; 0 of the others.
    pub(crate) t_slope: [Column; 2],
    pub(crate) spread: Column,
    /// Those in the exact form, and the points.
    pub(crate) exact: u64,
    pub(crate) points: u64,
    count: usize,
}

/// For each block of a tile the records of a batch that it needs, by sixteens.
#[derive(Clone, Copy)]
pub(crate) struct BlockMasks([[u16; BATCH / 16]; MAX_BLOCKS]);

impl BlockMasks {
    pub(crate) const NONE: Self = Self([[0; BATCH / 16]; MAX_BLOCKS]);

    /// The records that a block needs.
    #[inline(always)]
    pub(crate) fn of(&self, block: usize) -> u64 {
        let [a, b, c, d] = self.0[block].map(u64::from);
        a | b << 16 | c << 32 | d << 48
    }

    /// Leaves out all records but these.
    #[inline(always)]
    pub(crate) fn keep(&mut self, kept: u64) {
        if kept != u64::MAX {
            let kept: [u16; BATCH / 16] = std::array::from_fn(|i| (kept >> (16 * i)) as u16);
            for masks in &mut self.0 {
                for (mask, kept) in masks.iter_mut().zip(kept) {
                    *mask &= kept;
                }
            }
        }
    }

    /// Adds a record to all blocks that its rectangle touches.
    pub(super) fn add_rect(&mut self, number: usize, rect: &Rect, tile: Tile) {
        let mut blocks = tile.blocks_of(rect);
        while blocks != 0 {
            self.0[blocks.trailing_zeros() as usize][number / 16] |= 1 << (number % 16);
            blocks &= blocks - 1;
        }
    }
}

impl Default for Outlines {
    fn default() -> Self {
        Self::NONE
    }
}

impl Outlines {
    pub(crate) const NONE: Self = Self {
        mean: [[0.0; BATCH]; 2],
        root: [[1.0; BATCH]; 3],
        end: [0.0; BATCH],
        depth: [1.0; BATCH],
        depth_slope: [[0.0; BATCH]; 2],
        sigma_z: [0.0; BATCH],
        t_slope: [[0.0; BATCH]; 2],
        spread: [0.0; BATCH],
        exact: 0,
        points: 0,
        count: 0,
    };

    /// Begins with as many records; those of a set are known to be in the exact form.
    #[inline(always)]
    pub(crate) fn begin_with(&mut self, count: usize, exact: u64) {
        (self.exact, self.points, self.count) = (exact, 0, count);
    }

    /// Puts in some of an octet's surfels, as they are, from a place on.
    #[inline(always)]
    pub(crate) fn put<S: Simd>(&mut self, simd: S, place: Place<S>, octet: &Octet) {
        for axis in 0..2 {
            place.put(simd, &mut self.mean[axis], &octet.mean[axis]);
            place.put(simd, &mut self.depth_slope[axis], &octet.depth_slope[axis]);
        }
        for (column, root) in self.root.iter_mut().zip(&octet.conic_root) {
            place.put(simd, column, root);
        }
        place.put(simd, &mut self.depth, &octet.depth);
        place.put(simd, &mut self.sigma_z, &octet.sigma_z);
    }

    /// Takes in sixteen records as they are.
    #[inline(always)]
    pub(super) fn set<S: Simd>(&mut self, simd: S, first: usize, records: &Sixteen<S>) {
        let range = first..first + 16;
        for axis in 0..2 {
            records.mean[axis].store_slice(&mut self.mean[axis][range.clone()]);
            records.depth_slope[axis].store_slice(&mut self.depth_slope[axis][range.clone()]);
        }
        for (column, root) in self.root.iter_mut().zip(records.conic_root) {
            root.store_slice(&mut column[range.clone()]);
        }
        records.depth.store_slice(&mut self.depth[range.clone()]);
        records.sigma_z.store_slice(&mut self.sigma_z[range]);
        self.exact |= records.in_form(simd, Form::Exact) << first & self.all();
        self.points |= records.in_form(simd, Form::Point) << first & self.all();
    }

    /// Turns the records as they are into what pixels of a tile need.
    #[inline(always)]
    pub(crate) fn prepare<S: Simd>(&mut self, simd: S, tile: Tile) {
        let step = tile.step as f32;
        for first in (0..self.count).step_by(16) {
            for (axis, column) in self.mean.iter_mut().enumerate() {
                let origin = tile.origin[axis] as f32 + 0.5 / step;
                let mean = sixteen(simd, column, first) * (1.0 / step) - origin;
                mean.store_slice(&mut column[first..first + 16]);
            }
            for column in &mut self.root {
                let root = sixteen(simd, column, first) * (ROOT_HALF_LOG2_E * step);
                root.store_slice(&mut column[first..first + 16]);
            }
            if tile.step > 1 {
                for column in &mut self.depth_slope {
                    let slope = sixteen(simd, column, first) * step;
                    slope.store_slice(&mut column[first..first + 16]);
                }
            }
            if self.exact != 0 {
                self.prepare_exact(simd, first);
            }
        }
    }

    /// Finds what the exact form makes of the depths of sixteen records, if they are in it.
    #[inline(always)]
    fn prepare_exact<S: Simd>(&mut self, simd: S, first: usize) {
        let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
        let exact = mask32x16::from_bitmask(simd, self.exact >> first);
        let per_depth = exact.select(one / sixteen(simd, &self.depth, first), zero);
        let ratio = exact.select(per_depth * sixteen(simd, &self.sigma_z, first), zero);
        for (column, slope) in self.t_slope.iter_mut().zip(&self.depth_slope) {
            (-(sixteen(simd, slope, first) * per_depth)).store_slice(&mut column[first..first + 16]);
        }
        (ratio * ratio / HALF_LOG2_E).store_slice(&mut self.spread[first..first + 16]);
    }

    /// All of them, as bits.
    #[inline(always)]
    pub(crate) fn all(&self) -> u64 {
        u64::MAX.checked_shr((BATCH - self.count) as u32).unwrap_or(0)
    }

    /// Beginnings of the sixteens of records.
    #[inline(always)]
    pub(crate) fn sixteens(&self) -> impl Iterator<Item = usize> + use<> {
        (0..self.count).step_by(16)
    }

    /// Whether a record is in the exact form.
    #[inline(always)]
    pub(crate) fn is_exact(&self, number: usize) -> bool {
        self.exact >> number & 1 != 0
    }

    /// What the exact form needs of a record, where any is in it. Of one that isn't, what makes it affine.
    #[inline(always)]
    pub(crate) fn plane(&self, number: usize) -> Plane {
        Plane {
            depth: self.depth[number],
            slope: [self.depth_slope[0][number], self.depth_slope[1][number]],
            t_slope: [self.t_slope[0][number], self.t_slope[1][number]],
            spread: self.spread[number],
        }
    }

    /// Where pixels are from the mean of a record.
    #[inline(always)]
    pub(crate) fn offsets<S: Simd>(&self, simd: S, number: usize, pixels: [W<S>; 2]) -> Offsets<S> {
        let ([x, y], [a, b, c]) = (&self.mean, &self.root);
        Offsets::new(simd, pixels, ([x[number], y[number]], [a[number], b[number], c[number]]))
    }

    /// The ellipses of sixteen records, and those that have none since perspective makes none of theirs.
    #[inline(always)]
    fn ellipses<S: Simd>(&self, simd: S, first: usize) -> (Ellipses<S>, mask32x16<S>) {
        let mut ellipses = Ellipses {
            mean: sixteen_of(simd, &self.mean, first),
            root: sixteen_of(simd, &self.root, first),
            end: sixteen(simd, &self.end, first),
        };
        let mut open = mask32x16::splat(simd, false);
        if self.exact >> first & 0xffff != 0 {
            let exact = mask32x16::from_bitmask(simd, self.exact >> first);
            open = ellipses.make_exact(simd, exact, self, first);
        }
        (ellipses, open)
    }

    /// How far from their means sixteen records reach along rows and along columns; ∞ where they have no ellipse.
    #[inline(always)]
    pub(crate) fn reaches<S: Simd>(&self, simd: S, first: usize) -> [W<S>; 2] {
        let (ellipses, open) = self.ellipses(simd, first);
        let own = ellipses.half_sides(simd);
        [0, 1].each(
            #[inline(always)]
            |axis| {
                let shift = ellipses.mean[axis] - sixteen(simd, &self.mean[axis], first);
                open.select(W::simd_from(simd, f32::INFINITY), own[axis] + shift.abs())
            },
        )
    }

    /// The blocks that each record of a set needs: those that its ellipse meets, and where perspective makes none of it, those of
    /// its rectangle.
    #[inline(always)]
    pub(crate) fn blocks<'a, S: Simd>(
        &self,
        simd: S,
        tile: Tile,
        kept: u64,
        rect: impl Fn(usize) -> &'a Rect,
    ) -> BlockMasks {
        let (mut masks, mut open) = (BlockMasks::NONE, 0);
        let kept = kept & self.all();
        if kept == 0 {
            return masks;
        }
        for first in self.sixteens() {
            let (ellipses, of_sixteen) = self.ellipses(simd, first);
            open |= of_sixteen.to_bitmask() << first;
            let kept = mask32x16::from_bitmask(simd, kept >> first);
            ellipses.meet(simd, tile, (first, kept), &mut masks);
        }
        open &= kept;
        masks.keep(kept & !open);
        for number in (0..self.count).filter(|number| open >> number & 1 != 0) {
            masks.add_rect(number, rect(number), tile);
        }
        masks
    }
}

/// Sixteen ellipses q(u) ≤ end.
struct Ellipses<S: Simd> {
    mean: [W<S>; 2],
    root: [W<S>; 3],
    end: W<S>,
}

impl<S: Simd> Ellipses<S> {
    /// The ellipses of records in the exact form. With t = 1 − κ s·u and den = t² + (κσ₀)²q,
    ///
    /// ```text
    /// q ≤ ρ den    is    uᵀAu + 2ρκ s·u ≤ ρ,    A = (1 − ρ(κσ₀)²) Q − ρκ² ssᵀ
    /// ```
    ///
    /// whose centre is −A⁻¹ρκs. Says which have none since A is not positive.
    #[inline(always)]
    fn make_exact(
        &mut self,
        simd: S,
        exact: mask32x16<S>,
        outlines: &Outlines,
        first: usize,
    ) -> mask32x16<S> {
        let one = W::simd_from(simd, 1.0);
        let end = self.end;
        let depth = sixteen(simd, &outlines.depth, first);
        let [x, y] = sixteen_of(simd, &outlines.t_slope, first).each(
            #[inline(always)]
            |slope| -slope,
        );
        let share = one - sixteen(simd, &outlines.spread, first) * end;
        let [a, b, c] = self.root;
        let xx = (share * a).mul_sub(a, end * x * x);
        let xy = (share * a).mul_sub(b, end * x * y);
        let yy = share.mul_sub(b.mul_add(b, c * c), end * y * y);
        let area = xx.mul_sub(yy, xy * xy);
        // Where next to nothing is left of A, so little of it is right.
        let is_ellipse = depth.simd_gt(W::simd_from(simd, 0.0))
            & xx.simd_gt(a * a * 0.01)
            & area.simd_gt(a * a * c * c * 0.01);
        let per_area = end / area;
        let center = [xy.mul_sub(y, yy * x) * per_area, xy.mul_sub(x, xx * y) * per_area];
        let own_end = end - end * (x.mul_add(center[0], y * center[1]));
        let own_a = xx.sqrt();
        let root = [own_a, xy / own_a, (area / xx).sqrt()];
        for (mean, center) in self.mean.iter_mut().zip(center) {
            *mean = exact.select(*mean + center, *mean);
        }
        for (root, own) in self.root.iter_mut().zip(root) {
            *root = exact.select(own, *root);
        }
        self.end = exact.select(own_end, end);
        exact & !is_ellipse
    }

    /// Those of the boxes around them.
    #[inline(always)]
    fn half_sides(&self, simd: S) -> [W<S>; 2] {
        let [a, b, c] = self.root;
        // √V_xx is √(b² + c²)/(ac), √V_yy 1/c.
        let per_ac = self.end.sqrt() * (W::simd_from(simd, 1.0) / (a * c));
        [b.mul_add(b, c * c).sqrt() * per_ac, a * per_ac]
    }

    /// Adds records to the masks of the blocks that their ellipses meet: in a column of blocks those between the
    /// ellipse's outermost pixels there. Looks no further than those that are kept reach.
    #[inline(always)]
    fn meet(&self, simd: S, tile: Tile, (first, kept): (usize, mask32x16<S>), masks: &mut BlockMasks) {
        /// The first pixels of blocks.
        const ROWS: [f32; 8] = [0.0, 4.0, 8.0, 12.0, 16.0, 20.0, 24.0, 28.0];
        let zero = W::simd_from(simd, 0.0);
        let Self { mean: [x, y], root: [a, b, c], end } = *self;
        // v = mu ± √((ρ − u²/V_xx)/s); the lowest point over an interval is at its end nearest to the lowest of all.
        let s = b.mul_add(b, c * c);
        let inverse_s = W::simd_from(simd, 1.0) / s;
        let inverse_ac = W::simd_from(simd, 1.0) / (a * c);
        // Rounding moves a pixel by less than a hundredth.
        let [reach, half] = self.half_sides(simd).each(
            #[inline(always)]
            |half| half + 0.01,
        );
        let lowest = -b * inverse_ac * end.sqrt();
        let m = -a * b * inverse_s;
        let per_u = -(a * c) * (a * c) * inverse_s;
        let columns = blocks_around(simd, tile, kept, [x - reach, x + reach]);
        let rows = blocks_around(simd, tile, kept, [y - half, y + half]);
        for column in columns {
            let left = W::simd_from(simd, (column * BLOCK_SIDE) as f32) - x;
            let right = left + (BLOCK_SIDE - 1) as f32;
            let is_met = left.simd_le(reach) & right.simd_ge(-reach);
            if !is_met.any_true() {
                continue;
            }
            let (left, right) = (left.max(-reach), right.min(reach));
            let [(u, half), (u_top, half_top)] = [lowest, -lowest].each(
                #[inline(always)]
                |lowest| {
                    let u = lowest.max(left).min(right);
                    let under = ((u * u).mul_add(per_u, end) * inverse_s).max(zero);
                    (u, under.sqrt() + 0.01)
                },
            );
            let (bottom, top) = (u.mul_add(m, y) + half, u_top.mul_add(m, y) - half_top);
            let start = column * tile.blocks_a_side();
            for (mask, row) in masks.0[start..start + rows.end].iter_mut().zip(ROWS).skip(rows.start) {
                let met = is_met
                    & bottom.simd_ge(W::simd_from(simd, row))
                    & top.simd_le(W::simd_from(simd, row + (BLOCK_SIDE - 1) as f32));
                mask[first / 16] = met.to_bitmask() as u16;
            }
        }
    }
}

/// The columns, or the rows, of a tile's blocks that any of sixteen ranges of pixels reaches into. What is no number reaches nowhere.
#[inline(always)]
fn blocks_around<S: Simd>(simd: S, tile: Tile, kept: mask32x16<S>, [low, high]: [W<S>; 2]) -> Range<usize> {
    let infinity = W::simd_from(simd, f32::INFINITY);
    let low = (kept & low.simd_eq(low)).select(low, infinity).reduce_min();
    let high = (kept & high.simd_eq(high)).select(high, -infinity).reduce_max();
    // Casts keep to the numbers that there are.
    let block = |pixel: f32| pixel as usize / BLOCK_SIDE;
    let end = if high < 0.0 { 0 } else { (block(high) + 1).min(tile.blocks_a_side()) };
    block(low).min(end)..end
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::footprint::{Record, Tag};
    use crate::simd::{Level, dispatch};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 512, failure_persistence: None, ..ProptestConfig::default() })]

        /// Every pixel in the ellipse lies in a block that is met, and a block that is met is not two pixels off.
        #[test]
        fn blocks_are_those_with_pixels(
            mean in prop::array::uniform2(20.0..90.0f32),
            log_scales in prop::array::uniform2(-0.5..2.5f32),
            turn in 0.0..3.2f32,
            plane in prop::array::uniform3(-1.0..1.0f32),
            form in prop_oneof![Just(Form::Affine), Just(Form::Exact)],
            side in prop_oneof![Just(8_usize), Just(16), Just(32)],
        ) {
            let tile = Tile::new([1, 2], side, [200, 200]);
            // M with V = Σ s² e eᵀ, as the footprint stage gives it.
            let (sin, cos) = turn.sin_cos();
            let [p, q] = log_scales.map(|log| (2.0 * log).exp());
            let (xx, yy, xy) = (p * cos * cos + q * sin * sin, p * sin * sin + q * cos * cos, (p - q) * sin * cos);
            let area = xx * yy - xy * xy;
            let conic_root = [(yy / area).sqrt(), -xy / (yy * area).sqrt(), 1.0 / yy.sqrt()];
            // Up to a third of the depth within the ellipse.
            let depth_slope = [plane[0], plane[1]].map(|x| x * 0.06 / p.max(q).sqrt());
            let record = Record {
                mean,
                conic_root,
                depth: 1.0,
                depth_slope,
                sigma_z: 0.1 * plane[2].abs(),
                tag: Tag { form, ..Record::BLANK.tag },
                ..Record::BLANK
            };
            let end = 12.25;
            let (number, mut outlines) = (5, Outlines::NONE);
            outlines.begin_with(number + 1, 0);
            outlines.end = [end * HALF_LOG2_E; BATCH];
            for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
                let masks = dispatch!(level, simd => {
                    let mut outlines = outlines;
                    outlines.set(simd, 0, &Sixteen::of(simd, |_| &record));
                    outlines.prepare(simd, tile);
                    outlines.blocks(simd, tile, u64::MAX, |_| unreachable!("every ellipse is one"))
                });
                for block in 0..tile.blocks() {
                    let corner = tile.corner(block);
                    let r = |pixel: [i32; 2]| {
                        let [u, v] = [0, 1].map(|axis| {
                            (tile.origin[axis] + corner[axis]) as f32 + 0.5 + pixel[axis] as f32 - mean[axis]
                        });
                        let [a, b, c] = conic_root;
                        let q = (a * u + b * v).powi(2) + (c * v).powi(2);
                        let t = 1.0 - depth_slope[0] * u - depth_slope[1] * v;
                        if form == Form::Exact { q / (t * t + record.sigma_z.powi(2) * q) } else { q }
                    };
                    let any = |margin: i32, end: f32| {
                        let mut pixels = (-margin..4 + margin).flat_map(|i| (-margin..4 + margin).map(move |j| [i, j]));
                        pixels.any(|pixel| r(pixel) <= end)
                    };
                    let met = masks.of(block) >> number & 1 == 1;
                    prop_assert!(met || !any(0, end - 1e-3), "{level:?}: block {block} is missing");
                    prop_assert!(!met || any(2, end), "{level:?}: block {block} is too much");
                }
            }
        }
    }
}
