//! Closing slab by slab: optical depths, and colours times these, are summed up in any order.
//!
//! The first two open slabs are in registers while kernels come that touch no others; for those that touch more, all are in
//! memory.

use super::before;
use super::opening::{Fragment, Opening, Plain};
use super::seen::{Seeing, Seen};
use crate::closing::{BOX, Closing, Slabs, share_of_box, share_of_normal};
use crate::raster::{Kernels, SlabShare};
use crate::simd::*;
use crate::tile::Plane;

/// Slabs that may be open at once, a power of two; a kernel that reaches over more of them comes in pieces.
pub(super) const MOST_OPEN: u32 = 16;

/// What lies in a slab, along the rays of a block.
#[derive(Clone, Copy)]
struct Sum<S: Simd> {
    optical_depth: W<S>,
    /// Times the optical depth, as is z.
    color: [W<S>; 3],
    depth: W<S>,
}

/// [`Sum`] in memory.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Kept {
    optical_depth: Plane,
    color: [Plane; 3],
    depth: Plane,
}

impl Kept {
    const ZERO: Self = Self { optical_depth: Plane::ZERO, color: [Plane::ZERO; 3], depth: Plane::ZERO };
}

/// The open slabs of a block.
#[derive(Clone)]
pub(crate) struct OpenSlabs {
    /// The number of the first open slab.
    first: u32,
    /// There is nothing from this one on.
    end: u32,
    /// Slab n at n modulo their number; zero where nothing is, or what is there is in registers.
    kept: [Kept; MOST_OPEN as usize],
}

impl Default for OpenSlabs {
    fn default() -> Self {
        Self { first: 0, end: 0, kept: [Kept::ZERO; MOST_OPEN as usize] }
    }
}

impl OpenSlabs {
    #[inline(always)]
    fn slab(&mut self, number: u32) -> &mut Kept {
        &mut self.kept[(number % MOST_OPEN) as usize]
    }

    /// Takes what is in a slab out of memory.
    #[inline(always)]
    fn take<S: Simd>(&mut self, simd: S, number: u32) -> Sum<S> {
        let kept = self.slab(number);
        let sum = Sum::load(simd, kept);
        *kept = Kept::ZERO;
        sum
    }

    /// Closes slabs that are all in memory, until `first` is the first one.
    #[inline(always)]
    fn close_before<S: Simd, const DEPTH: bool>(
        &mut self,
        simd: S,
        first: u32,
        (seen, thickness): (&mut Seeing<S>, f32),
    ) {
        while self.first < first.min(self.end) {
            self.take(simd, self.first).close::<DEPTH>(simd, seen, thickness);
            self.first += 1;
        }
        self.first = self.first.max(first);
    }

    /// Adds a kernel to the slabs of a range.
    #[inline(always)]
    fn add<S: Simd, const DEPTH: bool>(
        &mut self,
        simd: S,
        (kernels, number, [first, last]): (&Kernels, usize, [u32; 2]),
        matter: Matter<S>,
        slabs: &Slabs,
    ) {
        let color = kernels.color(number);
        let share = kernels.slabs.share(number, [first, last]);
        let Matter { optical_depth, distance, .. } = matter;
        let cumulative = Cumulative::new(simd, &share, &matter);
        // How far the ends of slabs are behind the kernel, in its σ.
        let mut x = (W::simd_from(simd, slabs.begin(first)) - distance) * share.inverse;
        let step = slabs.thickness() * share.inverse;
        let mut passed = W::simd_from(simd, 0.0);
        if share.goes_on {
            passed = optical_depth * cumulative.before(simd, x);
        }
        self.end = self.end.max(last + 1);
        for slab in first..last {
            x += step;
            let until = optical_depth * cumulative.before(simd, x);
            let depth = matter.depth_in::<DEPTH>(simd, (slabs.begin(slab), slabs.thickness()), share.inverse);
            self.slab(slab).add::<S, DEPTH>(simd, (until - passed, depth), color);
            passed = until;
        }
        let mut until = optical_depth;
        if !share.ends {
            until *= cumulative.before(simd, x + step);
        }
        let depth = matter.depth_in::<DEPTH>(simd, (slabs.begin(last), slabs.thickness()), share.inverse);
        self.slab(last).add::<S, DEPTH>(simd, (until - passed, depth), color);
    }
}

