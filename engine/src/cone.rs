//! Cones around the normals of surfels: which of a closed surface's clusters show nothing but backs.

use crate::columns::{Column, Columns, Factors, Kind, LANES};
use crate::simd::{self, *};
use glam::{DAffine3, DVec3, Vec3};
use std::ops::Range;

/// Holds the vector areas of a cluster's surfels, in cloud space; of closed surfaces alone, of all else every direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cone {
    axis: Vec3,
    /// Of half of its angle, up to a right one; ∞ where it is wider.
    sin: f32,
}

/// From where surfels are seen, in the space of a cloud: from the eye, or along rays that are parallel.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Viewer {
    At(DVec3),
    Along(DVec3),
}

impl Viewer {
    /// By the transform from the cloud.
    pub(crate) fn of(cloud_to_camera: &DAffine3, is_perspective: bool) -> Self {
        let camera_to_cloud = cloud_to_camera.inverse();
        if is_perspective {
            Self::At(camera_to_cloud.translation)
        } else {
            Self::Along(camera_to_cloud.matrix3.z_axis)
        }
    }
}

/// What single precision moves an angle's sine by, and more.
const ROUNDING: f32 = 1e-4;

impl Cone {
    /// Every direction.
    const ALL: Self = Self { axis: Vec3::ZERO, sin: f32::INFINITY };

    /// Around the vector areas of splats, the first of which begins a block.
    pub(crate) fn of(columns: &Columns, splats: &Range<usize>) -> Self {
        match (&columns.kind, &columns.factors) {
            (Kind::Surface(surface), Factors::Each { flat, .. }) if surface.closed.hides_backs() => {
                dispatch!(simd::Level::best(), simd => Self::of_half_axes(simd, flat, splats))
            }
            _ => Self::ALL,
        }
    }

    #[inline(always)]
    fn of_half_axes<S: Simd>(simd: S, flat: &Column<6>, splats: &Range<usize>) -> Self {
        // The last block is filled up with its last splat.
        let blocks = splats.start / LANES..splats.end.div_ceil(LANES);
        let mut sum = [splat(simd, 0.0); 3];
        for block in blocks.clone() {
            let area = areas(simd, flat.block(block));
            for (sum, area) in sum.iter_mut().zip(area) {
                *sum += area;
            }
        }
        let sum = sum.map(|lanes| <[f32; LANES]>::from(lanes).iter().sum::<f32>());
        let Some(axis) = Vec3::from(sum).try_normalize() else { return Self::ALL };
        let along = splat3(simd, axis.to_array());
        let mut least = splat(simd, 1.0);
        for block in blocks {
            let area = areas(simd, flat.block(block));
            let squared = dot(area, area);
            // What single precision can't hold the area of has any direction.
            let is_held = squared.simd_gt(splat(simd, 1e-30)) & squared.simd_lt(splat(simd, 1e30));
            let cosine = dot(area, along) / squared.sqrt();
            least = is_held.select(cosine, splat(simd, -1.0)).min(least);
        }
        let cos = least.reduce_min();
        if cos > 0.0 { Self { axis, sin: (1.0 - cos * cos).max(0.0).sqrt() + ROUNDING } } else { Self::ALL }
    }

    /// Around this one, and another one.
    pub(crate) fn and(self, other: &Self) -> Self {
        if self.sin >= 1.0 || other.sin >= 1.0 {
            return Self::ALL;
        }
        let apart = self.axis.dot(other.axis).clamp(-1.0, 1.0).acos();
        let half = self.sin.asin().max(apart + other.sin.asin());
        if half < std::f32::consts::FRAC_PI_2 {
            Self { sin: half.sin() + ROUNDING, ..self }
        } else {
            Self::ALL
        }
    }

    /// Whether all of its surfels, whose centres lie in a sphere, face away.
    ///
    /// Let D lead from the eye to the sphere's middle, R be its radius, θ half of the cone's angle, and β that of D to its axis. Of a
    /// surfel at D + r with the unit normal n, n·(D + r) ≥ |D| cos(β + θ) − R; and where cos β ≥ sin θ + R/|D|, that is not negative, since
    /// sin(θ + ε) ≤ sin θ + sin ε.
    pub(crate) fn faces_away(&self, viewer: &Viewer, (center, radius): (Vec3, f32)) -> bool {
        let (to_center, radius) = match viewer {
            Viewer::At(eye) => (center.as_dvec3() - eye, f64::from(radius)),
            Viewer::Along(direction) => (*direction, 0.0),
        };
        let length = to_center.length();
        // What rounding moves centres by.
        let radius = radius + f64::from(ROUNDING) * length;
        self.axis.as_dvec3().dot(to_center) >= length * f64::from(self.sin) + radius
    }
}

