//! Closing after each kernel, in the order they come in.

use super::opening::{Fragment, Opening, Plain};
use super::seen::{Seeing, Seen};
use crate::simd::*;

/// Nothing stays open.
pub(super) struct Centers<S: Simd> {
    seen: Seeing<S>,
}

impl<S: Simd> Opening<S> for Centers<S> {
    type Open = ();
    const KEEPS_OPEN: bool = false;
    const CUTS_PLAIN: bool = true;
    type Policy<'a> = ();

    #[inline(always)]
    fn load(simd: S, seen: &Seen, (): &mut ()) -> Self {
        Self { seen: Seeing::load(simd, seen) }
    }

    #[inline(always)]
    fn store(self, seen: &mut Seen, (): &mut ()) {
        self.seen.store(seen);
    }

    #[inline(always)]
    fn seen(&self) -> &Seeing<S> {
        &self.seen
    }

    #[inline(always)]
    fn add_plain<const DEPTH: bool>(&mut self, simd: S, mut plain: Plain<S>, (): (), (): &mut ()) {
        while let Some(number) = plain.next() {
            let alpha_and_depth = plain.alpha_and_depth::<DEPTH>(simd, number);
            self.seen.show::<DEPTH>(simd, alpha_and_depth, plain.kernels.color(number));
        }
    }

    #[inline(always)]
    fn add<const DEPTH: bool>(&mut self, simd: S, fragment: Fragment<S>, (): (), (): &mut ()) {
        self.seen.show::<DEPTH>(simd, [fragment.alpha, fragment.depth_inside()], fragment.color);
    }

    #[inline(always)]
    fn finish<const DEPTH: bool>(&mut self, _: S, (): (), (): &mut ()) {}
}