/// A kernel at pixels, or what a segment has of it.
#[derive(Clone, Copy)]
struct Matter<S: Simd> {
    optical_depth: W<S>,
    /// z, and the distance from the eye, where it is densest.
    depth: W<S>,
    distance: W<S>,
    /// The distances between which all of it lies, of a share.
    segment: Option<[W<S>; 2]>,
}

impl<S: Simd> Matter<S> {
    /// The mean z of what lies in a slab from a distance on, of a spread with an inverse σ: as of a box with that σ.
    #[inline(always)]
    fn depth_in<const DEPTH: bool>(&self, simd: S, (from, thickness): (f32, f32), inverse: f32) -> W<S> {
        if !DEPTH {
            return self.depth;
        }
        let (begin, end) = (W::simd_from(simd, from), W::simd_from(simd, from + thickness));
        let half = 0.5 * BOX / inverse;
        let ends = [self.distance - half, self.distance + half].each(
            #[inline(always)]
            |end_of_box| end_of_box.max(begin).min(end),
        );
        self.depth * (ends[0] + ends[1]) * 0.5 / self.distance.max(W::simd_from(simd, 1e-20))
    }
}

/// The share of a kernel before a distance.
struct Cumulative<S: Simd> {
    normal_part: f32,
    cut: Option<CutOff<S>>,
}

/// Where a segment cuts a kernel, in its σ; its share is spread over the slabs between, as much as the kernel is there.
struct CutOff<S: Simd> {
    /// The spread that is shared out is narrower than the kernel, and may not reach the segment at all: then it is moved
    /// so far that a part of it does.
    shift: W<S>,
    from: W<S>,
    to: W<S>,
    /// What lies before the segment, and 1 over what lies in it.
    passed: W<S>,
    scale: W<S>,
}

impl<S: Simd> Cumulative<S> {
    #[inline(always)]
    fn new(simd: S, share: &SlabShare, matter: &Matter<S>) -> Self {
        let SlabShare { inverse, normal_part, .. } = *share;
        let Some([from, to]) = matter.segment else { return Self { normal_part, cut: None } };
        let [from, to] = [(from - matter.distance) * inverse, (to - matter.distance) * inverse];
        // A box ends at √3, and a tenth of it is beyond 1.4; 0.6 % of a normal distribution is beyond 2.5.
        let reach = W::simd_from(simd, normal_part.mul_add(2.5 - 1.4, 1.4));
        let zero = W::simd_from(simd, 0.0);
        let shift = (-reach - to).max(zero) + (reach - from).min(zero);
        let [from, to] = [from + shift, to + shift];
        let passed = share_before(simd, from, normal_part);
        let own = (share_before(simd, to, normal_part) - passed).max(W::simd_from(simd, 1e-6));
        Self { normal_part, cut: Some(CutOff { shift, from, to, passed, scale: reciprocal(simd, own) }) }
    }

    /// Before x of its σ.
    #[inline(always)]
    fn before(&self, simd: S, x: W<S>) -> W<S> {
        match &self.cut {
            None => share_before(simd, x, self.normal_part),
            Some(CutOff { shift, from, to, passed, scale }) => {
                let x = (x + *shift).max(*from).min(*to);
                (share_before(simd, x, self.normal_part) - *passed) * *scale
            }
        }
    }
}

/// Slabs are open.
#[derive(Clone, Copy)]
pub(super) struct Slabbed<S: Simd> {
    seen: Seeing<S>,
    near: [Sum<S>; 2],
    first: u32,
    end: u32,
}

impl<S: Simd> Opening<S> for Slabbed<S> {
    type Open = OpenSlabs;
    const KEEPS_OPEN: bool = true;
    type Policy = Closing;

