//! Splats before a camera, as proptest makes them up.

use crate::camera::{Camera, Pose, Projection};
use crate::cloud::{Cloud, Harmonics, Material, OpacityFilter, Shapes, Splats, Strength, Surface};
use crate::footprint::CameraSplat;
use crate::scene::{Blend, FootprintForm, RenderSettings};
use glam::{DAffine3, DMat3, DVec2, DVec3, Vec3};
use proptest::prelude::*;

/// A splat as the camera sees it.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    /// From the middle of the picture, 1 at its border.
    pub(super) place: [f64; 2],
    pub(super) log_depth: f64,
    pub(super) log_pixels: f64,
    /// Its longer half-axis over the other.
    pub(super) stretch: f64,
    /// The shorter half-axis over the thickness.
    pub(super) flattening: f64,
    pub(super) normal: [f64; 3],
    pub(super) edge_on: bool,
    pub(super) strength: f32,
    pub(super) color: [f32; 3],
    pub(super) shading: [f32; 3],
}

pub(super) fn seen() -> impl Strategy<Value = Seen> {
    let place = prop::array::uniform2(prop_oneof![4 => -1.0..1.0, 1 => 0.9..1.3, 1 => -1.3..-0.9]);
    let sizes = (0.0..3.0, -4.6..5.7, prop_oneof![Just(1.0), 1.0..20.0]);
    let flattening = prop_oneof![Just(1.0), 1.0..30.0, Just(f64::INFINITY)];
    let directions = (prop::array::uniform3(-1.0..1.0), any::<bool>());
    let looks = (
        prop_oneof![8 => 0.001..1.0_f32, 1 => Just(0.0_f32)],
        prop::array::uniform3(0.0..1.0_f32),
        prop::array::uniform3(-1.0..1.0_f32),
    );
    (place, sizes, flattening, directions, looks).prop_map(
        |(
            place,
            (log_depth, log_pixels, stretch),
            flattening,
            (normal, edge_on),
            (strength, color, shading),
        )| {
            Seen {
                place,
                log_depth,
                log_pixels,
                stretch,
                flattening,
                normal,
                edge_on,
                strength,
                color,
                shading,
            }
        },
    )
}

#[derive(Clone, Debug)]
pub(super) struct Setup {
    pub(super) projection: Projection,
    pub(super) kind: usize,
    pub(super) filter: OpacityFilter,
    /// Of opacities.
    pub(super) least: f32,
    pub(super) shared: bool,
    pub(super) transform: usize,
    pub(super) degree: u8,
    pub(super) near: f64,
    pub(super) settings: RenderSettings,
}

pub(super) fn setup() -> impl Strategy<Value = Setup> {
    let projection = prop_oneof![3 => Just(Projection::Perspective), 1 => Just(Projection::Orthographic)];
    let forms = prop_oneof![
        2 => Just(FootprintForm::Auto),
        1 => Just(FootprintForm::Point),
        1 => Just(FootprintForm::Affine),
        1 => Just(FootprintForm::Exact)
    ];
    let blend = prop_oneof![Just(Blend::Linear), Just(Blend::Display)];
    let filters = prop_oneof![1 => Just(0.0), 3 => Just(0.3), 1 => Just(1.0)];
    let of_peaks = (
        prop_oneof![Just(OpacityFilter::Classic), Just(OpacityFilter::Compensated)],
        prop_oneof![Just(0.0), Just(Strength::LEAST_OF_TRAINED), Just(0.2)],
    );
    let tolerances = prop_oneof![Just(1.0 / 255.0), Just(0.05), Just(1e-4)];
    (
        (projection, 0..4_usize, any::<bool>(), 0..4_usize, 0..4_u8, prop_oneof![Just(0.0), Just(2.0)]),
        (forms, blend, filters, of_peaks, tolerances, any::<bool>()),
    )
        .prop_map(
            |(
                (projection, kind, shared, transform, degree, near),
                (footprint, blend, low_pass, (filter, least), tolerance, shade),
            )| {
                let settings = RenderSettings {
                    footprint,
                    blend,
                    low_pass,
                    tolerance,
                    shade,
                    ..RenderSettings::default()
                };
                Setup { projection, kind, filter, least, shared, transform, degree, near, settings }
            },
        )
}

