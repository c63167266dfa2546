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
        let Plain { kernels, pixels, .. } = plain;
        while let Some(number) = plain.next() {
            let alpha = kernels.plain_alpha(simd, number, pixels);
            let shown = self.seen.blend(simd, alpha, kernels.color(number));
            if DEPTH {
                self.seen.place(shown, kernels.depth_at(simd, number, pixels));
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
