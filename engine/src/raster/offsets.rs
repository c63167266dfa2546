//! Where the pixels of a block are from a record's mean.

use crate::simd::*;

/// e^{−r/2} = 2^{−kr}.
pub(crate) const HALF_LOG2_E: f32 = 0.5 * std::f32::consts::LOG2_E;

/// √k, by which roots of conics are scaled.
pub(crate) const ROOT_HALF_LOG2_E: f32 = 0.849_321_8;

/// Offsets (u, v) and −kq.
pub(crate) struct Offsets<S: Simd> {
    u: W<S>,
    v: W<S>,
    pub(crate) exponent: W<S>,
}

impl<S: Simd> Offsets<S> {
    /// Of pixels by their columns and rows, from a record's mean and √k M.
    #[inline(always)]
    pub(crate) fn new(simd: S, pixels: [W<S>; 2], (mean, root): ([f32; 2], [f32; 3])) -> Self {
        let [a, b, c] = root;
        let (u, v) = (pixels[0] - mean[0], pixels[1] - mean[1]);
        let along = u.mul_add(W::simd_from(simd, a), v * b);
        let across = v * c;
        Self { u, v, exponent: (-along).mul_sub(along, across * across) }
    }

    /// A function of the pixel that is linear.
    #[inline(always)]
    pub(crate) fn linear(&self, simd: S, at_mean: f32, [x, y]: [f32; 2]) -> W<S> {
        let rise = self.v.mul_add(W::simd_from(simd, y), W::simd_from(simd, at_mean));
        self.u.mul_add(W::simd_from(simd, x), rise)
    }
}

/// A record in the exact form at pixels.
///
/// With κ = 1/d_z, t = 1 − κ·rise, den = t² + (κσ₀)² q: r = q/den, σ_z = σ₀/√den, z = d_z t/den. Where κ and σ₀ are 0 r is the affine
/// form's.
pub(crate) struct Exact<S: Simd> {
    /// −kr.
    pub(crate) exponent: W<S>,
    /// z of the densest point.
    pub(crate) depth: W<S>,
    pub(crate) den: W<S>,
}

/// A record's depth and its slope, and what the exact form makes of these and of σ₀.
#[derive(Clone, Copy)]
#[repr(C)]
pub(crate) struct Plane {
    pub(crate) depth: f32,
    pub(crate) slope: [f32; 2],
    /// Of t.
    pub(crate) t_slope: [f32; 2],
    /// (κσ₀)²/k.
    pub(crate) spread: f32,
}

impl Plane {
    /// t and den.
    #[inline(always)]
    fn t_and_den<S: Simd>(&self, simd: S, offsets: &Offsets<S>) -> [W<S>; 2] {
        // Rounded once beside 1, so that ends of kernels hang less on where a tile begins.
        let t = offsets.linear(simd, 0.0, self.t_slope) + W::simd_from(simd, 1.0);
        [t, (-offsets.exponent).mul_add(W::simd_from(simd, self.spread), t * t)]
    }

    /// −kr alone; NaN, perhaps, in the camera plane and infinitely far from it.
    #[inline(always)]
    pub(crate) fn exponent<S: Simd>(&self, simd: S, offsets: &Offsets<S>) -> W<S> {
        let [_, den] = self.t_and_den(simd, offsets);
        offsets.exponent * reciprocal(simd, den)
    }

    /// The same as some number or −∞, and 1/√den.
    #[inline(always)]
    pub(crate) fn exponent_and_scale<S: Simd>(&self, simd: S, offsets: &Offsets<S>) -> [W<S>; 2] {
        let [_, den] = self.t_and_den(simd, offsets);
        let per_den = reciprocal(simd, divisible(simd, den));
        [offsets.exponent * per_den, per_den.sqrt()]
    }
}

impl<S: Simd> Exact<S> {
    /// From where pixels are.
    #[inline(always)]
    pub(crate) fn new(simd: S, offsets: &Offsets<S>, plane: &Plane) -> Self {
        let [t, den] = plane.t_and_den(simd, offsets);
        let den = divisible(simd, den);
        let per_den = reciprocal(simd, den);
        Self { exponent: offsets.exponent * per_den, depth: t * plane.depth * per_den, den }
    }
}

/// den as something that can be divided by: in the camera plane there is no depth, but a number.
#[inline(always)]
pub(crate) fn divisible<S: Simd>(simd: S, den: W<S>) -> W<S> {
    den.max(W::simd_from(simd, 1e-30)).min(W::simd_from(simd, 1e30))
}
