//! Case 10: hostile input.

use super::setups::*;
use super::{Case, Findings};
use crate::curves::{Axis, Curve, Panel, Role};
use glam::{DVec3, Mat3, Vec3};
use oblate_engine::{
    Camera, Cloud, FootprintForm, Frame, Intrinsics, Material, OpacityFilter, Order, Pose, Projection,
    ReferenceKind, RenderSettings, Scene, Shapes, Splats, Strength, render,
};
use oblate_surfels::{Density, Mesh, SamplerSettings, primitives, sample};
use oblate_volumes::{GridFrame, Volume, Voxels};

pub(super) const CASE: Case = Case {
    number: 10,
    title: "Hostile input",
    criterion: "All of what is wrong is refused with an error that says where: numbers that are not finite, negative masses, arrays cut short, empty pictures. All of what is extreme and yet valid is drawn, from splats of size 0 to log-scales of ±40, from no splat at all to colours of 10³⁰: in any order and form no channel of any pixel is anything but a finite number.",
    run,
};

/// Two kernels of opacity before the camera, sound so far.
fn sound() -> Splats {
    Splats {
        centers: vec![Vec3::ZERO, Vec3::Z],
        shapes: Shapes::Each(vec![Mat3::from_diagonal(Vec3::splat(0.3)); 2]),
        strength: Strength::Opacity { peaks: vec![0.5; 2], filter: OpacityFilter::Classic, least: 0.0 },
        colors: vec![[0.5; 3]; 2],
        harmonics: None,
        normals: None,
        material: Material::UNLIT,
    }
}

fn cloud_with(change: impl Fn(&mut Splats)) -> Result<(), String> {
    let mut splats = sound();
    change(&mut splats);
    Cloud::new(splats).map(|_| ()).map_err(|error| error.to_string())
}

fn masses(values: [f32; 2]) -> Strength {
    Strength::Extinction { masses: values.to_vec() }
}

/// What each wrong input comes to; an error says where.
fn refusals() -> Vec<Result<(), String>> {
    let mut results = Vec::new();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        results.extend([
            cloud_with(|s| s.centers[1].y = bad),
            cloud_with(|s| {
                s.shapes = Shapes::Each(vec![Mat3::IDENTITY, Mat3::from_diagonal(Vec3::splat(bad))])
            }),
            cloud_with(|s| s.shapes = Shapes::Shared(Mat3::IDENTITY * bad)),
            cloud_with(|s| s.colors[1][2] = bad),
            cloud_with(|s| s.normals = Some(vec![Vec3::Z, Vec3::X * bad])),
            cloud_with(|s| s.strength = masses([1.0, bad])),
            cloud_with(|s| {
                s.strength =
                    Strength::Opacity { peaks: vec![bad, 0.5], filter: OpacityFilter::Classic, least: 0.0 }
            }),
            cloud_with(|s| {
                s.strength =
                    Strength::Opacity { peaks: vec![0.5; 2], filter: OpacityFilter::Classic, least: bad }
            }),
            cloud_with(|s| s.material.specular = bad),
            with_settings(RenderSettings { background: [0.0, bad, 0.0, 1.0], ..unshaded() }),
            with_settings(RenderSettings { low_pass: bad.into(), ..unshaded() }),
            with_settings(RenderSettings { tolerance: bad.into(), ..unshaded() }),
            with_settings(ordered(Order::Slabs { thickness: bad.into() })),
            camera_of([8; 2], bad.into(), 0.0),
            camera_of([8; 2], 1.0, bad.into()),
            grid(2, f64::from(bad)),
        ]);
    }
    results.extend([
        cloud_with(|s| s.strength = masses([-1.0, 1.0])),
        cloud_with(|s| {
            s.strength =
                Strength::Opacity { peaks: vec![1.5, 0.5], filter: OpacityFilter::Classic, least: 0.0 }
        }),
        // Files that end too soon.
        cloud_with(|s| s.colors.truncate(1)),
        cloud_with(|s| s.centers.push(Vec3::ZERO)),
        cloud_with(|s| s.strength = Strength::Extinction { masses: vec![1.0] }),
        cloud_with(|s| s.shapes = Shapes::Each(Vec::new())),
        with_settings(ordered(Order::Slabs { thickness: 0.0 })),
        camera_of([0, 8], 1.0, 0.0),
        camera_of([8; 2], 0.0, 0.0),
        grid(2, 0.0),
        grid(3, 1.0),
        mesh(|mesh| mesh.primitives[0].triangles[0] = [0, 1, u32::MAX]),
        mesh(|mesh| mesh.primitives[0].positions[0].x = f32::NAN),
    ]);
    results
}

fn with_settings(settings: RenderSettings) -> Result<(), String> {
    let drawn = render(&Scene::default(), &camera([4; 2]), &settings, &());
    drawn.map(|_| ()).map_err(|error| error.to_string())
}

