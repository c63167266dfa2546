//! Closing at planes: optical depths, and colours times these, are summed up in any order slab by slab.

use super::seen::{Seeing, Seen};
use super::{Fragment, Opening, Plain};
use crate::closing::{Closing, Slabs};
use crate::raster::Kernels;
use crate::simd::*;
use crate::tile::Plane;

/// Slabs that may be open at once; a kernel that reaches over more of them comes in pieces.
pub(super) const MOST_OPEN: u32 = 16;

/// Two slabs are open in registers, the others in memory.
const FAR: usize = MOST_OPEN as usize - 2;

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
    near: [Kept; 2],
    /// Slab number n at n modulo the length; zero where there is nothing.
    far: [Kept; FAR],
}

impl Default for OpenSlabs {
    fn default() -> Self {
        Self { first: 0, end: 0, near: [Kept::ZERO; 2], far: [Kept::ZERO; FAR] }
    }
}

/// Slabs are open.
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
    fn load(simd: S, seen: &Seen, open: &OpenSlabs) -> Self {
        let near = open.near.each_ref().each(
            #[inline(always)]
            |kept| Sum::load(simd, kept),
        );
        Self { seen: Seeing::load(simd, seen), near, first: open.first, end: open.end }
    }

    #[inline(always)]
    fn store(self, seen: &mut Seen, open: &mut OpenSlabs) {
        self.seen.store(seen);
        for (kept, sum) in open.near.iter_mut().zip(&self.near) {
            sum.store(kept);
        }
        (open.first, open.end) = (self.first, self.end);
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
        let Plain { kernels, number, corner, pixels } = plain;
        let optical_depth = kernels.plain_optical_depth(simd, number, pixels);
        let (first, last) = (kernels.slabs.first[number], kernels.slabs.last[number]);
        self.close_before::<DEPTH>(simd, first, closing, open);
        let color = kernels.color(number);
        if last == first {
            self.end = self.end.max(last + 1);
            let depth = if DEPTH { kernels.depth_at(simd, number, pixels) } else { optical_depth };
            self.near[0].add::<DEPTH>(simd, (optical_depth, depth), color);
        } else if let Closing::Slabs(slabs) = &closing {
            let depth = kernels.depth_at(simd, number, pixels);
            let range = kernels.slabs_in(number, corner, slabs);
            self.end = self.end.max(range[1] + 1);
            self.share_out::<DEPTH>(simd, (kernels, number, range), (optical_depth, depth), (slabs, open));
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
        let Fragment { kernels, number, optical_depth, depth, color, .. } = fragment;
        let range = [kernels.slabs.first[number], kernels.slabs.last[number]];
        self.close_before::<DEPTH>(simd, range[0], closing, open);
        self.end = self.end.max(range[1] + 1);
        match &closing {
            Closing::Slabs(slabs) => {
                self.share_out::<DEPTH>(
                    simd,
                    (kernels, number, range),
                    (optical_depth, depth),
                    (slabs, open),
                );
            }
            _ => self.near[0].add::<DEPTH>(simd, (optical_depth, depth), color),
        }
    }

    #[inline(always)]
    fn finish<const DEPTH: bool>(&mut self, simd: S, closing: Closing, open: &mut OpenSlabs) {
        self.close_before::<DEPTH>(simd, u32::MAX, closing, open);
        // Ready for the next tile: nothing is open, and what is kept is zero.
        (self.first, self.end) = (0, 0);
    }
}

impl<S: Simd> Slabbed<S> {
    /// Closes the slabs before `first`.
    #[inline(always)]
    fn close_before<const DEPTH: bool>(
        &mut self,
        simd: S,
        first: u32,
        closing: Closing,
        open: &mut OpenSlabs,
    ) {
        while self.first < first {
            if self.first >= self.end {
                self.first = first;
                return;
            }
            let planes = match &closing {
                Closing::Slabs(slabs) => Some([slabs.plane(self.first), slabs.thickness]),
                _ => None,
            };
            let [sum, next] = self.near;
            sum.close::<DEPTH>(simd, &mut self.seen, planes);
            self.near = [next, Sum::zero(simd)];
            self.first += 1;
            if self.first + 1 < self.end {
                let kept = &mut open.far[(self.first + 1) as usize % FAR];
                self.near[1] = Sum::load(simd, kept);
                *kept = Kept::ZERO;
            }
        }
    }

