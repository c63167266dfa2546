//! A Gaussian met by a ray, in whitened space.
//!
//! With Σ' = L Lᵀ and W = L⁻¹ the Gaussian is the unit sphere and a ray is still a line: its smallest
//! distance from the origin is the Mahalanobis distance, its speed there the inverse of the spread.
//! L comes from Gram–Schmidt on the rows of a factor of Σ', so that errors grow with the ratio of the
//! axes and not with its square (Golub, Van Loan, *Matrix Computations*, 2013, §5.2.8).

use super::view::Ray;
use glam::{DMat3, DVec3};
use std::f64::consts::TAU;

/// Flat splats get this thickness, relative to the root of the trace of Σ', so that L exists. It
/// changes r and the coverage by a relative 1e-12 at most unless the surfel is seen within 1e-3 radians
/// of edge-on (1e-6 there), and rounding in W by 1e-10.
const THICKNESS: f64 = 1e-6;

/// A Gaussian in camera space.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gaussian {
    pub(super) center: DVec3,
    whiten: DMat3,
    root_determinant: f64,
}

/// What a ray finds of a Gaussian of mass 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Profile {
    /// The smallest squared Mahalanobis distance.
    pub(super) r: f64,
    /// The z where it is reached.
    pub(super) z: f64,
    /// Standard deviation in z along the ray.
    pub(super) sigma: f64,
    /// Integral of the density over the length of the whole line.
    pub(super) integral: f64,
}

impl Gaussian {
    /// The Gaussian at `center` with Σ' = Σ c cᵀ over the `columns` plus the regularising thickness; `None`
    /// for a point and where numbers leave the range of f64.
    pub(super) fn new(center: DVec3, columns: &[DVec3; 5]) -> Option<Self> {
        let trace: f64 = columns.iter().map(|c| c.length_squared()).sum();
        let thickness = THICKNESS * trace.sqrt();
        let mut rows = [[0.0; 8]; 3];
        for (axis, row) in rows.iter_mut().enumerate() {
            for (entry, column) in row.iter_mut().zip(columns) {
                *entry = column[axis];
            }
            row[5 + axis] = thickness;
        }
        let mut lower = [[0.0; 3]; 3];
        for i in 0..3 {
            let length = dot(&rows[i], &rows[i]).sqrt();
            lower[i][i] = length;
            let unit = rows[i].map(|x| x / length);
            for j in i + 1..3 {
                lower[j][i] = dot(&rows[j], &unit);
                for (entry, q) in rows[j].iter_mut().zip(&unit) {
                    *entry -= lower[j][i] * q;
                }
            }
        }
        let solve = |b: DVec3| {
            let x = b.x / lower[0][0];
            let y = (b.y - lower[1][0] * x) / lower[1][1];
            DVec3::new(x, y, (b.z - lower[2][0] * x - lower[2][1] * y) / lower[2][2])
        };
        let whiten = DMat3::from_cols(solve(DVec3::X), solve(DVec3::Y), solve(DVec3::Z));
        let root_determinant = lower[0][0] * lower[1][1] * lower[2][2];
        let usable = center.is_finite() && whiten.is_finite() && root_determinant > 0.0;
        usable.then_some(Self { center, whiten, root_determinant })
    }

    /// Where and how the line of a ray passes; lengths are measured from where it crosses the plane
    /// z = centre.z, so nothing is lost far from the camera.
    pub(super) fn along(&self, ray: &Ray) -> Profile {
        let start = self.whiten * (ray.at(self.center.z) - self.center);
        let direction = self.whiten * ray.direction;
        let speed_squared = direction.length_squared();
        let passed = -start.dot(direction) / speed_squared;
        let r = (start + passed * direction).length_squared();
        let speed = speed_squared.sqrt();
        // ∫ e^{-s²|Wv|²/2} |v| ds = √(2π) |v|/|Wv| times the density's constant (2π)^{-3/2} |L|⁻¹.
        let integral = ray.direction.length() / (TAU * self.root_determinant * speed) * (-0.5 * r).exp();
        Profile { r, z: self.center.z + passed, sigma: 1.0 / speed, integral }
    }

    /// Area of the shadow along a direction, up to a constant that depends on the direction alone.
    pub(super) fn shadow(&self, direction: DVec3) -> f64 {
        self.root_determinant * (self.whiten * direction).length()
    }
}

