//! A trained splat as files have it, and as it is drawn.

use glam::{DMat3, DQuat, DVec3, Mat3, Vec3};
use oblate_engine::color::{linear_to_srgb, srgb_to_linear};
use oblate_engine::{Splats, Strength};

/// Colours of the harmonics of degree 1 to 3.
pub(crate) const MOST_HARMONICS: usize = 15;

/// The logarithm of σ is within ± this, or −∞.
pub(crate) const LARGEST_LOG_SCALE: f32 = 40.0;

/// Sums of harmonics with coefficients of this size, decoded to linear, are in the range of single precision.
const LARGEST_COLOR: f32 = 1e12;

/// The spherical harmonic of degree 0, √(1/4π).
const CONSTANT_HARMONIC: f32 = 0.282_094_8;

/// The display-encoded colour that coefficients of the constant harmonic make.
pub(crate) fn color(constant: [f32; 3]) -> [f32; 3] {
    constant.map(|coefficient| 0.5 + CONSTANT_HARMONIC * coefficient)
}

/// The coefficients of the constant harmonic that make a display-encoded colour.
pub(crate) fn constant(color: [f32; 3]) -> [f32; 3] {
    color.map(|display| (display - 0.5) / CONSTANT_HARMONIC)
}

/// A trained splat, in the words of its training. Axes are the file's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Trained {
    pub(crate) center: [f32; 3],
    /// Natural logarithms of σ along the half-axes; −∞ is flat.
    pub(crate) log_scales: [f32; 3],
    /// The half-axes' rotation, a quaternion w x y z of any length but 0.
    pub(crate) rotation: [f32; 4],
    /// The peak opacity, from 0 to 1.
    pub(crate) opacity: f32,
    /// The colour without harmonics, display-encoded; any number, of which training cuts off sums below 0.
    pub(crate) color: [f32; 3],
    /// σ of a round filter that shape and opacity lack: Yu, Chen, Huang, Sattler, Geiger, *Mip-Splatting*, 2024,
    /// eq. 7. 0 where there is none.
    pub(crate) filter: f32,
    /// The first 0, 3, 8 or 15 are in use.
    pub(crate) harmonics: [[f32; 3]; MOST_HARMONICS],
}

impl Default for Trained {
    fn default() -> Self {
        Self {
            center: [0.0; 3],
            log_scales: [0.0; 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
            opacity: 1.0,
            color: [0.5; 3],
            filter: 0.0,
            harmonics: [[0.0; 3]; MOST_HARMONICS],
        }
    }
}

/// Why a record is no splat, in the order in which this is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reject {
    NotANumber,
    NoOrientation,
    Scale,
    Color,
}

impl Reject {
    pub(crate) const ALL: [Self; 4] = [Self::NotANumber, Self::NoOrientation, Self::Scale, Self::Color];

    pub(crate) fn reason(self) -> &'static str {
        match self {
            Self::NotANumber => "with a number that is NaN, infinite or out of its range",
            Self::NoOrientation => "with a quaternion of zeros",
            Self::Scale => "with a log scale beyond ±40",
            Self::Color => "with a colour beyond ±1e12",
        }
    }
}

/// A splat as the engine takes it.
pub(crate) struct Splat {
    pub(crate) center: Vec3,
    pub(crate) factor: Mat3,
    pub(crate) peak: f32,
    /// Linear.
    pub(crate) color: [f32; 3],
}

/// The logarithm of a σ that a file holds itself; 0 becomes −∞, what is below 0 NaN.
pub(crate) fn log_scale(sigma: f32) -> f32 {
    // −0 is 0.
    (sigma + 0.0).ln()
}

