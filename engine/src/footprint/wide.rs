//! Eight splats to records at once.
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
//!
//! A kernel that reaches the camera plane, or has no area that f32 can hold, is left to [`super::scalar`].

use super::record::{Form, Kind, Record, Rect, Tag};
use super::scalar::Projector;
use super::{Places, Projected, SurfaceSample, cutoff_gain};
use crate::camera::Projection;
use crate::columns::{self, Factors, LANES, Lanes, PackedHarmonics};
use crate::cull::VisibleRange;
use crate::harmonics::basis;
use crate::scene::{Blend, FootprintForm};
use crate::simd::*;
use glam::{DMat3, Vec3};

/// What the splats of a cloud share, in f32.
pub(super) struct WideProjector<'a> {
    scalar: &'a Projector<'a>,
    perspective: bool,
    focal: [f32; 2],
    principal: [f32; 2],
    /// Rows of the linear part of cloud to camera, and of its cofactors with the sign of its determinant.
    to_camera: [[f32; 3]; 3],
    normal_to_camera: [[f32; 3]; 3],
    /// −1 where the cloud is mirrored.
    handedness: f32,
    /// What strengths are multiplied by: the volume's or area's scale, the cut-off's gain, over the coverage floor.
    strength_scale: f32,
    /// A cloud that is stretched unevenly has another area scale for each surfel.
    is_even: bool,
    cutoff: f32,
    low_pass: f32,
    near: f32,
    tolerance: f32,
}

/// Splats in camera space.
struct Placed<S: Simd> {
    center: V3<S>,
    /// 1/z, and 1 where rays are parallel.
    inverse_z: V<S>,
    /// The ray through the centre, with z = 1.
    ray: V3<S>,
    /// Half-axes.
    columns: [V3<S>; 3],
}

/// Their footprints.
struct Footprints<S: Simd> {
    mean: [V<S>; 2],
    conic_root: V3<S>,
    depth_slope: [V<S>; 2],
    sigma_z: V<S>,
    unit_integral: V<S>,
    /// √(D₀(Σ)/D₀(Σ')).
    attenuation: V<S>,
    variance: [V<S>; 2],
    /// Σ g_z v, Σ m² + h² Σ g_z² by axis, and Σ g_z².
    along: [V<S>; 2],
    minor: [V<S>; 2],
    zz: V<S>,
    /// Those that f32 can hold and that don't reach the camera plane.
    is_simple: M<S>,
}

/// What becomes of their amplitudes.
struct Amplitudes<S: Simd> {
    amplitude: V<S>,
    slope: [V<S>; 2],
    color: V3<S>,
    normal: V3<S>,
    /// Where r ends.
    cutoff: V<S>,
    is_seen: M<S>,
}

fn rows(m: DMat3) -> [[f32; 3]; 3] {
    [m.row(0), m.row(1), m.row(2)].map(|row| row.as_vec3().to_array())
}

/// Whether lengths and angles keep their proportions.
fn is_similarity(m: DMat3) -> bool {
    let product = m.transpose() * m;
    let scale = product.x_axis.x;
    let off = product - DMat3::from_diagonal(glam::DVec3::splat(scale));
    off.to_cols_array().iter().all(|x| x.abs() <= 1e-6 * scale)
}