fn camera_of(size: [u32; 2], focal: f64, shift: f64) -> Result<(), String> {
    let mut pose = camera([4; 2]).pose();
    pose.world_to_camera.translation.x += shift;
    let intrinsics = Intrinsics { focal: [focal; 2].into(), center: [4.0; 2].into() };
    let camera = Camera::from_intrinsics(pose, intrinsics, Projection::Perspective, size);
    camera.map(|_| ()).map_err(|error| error.to_string())
}

/// A grid with eight samples.
fn grid(side: usize, spacing: f64) -> Result<(), String> {
    let frame = GridFrame { spacing: DVec3::new(1.0, spacing, 1.0), ..GridFrame::default() };
    let volume = Volume::new([side; 3], Voxels::F32(vec![0.5; 8]), frame);
    volume.map(|_| ()).map_err(|error| error.to_string())
}

fn mesh(change: impl Fn(&mut Mesh)) -> Result<(), String> {
    let mut mesh = Mesh { primitives: vec![primitives::plane(2)] };
    change(&mut mesh);
    let cloud = sample(&mesh, Density::Count(20), &SamplerSettings::default());
    cloud.map(|_| ()).map_err(|error| error.to_string())
}

fn camera(size: [u32; 2]) -> Camera {
    let pose = Pose::look_at(DVec3::NEG_Z * 4.0, DVec3::ZERO, DVec3::Y).expect("the eye is off the origin");
    Camera::perspective(pose, 0.5, size).expect("sizes are in range")
}

fn factor(scale: Vec3) -> Mat3 {
    Mat3::from_rotation_x(0.7) * Mat3::from_diagonal(scale)
}

/// Valid splats with their name in errors, and whether anything of them is to be seen from before the origin.
fn extremes() -> Vec<(Splats, bool)> {
    let with = |change: &dyn Fn(&mut Splats)| {
        let mut splats = sound();
        change(&mut splats);
        splats
    };
    let shaped = |scale: Vec3| with(&|s| s.shapes = Shapes::Shared(factor(scale)));
    let huge = (40f32).exp();
    let tiny = (-40f32).exp();
    let mut all: Vec<(Splats, bool)> = [
        Vec3::splat(huge),
        Vec3::splat(tiny),
        Vec3::new(huge, tiny, 1.0),
        Vec3::new(1.0, 1.0, tiny),
        Vec3::new(1.0, tiny, tiny),
        // Rows of zeros in a file.
        Vec3::ZERO,
        Vec3::splat(f32::from_bits(1)),
        Vec3::splat(-0.3),
        Vec3::splat(1e30),
    ]
    .map(|scale| (shaped(scale), true))
    .into();
    all.extend([
        (with(&|s| s.colors = vec![[1e30, 0.0, -1e30]; 2]), true),
        (with(&|s| s.colors = vec![[f32::MAX; 3]; 2]), true),
        (with(&|s| s.colors = vec![[f32::from_bits(1); 3]; 2]), true),
        (with(&|s| s.centers[0] = Vec3::splat(1e30)), true),
        (with(&|s| s.centers = vec![Vec3::splat(f32::MAX); 2]), false),
        // At the eye and on its plane.
        (with(&|s| s.centers = vec![Vec3::NEG_Z * 4.0; 2]), true),
        (with(&|s| s.centers = vec![Vec3::new(1.0, 0.0, -4.0); 2]), false),
        (with(&|s| s.strength = masses([1e30; 2])), true),
        (with(&|s| s.strength = masses([f32::MAX; 2])), true),
        (with(&|s| s.strength = masses([f32::from_bits(1), 0.0])), false),
        (
            with(&|s| {
                s.strength = masses([1e30; 2]);
                s.shapes = Shapes::Shared(factor(Vec3::splat(tiny)));
                s.colors = vec![[1e30; 3]; 2];
            }),
            true,
        ),
        (
            with(&|s| {
                s.strength =
                    Strength::Opacity { peaks: vec![1.0; 2], filter: OpacityFilter::Classic, least: 0.0 }
            }),
            true,
        ),
    ]);
    all
}

fn not_finite(frame: &Frame) -> usize {
    frame.color.iter().flatten().filter(|value| !value.is_finite()).count()
}

/// Values that are not finite in all pictures, and the share of splats to be seen that are.
fn drawn(settings: &RenderSettings) -> [f64; 2] {
    let (mut wrong, mut seen, mut visible) = (0, 0, 0);
    for (splats, shows) in extremes() {
        let scene = scene(vec![Cloud::new(splats).expect("extreme, and in range")]);
        let pose = camera([4; 2]).pose();
        let parallel = Camera::orthographic(pose, 3.0, [9; 2]).expect("the height is in range");
        for (number, camera) in [camera([9; 2]), camera([1; 2]), parallel].iter().enumerate() {
            let frame = draw(&scene, camera, settings);
            wrong += not_finite(&frame);
            if shows && number == 0 {
                visible += 1;
                seen += usize::from(frame.color.iter().any(|pixel| pixel[3] > 0.0));
            }
        }
    }
    wrong += not_finite(&draw(&Scene::default(), &camera([1; 2]), settings));
    [wrong as f64, f64::from(seen as u32) / f64::from(visible)]
}

