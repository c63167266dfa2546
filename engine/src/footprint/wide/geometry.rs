//! Splats in camera space and their footprints.
//!
//! With vₖ = (gₖ,xy − v₀ gₖ,z)/d_z, the columns of a factor of Σ as the picture shows them in pixels, and with
//! nᵢⱼ = vᵢ × vⱼ, mᵢⱼ = vᵢ gⱼ,z − vⱼ gᵢ,z, all that [`super::Footprint`] says are sums of squares and products of these,
//! the filter h² among them; nothing cancels for large surfels seen edge-on:
//!
//! ```text
//! V = Σ vvᵀ + h²           |V| = Σ n² + h² Σ |v|² + h⁴              M from V as its inverse's root
//! s = Σ g_z v              dz/du = V⁻¹s = (Σ n (−m_y, m_x) + h² s)/|V|
//! σ₀² |V| = (n₀₁g₂ − n₀₂g₁ + n₁₂g₀)² + h² Σ |m|² + h⁴ Σ g_z²         κ² = s·(dz/du)/d_z²
//! ```

use super::{Rows, WideProjector};
use crate::columns::{Factors, Lanes};
use crate::simd::*;
use glam::Vec3;

/// Splats in camera space.
pub(super) struct Placed<S: Simd> {
    pub(super) center: V3<S>,
    /// 1/z, and 1 where rays are parallel.
    pub(super) inverse_z: V<S>,
    /// The ray through the centre, with z = 1.
    pub(super) ray: V3<S>,
}

/// Their footprints.
pub(super) struct Footprints<S: Simd> {
    pub(super) mean: [V<S>; 2],
    pub(super) conic_root: V3<S>,
    pub(super) depth_slope: [V<S>; 2],
    pub(super) sigma_z: V<S>,
    pub(super) unit_integral: V<S>,
    /// √(D₀(Σ)/D₀(Σ')).
    pub(super) attenuation: V<S>,
    /// What points multiply amplitudes by, being rounder than they are; else 1.
    pub(super) gain: V<S>,
    /// Of the picture, V_xx and V_yy, and V_xy.
    pub(super) variance: [V<S>; 2],
    pub(super) covariance: V<S>,
    /// Σ g_z v, Σ m² + h² Σ g_z² by axis, and Σ g_z².
    pub(super) along: [V<S>; 2],
    pub(super) minor: [V<S>; 2],
    pub(super) zz: V<S>,
    /// Those that f32 can hold and that don't reach the camera plane.
    pub(super) is_simple: M<S>,
}

/// Three numbers of each splat of a block.
#[inline(always)]
pub(super) fn lanes<S: Simd>(simd: S, rows: [Lanes; 3]) -> V3<S> {
    rows.each(
        #[inline(always)]
        |row| V::simd_from(simd, row),
    )
}