/// Even, moved, mirrored and larger, stretched unevenly.
pub(super) fn transform(number: usize) -> DAffine3 {
    let turned = DMat3::from_rotation_y(0.7) * DMat3::from_rotation_x(-1.1);
    match number {
        0 => DAffine3::IDENTITY,
        1 => DAffine3::from_mat3_translation(turned, DVec3::new(3.0, -2.0, 5.0)),
        2 => DAffine3::from_mat3(turned * DMat3::from_diagonal(DVec3::new(-2.5, 2.5, 2.5))),
        _ => DAffine3::from_mat3(turned * DMat3::from_diagonal(DVec3::new(0.5, 2.0, 1.3))),
    }
}

pub(super) const SIZE: [u32; 2] = [200, 144];

pub(super) fn camera(setup: &Setup) -> Camera {
    let pose = Pose::look_at(DVec3::new(4.0, -3.0, 2.0), DVec3::new(1.0, 2.0, 0.5), DVec3::Z).unwrap();
    let camera = match setup.projection {
        Projection::Perspective => Camera::perspective(pose, 0.9, SIZE),
        Projection::Orthographic => Camera::orthographic(pose, 6.0, SIZE),
    };
    camera.unwrap().with_near(setup.near).unwrap()
}

/// Centre and half-axes in camera space.
pub(super) fn placed(seen: &Seen, camera: &Camera) -> CameraSplat {
    let focal = camera.intrinsics().focal.x;
    let slope = DVec2::from(seen.place) * DVec2::new(100.0, 72.0) / focal;
    let z = seen.log_depth.exp();
    let perspective = camera.projection() == Projection::Perspective;
    let (center, ray) =
        if perspective { (slope.extend(1.0) * z, slope.extend(1.0)) } else { (slope.extend(z), DVec3::Z) };
    let radius = seen.log_pixels.exp() * camera.pixel_width_at(z);
    let normal = DVec3::from(seen.normal).try_normalize().unwrap_or(DVec3::Z);
    let normal = if seen.edge_on { normal.cross(ray).try_normalize().unwrap_or(DVec3::X) } else { normal };
    let tangent = normal.any_orthonormal_vector();
    let thickness = radius / seen.stretch / seen.flattening;
    let across = normal.cross(tangent) * (radius / seen.stretch);
    CameraSplat { center, factor: DMat3::from_cols(tangent * radius, across, normal * thickness) }
}

pub(super) fn cloud(setup: &Setup, splats: &[Seen], camera: &Camera) -> Cloud {
    let place = transform(setup.transform);
    let from_camera = (camera.pose().world_to_camera * place).inverse();
    let seen: Vec<CameraSplat> = splats.iter().map(|seen| placed(seen, camera)).collect();
    let factor = |splat: &CameraSplat| {
        let mut factor = (from_camera.matrix3 * splat.factor).as_mat3();
        if from_camera.matrix3.determinant() < 0.0 {
            factor.z_axis = -factor.z_axis;
        }
        factor
    };
    let strengths: Vec<f32> = splats.iter().map(|seen| seen.strength).collect();
    let strength = match setup.kind {
        0 => Strength::Extinction { masses: strengths },
        1 => Strength::Opacity { peaks: strengths, filter: setup.filter, least: setup.least },
        kind => Strength::Surface(Surface {
            areas: strengths.clone(),
            opacities: Some(strengths),
            depth_tolerance: 0.1,
            coverage_floor: 0.9,
            closed: (kind == 3).into(),
        }),
    };
    let per_splat = Harmonics::count(setup.degree);
    let harmonics = (setup.degree > 0).then(|| Harmonics {
        degree: setup.degree,
        coefficients: (0..splats.len() * per_splat)
            .map(|i| [0.3, 0.5, 0.7].map(|k| ((i as f32 + 1.0) * k).sin() * 0.3))
            .collect(),
    });
    let shading = |seen: &Seen| Vec3::from(seen.shading).normalize_or_zero();
    Cloud::new(Splats {
        centers: seen.iter().map(|splat| from_camera.transform_point3(splat.center).as_vec3()).collect(),
        shapes: if setup.shared {
            Shapes::Shared(factor(&seen[0]))
        } else {
            Shapes::Each(seen.iter().map(factor).collect())
        },
        strength,
        colors: splats.iter().map(|seen| seen.color).collect(),
        harmonics,
        normals: Some(splats.iter().map(shading).collect()),
        material: Material::default(),
    })
    .unwrap()
    .transformed(place)
}
