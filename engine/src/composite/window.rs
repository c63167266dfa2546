//! Closing after each kernel, by its depth at the pixel, as far as a window reaches.
//!
//! A window holds the last kernels of a block, from near to far at each pixel. A new one moves forward past those that it
//! lies before, and the nearest leaves: where kernels come in the order of a pixel, that is all there is to do.

use super::opening::{Fragment, Opening, Plain};
use super::seen::{Seeing, Seen};
use crate::simd::*;
use crate::tile::{PIXELS, Plane};

/// Kernels in a window.
const WINDOW: usize = 8;

/// A kernel at the pixels of a block.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Slot {
    depth: Plane,
    alpha: Plane,
    color: [Plane; 3],
}

impl Slot {
    /// Before everything, and transparent.
    const NONE: Self =
        Self { depth: Plane([f32::NEG_INFINITY; PIXELS]), alpha: Plane::ZERO, color: [Plane::ZERO; 3] };
}

/// The window of a block.
#[derive(Clone)]
pub(crate) struct Window {
    slots: [Slot; WINDOW],
    /// Where the nearest is; the others follow it round.
    nearest: usize,
    /// The depth of what left last.
    passed: Plane,
    /// Pixels of kernels that came when one behind them had left.
    pub(super) late: u64,
}

impl Default for Window {
    fn default() -> Self {
        Self { slots: [Slot::NONE; WINDOW], nearest: 0, passed: Slot::NONE.depth, late: 0 }
    }
}

/// Kernels wait in a window.
pub(super) struct Windowed<S: Simd> {
    seen: Seeing<S>,
}

/// [`Slot`] in registers.
#[derive(Clone, Copy)]
struct Waiting<S: Simd> {
    depth: W<S>,
    alpha: W<S>,
    color: [W<S>; 3],
}

impl<S: Simd> Opening<S> for Windowed<S> {
    type Open = Window;
    const KEEPS_OPEN: bool = true;
    const CUTS_PLAIN: bool = true;
    type Policy<'a> = ();

    #[inline(always)]
    fn load(simd: S, seen: &Seen, _: &mut Window) -> Self {
        Self { seen: Seeing::load(simd, seen) }
    }

    #[inline(always)]
    fn store(self, seen: &mut Seen, _: &mut Window) {
        self.seen.store(seen);
    }

    #[inline(always)]
    fn seen(&self) -> &Seeing<S> {
        &self.seen
    }

    #[inline(always)]
    fn add_plain<const DEPTH: bool>(&mut self, simd: S, mut plain: Plain<S>, (): (), window: &mut Window) {
        while let Some(number) = plain.next() {
            let [alpha, depth] = plain.alpha_and_depth::<true>(simd, number);
            self.insert::<DEPTH>(simd, (alpha, depth, plain.kernels.color(number)), window);
        }
    }

    #[inline(always)]
    fn add<const DEPTH: bool>(&mut self, simd: S, fragment: Fragment<S>, (): (), window: &mut Window) {
        let Fragment { alpha, color, .. } = fragment;
        let depth = fragment.depth_inside();
        self.insert::<DEPTH>(simd, (alpha, depth, color), window);
    }

    #[inline(always)]
    fn finish<const DEPTH: bool>(&mut self, simd: S, (): (), window: &mut Window) {
        for place in 0..WINDOW {
            let slot = &mut window.slots[(window.nearest + place) % WINDOW];
            let waiting = Waiting::load(simd, slot);
            *slot = Slot::NONE;
            self.show::<DEPTH>(simd, &waiting);
        }
        window.passed = Slot::NONE.depth;
    }
}

impl<S: Simd> Windowed<S> {
    #[inline(always)]
    fn insert<const DEPTH: bool>(
        &mut self,
        simd: S,
        (alpha, depth, color): (W<S>, W<S>, [f32; 3]),
        window: &mut Window,
    ) {
        let zero = W::simd_from(simd, 0.0);
        let is_there = alpha.simd_gt(zero);
        // What is nowhere must not push another one out.
        if !is_there.any_true() {
            return;
        }
        let nearest = window.nearest;
        let leaving = Waiting::load(simd, &window.slots[nearest]);
        self.show::<DEPTH>(simd, &leaving);
        window.nearest = (nearest + 1) % WINDOW;
        let passed = window.passed.load(simd);
        let passed = leaving.alpha.simd_gt(zero).select(leaving.depth.max(passed), passed);
        window.passed.store(passed);
        window.late += u64::from((is_there & depth.simd_lt(passed)).to_bitmask().count_ones());
        // Where there is nothing it comes last, and lets what comes next behind it.
        let last = window.slots[(nearest + WINDOW - 1) % WINDOW].depth.load(simd);
        let depth = is_there.select(depth, last);
        let color = color.each(
            #[inline(always)]
            |c| W::simd_from(simd, c),
        );
        let mut new = Waiting { depth, alpha, color };
        let mut place = nearest;
        for _ in 1..WINDOW {
            let before = (place + WINDOW - 1) % WINDOW;
            let is_nearer = new.depth.simd_lt(window.slots[before].depth.load(simd));
            if !is_nearer.any_true() {
                break;
            }
            let other = Waiting::load(simd, &window.slots[before]);
            Waiting::select(is_nearer, &other, &new).store(&mut window.slots[place]);
            new = Waiting::select(is_nearer, &new, &other);
            place = before;
        }
        new.store(&mut window.slots[place]);
    }

    #[inline(always)]
    fn show<const DEPTH: bool>(&mut self, simd: S, leaving: &Waiting<S>) {
        let Waiting { depth, alpha, color } = leaving;
        // A place without a kernel has no depth.
        let zero = W::simd_from(simd, 0.0);
        let depth = alpha.simd_gt(zero).select(*depth, zero);
        self.seen.show_in::<DEPTH>([*alpha, depth], *color);
    }
}

impl<S: Simd> Waiting<S> {
    #[inline(always)]
    fn load(simd: S, slot: &Slot) -> Self {
        let Slot { depth, alpha, color: [red, green, blue] } = slot;
        Self {
            depth: depth.load(simd),
            alpha: alpha.load(simd),
            color: [red.load(simd), green.load(simd), blue.load(simd)],
        }
    }

    #[inline(always)]
    fn store(&self, slot: &mut Slot) {
        slot.depth.store(self.depth);
        slot.alpha.store(self.alpha);
        for (plane, color) in slot.color.iter_mut().zip(&self.color) {
            plane.store(*color);
        }
    }

    #[inline(always)]
    fn select(mask: mask32x16<S>, a: &Self, b: &Self) -> Self {
        Self {
            depth: mask.select(a.depth, b.depth),
            alpha: mask.select(a.alpha, b.alpha),
            color: [0, 1, 2].each(
                #[inline(always)]
                |i| mask.select(a.color[i], b.color[i]),
            ),
        }
    }
}