    /// Shares a kernel out between the slabs of a range.
    #[inline(always)]
    fn share_out<const DEPTH: bool>(
        &mut self,
        simd: S,
        (kernels, number, [first, last]): (&Kernels, usize, [u32; 2]),
        (optical_depth, depth): (W<S>, W<S>),
        (slabs, open): (&Slabs, &mut OpenSlabs),
    ) {
        let color = kernels.color(number);
        let columns = &kernels.slabs;
        let is_whole = !columns.goes_on(number) && columns.ends(number);
        let place = first.saturating_sub(self.first);
        if is_whole && place == 0 && last <= first + 1 {
            // All that is narrower than a slab.
            if last == first {
                self.near[0].add::<DEPTH>(simd, (optical_depth, depth), color);
                return;
            }
            let before = kernels.share_before(simd, number, depth, (slabs, last));
            let nearer = optical_depth * before;
            self.near[0].add::<DEPTH>(simd, (nearer, depth), color);
            self.near[1].add::<DEPTH>(simd, (optical_depth - nearer, depth), color);
            return;
        }
        let mut passed = W::simd_from(simd, 0.0);
        if columns.goes_on(number) && first == columns.first[number] {
            passed = optical_depth * kernels.share_before(simd, number, depth, (slabs, first));
        }
        for slab in first..=last {
            let mut until = optical_depth;
            if slab < last || !(columns.ends(number) || last < columns.last[number]) {
                until *= kernels.share_before(simd, number, depth, (slabs, slab + 1));
            }
            let own = until - passed;
            passed = until;
            match slab.saturating_sub(self.first) {
                0 => self.near[0].add::<DEPTH>(simd, (own, depth), color),
                1 => self.near[1].add::<DEPTH>(simd, (own, depth), color),
                _ => {
                    let kept = &mut open.far[slab as usize % FAR];
                    let mut sum = Sum::load(simd, kept);
                    sum.add::<DEPTH>(simd, (own, depth), color);
                    sum.store(kept);
                }
            }
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
        for (plane, color) in kept.color.iter_mut().zip(self.color) {
            plane.store(color);
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

    /// Puts the slab behind what is seen: T·(1 − e^{−τ})/τ of each sum. Where half of the light is lost in it the median
    /// is there, as if the optical depth were even from the plane where it begins over its thickness; at the mean where it
    /// has no planes.
    #[inline(always)]
    fn close<const DEPTH: bool>(&self, simd: S, seen: &mut Seeing<S>, planes: Option<[f64; 2]>) {
        let one = W::simd_from(simd, 1.0);
        let tau = self.optical_depth;
        let through = one - seen.opacity;
        let shown = through * opacity_share(simd, tau);
        for (seen, sum) in seen.color.iter_mut().zip(self.color) {
            *seen = shown.mul_add(sum, *seen);
        }
        seen.opacity = shown.mul_add(tau, seen.opacity);
        if DEPTH {
            seen.depth = shown.mul_add(self.depth, seen.depth);
            let half = W::simd_from(simd, 0.5);
            let is_half = seen.opacity.simd_ge(half) & through.simd_gt(half);
            if is_half.any_true() {
                let inverse = one / tau.max(W::simd_from(simd, 1e-30));
                let z = match planes {
                    Some([begin, thickness]) => {
                        let least = W::simd_from(simd, 0.5);
                        let until = log2(simd, (through + through).max(least)) * std::f32::consts::LN_2;
                        let [begin, thickness] = [begin, thickness].map(|z| W::simd_from(simd, z as f32));
                        (until * inverse).min(one).mul_add(thickness, begin)
                    }
                    None => self.depth * inverse,
                };
                seen.median = is_half.select(z, seen.median);
            }
        }
    }
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
