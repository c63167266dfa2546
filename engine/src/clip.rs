//! Clouds cut by planes.

use crate::closed::Closed;
use crate::cloud::{Cloud, CloudError, Harmonics, Shapes, Splats, Strength, Surface};
use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};
use rayon::prelude::*;

/// What stays of the world: the points p with `normal` · p ≥ `offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfSpace {
    /// Points into what stays; finite, of any length above 0.
    pub normal: DVec3,
    /// In world units times the normal's length; finite.
    pub offset: f64,
}

impl HalfSpace {
    /// σ on one side of a plane beyond which a splat is whole or gone: 3e-5 of it would be on the other side.
    pub const REACH: f64 = 4.0;

    /// The six whose common part is the box between two corners.
    pub fn of_box([low, high]: [DVec3; 2]) -> [Self; 6] {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        std::array::from_fn(|side| {
            let normal = axes[side / 2];
            match side % 2 {
                0 => Self { normal, offset: normal.dot(low) },
                _ => Self { normal: -normal, offset: -normal.dot(high) },
            }
        })
    }

    /// The same in the space from which `to_world` leads.
    fn seen_from(self, to_world: &DAffine3) -> Self {
        Self {
            normal: to_world.matrix3.transpose() * self.normal,
            offset: self.offset - self.normal.dot(to_world.translation),
        }
    }
}

impl Cloud {
    /// What of the cloud is in all of the half-spaces.
    ///
    /// A Gaussian that a plane goes through becomes the one with the mass, mean and covariance of its part inside; a flat one
    /// is cut within its plane. So a cut is as sharp as splats are narrow: what is summed up fades over about a σ. Colours
    /// and normals stay. A body of which something is cut is not closed any more; what is one-sided stays so. Ids follow the order of what is left; levels
    /// of detail are to be made again.
    ///
    /// # Errors
    /// When cut splats leave the range of single precision.
    pub fn clipped(&self, kept: &[HalfSpace]) -> Result<Self, CloudError> {
        let planes: Vec<_> = kept.iter().map(|plane| plane.seen_from(&self.cloud_to_world())).collect();
        let is_surface = self.is_surface();
        let inside = |index: usize| {
            let part = Part::whole(self.center(index), self.factor(index));
            Some((index, planes.iter().try_fold(part, |part, plane| part.inside(plane, is_surface))?))
        };
        let parts: Vec<(usize, Part)> = (0..self.len()).into_par_iter().filter_map(inside).collect();
        if parts.len() == self.len() && parts.iter().all(|(_, part)| part.share == 1.0) {
            return Ok(self.clone());
        }
        Ok(Self::new(of_parts(self.splats(), &parts))?.transformed(self.cloud_to_world()))
    }
}

/// A Gaussian, or what planes leave of one.
#[derive(Clone, Copy)]
struct Part {
    center: DVec3,
    factor: DMat3,
    /// Of the mass.
    share: f64,
    /// By what |F|, or of a surface the area of its half-axes, is multiplied.
    narrowing: f64,
}

impl Part {
    fn whole(center: Vec3, factor: Mat3) -> Self {
        Self { center: center.as_dvec3(), factor: factor.as_dmat3(), share: 1.0, narrowing: 1.0 }
    }

    /// The part of it on the plane's inner side. Of a normal distribution cut off at −t the share Φ(t) stays, the mean is
    /// λ = φ(t)/Φ(t), the variance 1 − λ(λ + t).
    fn inside(self, plane: &HalfSpace, is_surface: bool) -> Option<Self> {
        let ahead = plane.normal.dot(self.center) - plane.offset;
        let mut along = self.factor.transpose() * plane.normal;
        if is_surface {
            // However thick it is, a surfel stays one: its half-axes are cut, its normal stays.
            along.z = 0.0;
        }
        let sigma = along.length();
        if ahead >= HalfSpace::REACH * sigma {
            return Some(self);
        }
        if ahead <= -HalfSpace::REACH * sigma {
            return None;
        }
        let t = ahead / sigma;
        let share = 0.5 * libm::erfc(-t * std::f64::consts::FRAC_1_SQRT_2);
        let mean = (-0.5 * t * t).exp() / ((2.0 * std::f64::consts::PI).sqrt() * share);
        let narrowing = (1.0 - mean * (mean + t)).max(0.0).sqrt();
        let axis = along / sigma;
        let toward = self.factor * axis;
        let narrower = |i: usize| self.factor.col(i) + toward * ((narrowing - 1.0) * axis[i]);
        Some(Self {
            center: self.center + toward * mean,
            factor: DMat3::from_cols(narrower(0), narrower(1), narrower(2)),
            share: self.share * share,
            narrowing: self.narrowing * narrowing,
        })
    }
}