impl<'a> WideProjector<'a> {
    pub(super) fn new(scalar: &'a Projector<'a>) -> Self {
        let lens = &scalar.view.lens;
        let settings = scalar.view.settings;
        let gain = cutoff_gain(settings.cutoff);
        let linear = scalar.cloud_to_camera.matrix3;
        let strength_scale = match scalar.cloud.columns().kind {
            columns::Kind::Extinction => scalar.determinant * gain,
            columns::Kind::Opacity => 1.0,
            columns::Kind::Surface(surface) => {
                scalar.determinant.cbrt().powi(2) * gain / f64::from(surface.coverage_floor)
            }
        };
        let is_surface = matches!(scalar.cloud.columns().kind, columns::Kind::Surface(_));
        Self {
            scalar,
            perspective: lens.projection == Projection::Perspective,
            focal: lens.focal.as_vec2().to_array(),
            principal: lens.principal.as_vec2().to_array(),
            to_camera: rows(linear),
            normal_to_camera: rows(scalar.normal_to_camera),
            handedness: linear.determinant().signum() as f32,
            strength_scale: strength_scale as f32,
            is_even: !is_surface || is_similarity(linear),
            cutoff: settings.cutoff as f32,
            low_pass: lens.low_pass.powi(2) as f32,
            near: scalar.view.camera.near() as f32,
            tolerance: settings.tolerance as f32,
        }
    }

    /// Projects a range whose first splat begins a block, with the instructions of a level.
    #[inline(never)]
    pub(super) fn project(&self, level: Level, range: &VisibleRange, out: &mut Places) {
        dispatch!(level, simd => self.project_wide(simd, range, out));
    }

    #[inline(always)]
    fn project_wide<S: Simd>(&self, simd: S, range: &VisibleRange, out: &mut Places) {
        let origin = self.scalar.cloud_to_camera.transform_point3(range.center.as_dvec3()).as_vec3();
        let eye = self.scalar.camera_to_cloud.translation - range.center.as_dvec3();
        let shared = match &self.scalar.cloud.columns().factors {
            Factors::Shared(factor) => Some(self.transform_columns(
                simd,
                factor.to_cols_array().each(
                    #[inline(always)]
                    |x| splat(simd, x),
                ),
            )),
            Factors::Each(_) => None,
        };
        for first in range.splats.clone().step_by(LANES) {
            let count = (range.splats.end - first).min(LANES);
            let valid = (1_u32 << count) - 1;
            if !self.is_even {
                self.push_scalar(range, first, valid, out);
                continue;
            }
            let center = self.scalar.cloud.columns().centers.block(first / LANES);
            let from_middle = [0, 1, 2].each(
                #[inline(always)]
                |i| V::simd_from(simd, center[i]) - range.center.to_array()[i],
            );
            let placed = self.place(simd, first / LANES, (origin, from_middle), shared);
            let footprints = self.footprints(simd, &placed);
            let towards = [0, 1, 2].each(
                #[inline(always)]
                |i| from_middle[i] - eye.to_array()[i] as f32,
            );
            let amplitudes = self.amplitudes(simd, first / LANES, (&placed, &footprints), towards);
            self.push(simd, (range, first, valid), (&placed, &footprints, &amplitudes), out);
        }
    }

