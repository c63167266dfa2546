//! The footprint of a splat: the squared Mahalanobis distance r(u) at which the ray through a pixel passes
//! it, the depth and spread along that ray, and the line integral.
//!
//! Source: Zwicker, Pfister, van Baar, Gross, *EWA Volume Splatting*, 2001, eq. 22–25, kept over the
//! perspective denominator that their affine approximation leaves out. Everything is expressed by the
//! columns gₖ of a factor of Σ' = Σ gₖgₖᵀ, as sums of squares, so nothing is divided by a thickness and
//! nothing cancels for large surfels seen edge-on.
//!
//! With adj(Σ') = A, D₀ = v₀ᵀAv₀ and σ₀² = |Σ'|/D₀ the denominator needs no matrix of its own: the identity
//! A (vᵀAv) − Av vᵀA = \[v\]ₓᵀ |Σ'|Σ' \[v\]ₓ gives H = ¼ggᵀ + (σ₀/d_z)² Q, hence
//!
//! ```text
//! q(u) = uᵀQu = |Mu|²        t(u) = 1 + ½gᵀu        den = t² + (σ₀/d_z)² q
//! r = q/den                  z = d_z t/den           σ_z = σ₀/√den
//! ```

use crate::camera::{Camera, Projection};
use crate::simd::*;
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::FRAC_2_PI;

/// A splat in camera space, before it is projected.
#[derive(Clone, Copy, Debug)]
pub struct CameraSplat {
    /// Its centre: x right, y down, z forward.
    pub center: DVec3,
    /// Its factor F with Σ = F Fᵀ.
    pub factor: DMat3,
}

/// What an affine footprint is off by, of its energy: so much of κ and of λ, as [`Footprint::affine_error`] has them.
pub(super) const OF_KAPPA: f64 = 1.74;
pub(super) const OF_LAMBDA: f64 = 1.1;

/// E|x| = 0.798 over a unit Gaussian: what it is off by where something changes by 1 over a standard deviation.
pub(super) const MEAN_DEVIATION: f64 = 0.8;

/// How a camera maps rays to pixels, and the filter at the pixels.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    /// Pixels per unit slope, or per world unit where rays are parallel.
    pub focal: DVec2,
    /// The principal point in pixels.
    pub principal: DVec2,
    /// How depth acts.
    pub projection: Projection,
    /// Standard deviation of the low-pass filter in pixels.
    pub filter_sigma: f64,
}

impl Lens {
    /// The lens of a camera with a low-pass filter of the given variance in squared pixels.
    pub fn new(camera: &Camera, low_pass_variance: f64) -> Self {
        let intrinsics = camera.intrinsics();
        Self {
            focal: intrinsics.focal,
            principal: intrinsics.center,
            projection: camera.projection(),
            filter_sigma: low_pass_variance.sqrt(),
        }
    }

    /// The lens of a picture of every second pixel, or of still fewer, whose first one is the first of all.
    pub fn of_every(self, step: usize) -> Self {
        let step = step as f64;
        Self {
            focal: self.focal / step,
            principal: (self.principal - 0.5) / step + 0.5,
            filter_sigma: self.filter_sigma / step,
            ..self
        }
    }

    /// The point at depth `z` on the ray through a point of the picture, in camera space.
    pub fn position(&self, pixel: DVec2, z: f64) -> DVec3 {
        let across = (pixel - self.principal) / self.focal;
        match self.projection {
            Projection::Perspective => across.extend(1.0) * z,
            Projection::Orthographic => across.extend(z),
        }
    }

    /// As [`Self::position`], for many points.
    #[inline(always)]
    pub(crate) fn positions<S: Simd, F: Floats<S>>(&self, [x, y]: [F; 2], z: F) -> [F; 3] {
        let [focal, principal] = [self.focal.as_vec2(), self.principal.as_vec2()];
        let across = (x - principal.x) * (1.0 / focal.x);
        let down = (y - principal.y) * (1.0 / focal.y);
        match self.projection {
            Projection::Perspective => [across * z, down * z, z],
            Projection::Orthographic => [across, down, z],
        }
    }

    /// The direction of the ray through a point of the picture, with z = 1, in camera space.
    pub fn ray(&self, pixel: DVec2) -> DVec3 {
        match self.projection {
            Projection::Perspective => ((pixel - self.principal) / self.focal).extend(1.0),
            Projection::Orthographic => DVec3::Z,
        }
    }
}