impl WideProjector<'_> {
    /// A vector by the rows of a matrix.
    #[inline(always)]
    pub(super) fn transform<S: Simd>(simd: S, rows: &Rows, v: V3<S>) -> V3<S> {
        rows.each_ref().each(
            #[inline(always)]
            |row| dot(lanes(simd, *row), v),
        )
    }

    #[inline(always)]
    pub(super) fn place<S: Simd>(&self, simd: S, in_camera: Vec3, offset: V3<S>) -> Placed<S> {
        let turned = Self::transform(simd, &self.to_camera, offset);
        let center = [0, 1, 2].each(
            #[inline(always)]
            |i| turned[i] + in_camera.to_array()[i],
        );
        let (zero, one) = (splat(simd, 0.0), splat(simd, 1.0));
        if self.perspective {
            let inverse_z = one / center[2];
            Placed { center, inverse_z, ray: [center[0] * inverse_z, center[1] * inverse_z, one] }
        } else {
            Placed { center, inverse_z: one, ray: [zero, zero, one] }
        }
    }

    /// The half-axes of a block in camera space.
    #[inline(always)]
    pub(super) fn half_axes<S: Simd>(&self, simd: S, block: usize) -> [V3<S>; 3] {
        match &self.scalar.columns.factors {
            Factors::Shared(_) => self.shared_axes.each(
                #[inline(always)]
                |axis| lanes(simd, axis),
            ),
            Factors::Each { flat, through } => {
                let [a, b, c, d, e, f] = *flat.block(block);
                [[a, b, c], [d, e, f], *through.block(block)].each(
                    #[inline(always)]
                    |column| Self::transform(simd, &self.to_camera, lanes(simd, column)),
                )
            }
        }
    }

    /// The two half-axes that surfels of a block lie in, in cloud space.
    #[inline(always)]
    pub(super) fn flat_in_cloud<S: Simd>(&self, simd: S, block: usize) -> [V3<S>; 2] {
        match &self.scalar.columns.factors {
            Factors::Shared(factor) => [factor.x_axis, factor.y_axis].each(
                #[inline(always)]
                |axis| splat3(simd, axis.to_array()),
            ),
            Factors::Each { flat, .. } => {
                let [a, b, c, d, e, f] = *flat.block(block);
                [lanes(simd, [a, b, c]), lanes(simd, [d, e, f])]
            }
        }
    }

    #[inline(always)]
    pub(super) fn footprints<S: Simd>(
        &self,
        simd: S,
        placed: &Placed<S>,
        half_axes: [V3<S>; 3],
    ) -> Footprints<S> {
        let Placed { center, inverse_z, ray } = placed;
        let [h2, h4] = [self.low_pass, self.low_pass * self.low_pass].each(
            #[inline(always)]
            |h| splat(simd, h),
        );
        let [scale_x, scale_y] = self.focal.each(
            #[inline(always)]
            |focal| *inverse_z * focal,
        );
        // In pixels; for parallel rays the ray has no slope.
        let x = half_axes.each(
            #[inline(always)]
            |g| (-ray[0]).mul_add(g[2], g[0]) * scale_x,
        );
        let y = half_axes.each(
            #[inline(always)]
            |g| (-ray[1]).mul_add(g[2], g[1]) * scale_y,
        );
        let z = half_axes.each(
            #[inline(always)]
            |g| g[2],
        );
        let [n, mx, my] = [minors(x, y), minors(x, z), minors(y, z)];
        let [xx, yy, xy, zz, nn] = [dot(x, x), dot(y, y), dot(x, y), dot(z, z), dot(n, n)];
        let along = [dot(x, z), dot(y, z)];
        let area = (xx + yy).mul_add(h2, nn + h4);
        let inverse_root = splat(simd, 1.0) / area.sqrt();
        let inverse_area = inverse_root * inverse_root;
        let triple = n[0].mul_add(z[2], n[2].mul_sub(z[0], n[1] * z[1]));
        let mm = [dot(mx, mx), dot(my, my)];
        let volume = triple.mul_add(triple, (mm[0] + mm[1]).mul_add(h2, zz * h4));
        let variance = [xx + h2, yy + h2];
        let root_y = variance[1].sqrt();
        let inverse_y = splat(simd, 1.0) / root_y;
        let [slope_x, slope_y] = [along[0].mul_sub(h2, dot(n, my)), along[1].mul_add(h2, dot(n, mx))];
        let across = if self.perspective { [ray[0], ray[1]] } else { [center[0], center[1]] };
        let mean = [0, 1].each(
            #[inline(always)]
            |i| across[i].mul_add(splat(simd, self.focal[i]), splat(simd, self.principal[i])),
        );
        let mut is_simple = area.simd_gt(splat(simd, 1e-12)) & area.simd_lt(splat(simd, 1e24));
        if self.perspective {
            let beyond = (center[2] * center[2]).simd_gt(zz * self.cutoff);
            is_simple &= beyond & center[2].simd_gt(splat(simd, 0.0));
        }
        let solid = self.focal[0] * self.focal[1] / std::f32::consts::TAU;
        Footprints {
            mean,
            conic_root: [root_y * inverse_root, -xy * inverse_y * inverse_root, inverse_y],
            depth_slope: [slope_x * inverse_area, slope_y * inverse_area],
            sigma_z: (volume * inverse_area).sqrt(),
            unit_integral: *inverse_z * *inverse_z * inverse_root * solid,
            attenuation: nn.sqrt() * inverse_root,
            gain: splat(simd, 1.0),
            variance,
            covariance: xy,
            along,
            minor: [0, 1].each(
                #[inline(always)]
                |i| zz.mul_add(h2, mm[i]),
            ),
            zz,
            is_simple,
        }
    }

    /// First and last pixels of the rectangles, along an axis.
    #[inline(always)]
    pub(super) fn bounds<S: Simd>(
        &self,
        simd: S,
        axis: usize,
        (placed, footprints): (&Placed<S>, &Footprints<S>),
        (exact, cutoff): (M<S>, V<S>),
    ) -> [V<S>; 2] {
        let Footprints { mean, variance, along, minor, zz, .. } = footprints;
        let (mut center, mut half) = (mean[axis], (variance[axis] * cutoff).sqrt());
        if exact.any_true() {
            let per_z = placed.inverse_z * placed.inverse_z * cutoff;
            let inverse = splat(simd, 1.0) / (splat(simd, 1.0) - per_z * *zz);
            let shift = along[axis] * placed.inverse_z * cutoff * inverse;
            let under = (variance[axis] - per_z * minor[axis]) * cutoff;
            let exact_half = under.max(splat(simd, 0.0)).sqrt() * inverse;
            center = exact.select(center - shift, center);
            half = exact.select(exact_half, half);
        }
        // As in `Rect::around`.
        let last = self.scalar.view.camera.size()[axis] as f32;
        let low = (center - half - 0.51).ceil().max(splat(simd, 0.0));
        let high = ((center + half - 0.49).floor() + 1.0).min(splat(simd, last));
        [low, high]
    }
}

/// a_i b_j − a_j b_i for (i, j) of (0, 1), (0, 2), (1, 2).
#[inline(always)]
fn minors<S: Simd>(a: V3<S>, b: V3<S>) -> V3<S> {
    [a[0].mul_sub(b[1], a[1] * b[0]), a[0].mul_sub(b[2], a[2] * b[0]), a[1].mul_sub(b[2], a[2] * b[1])]
}