fn dot(a: &[f64; 8], b: &[f64; 8]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Sums the density itself along the ray: the trapezoid rule on a Gaussian is exact to rounding at
    /// steps of σ/4.
    fn summed(center: DVec3, covariance: DMat3, ray: &Ray) -> [f64; 4] {
        let inverse = covariance.inverse();
        let constant = 1.0 / (TAU.powf(1.5) * covariance.determinant().sqrt());
        let density = |z: f64| {
            let x = ray.at(z) - center;
            constant * (-0.5 * x.dot(inverse * x)).exp()
        };
        let (mut zero, mut one, mut two, mut least) = (0.0, 0.0, 0.0, f64::INFINITY);
        let step = 0.02;
        for i in -3000..=3000 {
            let z = center.z + step * f64::from(i);
            let f = density(z) * step;
            (zero, one, two) = (zero + f, one + f * z, two + f * z * z);
            let x = ray.at(z) - center;
            least = least.min(x.dot(inverse * x));
        }
        let mean = one / zero;
        [zero * ray.direction.length(), mean, (two / zero - mean * mean).sqrt(), least]
    }

    proptest! {
        #[test]
        fn profile_is_the_density_summed(
            a in prop::array::uniform9(-1.0..1.0f64),
            c in prop::array::uniform3(-1.0..1.0f64),
            v in prop::array::uniform2(-0.5..0.5f64),
        ) {
            let factor = DMat3::from_cols_array(&a) + DMat3::IDENTITY * 1.5;
            prop_assume!(factor.determinant().abs() > 0.2);
            let center = DVec3::from(c) + DVec3::Z * 5.0;
            let ray = Ray { origin: DVec3::ZERO, direction: DVec3::new(v[0], v[1], 1.0) };
            let columns = [factor.x_axis, factor.y_axis, factor.z_axis, DVec3::ZERO, DVec3::ZERO];
            let profile = Gaussian::new(center, &columns).unwrap().along(&ray);
            let covariance = factor * factor.transpose();
            let [integral, z, sigma, r] = summed(center, covariance, &ray);
            prop_assume!(r < 100.0);
            // THICKNESS² tr Σ is at most this share of the smallest variance; it acts on |Σ|, σ and r. The
            // rest is rounding; the second moment loses digits as z² is 25 and σ² at least 0.01.
            let [trace, inverse_trace] = [covariance, covariance.inverse()]
                .map(|m| m.x_axis.x + m.y_axis.y + m.z_axis.z);
            let thickened = THICKNESS * THICKNESS * trace * inverse_trace * (3.0 + r);
            prop_assert!((profile.integral / integral - 1.0).abs() < thickened + 1e-9);
            prop_assert!((profile.z - z).abs() < (thickened + 1e-9) * 10.0);
            prop_assert!((profile.sigma / sigma - 1.0).abs() < thickened + 1e-7);
            // The smallest of samples 0.02 apart, of the thickened Gaussian, is above its minimum by at most (0.01/σ)².
            let thick = covariance + DMat3::IDENTITY * (THICKNESS * THICKNESS * trace);
            let [.., r] = summed(center, thick, &ray);
            prop_assert!(profile.r <= r + 1e-9 && profile.r > r - (0.01 / sigma).powi(2) - 1e-9);
        }

        #[test]
        fn a_flat_gaussian_is_met_on_its_plane(
            n in prop::array::uniform3(-1.0..1.0f64),
            v in prop::array::uniform2(-0.5..0.5f64),
            distance in 1.0..1e4f64,
        ) {
            let n = DVec3::from(n);
            prop_assume!(n.length() > 0.1);
            let normal = n.normalize();
            let ray = Ray { origin: DVec3::ZERO, direction: DVec3::new(v[0], v[1], 1.0) };
            let cosine = normal.dot(ray.direction).abs() / ray.direction.length();
            prop_assume!(cosine > 0.01);
            let (t, b) = normal.any_orthonormal_pair();
            let center = DVec3::new(v[0] * distance + 0.3, v[1] * distance - 0.2, distance);
            let columns = [t, b, DVec3::ZERO, DVec3::ZERO, DVec3::ZERO];
            let profile = Gaussian::new(center, &columns).unwrap().along(&ray);
            let z = normal.dot(center) / normal.dot(ray.direction);
            let offset = ray.at(z) - center;
            let r = offset.length_squared();
            prop_assume!(r < 30.0);
            // Rounding: 1e-10 in W, times offsets that the tilt stretches by 1/cosine.
            prop_assert!((profile.z - z).abs() < 1e-7 * distance.max(1.0));
            prop_assert!((profile.r - r).abs() < 1e-6 * r.max(1.0));
            let coverage = profile.integral * cosine;
            let expected = (-0.5 * r).exp() / TAU;
            prop_assert!((coverage / expected - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn a_point_is_nothing() {
        assert!(Gaussian::new(DVec3::Z, &[DVec3::ZERO; 5]).is_none());
    }
}