    fn push_scalar(&self, range: &VisibleRange, first: usize, mut lanes: u32, out: &mut Places) {
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            if let Some(splat) = self.scalar.project_splat(first + lane, range.first_id) {
                out.push(splat);
            }
        }
    }

    /// A vector by the rows of a matrix.
    #[inline(always)]
    fn transform<S: Simd>(simd: S, rows: &[[f32; 3]; 3], v: V3<S>) -> V3<S> {
        rows.each(
            #[inline(always)]
            |row| dot(splat3(simd, row), v),
        )
    }

    #[inline(always)]
    fn transform_columns<S: Simd>(&self, simd: S, factor: [V<S>; 9]) -> [V3<S>; 3] {
        [0, 3, 6].each(
            #[inline(always)]
            |k| Self::transform(simd, &self.to_camera, [factor[k], factor[k + 1], factor[k + 2]]),
        )
    }

    #[inline(always)]
    fn place<S: Simd>(
        &self,
        simd: S,
        block: usize,
        (origin, from_middle): (Vec3, V3<S>),
        shared: Option<[V3<S>; 3]>,
    ) -> Placed<S> {
        let turned = Self::transform(simd, &self.to_camera, from_middle);
        let center = [0, 1, 2].each(
            #[inline(always)]
            |i| turned[i] + origin.to_array()[i],
        );
        let columns = match (&self.scalar.cloud.columns().factors, shared) {
            (Factors::Each(factors), None) => self.transform_columns(
                simd,
                factors.block(block).each(
                    #[inline(always)]
                    |lanes| V::simd_from(simd, lanes),
                ),
            ),
            (_, shared) => shared.unwrap_or([splat3(simd, [0.0; 3]); 3]),
        };
        let one = splat(simd, 1.0);
        if self.perspective {
            let inverse_z = one / center[2];
            Placed { center, inverse_z, ray: [center[0] * inverse_z, center[1] * inverse_z, one], columns }
        } else {
            let zero = splat(simd, 0.0);
            Placed { center, inverse_z: one, ray: [zero, zero, one], columns }
        }
    }

    #[inline(always)]
    fn footprints<S: Simd>(&self, simd: S, placed: &Placed<S>) -> Footprints<S> {
        let Placed { center, inverse_z, ray, columns } = placed;
        let [h2, h4] = [self.low_pass, self.low_pass * self.low_pass].each(
            #[inline(always)]
            |h| splat(simd, h),
        );
        let [scale_x, scale_y] = self.focal.each(
            #[inline(always)]
            |focal| *inverse_z * focal,
        );
        // In pixels; for parallel rays the ray has no slope.
        let x = columns.each(
            #[inline(always)]
            |g| (g[0] - ray[0] * g[2]) * scale_x,
        );
        let y = columns.each(
            #[inline(always)]
            |g| (g[1] - ray[1] * g[2]) * scale_y,
        );
        let z = columns.each(
            #[inline(always)]
            |g| g[2],
        );
        let pair = |a: &V3<S>, b: &V3<S>| {
            [
                a[0].mul_sub(b[1], a[1] * b[0]),
                a[0].mul_sub(b[2], a[2] * b[0]),
                a[1].mul_sub(b[2], a[2] * b[1]),
            ]
        };
        let [n, mx, my] = [pair(&x, &y), pair(&x, &z), pair(&y, &z)];
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
            variance,
            along,
            minor: [0, 1].each(
                #[inline(always)]
                |i| zz.mul_add(h2, mm[i]),
            ),
            zz,
            is_simple,
        }
    }

    /// Where the exact form is needed.
    #[inline(always)]
    fn needs_exact<S: Simd>(&self, simd: S, placed: &Placed<S>, footprints: &Footprints<S>) -> M<S> {
        let form = self.scalar.view.settings.footprint;
        if !self.perspective || form != FootprintForm::Auto {
            return M::splat(simd, self.perspective && form == FootprintForm::Exact);
        }
        let Footprints { along, depth_slope, sigma_z, variance, .. } = footprints;
        let per_z = placed.inverse_z * placed.inverse_z;
        let kappa2 =
            (along[0].mul_add(depth_slope[0], along[1] * depth_slope[1]) * per_z).max(splat(simd, 0.0));
        let lambda = sigma_z.mul_add(*sigma_z * per_z, kappa2);
        let mut error = kappa2.sqrt().mul_add(splat(simd, 1.74), lambda * 1.1);
        if self.scalar.cloud.columns().kind == columns::Kind::Extinction {
            // |V| is small, so V can't be had from the root; its off-diagonal is −b/(a c²).
            let [a, b, c] = footprints.conic_root;
            let xy = -b / (a * c * c);
            let inverse_length2 = splat(simd, 1.0) / dot(placed.ray, placed.ray);
            let g = [0, 1].each(
                #[inline(always)]
                |i| placed.ray[i] * inverse_length2 * (1.0 / self.focal[i]),
            );
            let nu2 = (g[0] * g[0])
                .mul_add(variance[0], (g[1] * g[1]).mul_add(variance[1], g[0] * g[1] * xy * 2.0));
            error = nu2.max(splat(simd, 0.0)).sqrt().mul_add(splat(simd, 0.8), error);
        }
        error.simd_gt(splat(simd, self.tolerance / 4.0))
    }

    /// The base colours in the space of blending, as they are seen from the eye.
    #[inline(always)]
    fn colors<S: Simd>(&self, simd: S, block: usize, towards: V3<S>) -> V3<S> {
        let columns = self.scalar.cloud.columns();
        let linear = columns.colors.block(block).each(
            #[inline(always)]
            |lanes| V::simd_from(simd, lanes),
        );
        let blend = self.scalar.view.settings.blend;
        match &columns.harmonics {
            None if blend == Blend::Linear => linear,
            None => linear.each(
                #[inline(always)]
                |c| linear_to_srgb(simd, c),
            ),
            Some(harmonics) => {
                let direction = if self.perspective {
                    normalize_or_zero(simd, towards)
                } else {
                    let forward = self.scalar.camera_to_cloud.matrix3.z_axis.normalize_or_zero();
                    splat3(simd, forward.as_vec3().to_array())
                };
                let encoded = linear.each(
                    #[inline(always)]
                    |c| linear_to_srgb(simd, c),
                );
                let color = evaluate(simd, harmonics, block, direction);
                let color = [0, 1, 2].each(
                    #[inline(always)]
                    |i| (encoded[i] + color[i]).max(splat(simd, 0.0)),
                );
                if blend == Blend::Linear {
                    color.each(
                        #[inline(always)]
                        |c| srgb_to_linear(simd, c),
                    )
                } else {
                    color
                }
            }
        }
    }

    #[inline(always)]
    fn amplitudes<S: Simd>(
        &self,
        simd: S,
        block: usize,
        (placed, footprints): (&Placed<S>, &Footprints<S>),
        towards: V3<S>,
    ) -> Amplitudes<S> {
        let columns = self.scalar.cloud.columns();
        let zero = splat(simd, 0.0);
        let strength = V::simd_from(simd, columns.strengths.block(block)[0]) * self.strength_scale;
        let mut color = self.colors(simd, block, towards);
        let normal = match &columns.normals {
            None => splat3(simd, [0.0; 3]),
            Some(normals) => {
                let normal = normals.block(block).each(
                    #[inline(always)]
                    |lanes| V::simd_from(simd, lanes),
                );
                normalize_or_zero(simd, Self::transform(simd, &self.normal_to_camera, normal))
            }
        };
        let cutoff = splat(simd, self.cutoff);
        let is_volume = !matches!(columns.kind, columns::Kind::Surface(_));
        if is_volume && self.scalar.view.settings.shade {
            color = self.scalar.shader.shade_wide_two_sided(simd, color, normal, placed.center);
        }
        match columns.kind {
            columns::Kind::Extinction => {
                let amplitude = strength * footprints.unit_integral;
                let is_seen = amplitude.simd_gt(zero);
                Amplitudes { amplitude, slope: [zero; 2], color, normal, cutoff, is_seen }
            }
            columns::Kind::Opacity => {
                let amplitude = (strength * footprints.attenuation).min(splat(simd, 1.0 - 1e-6));
                let is_seen = amplitude.simd_gt(splat(simd, self.tolerance.max(1e-30)));
                const TWO_LN2: f32 = 2.0 * std::f32::consts::LN_2;
                let over = amplitude * (1.0 / self.tolerance.max(1e-30));
                let own = log2(simd, over.max(splat(simd, 1.0))) * TWO_LN2;
                Amplitudes { amplitude, slope: [zero; 2], color, normal, cutoff: own.min(cutoff), is_seen }
            }
            columns::Kind::Surface(surface) => {
                let coverage = strength * footprints.unit_integral;
                let [a, b, _] = placed.columns;
                let own = normalize_or_zero(simd, cross(a, b)).each(
                    #[inline(always)]
                    |n| n * self.handedness,
                );
                let facing = dot(own, placed.ray);
                let amplitude = coverage * facing;
                let slope = [0, 1].each(
                    #[inline(always)]
                    |i| own[i] * coverage * (1.0 / self.focal[i]),
                );
                // The side that is seen is the shape's; a shading normal agrees with it.
                let cosine = dot(normal, own);
                let turned = cosine.simd_lt(zero);
                let bare = dot(normal, normal).simd_lt(splat(simd, 0.5));
                let normal = [0, 1, 2].each(
                    #[inline(always)]
                    |i| bare.select(own[i], turned.select(-normal[i], normal[i])),
                );
                let mut is_seen = amplitude.abs().simd_gt(zero)
                    | slope[0].abs().simd_gt(zero)
                    | slope[1].abs().simd_gt(zero);
                if surface.closed {
                    is_seen &= facing.simd_lt(zero);
                }
                Amplitudes { amplitude, slope, color, normal, cutoff, is_seen }
            }
        }
    }

    /// First and last pixels of the rectangles, along an axis.
    #[inline(always)]
    fn bounds<S: Simd>(
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

    #[inline(always)]
    fn push<S: Simd>(
        &self,
        simd: S,
        (range, first, valid): (&VisibleRange, usize, u32),
        (placed, footprints, amplitudes): (&Placed<S>, &Footprints<S>, &Amplitudes<S>),
        out: &mut Places,
    ) {
        let exact = self.needs_exact(simd, placed, footprints);
        let limits = (exact, amplitudes.cutoff);
        let [left, right] = self.bounds(simd, 0, (placed, footprints), limits);
        let [top, bottom] = self.bounds(simd, 1, (placed, footprints), limits);
        let z = placed.center[2];
        let zero = splat(simd, 0.0);
        let reach = (footprints.zz * self.cutoff).sqrt();
        let visible = footprints.is_simple
            & amplitudes.is_seen
            & left.simd_lt(right)
            & top.simd_lt(bottom)
            & (z + reach).simd_gt(splat(simd, self.near));
        // Wholly behind the camera.
        let behind = if self.perspective { (z + reach).simd_le(zero) } else { M::splat(simd, false) };
        let visible = visible.to_bitmask() as u32 & valid;
        let hard = !(footprints.is_simple | behind).to_bitmask() as u32 & valid;
        if visible | hard == 0 {
            return;
        }
        let mut amplitude = amplitudes.amplitude;
        if self.scalar.cloud.columns().kind == columns::Kind::Extinction {
            // The exact form multiplies by |v| at the pixel.
            let length = dot(placed.ray, placed.ray).sqrt();
            amplitude = exact.select(amplitude, amplitude * length);
        }
        let most = splat(simd, 1e20);
        amplitude = amplitude.max(-most).min(most);
        let [a, b, c] = footprints.conic_root;
        let [red, green, blue] = amplitudes.color;
        let quads = [
            transposed([footprints.mean[0], footprints.mean[1], z, amplitude]),
            transposed([a, b, c, footprints.sigma_z]),
            transposed([
                footprints.depth_slope[0],
                footprints.depth_slope[1],
                amplitudes.slope[0],
                amplitudes.slope[1],
            ]),
            transposed([red, green, blue, zero]),
        ];
        let distance = if self.perspective { dot(placed.center, placed.center).sqrt() } else { z };
        let distance: Lanes = distance.into();
        let edges: [[i32; LANES]; 4] = [left, top, right, bottom].each(
            #[inline(always)]
            |v| v.to_int::<i32x8<S>>().into(),
        );
        let [nx, ny, nz] = amplitudes.normal;
        let is_surface = range.is_surface;
        let normals = if is_surface { transposed([nx, ny, nz, zero]) } else { [[0.0; 4]; LANES] };
        let exact = exact.to_bitmask() as u32;
        let columns = self.scalar.cloud.columns();
        let kind = match columns.kind {
            columns::Kind::Extinction => Kind::Extinction,
            columns::Kind::Opacity => Kind::Opacity,
            columns::Kind::Surface(_) => Kind::Surface,
        };
        let mut lanes = visible | hard;
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            lanes &= lanes - 1;
            if hard >> lane & 1 != 0 {
                self.push_scalar(range, first, 1 << lane, out);
                continue;
            }
            let [q0, q1, q2, q3] = quads.each(
                #[inline(always)]
                |quad| quad[lane],
            );
            let form = if exact >> lane & 1 != 0 { Form::Exact } else { Form::Affine };
            let record = Record {
                mean: [q0[0], q0[1]],
                depth: q0[2],
                amplitude: q0[3],
                conic_root: [q1[0], q1[1], q1[2]],
                sigma_z: q1[3],
                depth_slope: [q2[0], q2[1]],
                amplitude_slope: [q2[2], q2[3]],
                color: [q3[0], q3[1], q3[2]],
                tag: Tag { cloud: self.scalar.cloud_index, kind, form },
            };
            let edge = edges.each(
                #[inline(always)]
                |edge| edge[lane] as u16,
            );
            let rect = Rect { min: [edge[0], edge[1]], max: [edge[2], edge[3]] };
            let sample = if is_surface {
                let normal = normals[lane];
                SurfaceSample {
                    normal: [normal[0], normal[1], normal[2]],
                    opacity: columns.opacity(first + lane),
                    id: range.first_id + (first + lane) as u32,
                }
            } else {
                SurfaceSample::default()
            };
            out.push(Projected { record, rect, distance: distance[lane], sample });
        }
    }
}