/// The opacity of a splat at the middle of the picture as programs for trained scenes have it, in f32: J Σ Jᵀ, a filter of
/// 0.3 px², the conic by its inverse. Kerbl, Kopanas, Leimkühler, Drettakis, *3D Gaussian Splatting for Real-Time
/// Radiance Field Rendering*, 2023. Without `filter` nothing is added.
fn plain(factor: Mat3, peak: f32, filter: f32) -> f32 {
    let (focal, depth) = (camera([9; 2]).intrinsics().focal.x as f32, 4.0_f32);
    let covariance = factor * factor.transpose();
    let scale = focal / depth;
    let [a, b, c] = [
        covariance.x_axis.x * scale * scale + filter,
        covariance.x_axis.y * scale * scale,
        covariance.y_axis.y * scale * scale + filter,
    ];
    let determinant = a * c - b * b;
    let [qa, qb, qc] = [c / determinant, -b / determinant, a / determinant];
    // A pixel beside the mean: at the mean itself nothing can go wrong.
    let [x, y] = [0.3_f32, 0.2];
    peak * (-0.5 * (qa * x * x + qc * y * y) - qb * x * y).exp()
}

/// |Δα| at the middle of the picture over a log-scale; what isn't finite counts as 1.
fn error_at(scale: f64, found: impl Fn(Mat3) -> f64) -> [f64; 2] {
    // A needle, e⁴ times as long as it is thick.
    let factor = factor(Vec3::new((scale + 4.0).exp() as f32, scale.exp() as f32, scale.exp() as f32));
    let settings = RenderSettings { low_pass: 0.3, ..unshaded() };
    let expected = middle(&truth(&needle(factor), &offset_camera(), &settings, ReferenceKind::R1));
    let error = (found(factor) - expected).abs();
    [scale, if error.is_finite() { error.max(FLOOR) } else { 1.0 }]
}

fn needle(factor: Mat3) -> Scene {
    scene(vec![kernel(DVec3::ZERO, factor, 0.9, OpacityFilter::Classic)])
}

/// Sees the origin beside the middle of its only pixel.
fn offset_camera() -> Camera {
    let focal = camera([9; 2]).intrinsics().focal;
    let pose = Pose { world_to_camera: glam::DAffine3::from_translation(DVec3::Z * 4.0) };
    let intrinsics = Intrinsics { focal, center: [0.2, 0.3].into() };
    Camera::from_intrinsics(pose, intrinsics, Projection::Perspective, [1; 2]).expect("it is in range")
}

fn middle(frame: &Frame) -> f64 {
    f64::from(frame.color[0][3])
}

fn run() -> Findings {
    let accepted = refusals().iter().filter(|result| result.is_ok()).count();
    let silent = refusals().iter().filter(|result| result.as_ref().is_err_and(String::is_empty)).count();
    let exact = RenderSettings { footprint: FootprintForm::Exact, ..unshaded() };
    let methods = [
        ("default", Role::Default, unshaded()),
        ("exact", Role::Ours, exact),
        ("by centres", Role::Ours, ordered(Order::Centers)),
        ("pixel by pixel", Role::Ours, ordered(Order::PerPixel)),
        ("slabs of 0.01 σ", Role::Ours, ordered(Order::Slabs { thickness: 0.01 })),
    ];
    let (mut verdicts, mut curves) = (Vec::new(), Vec::new());
    verdicts.push(at_most(Role::Default, "default", "wrong inputs let in", (accepted + silent) as f64, 0.0));
    for (name, role, settings) in &methods {
        let [wrong, seen] = drawn(settings);
        verdicts.push(at_most(*role, name, "values of pictures that are not finite", wrong, 0.0));
        verdicts.push(at_least(*role, name, "share of extreme splats that are drawn", seen, 1.0));
    }
    let scales: Vec<f64> = steps(41, [-40.0, 40.0]).collect();
    for (name, role, settings) in &methods[..2] {
        let found = |factor| middle(&draw(&needle(factor), &offset_camera(), settings));
        curves.push(Curve::new(*name, *role, scales.iter().map(|scale| error_at(*scale, found))));
    }
    let factors = extremes().into_iter().map(|(splats, _)| splats.shapes.factor(0));
    for (name, filter) in [("3DGS in f32", 0.3), ("the same, no filter", 0.0)] {
        let wrong = factors.clone().filter(|factor| !plain(*factor, 0.9, filter).is_finite()).count();
        verdicts.push(failing(at_most(
            Role::Baseline,
            name,
            "extreme splats whose opacity is no number",
            wrong as f64,
            0.0,
        )));
        let found = |factor| f64::from(plain(factor, 0.9, filter));
        curves.push(Curve::new(name, Role::Baseline, scales.iter().map(|scale| error_at(*scale, found))));
    }
    let panels = vec![Panel {
        title: "A needle from e⁻⁴⁰ to e⁴⁰".into(),
        x: Axis::linear("logarithm of its thickness"),
        y: Axis::log("|Δα| beside its middle; 1 where it is no number"),
        bound: Some(LEVEL),
        curves,
    }];
    Findings { panels, verdicts }
}
