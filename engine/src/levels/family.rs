//! Splats that one will stand for, and their moments.

use crate::columns::{Columns, Kind};
use crate::levels::{CHILDREN, Orientation};
use glam::{DMat3, DVec3};
use std::ops::Range;

/// A splat of a family.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Member {
    pub(super) center: DVec3,
    pub(super) covariance: DMat3,
    pub(super) opacity: f64,
    /// Linear.
    pub(super) color: DVec3,
    /// For shading; zero for none.
    pub(super) normal: DVec3,
    /// Of surfaces. Of one that stands for no others it is e₁ × e₂ of the factor, of length 1, or 0 for needles.
    pub(super) orientation: Orientation,
    /// The mean σ₁σ₂ of the cloud's own surfels that it stands for.
    pub(super) kernel_of_own: f64,
    /// Of kernels with opacities, the sum of what those of the cloud's own that it stands for are above their least.
    pub(super) opacity_of_own: f64,
    /// Its part in the means of the family; all add up to 1.
    pub(super) share: f64,
}

/// Up to four consecutive splats.
pub(super) struct Family {
    members: [Member; CHILDREN],
    len: usize,
    /// What the shares are parts of.
    pub(super) weight: f64,
    pub(super) center: DVec3,
    /// The mean of the members' covariances, and the covariance of their centres.
    pub(super) within: DMat3,
    pub(super) between: DMat3,
}

impl Family {
    /// The family of consecutive splats.
    pub(super) fn new(columns: &Columns, splats: Range<usize>) -> Self {
        let len = splats.len();
        let mut members = [Member::default(); CHILDREN];
        for (member, index) in members.iter_mut().zip(splats) {
            *member = Member::new(columns, index);
        }
        let mut family = Self {
            members,
            len,
            weight: 0.0,
            center: DVec3::ZERO,
            within: DMat3::ZERO,
            between: DMat3::ZERO,
        };
        family.weight = family.members().iter().map(|m| m.share).sum();
        for member in &mut family.members[..len] {
            // What isn't there is anywhere.
            member.share = if family.weight > 0.0 { member.share / family.weight } else { 1.0 / len as f64 };
        }
        family.center = family.mean(|m| m.center);
        family.within = family.sum(|m| m.covariance);
        family.between = family.sum(|m| outer(m.center - family.center, m.center - family.center));
        family
    }

    pub(super) fn members(&self) -> &[Member] {
        &self.members[..self.len]
    }

    /// Of kernels with opacities, the sum of those of the cloud's own that all stand for.
    pub(super) fn opacity_of_own(&self) -> f64 {
        self.members().iter().map(|m| m.opacity_of_own).sum()
    }

    /// The mean of a vector.
    pub(super) fn mean(&self, value: impl Fn(&Member) -> DVec3) -> DVec3 {
        self.members().iter().map(|m| m.share * value(m)).sum()
    }

    /// The mean of a matrix.
    pub(super) fn sum(&self, value: impl Fn(&Member) -> DMat3) -> DMat3 {
        self.members().iter().fold(DMat3::ZERO, |sum, m| sum + m.share * value(m))
    }

    /// The mean of a number.
    pub(super) fn average(&self, value: impl Fn(&Member) -> f64) -> f64 {
        self.members().iter().map(|m| m.share * value(m)).sum()
    }

    /// The mean colour; of surfaces, whose layers take colours so, by opacity.
    pub(super) fn color(&self, is_surface: bool) -> DVec3 {
        let shown = if is_surface { self.average(|m| m.opacity) } else { 0.0 };
        if shown > 0.0 { self.mean(|m| m.opacity * m.color) / shown } else { self.mean(|m| m.color) }
    }

    /// The covariance of all members' mass.
    pub(super) fn covariance(&self) -> DMat3 {
        self.within + self.between
    }
}