impl Trained {
    /// Checks the record, with its first `per_splat` harmonics, and makes a splat of it.
    pub(crate) fn activate(&self, per_splat: usize) -> Result<Splat, Reject> {
        let harmonics = self.harmonics[..per_splat].as_flattened();
        // All are asked, whatever the first ones say: that is done for many at a time.
        let all =
            |numbers: &[f32], holds: fn(&f32) -> bool| numbers.iter().fold(true, |all, n| all & holds(n));
        let finite = |numbers: &[f32]| all(numbers, |n| n.is_finite());
        let is_finite =
            finite(&self.center) && finite(&self.rotation) && finite(&self.color) && finite(harmonics);
        let has_scales = self.log_scales.iter().all(|s| !s.is_nan() && *s != f32::INFINITY);
        let filter_is_sigma = self.filter.is_finite() && self.filter >= 0.0;
        if !(is_finite && has_scales && filter_is_sigma && (0.0..=1.0).contains(&self.opacity)) {
            return Err(Reject::NotANumber);
        }
        let [w, x, y, z] = self.rotation.map(f64::from);
        let quaternion = DQuat::from_xyzw(x, y, z, w);
        if quaternion.length_squared() == 0.0 {
            return Err(Reject::NoOrientation);
        }
        let too_far = |s: &f32| s.is_finite() && s.abs() > LARGEST_LOG_SCALE;
        // The filter is a σ too.
        if self.log_scales.iter().any(too_far) || too_far(&self.filter.ln()) {
            return Err(Reject::Scale);
        }
        let drawable = |colors: &[f32]| all(colors, |c| c.abs() <= LARGEST_COLOR);
        if !(drawable(&self.color) && drawable(harmonics)) {
            return Err(Reject::Color);
        }
        let own = DVec3::from(self.log_scales.map(|s| f64::from(s).exp()));
        let filter = f64::from(self.filter);
        let filtered = DVec3::from(own.to_array().map(|sigma| sigma.hypot(filter)));
        // What the filter adds to the volume it takes from the peak.
        let share = if filter == 0.0 { 1.0 } else { (own / filtered).element_product() };
        // With harmonics only the sum is cut off.
        let cut_off = |display: f32| if per_splat == 0 { display.max(0.0) } else { display };
        let factor = DMat3::from_quat(quaternion.normalize()) * DMat3::from_diagonal(filtered);
        Ok(Splat {
            center: Vec3::from(self.center),
            factor: factor.as_mat3(),
            peak: (f64::from(self.opacity) * share) as f32,
            color: self.color.map(|display| srgb_to_linear(cut_off(display))),
        })
    }
}

/// Splat `index` of splats with opacities as training would write it, without a filter; `None` for other strengths.
pub(crate) fn trained(splats: &Splats, index: usize) -> Option<Trained> {
    let Strength::Opacity { peaks, .. } = &splats.strength else { return None };
    let factor = splats.shapes.factor(index).as_dmat3();
    let (log_scales, rotation) = of_half_axes(if is_sheared(factor) { half_axes(factor) } else { factor });
    let mut harmonics = [[0.0; 3]; MOST_HARMONICS];
    if let Some(of_all) = &splats.harmonics {
        let count = of_all.per_splat();
        harmonics[..count].copy_from_slice(&of_all.coefficients[index * count..][..count]);
    }
    Some(Trained {
        center: splats.centers[index].to_array(),
        log_scales,
        rotation,
        opacity: peaks[index],
        color: splats.colors[index].map(linear_to_srgb),
        filter: 0.0,
        harmonics,
    })
}

/// The log scales and the quaternion (w x y z) of half-axes, the columns of a matrix; their signs don't matter.
pub(crate) fn of_half_axes(factor: DMat3) -> ([f32; 3], [f32; 4]) {
    let lengths = [factor.x_axis, factor.y_axis, factor.z_axis].map(DVec3::length);
    let rotation = rotation(factor, lengths);
    let quaternion = [rotation.w, rotation.x, rotation.y, rotation.z];
    (lengths.map(|length| length.ln() as f32), quaternion.map(|c| c as f32))
}

/// Whether columns are less orthogonal than rounding to single precision leaves half-axes.
fn is_sheared(factor: DMat3) -> bool {
    let pairs =
        [(factor.x_axis, factor.y_axis), (factor.x_axis, factor.z_axis), (factor.y_axis, factor.z_axis)];
    pairs.iter().any(|(a, b)| a.dot(*b).abs() > 1e-5 * a.length() * b.length())
}

/// The half-axes F of Σ = A Aᵀ: the columns of A turned into each other until they are orthogonal.
///
/// Hestenes, *Inversion of Matrices by Biorthogonalization and Related Results*, 1958: Σ is never formed, so the short
/// axes of flat splats keep their digits.
pub(crate) fn half_axes(factor: DMat3) -> DMat3 {
    let mut axes = [factor.x_axis, factor.y_axis, factor.z_axis];
    // Three axes converge quadratically; six rounds are twice what the worst need.
    for _ in 0..6 {
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            let (a, b, product) = (axes[i].length_squared(), axes[j].length_squared(), axes[i].dot(axes[j]));
            if product.abs() <= f64::EPSILON * (a * b).sqrt() {
                continue;
            }
            let half_difference = (b - a) / (2.0 * product);
            let tangent = half_difference.signum() / (half_difference.abs() + half_difference.hypot(1.0));
            let cos = 1.0 / tangent.hypot(1.0);
            let sin = cos * tangent;
            (axes[i], axes[j]) = (axes[i] * cos - axes[j] * sin, axes[i] * sin + axes[j] * cos);
        }
    }
    DMat3::from_cols_array_2d(&axes.map(|axis| axis.to_array()))
}

