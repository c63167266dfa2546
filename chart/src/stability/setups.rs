//! Cameras and clouds that several cases draw.

use glam::{DVec3, Mat3, Vec3};
use oblate_engine::cloud::oblate_factor;
use oblate_engine::{
    Camera, Cloud, Frame, Material, Metrics, Pixels, Pose, ReferenceKind, RenderSettings, Scene, Shapes,
    Splats, Strength, Surface, compare, reference, render,
};

/// A level of 8 bits.
pub(super) const LEVEL: f64 = 1.0 / 255.0;

/// A 30° camera at `eye` that looks at the origin, y up.
pub(super) fn looking_from(eye: DVec3, size: u32) -> Camera {
    let up = if eye.normalize().y.abs() > 0.99 { DVec3::Z } else { DVec3::Y };
    let pose = Pose::look_at(eye, DVec3::ZERO, up).expect("the eye is not at the origin");
    Camera::perspective(pose, 30f64.to_radians(), [size; 2]).expect("the size is in range")
}

/// Colours as they are.
pub(super) fn unshaded() -> RenderSettings {
    RenderSettings { shade: false, ..RenderSettings::default() }
}

/// The scene of some clouds, unlit.
pub(super) fn scene(clouds: Vec<Cloud>) -> Scene {
    Scene { clouds, lights: Vec::new() }
}

/// What the engine draws.
pub(super) fn draw(scene: &Scene, camera: &Camera, settings: &RenderSettings) -> Frame {
    render(scene, camera, settings, &()).expect("settings of cases are in range")
}

/// What a reference draws.
pub(super) fn truth(scene: &Scene, camera: &Camera, settings: &RenderSettings, kind: ReferenceKind) -> Frame {
    reference(scene, camera, settings, kind, &|_| ()).expect("settings of cases are in range")
}

/// How far two pictures are apart, alpha included.
pub(super) fn apart(a: &Frame, b: &Frame) -> Metrics {
    let [left, right] = [a, b].map(|frame| frame.color.as_flattened());
    let picture = |values| Pixels { width: a.width, height: a.height, channels: 4, values };
    compare(picture(left), picture(right)).expect("pictures of one size, finite")
}

/// Extinction kernels of one shape and mass.
pub(super) fn kernels(centers: Vec<Vec3>, factor: Mat3, mass: f32, color: [f32; 3]) -> Cloud {
    let count = centers.len();
    let strength = Strength::Extinction { masses: vec![mass; count] };
    splats(centers, Shapes::Shared(factor), strength, vec![color; count])
}

/// Unlit splats without normals.
pub(super) fn splats(centers: Vec<Vec3>, shapes: Shapes, strength: Strength, colors: Vec<[f32; 3]>) -> Cloud {
    let material = Material::UNLIT;
    Cloud::new(Splats { centers, shapes, strength, colors, harmonics: None, normals: None, material })
        .expect("splats of cases are in range")
}

/// A lattice of extinction kernels around the origin, σ = 0.7 of its spacing, that fills a box with a constant extinction.
pub(super) fn fog(dims: [usize; 3], spacing: DVec3, extinction: f64, color: [f32; 3]) -> Cloud {
    let corner = -0.5 * (DVec3::from(dims.map(|n| n as f64)) - 1.0);
    let places =
        (0..dims[2]).flat_map(|k| (0..dims[1]).flat_map(move |j| (0..dims[0]).map(move |i| [i, j, k])));
    let center = |index: [usize; 3]| ((corner + DVec3::from(index.map(|n| n as f64))) * spacing).as_vec3();
    let mass = (extinction * spacing.element_product()) as f32;
    kernels(places.map(center).collect(), Mat3::from_diagonal(spacing.as_vec3() * 0.7), mass, color)
}

/// One flat surfel of a given area at each point with a normal, σ = 0.8 √area.
pub(super) fn surfels(points: &[(Vec3, Vec3)], area: f32, color: [f32; 3]) -> Cloud {
    let radius = 0.8 * area.sqrt();
    let factors = points.iter().map(|(_, normal)| oblate_factor(*normal, radius, f32::INFINITY)).collect();
    Cloud::new(Splats {
        centers: points.iter().map(|(center, _)| *center).collect(),
        shapes: Shapes::Each(factors),
        strength: Strength::Surface(Surface {
            areas: vec![area; points.len()],
            opacities: None,
            depth_tolerance: radius,
            coverage_floor: 0.98,
            closed: false,
        }),
        colors: vec![color; points.len()],
        harmonics: None,
        normals: Some(points.iter().map(|(_, normal)| *normal).collect()),
        material: Material::UNLIT,
    })
    .expect("surfels of cases are in range")
}

/// A square lattice of surfels in the plane z = 0, facing −z, `side` surfels along an edge.
pub(super) fn plane(side: usize, spacing: f32, color: [f32; 3]) -> Cloud {
    let middle = (side as f32 - 1.0) / 2.0;
    let place = |i: usize| Vec3::new((i % side) as f32 - middle, (i / side) as f32 - middle, 0.0) * spacing;
    let points: Vec<_> = (0..side * side).map(|i| (place(i), Vec3::NEG_Z)).collect();
    surfels(&points, spacing * spacing, color)
}