/// Four numbers of each of eight splats, splat by splat.
#[inline(always)]
fn transposed<S: Simd>(columns: [V<S>; 4]) -> [[f32; 4]; LANES] {
    let halves = columns.each(
        #[inline(always)]
        |v| v.split(),
    );
    let transpose = |a: f32x4<S>, b: f32x4<S>, c: f32x4<S>, d: f32x4<S>| -> [[f32; 4]; 4] {
        let (ac, bd) = ([a.zip_low(c), a.zip_high(c)], [b.zip_low(d), b.zip_high(d)]);
        [ac[0].zip_low(bd[0]), ac[0].zip_high(bd[0]), ac[1].zip_low(bd[1]), ac[1].zip_high(bd[1])].each(
            #[inline(always)]
            |row| row.into(),
        )
    };
    let [a, b, c, d] = halves;
    let (low, high) = (transpose(a.0, b.0, c.0, d.0), transpose(a.1, b.1, c.1, d.1));
    [low[0], low[1], low[2], low[3], high[0], high[1], high[2], high[3]]
}

/// Harmonics of the splats of a block, seen along unit vectors.
#[inline(always)]
fn evaluate<S: Simd>(simd: S, harmonics: &PackedHarmonics, block: usize, direction: V3<S>) -> V3<S> {
    let [x, y, z] = direction;
    let values = basis(x, y, z).each(
        #[inline(always)]
        |value| value * harmonics.unit,
    );
    let pairs = harmonics.block(block);
    let per_channel = harmonics.pairs_per_channel();
    [0, 1, 2].each(
        #[inline(always)]
        |channel| {
            let mut sum = splat(simd, 0.0);
            for (number, pair) in pairs[channel * per_channel..][..per_channel].iter().enumerate() {
                let pair: i32x8<S> = u32x8::simd_from(simd, *pair).bitcast();
                let low: V<S> = ((pair << 16) >> 16).to_float();
                let high: V<S> = (pair >> 16).to_float();
                sum = low.mul_add(values[2 * number], sum);
                if 2 * number + 1 < values.len() {
                    sum = high.mul_add(values[2 * number + 1], sum);
                }
            }
            sum
        },
    )
}