/// The cross products of the first two half-axes.
#[inline(always)]
fn areas<S: Simd>(simd: S, [a, b, c, d, e, f]: &[[f32; LANES]; 6]) -> V3<S> {
    let lanes = |numbers: &[f32; LANES]| V::simd_from(simd, *numbers);
    cross([lanes(a), lanes(b), lanes(c)], [lanes(d), lanes(e), lanes(f)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::closed::Closed;
    use crate::cloud::{Cloud, Material, Shapes, Splats, Strength, Surface, oblate_factor};
    use crate::columns::CHILDREN;
    use proptest::prelude::*;
    use std::sync::LazyLock;

    /// A sphere of radius 1 with bumps, in 40,000 surfels, with levels.
    static BODY: LazyLock<Cloud> = LazyLock::new(|| body(Closed::EVERYWHERE));

    fn body(closed: Closed) -> Cloud {
        let count = 40_000;
        let point = |i: i32| {
            let z = 1.0 - (2 * i + 1) as f32 / count as f32;
            let (sin, cos) = (i as f32 * 2.399_963_2).sin_cos();
            let across = (1.0 - z * z).sqrt();
            Vec3::new(across * cos, across * sin, z)
        };
        let bump = |p: Vec3| 0.1 * (p * 7.0).map(f32::sin);
        let splats = Splats {
            centers: (0..count).map(point).collect(),
            shapes: Shapes::Each(
                (0..count).map(point).map(|p| oblate_factor(p + bump(p), 0.01, f32::INFINITY)).collect(),
            ),
            strength: Strength::Surface(Surface {
                areas: vec![3e-4; count as usize],
                opacities: None,
                depth_tolerance: 0.02,
                coverage_floor: 0.9,
                closed,
            }),
            colors: vec![[0.5; 3]; count as usize],
            harmonics: None,
            normals: None,
            material: Material::default(),
        };
        Cloud::new(splats.in_morton_order()).unwrap().with_levels()
    }

    /// How far a splat is from showing its front: not at all where this is negative.
    fn back(columns: &Columns, index: usize, viewer: &Viewer) -> f64 {
        let factor = columns.factor(index).as_dmat3();
        let to_center = match viewer {
            Viewer::At(eye) => columns.center(index).as_dvec3() - eye,
            Viewer::Along(direction) => *direction,
        };
        factor.x_axis.cross(factor.y_axis).dot(to_center)
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 32, failure_persistence: None, ..ProptestConfig::default() })]

        /// Nothing of a cluster that faces away shows its front, nor of what it stands for.
        #[test]
        fn what_faces_away_shows_its_back(
            direction in prop::array::uniform3(-1.0..1.0f64),
            (log_distance, is_parallel) in (-1.0..4.0f64, any::<bool>()),
        ) {
            let direction = DVec3::from(direction).try_normalize().unwrap_or(DVec3::X);
            let viewer = if is_parallel { Viewer::Along(direction) } else { Viewer::At(-direction * log_distance.exp()) };
            let levels = BODY.levels();
            let mut away = vec![Vec::new(); levels.len()];
            for (level, found) in levels.iter().zip(&mut away) {
                for (number, cluster) in level.clusters.iter().enumerate() {
                    if cluster.normals.faces_away(&viewer, (cluster.center, cluster.radius)) {
                        found.push(number);
                    }
                }
            }
            for (above, found) in away.iter().enumerate() {
                for number in found {
                    for (below, level) in levels[..=above].iter().enumerate() {
                        let children = CHILDREN.pow((above - below) as u32);
                        for cluster in level.clusters.iter().skip(number * children).take(children) {
                            for index in cluster.splats.clone() {
                                prop_assert!(back(&level.columns, index, &viewer) >= 0.0, "{above}, {below}: {index}");
                            }
                        }
                    }
                }
            }
            // Clusters are half of the radius wide, and bumps take as much again.
            if is_parallel || log_distance > 2.0 {
                prop_assert!(away[0].len() * 10 > levels[0].clusters.len(), "{} of {}", away[0].len(), levels[0].clusters.len());
            }
        }
    }

    #[test]
    fn what_may_be_seen_from_both_sides_has_every_direction() {
        let open = body(Closed::Nowhere);
        assert!(
            open.levels()
                .iter()
                .flat_map(|level| &level.clusters)
                .all(|cluster| cluster.normals == Cone::ALL)
        );
        let narrow = Cone { axis: Vec3::Z, sin: 0.1 };
        assert_eq!(narrow.and(&Cone { axis: Vec3::NEG_Z, sin: 0.1 }), Cone::ALL);
        assert_eq!(narrow.and(&Cone::ALL), Cone::ALL);
        assert!(!Cone::ALL.faces_away(&Viewer::Along(DVec3::Z), (Vec3::ZERO, 0.0)));
        assert!(!Cone::ALL.faces_away(&Viewer::At(DVec3::ZERO), (Vec3::ZERO, 0.0)));
        let both = narrow.and(&Cone { axis: Vec3::new(0.6, 0.0, 0.8), sin: 0.1 });
        let half = 0.6_f32.asin() + 0.1_f32.asin();
        assert!((both.sin - half.sin()).abs() < 1e-3 && both.axis == Vec3::Z);
    }
}