    #[inline(always)]
    fn load(simd: S, seen: &Seen, open: &mut OpenSlabs) -> Self {
        let near = [open.take(simd, open.first), open.take(simd, open.first + 1)];
        Self { seen: Seeing::load(simd, seen), near, first: open.first, end: open.end }
    }

    #[inline(always)]
    fn store(self, seen: &mut Seen, open: &mut OpenSlabs) {
        self.seen.store(seen);
        self.store_near(open);
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
        closing: Closing,
        open: &mut OpenSlabs,
    ) {
        let Closing::Slabs(slabs) = &closing else {
            return self.add_to_sheets::<DEPTH>(simd, plain, open);
        };
        let narrow = plain.kernels.slabs.narrow;
        let mut rest = plain.set;
        while rest != 0 {
            let set = before(rest, rest & !narrow);
            self.add_narrow::<DEPTH>(simd, Plain { set, ..plain }, slabs, open);
            rest ^= set;
            if rest != 0 {
                let set = before(rest, rest & narrow);
                // A function of its own takes no registers from the other way.
                let copy = *self;
                *self = apart(
                    simd,
                    #[inline(always)]
                    || copy.add_wide::<DEPTH>(simd, Plain { set, ..plain }, slabs, open),
                );
                rest ^= set;
            }
        }
    }

    #[inline(always)]
    fn add<const DEPTH: bool>(
        &mut self,
        simd: S,
        fragment: Fragment<S>,
        closing: Closing,
        open: &mut OpenSlabs,
    ) {
        let Fragment { kernels, number, corner, optical_depth, depth, distance, ray_length, .. } = fragment;
        let first = kernels.slabs.first[number];
        let Closing::Slabs(slabs) = &closing else {
            self.close_before::<DEPTH>(simd, first, 0.0, open);
            self.near[0].add::<DEPTH>(simd, (optical_depth, fragment.depth_inside()), kernels.color(number));
            self.end = self.end.max(first + 2);
            return;
        };
        let segment = fragment.segment.map(
            #[inline(always)]
            |[from, to]| [from * ray_length, to * ray_length],
        );
        let matter = Matter { optical_depth, depth, distance, segment };
        if kernels.slabs.narrow >> number & 1 != 0 {
            self.close_before::<DEPTH>(simd, first, slabs.thickness(), open);
            let share = kernels.slabs.share(number, [first, first + 1]);
            let plane = slabs.begin(first + 1);
            let x = (W::simd_from(simd, plane) - distance) * share.inverse;
            let share = Cumulative::new(simd, &share, &matter).before(simd, x);
            self.share_between::<DEPTH>(simd, (kernels, number), (matter, share), slabs);
            return;
        }
        self.store_near(open);
        open.close_before::<S, DEPTH>(simd, first, (&mut self.seen, slabs.thickness()));
        let range = kernels.slabs_in(number, corner, slabs);
        open.add::<S, DEPTH>(simd, (kernels, number, range), matter, slabs);
        self.load_near(simd, open);
    }

    #[inline(always)]
    fn finish<const DEPTH: bool>(&mut self, simd: S, closing: Closing, open: &mut OpenSlabs) {
        self.close_before::<DEPTH>(simd, u32::MAX, closing.thickness(), open);
        // Ready for the next tile.
        (self.first, self.end) = (0, 0);
    }
}

impl<S: Simd> Slabbed<S> {
    #[inline(always)]
    fn load_near(&mut self, simd: S, open: &mut OpenSlabs) {
        (self.first, self.end) = (open.first, open.end);
        self.near = [open.take(simd, open.first), open.take(simd, open.first + 1)];
    }

    #[inline(always)]
    fn store_near(&self, open: &mut OpenSlabs) {
        (open.first, open.end) = (self.first, self.end);
        self.near[0].store(open.slab(self.first));
        self.near[1].store(open.slab(self.first + 1));
    }

