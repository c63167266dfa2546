//! Closing slab by slab: optical depths, and colours times these, are summed up in any order.
//!
//! The first three open slabs are in registers, those behind them in memory. Where registers are fewer and narrower, level kernels and boxes
//! are added there, all others in memory: the first three slabs are sums of both.
//!
//! Opacities beside extinctions aren't spread. What lies in a slab before the centre of one is closed, and the rest stays open.

use super::before;
use super::opening::{Fragment, Opening, Plain};
use super::seen::{Seeing, Seen};
use super::spread::{Cumulative, Matter, Shares, z_per_length};
use super::sums::{Kept, NEAR, OpenSlabs, Sum};
use crate::closing::{Closing, Slabs};
use crate::raster::{Kernels, SlabColumns};
use crate::simd::*;

/// Slabs are open.
pub(super) struct Slabbed<S: Simd> {
    seen: Seeing<S>,
    near: [Sum<S>; NEAR as usize],
    first: u32,
    end: u32,
    /// The part of the first slab that is closed already.
    closed: f32,
}

impl<S: Simd> Opening<S> for Slabbed<S> {
    type Open = OpenSlabs;
    const KEEPS_OPEN: bool = true;
    const CUTS_PLAIN: bool = false;
    type Policy<'a> = &'a Closing;

    #[inline(always)]
    fn load(simd: S, seen: &Seen, open: &mut OpenSlabs) -> Self {
        let OpenSlabs { first, end, closed, .. } = *open;
        let near = if holds_sixteen::<S>() { open.take_near(simd) } else { [Sum::zero(simd); NEAR as usize] };
        Self { seen: Seeing::load(simd, seen), near, first, end, closed }
    }

    #[inline(always)]
    fn store(self, seen: &mut Seen, open: &mut OpenSlabs) {
        self.seen.store(seen);
        (open.first, open.end, open.closed) = (self.first, self.end, self.closed);
        self.keep(open);
    }

    #[inline(always)]
    fn seen(&self) -> &Seeing<S> {
        &self.seen
    }

    #[inline(always)]
    fn add_plain<const DEPTH: bool>(
        &mut self,
        simd: S,
        plain: Plain<S>,
        closing: &Closing,
        open: &mut OpenSlabs,
    ) {
        let Closing::Slabs(slabs) = closing else {
            return self.add_to_sheets::<DEPTH>(simd, plain, open);
        };
        let SlabColumns { narrow, at_centers, .. } = plain.kernels.slabs;
        let [level, level_in_three] = plain.kernels.slabs.level;
        let mut rest = plain.set;
        while rest != 0 {
            let set = before(rest, rest & !level);
            self.add_level::<DEPTH, false>(simd, Plain { set, ..plain }, slabs, open);
            rest ^= set;
            let set = before(rest, rest & (level | !narrow));
            self.add_narrow::<DEPTH>(simd, Plain { set, ..plain }, slabs, open);
            rest ^= set;
            let set = before(rest, rest & !level_in_three);
            self.add_level::<DEPTH, true>(simd, Plain { set, ..plain }, slabs, open);
            rest ^= set;
            let set = before(rest, rest & (narrow | level_in_three | at_centers));
            rest ^= set;
            self.add_wide::<DEPTH>(simd, Plain { set, ..plain }, slabs, open);
            let set = before(rest, rest & !at_centers);
            rest ^= set;
            self.add_at_centers::<DEPTH>(simd, Plain { set, ..plain }, slabs, open);
        }
    }

