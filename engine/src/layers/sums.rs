//! What a layer's samples add up to, and what is seen through layers.

use crate::raster::{Look, Surfel};
use crate::simd::*;

/// Sums over the samples of a layer.
#[derive(Clone, Copy)]
pub(super) struct Sums<S: Simd> {
    /// Of the splats that show their front, and of those that show their back. The two sides of a thin sheet would
    /// cancel, so their normals are never added.
    pub(super) front: Side<S>,
    pub(super) back: Side<S>,
    /// Of how far colours are from the tile's usual one, which surfaces most often have all over.
    pub(super) tint: [W<S>; 3],
    /// Of depths behind the first sample's.
    pub(super) depth: W<S>,
    /// Of 1 − opacity; and of that by how even coverage is.
    pub(super) clear: W<S>,
    pub(super) even: W<S>,
}

#[derive(Clone, Copy)]
pub(super) struct Side<S: Simd> {
    pub(super) weight: W<S>,
    pub(super) normal: [W<S>; 3],
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    pub(super) fn zero(simd: S) -> Self {
        let zero = W::simd_from(simd, 0.0);
        let side = Side { weight: zero, normal: [zero; 3] };
        Self { front: side, back: side, tint: [zero; 3], depth: zero, clear: zero, even: zero }
    }

    #[inline(always)]
    pub(super) fn weight(&self) -> W<S> {
        self.front.weight + self.back.weight
    }

    /// Adds samples of a surfel, by their weights and how far they are behind the first ones.
    #[inline(always)]
    pub(super) fn add(&mut self, simd: S, (surfel, look): (&Surfel, &Look), [weight, behind]: [W<S>; 2]) {
        self.depth = behind.mul_add(weight, self.depth);
        if !surfel.is_plain() {
            self.clear = weight.mul_add(W::simd_from(simd, look.clear), self.clear);
            self.even = weight.mul_add(W::simd_from(simd, look.clear * look.even), self.even);
            self.tint = [0, 1, 2].each(
                #[inline(always)]
                |i| weight.mul_add(W::simd_from(simd, look.tint[i]), self.tint[i]),
            );
        }
        // An index would keep both sides in memory.
        if surfel.faces_away() {
            self.back.add(simd, surfel, weight);
        } else {
            self.front.add(simd, surfel, weight);
        }
    }
}

impl<S: Simd> Side<S> {
    #[inline(always)]
    fn add(&mut self, simd: S, surfel: &Surfel, weight: W<S>) {
        self.weight += weight;
        self.normal = [0, 1, 2].each(
            #[inline(always)]
            |axis| weight.mul_add(W::simd_from(simd, surfel.normal[axis]), self.normal[axis]),
        );
    }
}

/// How far one sees into a pixel past its layers so far.
///
/// Coverage is a share of the pixel's area. A layer covers what is left bare first, and only then what is
/// covered already: the parts of one surface that fall into two layers, at a crease or along a silhouette, lie
/// beside each other. Were they independent, every such pixel would let the background through.
#[derive(Clone, Copy)]
pub(super) struct SeenThrough<S: Simd> {
    /// Share of the pixel that no layer covers.
    pub(super) bare: W<S>,
    /// What the covered share lets through, as a share of the pixel.
    pub(super) covered: W<S>,
}

impl<S: Simd> SeenThrough<S> {
    /// Puts a layer behind; gives the opacity with which it is composited, and what is still seen.
    #[inline(always)]
    pub(super) fn cover(&mut self, simd: S, coverage: W<S>, opacity: W<S>) -> [W<S>; 2] {
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