    /// Closes slabs until `first` is the first one.
    #[inline(always)]
    fn close_before<const DEPTH: bool>(&mut self, simd: S, first: u32, thickness: f32, open: &mut OpenSlabs) {
        while self.first < first.min(self.end) {
            let [sum, next] = self.near;
            sum.close::<DEPTH>(simd, &mut self.seen, thickness);
            self.first += 1;
            self.near[0] = next;
            self.near[1] = Sum::zero(simd);
            if self.first + 1 < self.end {
                self.near[1] = open.take(simd, self.first + 1);
            }
        }
        self.first = self.first.max(first);
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
        let Plain { kernels, pixels, .. } = plain;
        let mut plane = slabs.begin(self.first + 1);
        while let Some(number) = plain.next() {
            let first = kernels.slabs.first[number];
            if first != self.first {
                self.close_before::<DEPTH>(simd, first, slabs.thickness(), open);
                plane = slabs.begin(first + 1);
            }
            let (optical_depth, share) = kernels.plain_share_before(simd, number, pixels, plane);
            let [depth, distance] = if DEPTH {
                [kernels.depth_at(simd, number, pixels), kernels.affine_distance(simd, number, pixels)]
            } else {
                [share; 2]
            };
            let matter = Matter { optical_depth, depth, distance, segment: None };
            self.share_between::<DEPTH>(simd, (kernels, number), (matter, share), slabs);
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
            |slab| {
                let slab = (slabs.begin(slab), slabs.thickness());
                matter.depth_in::<DEPTH>(simd, slab, kernels.slabs.inverse(number))
            },
        );
        self.end = self.end.max(self.first + 2);
        self.near[0].add::<DEPTH>(simd, (nearer, depths[0]), color);
        self.near[1].add::<DEPTH>(simd, (matter.optical_depth - nearer, depths[1]), color);
    }

    /// Adds any plain kernels.
    #[inline(always)]
    fn add_wide<const DEPTH: bool>(
        mut self,
        simd: S,
        mut plain: Plain<S>,
        slabs: &Slabs,
        open: &mut OpenSlabs,
    ) -> Self {
        self.store_near(open);
        let Plain { kernels, pixels, corner, .. } = plain;
        while let Some(number) = plain.next() {
            let first = kernels.slabs.first[number];
            open.close_before::<S, DEPTH>(simd, first, (&mut self.seen, slabs.thickness()));
            let optical_depth = kernels.plain_optical_depth(simd, number, pixels);
            let depth = if DEPTH { kernels.depth_at(simd, number, pixels) } else { optical_depth };
            let distance = kernels.affine_distance(simd, number, pixels);
            let range = kernels.slabs_in(number, corner, slabs);
            let matter = Matter { optical_depth, depth, distance, segment: None };
            open.add::<S, DEPTH>(simd, (kernels, number, range), matter, slabs);
        }
        self.load_near(simd, open);
        self
    }

    /// Adds plain kernels to the sheets of their centres.
    #[inline(always)]
    fn add_to_sheets<const DEPTH: bool>(&mut self, simd: S, mut plain: Plain<S>, open: &mut OpenSlabs) {
        let Plain { kernels, pixels, .. } = plain;
        while let Some(number) = plain.next() {
            let first = kernels.slabs.first[number];
            self.close_before::<DEPTH>(simd, first, 0.0, open);
            self.end = self.end.max(first + 2);
            let optical_depth = kernels.plain_optical_depth(simd, number, pixels);
            let depth = if DEPTH { kernels.depth_at(simd, number, pixels) } else { optical_depth };
            self.near[0].add::<DEPTH>(simd, (optical_depth, depth), kernels.color(number));
        }
    }
}

impl Kept {
    #[inline(always)]
    fn add<S: Simd, const DEPTH: bool>(
        &mut self,
        simd: S,
        (optical_depth, depth): (W<S>, W<S>),
        color: [f32; 3],
    ) {
        self.optical_depth.store(self.optical_depth.load(simd) + optical_depth);
        for (plane, own) in self.color.iter_mut().zip(color) {
            plane.store(optical_depth.mul_add(W::simd_from(simd, own), plane.load(simd)));
        }
        if DEPTH {
            self.depth.store(optical_depth.mul_add(depth, self.depth.load(simd)));
        }
    }
}

