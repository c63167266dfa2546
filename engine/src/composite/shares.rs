//! How surfaces share kernels out.

use super::opening::Fragment;
use crate::raster::{Kernels, Places, Spans};
use crate::simd::*;

/// A segment of the rays of a block, and where the kernels of a batch are from it.
#[derive(Clone, Copy)]
pub(super) struct Segment<S: Simd> {
    /// z where it begins and ends; no infinity, which times 0 would be none.
    from: W<S>,
    to: W<S>,
    places: Places,
}

impl<S: Simd> Segment<S> {
    /// Nothing yet: what ends where the next one begins.
    #[inline(always)]
    pub(super) fn before(simd: S, near: f32) -> Self {
        let near = W::simd_from(simd, near);
        Self { from: near, to: near, places: Places::default() }
    }

    /// What follows until a depth; where kernels are from there, if cuts are near, their spans say.
    #[inline(always)]
    pub(super) fn next(self, simd: S, to: W<S>, (kernels, spans): (&Kernels, Option<&Spans>)) -> Self {
        let (from, to) = (self.to, to.min(W::simd_from(simd, 1e30)));
        let ends = [from, to].each(
            #[inline(always)]
            |end| [end.reduce_min(), end.reduce_max()],
        );
        Self { from, to, places: kernels.places(simd, spans, ends) }
    }

    /// Kernels that may have a share of it.
    #[inline(always)]
    pub(super) fn touched(&self) -> u64 {
        self.places.touched
    }

    /// Kernels that lie wholly in it.
    #[inline(always)]
    pub(super) fn whole(&self) -> u64 {
        self.places.whole()
    }

    /// What it has of a kernel: Φ((to − z)/σ_z) − Φ((from − z)/σ_z).
    #[inline(always)]
    pub(super) fn share(&self, simd: S, number: usize, (depth, inverse_sigma_z): (W<S>, W<S>)) -> W<S> {
        let mut share = W::simd_from(simd, 1.0);
        if self.places.before_end >> number & 1 == 0 {
            share = normal_cdf(simd, (self.to - depth) * inverse_sigma_z);
        }
        if self.places.behind_begin >> number & 1 == 0 {
            share -= normal_cdf(simd, (self.from - depth) * inverse_sigma_z);
        }
        share.max(W::simd_from(simd, 0.0))
    }

    /// A depth, or the nearest to it that it has.
    #[inline(always)]
    pub(super) fn nearest_to(&self, depth: W<S>) -> W<S> {
        depth.max(self.from).min(self.to)
    }

    /// Leaves of a whole kernel its share.
    #[inline(always)]
    pub(super) fn cut(&self, simd: S, fragment: &mut Fragment<S>) {
        let Fragment { kernels, number, optical_depth, depth, sigma_z, .. } = *fragment;
        let inverse = reciprocal(simd, sigma_z.max(W::simd_from(simd, LEAST_SIGMA)));
        fragment.optical_depth = optical_depth * self.share(simd, number, (depth, inverse));
        fragment.alpha = kernels.opacity(simd, number, fragment.optical_depth);
        fragment.segment = Some([self.from, self.to]);
    }
}

/// What is thinner along a ray counts as this thick.
pub(super) const LEAST_SIGMA: f32 = 1e-20;