/// The splats that are left, cut; in their order.
fn of_parts(splats: Splats, parts: &[(usize, Part)]) -> Splats {
    let shares = |values: &[f32]| {
        let share = |(index, part): &(usize, Part)| (f64::from(values[*index]) * part.share) as f32;
        parts.iter().map(|part| share(part).min(f32::MAX)).collect::<Vec<f32>>()
    };
    let strength = match splats.strength {
        Strength::Extinction { masses } => Strength::Extinction { masses: shares(&masses) },
        // What a peak is above the least times the extent is what a mass is to extinction.
        Strength::Opacity { peaks, filter, least } => {
            let peak = |(index, part): &(usize, Part)| {
                let more = part.share / part.narrowing.max(f64::MIN_POSITIVE);
                (f64::from(peaks[*index]) * more + f64::from(least) * (1.0 - more)).clamp(0.0, 1.0) as f32
            };
            Strength::Opacity { peaks: parts.iter().map(peak).collect(), filter, least }
        }
        Strength::Surface(surface) => Strength::Surface(Surface {
            areas: shares(&surface.areas),
            opacities: surface.opacities.map(|values| parts.iter().map(|(i, _)| values[*i]).collect()),
            closed: match surface.closed {
                Closed::OneSided => Closed::OneSided,
                Closed::Nowhere => Closed::Nowhere,
                Closed::Sided | Closed::Within(_) => Closed::Sided,
            },
            ..surface
        }),
    };
    let harmonics = splats.harmonics.map(|harmonics| {
        let per_splat = harmonics.per_splat();
        let own = |(index, _): &(usize, Part)| &harmonics.coefficients[index * per_splat..][..per_splat];
        Harmonics { coefficients: parts.iter().flat_map(own).copied().collect(), ..harmonics }
    });
    Splats {
        centers: parts.iter().map(|(_, part)| part.center.as_vec3()).collect(),
        shapes: Shapes::Each(parts.iter().map(|(_, part)| part.factor.as_mat3()).collect()),
        strength,
        colors: parts.iter().map(|(index, _)| splats.colors[*index]).collect(),
        harmonics,
        normals: splats.normals.map(|normals| parts.iter().map(|(index, _)| normals[*index]).collect()),
        material: splats.material,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{Material, OpacityFilter};

    fn splats(count: usize, strength: Strength) -> Splats {
        Splats {
            centers: vec![Vec3::ZERO; count],
            shapes: Shapes::Shared(Mat3::from_diagonal(Vec3::new(1.0, 2.0, 3.0))),
            strength,
            colors: vec![[0.5; 3]; count],
            harmonics: None,
            normals: Some(vec![Vec3::X; count]),
            material: Material::default(),
        }
    }

    /// Half of a Gaussian has half of its mass, its mean at √(2/π) σ and the variance (1 − 2/π) σ².
    #[test]
    fn half_of_a_kernel() {
        let cloud = Cloud::new(splats(1, Strength::Extinction { masses: vec![3.0] })).unwrap();
        let to_world = DAffine3::from_scale_rotation_translation(
            DVec3::splat(2.0),
            glam::DQuat::from_rotation_z(0.7),
            DVec3::new(5.0, 6.0, 7.0),
        );
        let cloud = cloud.transformed(to_world);
        // The cloud's y axis in the world, and not a unit vector.
        let normal = to_world.transform_vector3(DVec3::Y) * 10.0;
        let offset = normal.dot(to_world.translation);
        let half = cloud.clipped(&[HalfSpace { normal, offset }]).unwrap();
        let mean = 2.0 * (2.0 / std::f32::consts::PI).sqrt();
        assert!((half.center(0) - Vec3::new(0.0, mean, 0.0)).length() < 1e-6, "{}", half.center(0));
        let wanted = Vec3::new(1.0, 2.0 * (1.0 - 2.0 / std::f32::consts::PI).sqrt(), 3.0);
        let factor = half.factor(0);
        let covariance = factor * factor.transpose();
        let difference = covariance - Mat3::from_diagonal(wanted * wanted);
        assert!(difference.to_cols_array().iter().all(|c| c.abs() < 1e-5), "{covariance}");
        let Strength::Extinction { masses } = half.splats().strength else { panic!("still extinction") };
        assert!((masses[0] - 1.5).abs() < 1e-6, "{masses:?}");
        assert_eq!(half.cloud_to_world(), to_world);
    }

    /// What it has above its least opacity falls with its half, and rises as it gets narrower, by √(1 − 2/π).
    #[test]
    fn half_of_an_opacity() {
        for least in [0.0, 0.02] {
            let strength = Strength::Opacity { peaks: vec![0.05], filter: OpacityFilter::Classic, least };
            let cloud = Cloud::new(splats(1, strength)).unwrap();
            let half = cloud.clipped(&[HalfSpace { normal: DVec3::Y, offset: 0.0 }]).unwrap();
            let Strength::Opacity { peaks, .. } = half.splats().strength else { panic!("still opacities") };
            let wanted = least + 0.5 * (0.05 - least) / (1.0 - 2.0 / std::f32::consts::PI).sqrt();
            assert!((peaks[0] - wanted).abs() < 1e-6, "{peaks:?}, not {wanted}");
        }
    }

    /// What is on one side of a plane and what is on the other are the whole: mass, first and second moments.
    #[test]
    fn two_parts_have_the_moments_of_the_whole() {
        let whole = Part::whole(
            Vec3::new(1.0, -2.0, 0.5),
            Mat3::from_cols(Vec3::new(1.0, 0.3, 0.0), Vec3::new(-0.2, 2.0, 0.4), Vec3::new(0.1, 0.0, 0.7)),
        );
        for (offset, normal) in
            [(0.0, DVec3::X), (1.0, DVec3::new(1.0, 0.5, -0.3)), (-3.0, DVec3::new(0.0, 1.0, 1.0))]
        {
            let plane = HalfSpace { normal, offset };
            let other = HalfSpace { normal: -normal, offset: -offset };
            let parts = [plane, other].map(|plane| whole.inside(&plane, false).unwrap());
            let second = |part: &Part| {
                let c = part.center;
                let outer = DMat3::from_cols(c * c.x, c * c.y, c * c.z);
                (part.factor * part.factor.transpose() + outer) * part.share
            };
            let mass: f64 = parts.iter().map(|part| part.share).sum();
            let first: DVec3 = parts.iter().map(|part| part.center * part.share).sum();
            let both = second(&parts[0]) + second(&parts[1]) - second(&whole);
            assert!((mass - 1.0).abs() < 1e-12 && (first - whole.center).length() < 1e-12);
            assert!(both.to_cols_array().iter().all(|c| c.abs() < 1e-12), "{both}");
        }
    }

    #[test]
    fn what_is_outside_goes_and_what_is_inside_stays() {
        let surface = |closed: Closed| {
            Strength::Surface(Surface {
                areas: vec![1.0; 3],
                opacities: Some(vec![0.25, 0.5, 0.75]),
                depth_tolerance: 0.1,
                coverage_floor: 0.9,
                closed,
            })
        };
        let strengths = [
            Strength::Opacity { peaks: vec![0.5; 3], filter: OpacityFilter::Classic, least: 0.0 },
            surface(Closed::EVERYWHERE),
            surface(Closed::Nowhere),
        ];
        for strength in strengths {
            let is_known = strength != surface(Closed::Nowhere);
            let mut splats = splats(3, strength);
            splats.centers = vec![Vec3::ZERO, Vec3::X * 100.0, Vec3::X * -100.0];
            splats.harmonics =
                Some(Harmonics { degree: 1, coefficients: (0..9).map(|i| [i as f32; 3]).collect() });
            let cloud = Cloud::new(splats).unwrap();
            let all = HalfSpace::of_box([DVec3::splat(-200.0), DVec3::splat(200.0)]);
            assert_eq!(cloud.clipped(&all).unwrap(), cloud);
            let some = HalfSpace::of_box([DVec3::new(-50.0, -50.0, -50.0), DVec3::splat(200.0)]);
            let left = cloud.clipped(&some).unwrap();
            let (before, after) = (cloud.splats(), left.splats());
            assert_eq!(after.centers, before.centers[..2]);
            // Rounded twice, by 1.6e-5 of the largest each time.
            let coefficients =
                [&before, &after].map(|splats| &splats.harmonics.as_ref().unwrap().coefficients);
            assert_eq!(coefficients[1].len(), 6);
            for (a, b) in coefficients[0].iter().zip(coefficients[1]) {
                assert!((a[0] - b[0]).abs() < 2.0 * 1.6e-5 * 8.0, "{a:?} became {b:?}");
            }
            if let Strength::Surface(surface) = after.strength {
                assert_eq!(surface.closed, if is_known { Closed::Sided } else { Closed::Nowhere });
                assert_eq!(surface.opacities, Some(vec![0.25, 0.5]));
            }
            let nothing = cloud.clipped(&[HalfSpace { normal: DVec3::X, offset: 1000.0 }]).unwrap();
            assert!(nothing.is_empty());
        }
    }

    /// A surfel keeps its normal, however thick it is, and its own plane does not cut it.
    #[test]
    fn surfels_are_cut_within_their_planes() {
        for thickness in [0.0, 0.1] {
            let factor = Mat3::from_cols(Vec3::X, Vec3::Y * 2.0, Vec3::Z * thickness);
            let whole = Part::whole(Vec3::ZERO, factor);
            let cut =
                whole.inside(&HalfSpace { normal: DVec3::new(1.0, 1.0, 5.0), offset: 0.5 }, true).unwrap();
            assert!(cut.factor.x_axis.cross(cut.factor.y_axis).truncate().length() < 1e-12);
            assert_eq!(cut.factor.z_axis, whole.factor.z_axis);
            assert!(whole.inside(&HalfSpace { normal: DVec3::Z, offset: -1e-9 }, true).is_some());
            assert!(whole.inside(&HalfSpace { normal: DVec3::Z, offset: 1e-9 }, true).is_none());
        }
    }
}