/// Where and how a splat appears in the picture. Offsets u are in pixels from `mean`.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    /// The projected centre in pixels.
    pub mean: DVec2,
    /// M = \[\[a, b\], \[0, c\]\] as (a, b, c), in 1/pixels: q(u) = |Mu|² with Q = MᵀM.
    pub conic_root: [f64; 3],
    /// z of the centre in world units.
    pub depth: f64,
    /// dz/du of the densest point, at the centre, in world units a pixel; ½g = −slope/depth.
    pub depth_slope: DVec2,
    /// Spread σ₀ along the ray through the centre, in z.
    pub sigma_z: f64,
    /// 1/depth, and 0 where rays are parallel.
    pub inverse_depth: f64,
    /// The line integral through the centre of a kernel of mass 1, over |v|, in 1/world units squared.
    pub unit_integral: f64,
    /// The ray through the centre, with z = 1.
    pub center_ray: DVec3,
    /// The 2×2 covariance in the picture (xx, yy) and what bounds the exact form.
    extent: Extent,
}

/// What the bounding rectangles need.
#[derive(Clone, Copy, Debug)]
struct Extent {
    /// Diagonal of JΣ'Jᵀ in squared pixels.
    variance: DVec2,
    /// Σ'_zz and Σ'_xy,z in scaled camera units.
    zz: f64,
    xy_z: DVec2,
    /// Σ'_xx Σ'_zz − Σ'_xz² and the same for y.
    minor: DVec2,
    /// The centre ray's slope in pixels.
    slope: DVec2,
}

/// One pixel of a footprint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Squared Mahalanobis distance of the ray.
    pub r: f64,
    /// z of the densest point.
    pub z: f64,
    /// Spread along the ray, in z.
    pub sigma_z: f64,
    /// 1/√den: the change of the line integral besides e^{−r/2} and |v|.
    pub scale: f64,
}

/// A centre closer to the camera plane than this, in standard deviations along z, is moved away from it: its
/// projection would be at infinity. A kernel changes by at most 0.61 of that share of its peak for such a move,
/// and single precision loses as much nearer by.
const CAMERA_PLANE_GAP: f64 = 3e-4;

impl Footprint {
    /// Projects a splat; `None` if it covers no area of the picture (a point without a filter, say).
    pub fn new(splat: &CameraSplat, lens: &Lens) -> Option<Self> {
        // In coordinates scaled by the focal length a ray's slope is an offset in pixels.
        let scale = DVec3::new(lens.focal.x, lens.focal.y, 1.0);
        let mut d = splat.center * scale;
        let perspective = lens.projection == Projection::Perspective;
        let gap = CAMERA_PLANE_GAP * splat.factor.row(2).length();
        if perspective && d.z.abs() < gap {
            d.z = gap.copysign(d.z);
        }
        let (v0, zeta, inverse_depth) =
            if perspective { (d / d.z, d.z.abs(), 1.0 / d.z) } else { (DVec3::Z, 1.0, 0.0) };
        let filter = lens.filter_sigma * zeta;
        let g = [
            splat.factor.x_axis * scale,
            splat.factor.y_axis * scale,
            splat.factor.z_axis * scale,
            DVec3::X * filter,
            DVec3::Y * filter,
        ];

        // Cauchy–Binet: adj(Σ') = Σ cᵢⱼcᵢⱼᵀ and |Σ'| = Σ (gᵢ·(gⱼ×gₖ))².
        let mut a_v0 = DVec3::ZERO;
        let (mut d0, mut determinant, mut minor) = (0.0, 0.0, DVec2::ZERO);
        for i in 0..g.len() {
            for j in i + 1..g.len() {
                let c = g[i].cross(g[j]);
                let along = c.dot(v0);
                a_v0 += c * along;
                d0 += along * along;
                minor += DVec2::new(c.y * c.y, c.x * c.x);
                for third in &g[j + 1..] {
                    determinant += c.dot(*third).powi(2);
                }
            }
        }
        let (mut q_xx, mut q_xy) = (0.0, 0.0);
        let (mut variance, mut zz, mut xy_z) = (DVec2::ZERO, 0.0, DVec2::ZERO);
        for column in g {
            let w = column.cross(v0);
            q_xx += w.x * w.x;
            q_xy += w.x * w.y;
            let across = column.truncate() - v0.truncate() * column.z;
            variance += across * across;
            zz += column.z * column.z;
            xy_z += column.truncate() * column.z;
        }
        let a = zeta * (q_xx / d0).sqrt();
        let b = zeta * (q_xy / (d0 * q_xx).sqrt());
        let c = zeta / q_xx.sqrt();
        if !(d0 > 0.0 && a.is_finite() && a > 0.0 && c.is_finite() && b.is_finite()) {
            return None;
        }
        let ray = DVec3::new(v0.x / scale.x, v0.y / scale.y, 1.0);
        Some(Self {
            mean: if perspective { v0.truncate() } else { d.truncate() } + lens.principal,
            conic_root: [a, b, c],
            depth: d.z,
            depth_slope: -a_v0.truncate() * ((if perspective { d.z } else { 1.0 }) / d0),
            sigma_z: (determinant / d0).sqrt(),
            inverse_depth,
            unit_integral: scale.x * scale.y / (std::f64::consts::TAU * d0.sqrt()),
            center_ray: if perspective { ray } else { DVec3::Z },
            extent: Extent { variance: variance / (zeta * zeta), zz, xy_z, minor, slope: v0.truncate() },
        })
    }