impl Member {
    fn new(columns: &Columns, index: usize) -> Self {
        let factor = columns.factor(index).as_dmat3();
        let mut covariance = factor * factor.transpose();
        let mut strength = f64::from(columns.strength(index));
        let across = factor.x_axis.cross(factor.y_axis);
        let mut shadow = 0.0;
        if let Kind::Opacity { least, .. } = columns.kind {
            shadow = mean_shadow(covariance);
            let [light, variance] = kept_to_end(f64::from(least) / strength);
            strength *= light;
            covariance *= variance;
        }
        let orientation = match &columns.orientations {
            Some(orientations) => Orientation::of_numbers(orientations.row(index)),
            None => Orientation::of(across.normalize_or_zero()),
        };
        let normal = columns.normal(index).as_dvec3();
        let normal = if normal.length_squared() > 1.0 { normal.normalize() } else { normal };
        let is_surface = matches!(columns.kind, Kind::Surface(_));
        let grain = columns.grains.as_ref().map_or(1.0, |grains| f64::from(grains.row(index)[0]));
        Self {
            center: columns.center(index).as_dvec3(),
            covariance,
            opacity: f64::from(columns.opacity(index)),
            color: DVec3::from_array(columns.color(index).map(f64::from)),
            normal: if is_surface && normal == DVec3::ZERO { orientation.mean } else { normal },
            orientation,
            kernel_of_own: grain.powi(2) * across.length(),
            opacity_of_own: columns
                .opacities_of_own
                .as_ref()
                .map_or(strength, |sums| f64::from(sums.row(index)[0])),
            share: match columns.kind {
                Kind::Extinction | Kind::Surface(_) => strength,
                Kind::Opacity { .. } => strength * shadow,
            },
        }
    }
}

/// What is left of the light and of the variances of a Gaussian in the picture that ends where it has fallen to a share q of its peak: 1 − q, and
/// 1 + q ln q/(1 − q). So much is left from every side, hence along all three axes.
fn kept_to_end(q: f64) -> [f64; 2] {
    match q {
        q if q >= 1.0 => [0.0, 1.0],
        q if q > 0.0 => [1.0 - q, 1.0 + q * q.ln() / (1.0 - q)],
        _ => [1.0; 2],
    }
}

/// The mean over all directions of √det of a covariance as it is projected along them.
///
/// K. Thomsen's formula for the surface of an ellipsoid (2004; within 1.1 %), four times its mean shadow.
pub(super) fn mean_shadow(covariance: DMat3) -> f64 {
    const P: f64 = 1.6075;
    let [a, b, c] = eigenvalues(covariance).map(|x| x.powf(0.5 * P));
    ((a * b + b * c + c * a) / 3.0).powf(1.0 / P)
}

/// The eigenvalues of a covariance, from the largest to the least, which are not negative.
///
/// O. K. Smith, *Eigenvalues of a symmetric 3 × 3 matrix*, 1961.
pub(crate) fn eigenvalues(m: DMat3) -> [f64; 3] {
    let mean = (m.x_axis.x + m.y_axis.y + m.z_axis.z) / 3.0;
    let rest = m - DMat3::from_diagonal(DVec3::splat(mean));
    let spread = (frobenius_squared(rest) / 6.0).sqrt();
    // Coefficients underflow where the matrix is all but a multiple of 1.
    if spread <= 1e-12 * mean {
        return [mean.max(0.0); 3];
    }
    let angle = (0.5 * (rest * (1.0 / spread)).determinant()).clamp(-1.0, 1.0).acos() / 3.0;
    let third = std::f64::consts::TAU / 3.0;
    [0.0, -third, third].map(|turn| (mean + 2.0 * spread * (angle + turn).cos()).max(0.0))
}

pub(super) fn frobenius_squared(m: DMat3) -> f64 {
    m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared()
}

/// a bᵀ.
pub(super) fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvalues_are_those_of_a_turned_diagonal() {
        let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 0.7);
        for values in [[4.0, 2.0, 1.0], [3.0, 3.0, 0.0], [5.0, 1.0, 1.0], [2.0; 3], [1.0, 0.0, 0.0], [0.0; 3]]
        {
            let m = turn * DMat3::from_diagonal(values.into()) * turn.transpose();
            for (found, expected) in eigenvalues(m).into_iter().zip(values) {
                // A double root is right to the square root of rounding.
                assert!((found - expected).abs() < 1e-7, "{found}, not {expected}");
            }
        }
    }

    #[test]
    fn shadows_of_a_ball_and_of_a_disc() {
        assert!((mean_shadow(DMat3::from_diagonal(DVec3::splat(4.0))) - 4.0).abs() < 1e-12);
        // A disc is seen at a mean cosine of one half.
        assert!((mean_shadow(DMat3::from_diagonal(DVec3::new(4.0, 4.0, 0.0))) - 2.0).abs() < 0.022);
    }
}