/// The rotation of half-axes of these lengths, any of which may be 0.
fn rotation(factor: DMat3, lengths: [f64; 3]) -> DQuat {
    let axes = [factor.x_axis, factor.y_axis, factor.z_axis];
    // The longest and the next longest tell directions best.
    let mut by_length = [0, 1, 2];
    by_length.sort_by(|a, b| lengths[*b].total_cmp(&lengths[*a]));
    let [first, second, third] = by_length;
    let one = axes[first].try_normalize().unwrap_or([DVec3::X, DVec3::Y, DVec3::Z][first]);
    let two = (axes[second] - one * one.dot(axes[second])).try_normalize();
    let two = two.unwrap_or_else(|| one.any_orthonormal_vector());
    let mut directions = [DVec3::ZERO; 3];
    directions[first] = one;
    directions[second] = two;
    // Right-handed whatever the order of lengths.
    let cyclic = (first + 1) % 3 == second;
    directions[third] = if cyclic { one.cross(two) } else { two.cross(one) };
    DQuat::from_mat3(&DMat3::from_cols_array_2d(&directions.map(|d| d.to_array())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn splats(splat: &Splat) -> Splats {
        Splats {
            centers: vec![splat.center],
            shapes: oblate_engine::Shapes::Each(vec![splat.factor]),
            strength: Strength::Opacity {
                peaks: vec![splat.peak],
                filter: oblate_engine::OpacityFilter::Classic,
                least: Strength::LEAST_OF_TRAINED,
            },
            colors: vec![splat.color],
            harmonics: None,
            normals: None,
            material: oblate_engine::Material::UNLIT,
        }
    }

    proptest! {
        #[test]
        fn half_axes_are_orthogonal_and_of_the_same_covariance(
            entries in prop::array::uniform9(-1.0..1.0f64),
            powers in prop::array::uniform3(-6..1),
        ) {
            let scales = DVec3::from(powers.map(|power| 10f64.powi(power)));
            let factor = DMat3::from_cols_array(&entries) * DMat3::from_diagonal(scales);
            let found = half_axes(factor);
            let difference = found * found.transpose() - factor * factor.transpose();
            // Each round turns by exact rotations: a few roundings of the largest entry, which is below 3.
            prop_assert!(difference.abs_diff_eq(DMat3::ZERO, 1e-14), "{}", difference);
            for (a, b) in [(found.x_axis, found.y_axis), (found.x_axis, found.z_axis), (found.y_axis, found.z_axis)] {
                prop_assert!(a.dot(b).abs() <= 1e-12 * a.length() * b.length(), "{}", found);
            }
        }

        #[test]
        fn sheared_factors_keep_their_covariance(entries in prop::array::uniform9(-1.0..1.0f32)) {
            let splat = Trained::default().activate(0).ok().unwrap();
            let factor = Mat3::from_cols_array(&entries);
            let back = trained(&splats(&Splat { factor, ..splat }), 0).unwrap().activate(0);
            // Factors that are nearly singular may have a half-axis below e⁻⁴⁰, which is none.
            if let Ok(back) = back {
                let difference = back.factor * back.factor.transpose() - factor * factor.transpose();
                // Entries of Σ of up to 3; a logarithm of 1 and a quaternion are rounded to 2⁻²⁴ of themselves.
                prop_assert!(difference.abs_diff_eq(Mat3::ZERO, 1e-5), "{}", difference);
            }
        }

        #[test]
        fn there_and_back(
            q in prop::array::uniform4(-1.0..1.0f32),
            mut log_scales in prop::array::uniform3(-8.0..3.0f32),
            opacity in 0.0..=1.0f32,
            color in prop::array::uniform3(0.0..2.0f32),
            flat in 0..5usize,
        ) {
            prop_assume!(q.iter().map(|c| c * c).sum::<f32>() > 0.01);
            if flat < 3 {
                log_scales[flat] = f32::NEG_INFINITY;
            }
            let record = Trained { rotation: q, log_scales, opacity, color, ..Trained::default() };
            let splat = record.activate(0).ok().unwrap();
            let back = trained(&splats(&splat), 0).unwrap();
            for (found, wanted) in back.log_scales.iter().zip(log_scales) {
                // F is rounded to 2⁻²⁴ of itself, a logarithm of 8 to 2⁻²².
                prop_assert!(*found == wanted || (found - wanted).abs() < 1e-6, "{} {}", found, wanted);
            }
            let again = back.activate(0).ok().unwrap();
            let largest = log_scales.iter().fold(0.0, |a: f32, s| a.max(s.exp()));
            prop_assert!(again.factor.abs_diff_eq(splat.factor, 1e-6 * largest));
            prop_assert_eq!(back.opacity, opacity);
            // sRGB there and back.
            prop_assert!(back.color.iter().zip(color).all(|(a, b)| (a - b).abs() < 2e-6));
        }
    }
}
