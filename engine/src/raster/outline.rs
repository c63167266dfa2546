//! Which blocks of a tile the ellipses of records meet.

use super::offsets::Offsets;
use crate::footprint::Rect;
use crate::simd::*;
use crate::tile::{BLOCK_SIDE, MAX_BLOCKS, MAX_SIDE, Tile};

/// Records that are rasterized together: as many as a mask has bits.
pub(crate) const BATCH: usize = u64::BITS as usize;

/// A number for each record of a batch.
pub(crate) type Column = [f32; BATCH];

/// The ellipses of a batch of records in the affine form.
#[repr(C, align(64))]
pub(crate) struct Outlines {
    /// From the centre of the tile's first pixel.
    pub(crate) mean: [Column; 2],
    /// M with q = |Mu|².
    pub(crate) root: [Column; 3],
    /// Where q ends.
    pub(crate) end: Column,
}

/// For each block of a tile the records of a batch that it needs.
pub(crate) type BlockMasks = [u64; MAX_BLOCKS];

impl Outlines {
    pub(crate) const NONE: Self =
        Self { mean: [[0.0; BATCH]; 2], root: [[1.0; BATCH]; 3], end: [0.0; BATCH] };

    /// Where pixels are from the mean of a record.
    #[inline(always)]
    pub(crate) fn offsets<S: Simd>(&self, simd: S, number: usize, pixels: [W<S>; 2]) -> Offsets<S> {
        let ([x, y], [a, b, c]) = (&self.mean, &self.root);
        Offsets::new(simd, pixels, ([x[number], y[number]], [a[number], b[number], c[number]]))
    }

    /// The blocks that each ellipse meets, column of blocks by column: between the outermost pixels of the ellipse
    /// there. The first `count` records are looked at, and any that the batch had before behind them.
    #[inline(always)]
    pub(crate) fn meet<S: Simd>(&self, simd: S, tile: Tile, count: usize) -> BlockMasks {
        let mut masks = [0; MAX_BLOCKS];
        let least = W::simd_from(simd, 1e-30);
        let (zero, last) = (W::simd_from(simd, 0.0), W::simd_from(simd, (BLOCK_SIDE - 1) as f32));
        for first in (0..count).step_by(16) {
            let [x, y] = sixteen_of(simd, &self.mean, first);
            let [a, b, c] = sixteen_of(simd, &self.root, first);
            let end = sixteen(simd, &self.end, first);
            // v = mu ± √((ρ − u²/V_xx)/s); the lowest point over an interval is at its end nearest to the lowest of all.
            let s = b.mul_add(b, c * c);
            let inverse_s = W::simd_from(simd, 1.0) / s;
            let inverse_ac = W::simd_from(simd, 1.0) / (a * c);
            let root = end.sqrt();
            // Rounding moves a pixel by less than a hundredth.
            let reach = root * s.sqrt() * inverse_ac + 0.01;
            let lowest = -b * inverse_ac * root;
            let m = -a * b * inverse_s;
            let per_u = -(a * c) * (a * c) * inverse_s;
            for column in 0..tile.blocks_a_side() {
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
                        let under = ((u * u).mul_add(per_u, end) * inverse_s).max(least);
                        (u, under * inverse_root(simd, under) + 0.01)
                    },
                );
                // From the first row of blocks, then from the next.
                let (mut bottom, mut top) = (u.mul_add(m, y) + half, u_top.mul_add(m, y) - half_top);
                let rows = column * tile.blocks_a_side()..(column + 1) * tile.blocks_a_side();
                for mask in &mut masks[rows] {
                    let met = is_met & bottom.simd_ge(zero) & top.simd_le(last);
                    *mask |= met.to_bitmask() << first;
                    (bottom, top) = (bottom - BLOCK_SIDE as f32, top - BLOCK_SIDE as f32);
                }
            }
        }
        masks
    }
}

/// The numbers of sixteen records.
#[inline(always)]
pub(crate) fn sixteen<S: Simd>(simd: S, column: &Column, first: usize) -> W<S> {
    W::from_slice(simd, &column[first..first + 16])
}

/// As [`sixteen`], of some columns.
#[inline(always)]
pub(crate) fn sixteen_of<S: Simd, const N: usize>(simd: S, columns: &[Column; N], first: usize) -> [W<S>; N]
where
    for<'a> [&'a Column; N]: Each<&'a Column, N>,
{
    columns.each_ref().each(
        #[inline(always)]
        |column| sixteen(simd, column, first),
    )
}

/// Adds a record to the masks of all blocks of a tile that its rectangle touches.
pub(crate) fn add_rect(masks: &mut BlockMasks, number: usize, rect: &Rect, tile: Tile) {
    let range = |axis: usize| {
        let origin = tile.origin[axis];
        let from = usize::from(rect.min[axis]).saturating_sub(origin);
        let to = usize::from(rect.max[axis]).saturating_sub(origin).min(MAX_SIDE.min(tile.side));
        from / BLOCK_SIDE..to.div_ceil(BLOCK_SIDE)
    };
    for column in range(0) {
        for row in range(1) {
            masks[column * tile.blocks_a_side() + row] |= 1 << number;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Level, dispatch};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

        /// Every pixel in the ellipse lies in a block that is met, and a block that is met is not two pixels off.
        #[test]
        fn blocks_are_those_with_pixels(
            mean in prop::array::uniform2(-20.0..50.0f32),
            log_scales in prop::array::uniform2(-0.5..2.5f32),
            turn in 0.0..3.2f32,
            side in prop_oneof![Just(8_usize), Just(16), Just(32)],
        ) {
            let tile = Tile::new([1, 2], side, [200, 200]);
            // M = R⁻¹-like root of a turned ellipse: V = Σ s² e eᵀ, as the footprint stage gives it.
            let (sin, cos) = turn.sin_cos();
            let [p, q] = log_scales.map(|log| (2.0 * log).exp());
            let (xx, yy, xy) = (p * cos * cos + q * sin * sin, p * sin * sin + q * cos * cos, (p - q) * sin * cos);
            let area = xx * yy - xy * xy;
            let [a, b, c] = [(yy / area).sqrt(), -xy / (yy * area).sqrt(), 1.0 / yy.sqrt()];
            let mut outlines = Outlines::NONE;
            let (number, end) = (5, 12.25);
            for (column, value) in outlines.mean.iter_mut().chain(&mut outlines.root).zip([mean[0], mean[1], a, b, c]) {
                column[number] = value;
            }
            outlines.end[number] = end;
            for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
                let masks = dispatch!(level, simd => outlines.meet(simd, tile, number + 1));
                for block in 0..tile.blocks() {
                    let [left, top] = tile.corner(block);
                    let q = |x: f32, y: f32| {
                        let (u, v) = (x - mean[0], y - mean[1]);
                        (a * u + b * v).powi(2) + (c * v).powi(2)
                    };
                    let any = |margin: i32, end: f32| {
                        let pixel = |from: usize, i: i32| from as f32 + i as f32;
                        let mut pixels = (-margin..4 + margin).flat_map(|i| (-margin..4 + margin).map(move |j| (i, j)));
                        pixels.any(|(i, j)| q(pixel(left, i), pixel(top, j)) <= end)
                    };
                    let met = masks[block] >> number & 1 == 1;
                    prop_assert!(met || !any(0, end - 1e-3), "{level:?}: block {block} is missing");
                    prop_assert!(!met || any(2, end), "{level:?}: block {block} is too much");
                }
            }
        }
    }
}