    #[inline(always)]
    fn add<const DEPTH: bool>(
        &mut self,
        simd: S,
        fragment: Fragment<S>,
        closing: &Closing,
        open: &mut OpenSlabs,
    ) {
        let Fragment { kernels, number, corner, optical_depth, sigma_z, distance, ray_length, .. } = fragment;
        let first = kernels.slabs.first[number];
        let Closing::Slabs(slabs) = closing else {
            self.close_before::<DEPTH>(simd, first, 0.0, open);
            self.near[0].add::<DEPTH>(simd, (optical_depth, fragment.depth_inside()), kernels.color(number));
            self.end = self.end.max(first + 1);
            return;
        };
        let segment = fragment.segment.map(
            #[inline(always)]
            |segment| [segment.from * ray_length, segment.to * ray_length],
        );
        if kernels.slabs.at_centers >> number & 1 != 0 {
            self.close_until::<DEPTH>(simd, (kernels.slabs.center(number), segment), slabs, open);
            self.seen.show::<DEPTH>(simd, [fragment.alpha, fragment.depth_inside()], fragment.color);
            return;
        }
        let inverse = kernels.inverse_spread(simd, number, (slabs, sigma_z * ray_length));
        let z_per_length = z_per_length::<S, DEPTH>(simd, ray_length);
        let matter = Matter { optical_depth, distance, z_per_length, inverse, segment };
        if kernels.slabs.narrow >> number & 1 != 0 {
            self.close_before::<DEPTH>(simd, first, slabs.thickness(), open);
            let share = kernels.slabs.share(number);
            let plane = slabs.begin(first + 1);
            let x = (W::simd_from(simd, plane) - distance) * inverse;
            let share = Cumulative::new(simd, &share, &matter).before(simd, x);
            self.share_between::<DEPTH>(simd, (kernels, number), (matter, share), slabs);
            return;
        }
        self.share_out::<DEPTH>(simd, (kernels, number, corner), matter, (slabs, open));
    }

    #[inline(always)]
    fn finish<const DEPTH: bool>(&mut self, simd: S, closing: &Closing, open: &mut OpenSlabs) {
        self.close_before::<DEPTH>(simd, u32::MAX, closing.thickness(), open);
        if DEPTH {
            self.seen.place_missed(simd);
        }
        // Ready for the next tile.
        (self.first, self.end, self.closed) = (0, 0, 0.0);
    }
}

impl<S: Simd> Slabbed<S> {
    /// Puts what is in registers into memory.
    #[inline(always)]
    fn keep(&self, open: &mut OpenSlabs) {
        for (slab, sum) in (self.first..).zip(self.near) {
            let kept = open.slab(slab);
            let sum = if holds_sixteen::<S>() { sum } else { sum.plus(kept) };
            sum.store(kept);
        }
    }

    /// Closes slabs until `first` is the first one.
    #[inline(always)]
    fn close_before<const DEPTH: bool>(&mut self, simd: S, first: u32, thickness: f32, open: &mut OpenSlabs) {
        if self.first < first {
            self.closed = 0.0;
        }
        while self.first < first.min(self.end) {
            let [mut sum, second, third] = self.near;
            if !holds_sixteen::<S>() {
                sum = sum.plus(open.slab(self.first));
                *open.slab(self.first) = Kept::ZERO;
            }
            sum.close::<DEPTH>(simd, &mut self.seen, thickness);
            self.first += 1;
            let last = self.first + NEAR - 1;
            let is_behind = holds_sixteen::<S>() && last < self.end;
            let next = if is_behind { open.take(simd, last) } else { Sum::zero(simd) };
            self.near = [second, third, next];
        }
        self.first = self.first.max(first);
    }

    /// Closes slabs before a place in one of them, and of that one the part before the place: what is left of it is as even. Where a segment
    /// begins or ends in the slab, all lies between.
    #[inline(always)]
    fn close_until<const DEPTH: bool>(
        &mut self,
        simd: S,
        ((slab, part), segment): ((u32, f32), Option<[W<S>; 2]>),
        slabs: &Slabs,
        open: &mut OpenSlabs,
    ) {
        self.close_before::<DEPTH>(simd, slab, slabs.thickness(), open);
        // Rounded keys may put it behind what comes first in the next slab.
        if slab < self.first || self.first >= self.end || part <= self.closed {
            return;
        }
        let (zero, one) = (W::simd_from(simd, 0.0), W::simd_from(simd, 1.0));
        let [mut from, mut to, mut end] = [self.closed, part, 1.0].each(
            #[inline(always)]
            |part| W::simd_from(simd, part),
        );
        if let Some(ends) = segment {
            let per_length = 1.0 / slabs.thickness();
            let [begins, ends] = ends.each(
                #[inline(always)]
                |distance| ((distance - slabs.begin(slab)) * per_length).max(zero).min(one),
            );
            (from, to, end) = (from.max(begins), to.max(begins).min(ends), ends);
        }
        // Where nothing is left of the segment it doesn't matter what is closed.
        let share = ((to - from) / (end - from).max(W::simd_from(simd, 1e-6))).max(zero).min(one);
        self.closed = part;
        if !holds_sixteen::<S>() {
            self.near[0] = self.near[0].plus(open.slab(slab));
            *open.slab(slab) = Kept::ZERO;
        }
        let now = self.near[0].times(share);
        self.near[0] = self.near[0].times(one - share);
        now.close::<DEPTH>(simd, &mut self.seen, slabs.thickness());
    }

