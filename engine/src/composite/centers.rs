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
            let [alpha, depth] = plain.alpha_and_depth::<DEPTH>(simd, number);
            let shown = self.seen.blend(simd, alpha, plain.kernels.color(number));
            if DEPTH {
                self.seen.place(shown, depth);
            }
        }
    }

    #[inline(always)]
    fn add<const DEPTH: bool>(&mut self, simd: S, fragment: Fragment<S>, (): (), (): &mut ()) {
        let shown = self.seen.blend(simd, fragment.alpha, fragment.color);
        if DEPTH {
            self.seen.place(shown, fragment.depth_inside());
        }
    }

    #[inline(always)]
    fn finish<const DEPTH: bool>(&mut self, _: S, (): (), (): &mut ()) {}
}
