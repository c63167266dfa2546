//! What policies of closing have in common.

use super::seen::{Seeing, Seen};
use super::shares::{LEAST_SIGMA, Segment};
use crate::raster::{BATCH, Kernels};
use crate::simd::*;

/// A policy at work on the rays of a block, in registers.
pub(super) trait Opening<S: Simd>: Sized {
    /// What stays open from one batch to the next, in memory.
    type Open: Default;
    /// Whether anything does.
    const KEEPS_OPEN: bool;
    /// Whether plain kernels may be cut, if they are of those whose shares are shares of strengths; else they are whole.
    const CUTS_PLAIN: bool;
    /// What is the same for all blocks.
    type Policy<'a>: Copy;

    /// Takes up what is seen and open.
    fn load(simd: S, seen: &Seen, open: &mut Self::Open) -> Self;

    /// Puts it back.
    fn store(self, seen: &mut Seen, open: &mut Self::Open);

    /// Without what is open.
    fn seen(&self) -> &Seeing<S>;

    /// Adds a set of plain kernels in their order.
    fn add_plain<const DEPTH: bool>(
        &mut self,
        simd: S,
        plain: Plain<S>,
        policy: Self::Policy<'_>,
        open: &mut Self::Open,
    );

    /// Adds any kernel, or a share of one.
    fn add<const DEPTH: bool>(
        &mut self,
        simd: S,
        fragment: Fragment<S>,
        policy: Self::Policy<'_>,
        open: &mut Self::Open,
    );

    /// Closes what is open.
    fn finish<const DEPTH: bool>(&mut self, simd: S, policy: Self::Policy<'_>, open: &mut Self::Open);
}

/// A set of a batch's kernels, to be evaluated at the pixels of a block.
#[derive(Clone, Copy)]
pub(super) struct Plain<'a, S: Simd> {
    pub(super) kernels: &'a Kernels,
    pub(super) set: u64,
    pub(super) corner: [f32; 2],
    pub(super) pixels: [W<S>; 2],
    /// Of rays with z = 1, as plain kernels, what is closed before them and its depth ask for them.
    pub(super) ray_length: W<S>,
    /// Of which they may lie partly outside; `None`: all are whole.
    pub(super) segment: Option<Segment<S>>,
}

impl<S: Simd> Plain<'_, S> {
    /// The next kernel of the set, which it leaves.
    #[inline(always)]
    pub(super) fn next(&mut self) -> Option<usize> {
        let number = self.set.trailing_zeros() as usize;
        self.set &= self.set.wrapping_sub(1);
        (number < BATCH).then_some(number)
    }

    /// The opacity of a kernel, and its z if that is asked for.
    #[inline(always)]
    pub(super) fn alpha_and_depth<const DEPTH: bool>(&self, simd: S, number: usize) -> [W<S>; 2] {
        let Self { kernels, pixels, segment, ray_length, .. } = self;
        let rays = (*pixels, *ray_length);
        match segment.filter(|segment| segment.whole() >> number & 1 == 0) {
            None => {
                let alpha = kernels.plain_alpha(simd, number, rays, None);
                [alpha, if DEPTH { kernels.depth_at(simd, number, *pixels) } else { alpha }]
            }
            Some(segment) => {
                let depth = kernels.depth_at(simd, number, *pixels);
                let inverse = 1.0 / kernels.sigma_z(number).max(LEAST_SIGMA);
                let share = segment.share(simd, number, (depth, W::simd_from(simd, inverse)));
                [kernels.plain_alpha(simd, number, rays, Some(share)), segment.nearest_to(depth)]
            }
        }
    }
}

/// A kernel of a batch, or a share of it, at the pixels of a block. What a policy doesn't read is not computed.
#[derive(Clone, Copy)]
pub(super) struct Fragment<'a, S: Simd> {
    pub(super) kernels: &'a Kernels,
    pub(super) number: usize,
    pub(super) corner: [f32; 2],
    pub(super) alpha: W<S>,
    pub(super) optical_depth: W<S>,
    /// z and its spread, and the distance from the eye.
    pub(super) depth: W<S>,
    pub(super) sigma_z: W<S>,
    pub(super) distance: W<S>,
    /// Of rays with z = 1.
    pub(super) ray_length: W<S>,
    pub(super) color: [f32; 3],
    /// Of a share.
    pub(super) segment: Option<Segment<S>>,
}

impl<S: Simd> Fragment<'_, S> {
    /// z, within its segment.
    #[inline(always)]
    pub(super) fn depth_inside(&self) -> W<S> {
        self.segment.map_or(
            self.depth,
            #[inline(always)]
            |segment| segment.nearest_to(self.depth),
        )
    }
}
