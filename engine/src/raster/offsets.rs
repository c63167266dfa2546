//! Where the pixels of a block are from a record's mean.

use crate::simd::*;
use crate::tile::Block;

/// e^{−r/2} = 2^{−kr}.
pub(crate) const HALF_LOG2_E: f32 = 0.5 * std::f32::consts::LOG2_E;

/// √k, by which roots of conics are scaled.
pub(crate) const ROOT_HALF_LOG2_E: f32 = 0.849_321_8;

/// Offsets (u, v) and the two terms of kq = along² + across².
pub(crate) struct Offsets<S: Simd> {
    pub(crate) u: W<S>,
    pub(crate) v: Block<S>,
    pub(crate) along: Block<S>,
    pub(crate) across: Block<S>,
}

impl<S: Simd> Offsets<S> {
    /// From a record's mean and √k M; `pixels` are the columns and rows of the first two rows of pixels.
    #[inline(always)]
    pub(crate) fn new(simd: S, pixels: [W<S>; 2], (mean, root): ([f32; 2], [f32; 3])) -> Self {
        let [a, b, c] = root;
        let (u, v) = (pixels[0] - mean[0], pixels[1] - mean[1]);
        let along = u.mul_add(W::simd_from(simd, a), v * b);
        Self { u, v: by_rows(v, 1.0), along: by_rows(along, b), across: by_rows(v * c, c) }
    }

    /// −kq.
    #[inline(always)]
    pub(crate) fn exponent(&self, pair: usize) -> W<S> {
        let (along, across) = (self.along[pair], self.across[pair]);
        (-along).mul_sub(along, across * across)
    }

    /// A function of the pixel that is linear.
    #[inline(always)]
    pub(crate) fn linear(&self, simd: S, at_mean: f32, [x, y]: [f32; 2]) -> Block<S> {
        let first = self.u.mul_add(W::simd_from(simd, x), self.v[0] * y) + at_mean;
        by_rows(first, y)
    }
}

/// Two rows of values, and those below, that change by `a_row` from row to row.
#[inline(always)]
fn by_rows<S: Simd>(first: W<S>, a_row: f32) -> Block<S> {
    let step = W::simd_from(first.simd, 2.0 * a_row);
    let second = first + step;
    let third = second + step;
    [first, second, third, third + step]
}

/// A record in the exact form at the pixels of a block.
///
/// With κ = 1/d_z, t = 1 − κ·rise, den = t² + (κσ₀)² q: r = q/den, σ_z = σ₀/√den, z = (d_z − rise)/den.
pub(crate) struct ExactBlock<S: Simd> {
    /// −kr.
    pub(crate) exponent: Block<S>,
    /// z of the densest point.
    pub(crate) depth: Block<S>,
    pub(crate) den: Block<S>,
}

impl<S: Simd> ExactBlock<S> {
    /// From where pixels are, and a record's depth, its slope and σ₀.
    #[inline(always)]
    pub(crate) fn new(simd: S, offsets: &Offsets<S>, (depth, slope, sigma_z): (f32, [f32; 2], f32)) -> Self {
        let one = W::simd_from(simd, 1.0);
        let inverse_depth = 1.0 / depth;
        let spread = W::simd_from(simd, (inverse_depth * sigma_z).powi(2) / HALF_LOG2_E);
        let rises = offsets.linear(simd, 0.0, slope);
        let mut block = Self { exponent: rises, depth: rises, den: rises };
        for i in 0..4 {
            let exponent = offsets.exponent(i);
            let t = one - rises[i] * inverse_depth;
            block.den[i] = (-exponent).mul_add(spread, t * t);
            let inverse = reciprocal(simd, block.den[i]);
            block.exponent[i] = exponent * inverse;
            block.depth[i] = (W::simd_from(simd, depth) - rises[i]) * inverse;
        }
        block
    }
}