impl<S: Simd> Sum<S> {
    #[inline(always)]
    fn zero(simd: S) -> Self {
        let zero = W::simd_from(simd, 0.0);
        Self { optical_depth: zero, color: [zero; 3], depth: zero }
    }

    #[inline(always)]
    fn load(simd: S, kept: &Kept) -> Self {
        let Kept { optical_depth, color: [red, green, blue], depth } = kept;
        Self {
            optical_depth: optical_depth.load(simd),
            color: [red.load(simd), green.load(simd), blue.load(simd)],
            depth: depth.load(simd),
        }
    }

    #[inline(always)]
    fn store(&self, kept: &mut Kept) {
        kept.optical_depth.store(self.optical_depth);
        for (plane, color) in kept.color.iter_mut().zip(&self.color) {
            plane.store(*color);
        }
        kept.depth.store(self.depth);
    }

    #[inline(always)]
    fn add<const DEPTH: bool>(&mut self, simd: S, (optical_depth, depth): (W<S>, W<S>), color: [f32; 3]) {
        self.optical_depth += optical_depth;
        for (sum, own) in self.color.iter_mut().zip(color) {
            *sum = optical_depth.mul_add(W::simd_from(simd, own), *sum);
        }
        if DEPTH {
            self.depth = optical_depth.mul_add(depth, self.depth);
        }
    }

    /// Puts the slab behind what is seen: T·(1 − e^{−τ})/τ of each sum. Where the transmittance falls to a half in it the median
    /// is there, as if the optical depth were even over the thickness, to either side of the mean.
    #[inline(always)]
    fn close<const DEPTH: bool>(&self, simd: S, seen: &mut Seeing<S>, thickness: f32) {
        let one = W::simd_from(simd, 1.0);
        let tau = self.optical_depth;
        let through = one - seen.opacity;
        let shown = through * opacity_share(simd, tau);
        for (seen, sum) in seen.color.iter_mut().zip(&self.color) {
            *seen = shown.mul_add(*sum, *seen);
        }
        seen.opacity = shown.mul_add(tau, seen.opacity);
        if DEPTH {
            seen.depth = shown.mul_add(self.depth, seen.depth);
            let left = one - seen.half;
            let is_half = seen.opacity.simd_ge(seen.half) & through.simd_gt(left);
            if is_half.any_true() {
                let inverse = one / tau.max(W::simd_from(simd, 1e-30));
                let until = log2(simd, (through / left).max(one)) * std::f32::consts::LN_2;
                let from_middle = (until * inverse).min(one) - 0.5;
                let z = from_middle.mul_add(W::simd_from(simd, thickness), self.depth * inverse);
                seen.median = is_half.select(z, seen.median);
            }
        }
    }
}

/// The share of a kernel before x of its σ.
#[inline(always)]
fn share_before<S: Simd>(simd: S, x: W<S>, normal_part: f32) -> W<S> {
    if normal_part == 1.0 {
        return share_of_normal(simd, x);
    }
    let of_box = share_of_box(simd, x);
    if normal_part == 0.0 {
        return of_box;
    }
    (share_of_normal(simd, x) - of_box).mul_add(W::simd_from(simd, normal_part), of_box)
}

/// (1 − e^{−τ})/τ, within 5e-6 of itself.
#[inline(always)]
fn opacity_share<S: Simd>(simd: S, tau: W<S>) -> W<S> {
    const UP_TO_2: [f32; 6] =
        [0.999_995_95, -0.499_867_62, 0.165_930_64, -0.040_109_772, 0.006_771_013, -0.000_597_210_3];
    let two = W::simd_from(simd, 2.0);
    let thin = polynomial(simd, tau.min(two), UP_TO_2);
    let is_thick = tau.simd_gt(two);
    if !is_thick.any_true() {
        return thin;
    }
    let thick = (W::simd_from(simd, 1.0) - exp(simd, -tau)) / tau.max(two);
    is_thick.select(thick, thin)
}
