//! How surfaces share kernels out.

use super::opening::Fragment;
use crate::raster::{Kernels, Places, Spans};
use crate::simd::*;

/// A segment of the rays of a block, and where the kernels of a batch are from it.
#[derive(Clone, Copy)]
pub(super) struct Segment<S: Simd> {
    /// z where it begins and ends; no infinity, which times 0 would be none.
    pub(super) from: W<S>,
    pub(super) to: W<S>,
    places: Places,
}

impl<S: Simd> Segment<S> {
    /// What lies behind another one, or behind the near plane, until a depth; where kernels are from there, if cuts are near, their
    /// spans say.
    #[inline(always)]
    pub(super) fn behind(
        simd: S,
        (before, near): (Option<Self>, f32),
        to: W<S>,
        (kernels, spans): (&Kernels, Option<&Spans>),
    ) -> Self {
        let to = to.min(W::simd_from(simd, 1e30));
        let from = match before {
            Some(before) => before.to,
            None => W::simd_from(simd, near),
        };
        // Rays that have nothing of it touch nothing, but no kernel lies wholly in it.
        let is_there = from.simd_lt(to);
        let infinity = W::simd_from(simd, f32::INFINITY);
        let begin = [is_there.select(from, infinity).reduce_min(), from.reduce_max()];
        let end = [to.reduce_min(), is_there.select(to, -infinity).reduce_max()];
        Self { from, to, places: kernels.places(simd, spans, (before.is_some().then_some(begin), end)) }
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
        fragment.segment = Some(*self);
    }
}

/// What is thinner along a ray counts as this thick.
pub(super) const LEAST_SIGMA: f32 = 1e-20;
