//! What lies in open slabs, along the rays of a block.

use super::seen::Seeing;
use crate::raster::Grain;
use crate::simd::*;
use crate::tile::Plane;

/// Slabs that may be open at once, a power of two; a kernel that reaches over more of them comes in pieces.
pub(super) const MOST_OPEN: u32 = 16;

/// The first of them are in registers, as many as level kernels touch at most.
pub(super) const NEAR: u32 = 3;

/// What lies in a slab, along the rays of a block.
#[derive(Clone, Copy)]
pub(super) struct Sum<S: Simd> {
    optical_depth: W<S>,
    /// Times the optical depth, as is z.
    color: [W<S>; 3],
    depth: W<S>,
}

/// [`Sum`] in memory.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Kept {
    optical_depth: Plane,
    color: [Plane; 3],
    depth: Plane,
}

impl Kept {
    pub(super) const ZERO: Self =
        Self { optical_depth: Plane::ZERO, color: [Plane::ZERO; 3], depth: Plane::ZERO };
}

/// The open slabs of a block.
#[derive(Clone)]
pub(crate) struct OpenSlabs {
    /// The number of the first open slab.
    pub(super) first: u32,
    /// There is nothing from this one on.
    pub(super) end: u32,
    /// The part of the first one that is closed already.
    pub(super) closed: f32,
    /// Slab n at n modulo their number; zero where nothing is, or all that is there is in registers.
    kept: [Kept; MOST_OPEN as usize],
}

impl Default for OpenSlabs {
    fn default() -> Self {
        Self { first: 0, end: 0, closed: 0.0, kept: [Kept::ZERO; MOST_OPEN as usize] }
    }
}

impl OpenSlabs {
    #[inline(always)]
    pub(super) fn slab(&mut self, number: u32) -> &mut Kept {
        &mut self.kept[(number % MOST_OPEN) as usize]
    }

    /// Takes what is in a slab out of memory.
    #[inline(always)]
    pub(super) fn take<S: Simd>(&mut self, simd: S, number: u32) -> Sum<S> {
        let kept = self.slab(number);
        let sum = Sum::load(simd, kept);
        *kept = Kept::ZERO;
        sum
    }

    /// Takes the first [`NEAR`] out of memory.
    #[inline(always)]
    pub(super) fn take_near<S: Simd>(&mut self, simd: S) -> [Sum<S>; NEAR as usize] {
        let first = self.first;
        [self.take(simd, first), self.take(simd, first + 1), self.take(simd, first + 2)]
    }
}

impl Kept {
    #[inline(always)]
    pub(super) fn add<S: Simd, const DEPTH: bool>(
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
    pub(super) fn zero(simd: S) -> Self {
        let zero = W::simd_from(simd, 0.0);
        Self { optical_depth: zero, color: [zero; 3], depth: zero }
    }

    #[inline(always)]
    pub(super) fn load(simd: S, kept: &Kept) -> Self {
        let Kept { optical_depth, color: [red, green, blue], depth } = kept;
        Self {
            optical_depth: optical_depth.load(simd),
            color: [red.load(simd), green.load(simd), blue.load(simd)],
            depth: depth.load(simd),
        }
    }

    /// Together with what is in memory.
    #[inline(always)]
    pub(super) fn plus(mut self, kept: &Kept) -> Self {
        let kept = Self::load(self.optical_depth.simd, kept);
        self.optical_depth += kept.optical_depth;
        for (sum, kept) in self.color.iter_mut().zip(kept.color) {
            *sum += kept;
        }
        self.depth += kept.depth;
        self
    }

    /// A share of it.
    #[inline(always)]
    pub(super) fn times(&self, share: W<S>) -> Self {
        let color = self.color.each(
            #[inline(always)]
            |sum| sum * share,
        );
        Self { optical_depth: self.optical_depth * share, color, depth: self.depth * share }
    }

    #[inline(always)]
    pub(super) fn store(&self, kept: &mut Kept) {
        kept.optical_depth.store(self.optical_depth);
        for (plane, color) in kept.color.iter_mut().zip(&self.color) {
            plane.store(*color);
        }
        kept.depth.store(self.depth);
    }

    #[inline(always)]
    pub(super) fn add<const DEPTH: bool>(
        &mut self,
        simd: S,
        (optical_depth, depth): (W<S>, W<S>),
        color: [f32; 3],
    ) {
        self.optical_depth += optical_depth;
        for (sum, own) in self.color.iter_mut().zip(color) {
            *sum = optical_depth.mul_add(W::simd_from(simd, own), *sum);
        }
        if DEPTH {
            self.depth = optical_depth.mul_add(depth, self.depth);
        }
    }

    /// Adds a level kernel with a weight at each pixel, and that times how much farther its z is there.
    #[inline(always)]
    pub(super) fn add_grain<const DEPTH: bool>(
        &mut self,
        simd: S,
        [weight, farther]: [W<S>; 2],
        grain: &Grain,
    ) {
        let optical_depth = W::simd_from(simd, grain.optical_depth);
        self.optical_depth = weight.mul_add(optical_depth, self.optical_depth);
        for (sum, own) in self.color.iter_mut().zip(grain.color) {
            *sum = weight.mul_add(W::simd_from(simd, own), *sum);
        }
        if DEPTH {
            let depth = farther.mul_add(optical_depth, self.depth);
            self.depth = weight.mul_add(W::simd_from(simd, grain.depth), depth);
        }
    }

    /// Puts the slab behind what is seen: T·(1 − e^{−τ})/τ of each sum. Where the transmittance falls to a half in it the median
    /// is there, as if the optical depth were even over the thickness, to either side of the mean.
    #[inline(always)]
    pub(super) fn close<const DEPTH: bool>(&self, simd: S, seen: &mut Seeing<S>, thickness: f32) {
        let one = W::simd_from(simd, 1.0);
        let tau = self.optical_depth;
        let before = seen.opacity;
        let through = one - before;
        let shown = through * opacity_share(simd, tau);
        for (seen, sum) in seen.color.iter_mut().zip(&self.color) {
            *seen = shown.mul_add(*sum, *seen);
        }
        seen.opacity = shown.mul_add(tau, seen.opacity);
        if DEPTH {
            seen.depth = shown.mul_add(self.depth, seen.depth);
            let left = one - seen.half;
            let is_half = seen.opacity.simd_ge(seen.half) & before.simd_lt(seen.half);
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
