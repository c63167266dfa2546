//! How surfaces share kernels out.

use super::opening::Fragment;
use crate::raster::Fragments;
use crate::simd::*;

/// A kernel that is shared out between the segments of a block's rays:
/// share_j = Φ((z_{j+1} − z)/σ_z) − Φ((z_j − z)/σ_z).
#[derive(Clone, Copy)]
pub(super) struct Shares<S: Simd> {
    depth: W<S>,
    /// 1/σ_z.
    inverse: W<S>,
    /// Where the next segment begins, and the share before it.
    from: W<S>,
    before: W<S>,
}

/// What a segment has of a kernel.
pub(super) struct Share<S: Simd> {
    share: W<S>,
    from: W<S>,
    to: W<S>,
    /// All until the segment's end.
    before_end: W<S>,
}

impl<S: Simd> Shares<S> {
    /// Of what lies behind the near plane, or of all.
    #[inline(always)]
    pub(super) fn new(simd: S, fragments: &Fragments<S>, near: Option<f32>) -> Self {
        let Fragments { depth, sigma_z, .. } = *fragments;
        let inverse = reciprocal(simd, sigma_z.max(W::simd_from(simd, 1e-20)));
        let Some(near) = near else {
            let (from, before) = (W::simd_from(simd, -1e30), W::simd_from(simd, 0.0));
            return Self { depth, inverse, from, before };
        };
        let from = W::simd_from(simd, near);
        Self { depth, inverse, from, before: normal_cdf(simd, (from - depth) * inverse) }
    }

    /// The share of the next segment, which ends at a depth.
    #[inline(always)]
    pub(super) fn first(&self, simd: S, to: W<S>) -> Share<S> {
        // No infinity times 0.
        let to = to.min(W::simd_from(simd, 1e30));
        let before_end = normal_cdf(simd, (to - self.depth) * self.inverse);
        let share = (before_end - self.before).max(W::simd_from(simd, 0.0));
        Share { share, from: self.from, to, before_end }
    }

    /// What is behind a segment.
    #[inline(always)]
    pub(super) fn rest(self, segment: &Share<S>) -> Self {
        Self { from: segment.to, before: segment.before_end, ..self }
    }
}

impl<S: Simd> Share<S> {
    /// Whether any pixel has one.
    #[inline(always)]
    pub(super) fn is_any(&self, simd: S) -> bool {
        self.share.simd_gt(W::simd_from(simd, 0.0)).any_true()
    }

    /// Leaves of a whole kernel its share.
    #[inline(always)]
    pub(super) fn cut(&self, simd: S, fragment: &mut Fragment<S>) {
        let Fragment { kernels, number, optical_depth, .. } = *fragment;
        fragment.optical_depth = optical_depth * self.share;
        fragment.alpha = kernels.opacity(simd, number, fragment.optical_depth);
        fragment.segment = Some([self.from, self.to]);
    }
}