    /// q(u) = uᵀQu: the squared radius of EWA splatting, and r(u) of the affine form.
    pub fn q(&self, u: DVec2) -> f64 {
        let [a, b, c] = self.conic_root;
        (a * u.x + b * u.y).powi(2) + (c * u.y).powi(2)
    }

    /// Exact perspective.
    pub fn exact(&self, u: DVec2) -> Hit {
        let q = self.q(u);
        let t = 1.0 - self.inverse_depth * self.depth_slope.dot(u);
        let den = t * t + (self.inverse_depth * self.sigma_z).powi(2) * q;
        let z = if self.inverse_depth == 0.0 {
            self.depth + self.depth_slope.dot(u)
        } else {
            self.depth * t / den
        };
        Hit { r: q / den, z, sigma_z: self.sigma_z / den.sqrt(), scale: 1.0 / den.sqrt() }
    }

    /// The denominator dropped; exact where rays are parallel.
    pub fn affine(&self, u: DVec2) -> Hit {
        let z = self.depth + self.depth_slope.dot(u);
        Hit { r: self.q(u), z, sigma_z: self.sigma_z, scale: 1.0 }
    }

    /// √(D₀(Σ)/D₀(Σ')): by how much a compensated filter lowers the peak of a kernel of given opacity.
    pub fn filter_attenuation(&self, splat: &CameraSplat, lens: &Lens) -> f64 {
        let unfiltered = Lens { filter_sigma: 0.0, ..*lens };
        // A kernel without area of its own is invisible next to its filter.
        Self::new(splat, &unfiltered).map_or(0.0, |sharp| self.unit_integral / sharp.unit_integral)
    }

    /// Whether part of the kernel within r ≤ `cutoff` is at or behind the camera plane, so that only the
    /// exact form serves and the rectangle is unbounded.
    pub fn crosses_camera_plane(&self, cutoff: f64) -> bool {
        self.inverse_depth != 0.0 && self.depth.powi(2) <= cutoff * self.extent.zz
    }

    /// Nearest and farthest z of the ellipsoid r ≤ `cutoff`.
    pub(crate) fn depth_range(&self, cutoff: f64) -> [f64; 2] {
        let reach = (cutoff * self.extent.zz).sqrt();
        [self.depth - reach, self.depth + reach]
    }

    /// Centre and half extent of the rectangle around r ≤ `cutoff`, in pixels; for `exact` perspective or
    /// the affine form. Infinite where the kernel crosses the camera plane.
    pub fn bounds(&self, cutoff: f64, exact: bool) -> [DVec2; 2] {
        if !exact || self.inverse_depth == 0.0 {
            return [self.mean, (self.extent.variance * cutoff).map(f64::sqrt)];
        }
        if self.crosses_camera_plane(cutoff) {
            return [self.mean, DVec2::INFINITY];
        }
        let k2 = self.inverse_depth.powi(2);
        let e = 1.0 - cutoff * k2 * self.extent.zz;
        let shift = (self.extent.slope * self.extent.zz - self.extent.xy_z) * (cutoff * k2 / e);
        let under = (self.extent.variance - self.extent.minor * (cutoff * k2 * k2)) * cutoff;
        // The root's argument can only be negative by rounding.
        [self.mean + shift, under.max(DVec2::ZERO).map(f64::sqrt) / e]
    }