    /// Adds plain kernels that are composited whole, at their centres.
    #[inline(always)]
    fn add_at_centers<const DEPTH: bool>(
        &mut self,
        simd: S,
        mut plain: Plain<S>,
        slabs: &Slabs,
        open: &mut OpenSlabs,
    ) {
        let Plain { kernels, ray_length, .. } = plain;
        let segment = plain.segment.map(
            #[inline(always)]
            |segment| [segment.from * ray_length, segment.to * ray_length],
        );
        while let Some(number) = plain.next() {
            self.close_until::<DEPTH>(simd, (kernels.slabs.center(number), segment), slabs, open);
            let alpha_and_depth = plain.alpha_and_depth::<DEPTH>(simd, number);
            self.seen.show::<DEPTH>(simd, alpha_and_depth, kernels.color(number));
        }
    }

    /// Adds plain kernels that touch two slabs at most.
    #[inline(always)]
    fn add_narrow<const DEPTH: bool>(
        &mut self,
        simd: S,
        mut plain: Plain<S>,
        slabs: &Slabs,
        open: &mut OpenSlabs,
    ) {
        let Plain { kernels, pixels, ray_length, .. } = plain;
        let z_per_length = z_per_length::<S, DEPTH>(simd, ray_length);
        let mut plane = slabs.begin(self.first + 1);
        while let Some(number) = plain.next() {
            let first = kernels.slabs.first[number];
            if first != self.first {
                self.close_before::<DEPTH>(simd, first, slabs.thickness(), open);
                plane = slabs.begin(first + 1);
            }
            let (optical_depth, share) = kernels.plain_share_before(simd, number, pixels, plane);
            let distance = if DEPTH { kernels.affine_distance(simd, number, pixels) } else { share };
            let inverse = W::simd_from(simd, kernels.slabs.inverse(number));
            let matter = Matter { optical_depth, distance, z_per_length, inverse, segment: None };
            self.share_between::<DEPTH>(simd, (kernels, number), (matter, share), slabs);
        }
    }

    /// Adds level kernels, which touch two slabs at most, or three: all sums grow by the same weight, and those of z by what it changes over the pixels, too.
    #[inline(always)]
    fn add_level<const DEPTH: bool, const IN_THREE: bool>(
        &mut self,
        simd: S,
        mut plain: Plain<S>,
        slabs: &Slabs,
        open: &mut OpenSlabs,
    ) {
        let Plain { kernels, pixels, .. } = plain;
        let count = if IN_THREE { NEAR } else { 2 };
        while let Some(number) = plain.next() {
            let first = kernels.slabs.first[number];
            if first != self.first {
                self.close_before::<DEPTH>(simd, first, slabs.thickness(), open);
            }
            self.end = self.end.max(first + count);
            let weight = kernels.plain_weight::<S, DEPTH>(simd, number, pixels);
            for (slab, sum) in self.near.iter_mut().enumerate().take(count as usize) {
                sum.add_grain::<DEPTH>(simd, weight, &kernels.slabs.grain(number, slab));
            }
        }
    }

