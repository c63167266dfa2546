//! What a layer's samples add up to, and what is seen through layers.

use crate::raster::Surfel;
use crate::simd::*;

/// Sums over the samples of a layer.
#[derive(Clone, Copy)]
pub(super) struct Sums<S: Simd> {
    /// Of the splats that show their front, and of those that show their back. The two sides of a thin sheet would
    /// cancel, so their normals are never added.
    pub(super) sides: [Side<S>; 2],
    /// Of how far colours are from the one that surfaces most often have all over.
    pub(super) color: [W<S>; 3],
    pub(super) usual: [f32; 3],
    /// Of depths behind the first sample's.
    pub(super) depth: W<S>,
    /// Of 1 − opacity.
    pub(super) clear: W<S>,
}

#[derive(Clone, Copy)]
pub(super) struct Side<S: Simd> {
    pub(super) weight: W<S>,
    pub(super) normal: [W<S>; 3],
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    pub(super) fn zero(simd: S, usual: [f32; 3]) -> Self {
        let zero = W::simd_from(simd, 0.0);
        Self {
            sides: [Side { weight: zero, normal: [zero; 3] }; 2],
            color: [zero; 3],
            usual,
            depth: zero,
            clear: zero,
        }
    }

    #[inline(always)]
    pub(super) fn weight(&self) -> W<S> {
        self.sides[0].weight + self.sides[1].weight
    }

    /// Adds samples of a surfel, by their weights and how far they are behind the first ones.
    #[inline(always)]
    pub(super) fn add(&mut self, simd: S, surfel: &Surfel, [weight, behind]: [W<S>; 2]) {
        let Surfel { normal, color, opacity, .. } = *surfel;
        self.depth = behind.mul_add(weight, self.depth);
        if opacity < 1.0 {
            self.clear = weight.mul_add(W::simd_from(simd, 1.0 - opacity), self.clear);
        }
        if color != self.usual {
            self.color = [0, 1, 2].each(
                #[inline(always)]
                |i| weight.mul_add(W::simd_from(simd, color[i] - self.usual[i]), self.color[i]),
            );
        }
        self.sides[usize::from(surfel.faces_away())].add(simd, normal, weight);
    }
}

impl<S: Simd> Side<S> {
    #[inline(always)]
    fn add(&mut self, simd: S, normal: [f32; 3], weight: W<S>) {
        self.weight += weight;
        self.normal = [0, 1, 2].each(
            #[inline(always)]
            |axis| weight.mul_add(W::simd_from(simd, normal[axis]), self.normal[axis]),
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
