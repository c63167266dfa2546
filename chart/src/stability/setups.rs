//! Cameras and clouds that several cases draw.

use super::{Bound, Verdict};
use crate::curves::Role;
use crate::rgba::compare_rgba;
use glam::{DAffine3, DVec2, DVec3, Mat3, Vec3};
use oblate_engine::cloud::oblate_factor;
use oblate_engine::footprint::{CameraSplat, Lens};
use oblate_engine::{
    Camera, Closed, Cloud, FootprintForm, Frame, Intrinsics, Material, Metrics, OpacityFilter, Order, Pose,
    Projection, ReferenceKind, RenderSettings, Scene, Shapes, Splats, Strength, Surface, reference, render,
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

/// How far two pictures are apart; alpha counts where either has any that is not opaque.
pub(super) fn apart(a: &Frame, b: &Frame) -> Metrics {
    compare_rgba([a.width, a.height], &a.color, &b.color).expect("pictures of one size, finite")
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

/// A cloud elsewhere.
pub(super) fn moved(cloud: Cloud, shift: DVec3) -> Cloud {
    cloud.transformed(DAffine3::from_translation(shift))
}

/// Numbers from 0 to 1 that are spread evenly but in no order.
pub(super) fn spread(index: usize, stride: f64) -> f64 {
    (index as f64 * stride + 0.5).fract()
}

/// A direction for each index, from anywhere.
pub(super) fn direction(index: usize) -> DVec3 {
    let z = 2.0 * spread(index, 0.754_877_67) - 1.0;
    (DVec2::from_angle(std::f64::consts::TAU * spread(index, 0.569_840_29)) * (1.0 - z * z).sqrt()).extend(z)
}

/// A cloud in the colours of its centres.
pub(super) fn painted(cloud: &Cloud, color: impl Fn(Vec3) -> [f32; 3]) -> Cloud {
    let mut splats = cloud.splats();
    splats.colors = splats.centers.iter().map(|center| color(*center)).collect();
    Cloud::new(splats).expect("colours of cases are finite")
}

/// A cube of fog whose colours turn along each axis, once through it.
pub(super) fn haze(side: usize, spacing: f64, extinction: f64) -> Cloud {
    let turn = std::f32::consts::TAU / (side as f32 * spacing as f32);
    let shades = |p: Vec3| (p * turn + Vec3::new(0.0, 1.0, 2.0)).to_array().map(|a| 0.5 + 0.4 * a.sin());
    painted(&fog([side; 3], DVec3::splat(spacing), extinction, [0.0; 3]), shades)
}

/// Kernels of opacity of many colours in a ball of radius 1, as trained scenes have them.
pub(super) fn trained(count: usize, radius: f32) -> Cloud {
    let indices = 0..count;
    let center = |i| (direction(i) * spread(i, 0.819_173).cbrt()).as_vec3();
    let factor = |i| oblate_factor(direction(i + 1000).as_vec3(), radius, 1.0 + (i % 4) as f32);
    let peaks = indices.clone().map(|i| 0.3 + 0.1 * (i % 6) as f32).collect();
    let color = |i: usize| [(i % 2) as f32, (i % 3) as f32 / 2.0, (i % 5) as f32 / 4.0];
    let strength = Strength::Opacity { peaks, filter: OpacityFilter::Classic, least: 0.0 };
    let shapes = Shapes::Each(indices.clone().map(factor).collect());
    splats(indices.clone().map(center).collect(), shapes, strength, indices.map(color).collect())
}

/// A surface that lets a share through.
pub(super) fn translucent(cloud: &Cloud, opacity: f32) -> Cloud {
    let mut splats = cloud.splats();
    if let Strength::Surface(surface) = &mut splats.strength {
        surface.opacities = Some(vec![opacity; surface.areas.len()]);
    }
    Cloud::new(splats).expect("opacities of cases are in range").transformed(cloud.cloud_to_world())
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
            closed: Closed::Nowhere,
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

/// The least that is drawn on a logarithmic axis.
pub(super) const FLOOR: f64 = 1e-9;

/// A number that passes up to `bound`.
pub(super) fn at_most(role: Role, method: &str, figure: &str, found: f64, bound: f64) -> Verdict {
    let (method, figure) = (method.into(), figure.into());
    Verdict { method, role, figure, found, bound: Bound::AtMost(bound), fails: false }
}

/// A number that passes from `bound` on.
pub(super) fn at_least(role: Role, method: &str, figure: &str, found: f64, bound: f64) -> Verdict {
    Verdict { bound: Bound::AtLeast(bound), ..at_most(role, method, figure, found, bound) }
}

/// One that is known not to pass.
pub(super) fn failing(verdict: Verdict) -> Verdict {
    Verdict { fails: true, ..verdict }
}

/// So many numbers from the first to the last in equal steps.
pub(super) fn steps(count: usize, [first, last]: [f64; 2]) -> impl Iterator<Item = f64> + Clone {
    (0..count).map(move |i| first + (last - first) * i as f64 / (count - 1) as f64)
}

/// So many numbers from the first to the last in equal ratios.
pub(super) fn ratios(count: usize, [first, last]: [f64; 2]) -> impl Iterator<Item = f64> + Clone {
    steps(count, [first.ln(), last.ln()]).map(f64::exp)
}

/// Colours as they are, in this order.
pub(super) fn ordered(order: Order) -> RenderSettings {
    RenderSettings { order, ..unshaded() }
}

/// Exact footprints, cut off where nothing is left of kernels, nothing left out behind: what remains of the error is the order's.
pub(super) fn nothing_but(order: Order) -> RenderSettings {
    RenderSettings { footprint: FootprintForm::Exact, cutoff: 40.0, tolerance: 0.0, ..ordered(order) }
}

/// A camera at the origin of the world that looks along z, y down; its axis meets the picture at `center`, in pixels.
pub(super) fn ahead(focal: f64, center: DVec2, size: u32) -> Camera {
    let pose = Pose { world_to_camera: DAffine3::IDENTITY };
    let intrinsics = Intrinsics { focal: DVec2::splat(focal), center };
    Camera::from_intrinsics(pose, intrinsics, Projection::Perspective, [size; 2])
        .expect("focals are in range")
}

/// One kernel of a peak opacity.
pub(super) fn kernel(center: DVec3, factor: Mat3, peak: f32, filter: OpacityFilter) -> Cloud {
    let strength = Strength::Opacity { peaks: vec![peak], filter, least: 0.0 };
    splats(vec![center.as_vec3()], Shapes::Shared(factor), strength, vec![[1.0; 3]])
}

/// The mass of a kernel whose optical depth is `depth` along a ray through its middle and its third column, across the others.
pub(super) fn mass_of(depth: f32, factor: Mat3) -> f32 {
    depth * std::f32::consts::TAU * factor.x_axis.length() * factor.y_axis.length()
}

/// The pixels' opacities.
pub(super) fn alphas(frame: &Frame) -> Vec<f64> {
    frame.color.iter().map(|pixel| f64::from(pixel[3])).collect()
}

/// The largest difference of two rows of numbers.
pub(super) fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// The largest of some numbers.
pub(super) fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    values.into_iter().fold(f64::NEG_INFINITY, f64::max)
}

/// The centres of the pixels of a square picture, row by row.
pub(super) fn pixel_centers(side: u32) -> impl Iterator<Item = DVec2> {
    (0..side * side).map(move |i| DVec2::new(f64::from(i % side), f64::from(i / side)) + 0.5)
}

/// How far in front of the camera programs for trained splats drop a splat by its centre, in world units.
pub(super) const DROPPED_BEFORE: f64 = 0.2;

/// Opacities of a kernel of peak opacity 1 as programs for trained splats draw it: the affine form with slopes x/z, y/z of its derivative
/// cut off at `steepest`, 0.3 px² added, nothing where the centre is nearer than [`DROPPED_BEFORE`].
/// Kerbl, Kopanas, Leimkühler, Drettakis, *3D Gaussian Splatting for Real-Time Radiance Field Rendering*, 2023: 1.3 of the picture's half.
pub(super) fn linearized(splat: &CameraSplat, lens: &Lens, steepest: f64, side: u32) -> Vec<f64> {
    let d = splat.center;
    if d.z < DROPPED_BEFORE {
        return vec![0.0; (side * side) as usize];
    }
    let slope = (d.truncate() / d.z).clamp(DVec2::splat(-steepest), DVec2::splat(steepest));
    let rows = [DVec3::new(1.0, 0.0, -slope.x), DVec3::new(0.0, 1.0, -slope.y)];
    let [x, y] = [0, 1].map(|k| splat.factor.transpose() * (rows[k] * (lens.focal[k] / d.z)));
    let (xx, xy, yy) = (x.length_squared() + 0.3, x.dot(y), y.length_squared() + 0.3);
    let mean = d.truncate() / d.z * lens.focal + lens.principal;
    let alpha = |pixel: DVec2| {
        let u = pixel - mean;
        (-0.5 * (yy * u.x * u.x - 2.0 * xy * u.x * u.y + xx * u.y * u.y) / (xx * yy - xy * xy)).exp()
    };
    pixel_centers(side).map(alpha).collect()
}