    /// Shares a kernel out between the first two slabs.
    #[inline(always)]
    fn share_between<const DEPTH: bool>(
        &mut self,
        simd: S,
        (kernels, number): (&Kernels, usize),
        (matter, share): (Matter<S>, W<S>),
        slabs: &Slabs,
    ) {
        let color = kernels.color(number);
        let nearer = matter.optical_depth * share;
        let depths = [self.first, self.first + 1].each(
            #[inline(always)]
            |slab| matter.depth_in::<DEPTH>(simd, (slabs.begin(slab), slabs.thickness())),
        );
        self.end = self.end.max(self.first + 2);
        self.near[0].add::<DEPTH>(simd, (nearer, depths[0]), color);
        self.near[1].add::<DEPTH>(simd, (matter.optical_depth - nearer, depths[1]), color);
    }

    /// Adds any plain kernels.
    #[inline(always)]
    fn add_wide<const DEPTH: bool>(
        &mut self,
        simd: S,
        mut plain: Plain<S>,
        slabs: &Slabs,
        open: &mut OpenSlabs,
    ) {
        let Plain { kernels, pixels, corner, ray_length, .. } = plain;
        let z_per_length = z_per_length::<S, DEPTH>(simd, ray_length);
        while let Some(number) = plain.next() {
            let optical_depth = kernels.plain_optical_depth(simd, number, pixels);
            let distance = kernels.affine_distance(simd, number, pixels);
            let inverse = W::simd_from(simd, kernels.slabs.inverse(number));
            let matter = Matter { optical_depth, distance, z_per_length, inverse, segment: None };
            self.share_out::<DEPTH>(simd, (kernels, number, corner), matter, (slabs, open));
        }
    }

    /// Shares a kernel out between the first three slabs and those behind them that it touches in the block with a corner.
    #[inline(always)]
    fn share_out<const DEPTH: bool>(
        &mut self,
        simd: S,
        (kernels, number, corner): (&Kernels, usize, [f32; 2]),
        matter: Matter<S>,
        (slabs, open): (&Slabs, &mut OpenSlabs),
    ) {
        self.close_before::<DEPTH>(simd, kernels.slabs.first[number], slabs.thickness(), open);
        let [first, last] = kernels.slabs_in(number, corner, slabs);
        let share = kernels.slabs.share(number);
        let color = kernels.color(number);
        let mut shares = Shares::new(simd, (&share, matter), (slabs, self.first));
        let in_registers = if holds_sixteen::<S>() { NEAR } else { 0 };
        let behind = self.first + in_registers;
        let last = last.max(behind.saturating_sub(1));
        self.end = self.end.max(last + 1);
        if in_registers > 0 {
            shares.go_to(simd, slabs, self.first);
        }
        let gets_rest = [false, false, last < behind && share.ends];
        for ((slab, sum), gets_rest) in (self.first..behind).zip(&mut self.near).zip(gets_rest) {
            let own = shares.next::<DEPTH>(simd, (slabs, slab), gets_rest);
            sum.add::<DEPTH>(simd, own, color);
        }
        if first > behind || in_registers == 0 {
            shares.go_to(simd, slabs, first);
        }
        for slab in first.max(behind)..last {
            let own = shares.next::<DEPTH>(simd, (slabs, slab), false);
            open.slab(slab).add::<S, DEPTH>(simd, own, color);
        }
        if last >= behind {
            let own = shares.next::<DEPTH>(simd, (slabs, last), share.ends);
            open.slab(last).add::<S, DEPTH>(simd, own, color);
        }
    }

    /// Adds plain kernels to the sheets of their centres.
    #[inline(always)]
    fn add_to_sheets<const DEPTH: bool>(&mut self, simd: S, mut plain: Plain<S>, open: &mut OpenSlabs) {
        let Plain { kernels, pixels, .. } = plain;
        while let Some(number) = plain.next() {
            let first = kernels.slabs.first[number];
            self.close_before::<DEPTH>(simd, first, 0.0, open);
            self.end = self.end.max(first + 1);
            let optical_depth = kernels.plain_optical_depth(simd, number, pixels);
            let depth = if DEPTH { kernels.depth_at(simd, number, pixels) } else { optical_depth };
            self.near[0].add::<DEPTH>(simd, (optical_depth, depth), kernels.color(number));
        }
    }
}