    /// The footprint as a point's: V' = (h² + v)·1 with v the mean variance that the splat has in the picture, its energy kept, one
    /// depth. It is the circular filter at the pixels in which minified splats accumulate (Yuan, Chen et al., *Hybrid Forward Resampling and
    /// Volume Rendering*, 2003, §4.1), no narrower than what it stands for: where splats become points nothing gets brighter or sharper.
    pub fn round(&self) -> Self {
        let variance = self.mean_variance();
        let root = 1.0 / variance.sqrt();
        Self {
            conic_root: [root, 0.0, root],
            depth_slope: DVec2::ZERO,
            unit_integral: self.unit_integral / (self.root_area() * variance),
            extent: Extent { variance: DVec2::splat(variance), ..self.extent },
            ..*self
        }
    }

    /// A bound on the error of the point's footprint as a share of the splat's energy, besides that of the affine form:
    /// ∫|w − w_round| / ∫w ≤ (2/π) ε/(1 − ε²) where V has the eigenvalues (1 ± ε)·½ tr V. To first order the difference is ½ε(x² − y²)w, and
    /// E|x² − y²| = 4/π over a unit Gaussian; it is below the bound by 0.3 ε² of it where ε is small, by 8 % at ε = 0.4.
    pub fn roundness_error(&self) -> f64 {
        let [a, b, c] = self.conic_root;
        let mean = self.mean_variance();
        let half = 0.5 * (self.extent.variance.x - self.extent.variance.y);
        let epsilon = half.hypot(b / (a * c * c)) / mean;
        // 1 − ε² is |V| over the squared mean.
        FRAC_2_PI * epsilon * (self.root_area() * mean).powi(2)
    }

    /// ½ tr V.
    fn mean_variance(&self) -> f64 {
        0.5 * self.extent.variance.element_sum()
    }

    /// 1/√|V|.
    pub(super) fn root_area(&self) -> f64 {
        self.conic_root[0] * self.conic_root[2]
    }

    /// Standard deviation over the footprint of what changes with a slope a pixel.
    pub(crate) fn spread_of(&self, slope: DVec2) -> f64 {
        self.whiten(slope).length()
    }

    /// Estimate of the affine form's error as a share of the splat's energy, ∫|τ_exact − τ_affine| / ∫τ:
    /// 1.74κ + 1.1λ + 0.8ν with κ = ½√(gᵀQ⁻¹g), λ = λ_max(Q⁻¹H) = κ² + (σ₀/d_z)² and ν the change of |v|
    /// over the splat. To first order the constants are E|x(x² + y² − 1)| = 1.733 and E|x| = 0.798 over a unit
    /// Gaussian; the second-order one is fitted. `of_line_integral` counts ν, which coverage and opacity do not have.
    pub fn affine_error(&self, of_line_integral: bool, lens: &Lens) -> f64 {
        let [kappa, lambda] = self.curvature();
        let nu = if of_line_integral && self.inverse_depth != 0.0 {
            let gradient = self.center_ray.truncate() / lens.focal / self.center_ray.length_squared();
            self.whiten(gradient).length()
        } else {
            0.0
        };
        OF_KAPPA * kappa + OF_LAMBDA * lambda + MEAN_DEVIATION * nu
    }

    /// Estimate of the largest |Δα| of the affine form for a kernel of peak opacity 1.
    pub fn affine_peak_error(&self) -> f64 {
        let [kappa, lambda] = self.curvature();
        1.159 * kappa + 1.083 * lambda
    }

    /// κ and λ_max(Q⁻¹H).
    fn curvature(&self) -> [f64; 2] {
        let kappa = self.whiten(self.depth_slope * self.inverse_depth).length();
        [kappa, kappa * kappa + (self.sigma_z * self.inverse_depth).powi(2)]
    }

    /// M⁻ᵀx, so that |M⁻ᵀx|² = xᵀQ⁻¹x.
    fn whiten(&self, x: DVec2) -> DVec2 {
        let [a, b, c] = self.conic_root;
        let first = x.x / a;
        DVec2::new(first, (x.y - b * first) / c)
    }
}
