//! Plain kernels to optical depths and opacities: those of which nothing else is asked for.

use super::kernel::{KernelLens, Kernels};
use crate::simd::*;
use crate::tile::Tile;

/// Up to this optical depth opacities are a cubic polynomial.
pub(super) const THIN_PEAK: f32 = 0.25;

/// (1 − e^{−t})/t on [0, [`THIN_PEAK`]] to 2e-5 of itself, relative minimax.
pub(super) const THIN: [f32; 3] = [0.999_980_4, -0.498_614_63, 0.151_798_94];

/// α = τ.
pub(super) const TAYLOR: [f32; 3] = [1.0, 0.0, 0.0];

/// Where one of as many in a batch of optical depths isn't thin, or is in the exact form, all are evaluated so that this doesn't matter.
pub(super) const ONE_THICK_OF: usize = 4;

impl Kernels {
    /// Plain kernels of which a share is the same share of their strength: those of optical depths in the affine form, unless these are taken
    /// for opacities, which end at 1.
    #[inline(always)]
    pub(crate) fn plain_media(&self) -> u64 {
        if self.is_taylor { 0 } else { self.plain & !self.opacities & !self.outlines.exact }
    }

    /// The strength 2^{peak − kr}, down to where the kernel ends, 0 beyond and of NaN.
    #[inline(always)]
    fn strength<S: Simd>(&self, simd: S, number: usize, exponent: W<S>) -> W<S> {
        let is_within = exponent.simd_ge(W::simd_from(simd, self.least[number]));
        exp2_where(simd, is_within, exponent + self.peak[number])
    }

    /// The opacity of a kernel, or of a share of it, of an optical depth.
    #[inline(always)]
    pub(crate) fn opacity<S: Simd>(&self, simd: S, number: usize, optical_depth: W<S>) -> W<S> {
        if self.is_taylor {
            optical_depth.min(W::simd_from(simd, 1.0))
        } else if self.thin >> number & 1 != 0 && !self.is_opacity(number) {
            optical_depth * polynomial(simd, optical_depth, THIN)
        } else {
            opacity(simd, optical_depth)
        }
    }

    /// The opacity of a kernel that is plain at pixels, whose rays have lengths; or of a share of it, of an optical depth in the affine
    /// form.
    #[inline(always)]
    pub(crate) fn plain_alpha<S: Simd>(
        &self,
        simd: S,
        number: usize,
        (pixels, ray_length): ([W<S>; 2], W<S>),
        share: Option<W<S>>,
    ) -> W<S> {
        let offsets = self.outlines.offsets(simd, number, pixels);
        // Of a batch all or none: a branch for each kernel is foreseen wrongly, which takes longer than the division.
        let mut strength = if self.outlines.exact == 0 {
            self.strength(simd, number, offsets.exponent)
        } else if !self.is_thick {
            self.strength(simd, number, self.outlines.plane(number).exponent(simd, &offsets))
        } else {
            let plane = self.outlines.plane(number);
            let [exponent, scale] = plane.exponent_and_scale(simd, &offsets);
            // In the exact form strengths are per length of the ray.
            let is_exact = mask32x16::splat(simd, self.outlines.is_exact(number));
            let length = is_exact.select(ray_length, W::simd_from(simd, 1.0));
            self.strength(simd, number, exponent) * scale * length
        };
        if let Some(share) = share {
            strength *= share;
        }
        if self.is_linear {
            return strength;
        }
        if self.is_thick {
            // Both: an opacity doesn't depend on what is in the batch.
            let is_thin = mask32x16::splat(simd, self.thin >> number & 1 != 0);
            return is_thin.select(strength * polynomial(simd, strength, THIN), opacity(simd, strength));
        }
        let [first, second, third] = self.alpha.each_ref().each(
            #[inline(always)]
            |column| W::simd_from(simd, column[number]),
        );
        strength * strength.mul_add(strength.mul_add(third, second), first)
    }

    /// |v| of a block's rays if plain kernels ask for it, else 1.
    #[inline(always)]
    pub(crate) fn plain_ray_lengths<S: Simd>(
        &self,
        simd: S,
        pixels: [W<S>; 2],
        (tile, lens): (Tile, &KernelLens),
    ) -> W<S> {
        let is_asked_for = self.is_thick && self.outlines.exact != 0;
        if is_asked_for { lens.ray_lengths(simd, pixels, tile) } else { W::simd_from(simd, 1.0) }
    }

    /// The optical depth of a plain kernel at pixels, where sums are of optical depths.
    #[inline(always)]
    pub(crate) fn plain_optical_depth<S: Simd>(&self, simd: S, number: usize, pixels: [W<S>; 2]) -> W<S> {
        let exponent = self.outlines.offsets(simd, number, pixels).exponent;
        self.affine_optical_depth(simd, number, exponent)
    }

    #[inline(always)]
    pub(super) fn affine_optical_depth<S: Simd>(&self, simd: S, number: usize, exponent: W<S>) -> W<S> {
        let strength = self.strength(simd, number, exponent);
        if self.is_opacity(number) { optical_depth(simd, strength) } else { strength }
    }
}
