//! Any form, row by row.

use crate::camera::Projection;
use crate::footprint::{Form, Lens, Record};
use crate::simd::*;

/// A record's formula for rows of eight pixels.
///
/// With κ = 1/d_z in the exact form and 0 in the affine one, t = 1 − κ·rise, den = t² + (κσ₀)² q, r = q/den,
/// σ_z = σ₀/√den, and z = (d_z ∓ rise)/den, the upper sign in the exact form.
#[derive(Clone, Copy)]
pub(crate) struct ExactRows {
    inverse_depth: f32,
    spread: f32,
    rise_sign: f32,
}

/// One row of it.
#[derive(Clone, Copy)]
pub(crate) struct ExactRow<S: Simd> {
    /// Squared Mahalanobis distance.
    pub(crate) r: V<S>,
    /// z of the densest point.
    pub(crate) depth: V<S>,
    /// Spread in z.
    pub(crate) sigma_z: V<S>,
    /// 1/√den.
    pub(crate) scale: V<S>,
}

impl ExactRows {
    #[inline(always)]
    pub(crate) fn new(record: &Record) -> Self {
        let exact = record.tag.form == Form::Exact;
        let inverse_depth = if exact { 1.0 / record.depth } else { 0.0 };
        let spread = inverse_depth * record.sigma_z;
        Self { inverse_depth, spread: spread * spread, rise_sign: if exact { -1.0 } else { 1.0 } }
    }

    /// At offsets (u, v) from the record's mean.
    #[inline(always)]
    pub(crate) fn row<S: Simd>(self, simd: S, record: &Record, u: V<S>, v: f32) -> ExactRow<S> {
        let [a, b, c] = record.conic_root;
        let along = u.mul_add(splat(simd, a), splat(simd, b * v));
        let q = along.mul_add(along, splat(simd, c * v * c * v));
        let [slope_x, slope_y] = record.depth_slope;
        let rise = u.mul_add(splat(simd, slope_x), splat(simd, slope_y * v));
        let t = splat(simd, 1.0) - rise * self.inverse_depth;
        let den = q.mul_add(splat(simd, self.spread), t * t);
        let inverse = splat(simd, 1.0) / den;
        let scale = inverse.sqrt();
        ExactRow {
            r: q * inverse,
            depth: rise.mul_add(splat(simd, self.rise_sign), splat(simd, record.depth)) * inverse,
            sigma_z: scale * record.sigma_z,
            scale,
        }
    }
}

/// |v| of the rays through eight pixels of a row, from their centres in the picture.
#[inline(always)]
pub(crate) fn ray_lengths<S: Simd>(simd: S, lens: &Lens, x: V<S>, y: f32) -> V<S> {
    if lens.projection == Projection::Orthographic {
        return splat(simd, 1.0);
    }
    let [focal, principal] = [lens.focal.as_vec2(), lens.principal.as_vec2()];
    let across = (x - principal.x) * (1.0 / focal.x);
    let down = (y - principal.y) / focal.y;
    across.mul_add(across, splat(simd, 1.0 + down * down)).sqrt()
}
