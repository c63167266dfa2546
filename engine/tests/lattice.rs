//! Volumes at every second pixel look as they do at every one.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod scenes;

use glam::{DAffine3, DVec3, Mat3, Vec2, Vec3};
use oblate_engine::simd::Level;
use oblate_engine::{
    Blend, Camera, Channels, Cloud, Counts, FootprintForm, Frame, Material, OpacityFilter, Order, Pose,
    RenderSettings, Renderer, Scene, Shapes, Splats, Strength, render,
};
use scenes::*;

const TOLERANCE: f32 = 1.0 / 255.0;

fn colors_only() -> RenderSettings {
    RenderSettings { channels: Channels::Color, ..unshaded() }
}

fn counted(scene: &Scene, camera: &Camera, settings: &RenderSettings) -> (Frame, Counts) {
    let counter = Counter::default();
    let frame = render(scene, camera, settings, &counter).unwrap();
    (frame, counter.0.into_inner().unwrap())
}

/// Differences of each pixel's channels, the largest first.
fn differences(a: &Frame, b: &Frame) -> Vec<f32> {
    let largest =
        |(a, b): (&[f32; 4], &[f32; 4])| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let mut all: Vec<f32> = a.color.iter().zip(&b.color).map(largest).collect();
    all.sort_by(|a, b| b.total_cmp(a));
    all
}

/// Draws a scene with and without a lattice; gives the differences, the largest first, and the share of the pixels that are
/// evaluated with one.
fn compare(clouds: Vec<Cloud>, camera: &Camera, settings: &RenderSettings) -> (Vec<f32>, f64) {
    let scene = Scene { clouds, lights: Vec::new() };
    let (all, of_all) = counted(&scene, camera, &RenderSettings { interpolation: false, ..*settings });
    let (some, of_some) = counted(&scene, camera, &RenderSettings { interpolation: true, ..*settings });
    assert!(all.color.iter().any(|[.., alpha]| *alpha > 0.3), "nothing is there");
    (differences(&all, &some), of_some.fragments as f64 / of_all.fragments as f64)
}

/// A block may be interpolated where its own outermost samples change it by an eighth of the tolerance. A round kernel alone, at 1.75
/// pixels, is off by six times as much at most, in one or two of its pixels: in most by less than half of that.
fn assert_alike(name: &str, differences: &[f32]) {
    let (most, usual) = (differences[0] / TOLERANCE, differences[differences.len() / 100] / TOLERANCE);
    println!("{name}: {most:.3} tolerances at most, {usual:.3} at 99 %");
    assert!(most <= 0.75 && usual <= 0.375, "{name}: off by {most} tolerances, by {usual} at 99 %");
}

/// A dense core in a thin box, in colours that change from place to place, 24 kernels a side.
fn core(spacing: f64) -> Cloud {
    const SIDE: usize = 24;
    let place = |i: usize| Vec3::new((i % SIDE) as f32, (i / SIDE % SIDE) as f32, (i / SIDE / SIDE) as f32);
    let from_middle = |i: usize| place(i) - 0.5 * (SIDE - 1) as f32;
    let count = SIDE.pow(3);
    let extinction = |i: usize| if from_middle(i).length() < 7.0 { 0.8_f32 } else { 0.02 };
    Cloud::new(Splats {
        centers: (0..count).map(|i| from_middle(i) * spacing as f32).collect(),
        shapes: Shapes::Shared(Mat3::from_diagonal(Vec3::splat(0.7 * spacing as f32))),
        strength: Strength::Extinction {
            masses: (0..count).map(|i| extinction(i) * spacing.powi(2) as f32).collect(),
        },
        colors: (0..count).map(|i| (0.5 + 0.4 * (place(i) * 0.6).map(f32::sin)).to_array()).collect(),
        harmonics: None,
        normals: None,
        material: Material::UNLIT,
    })
    .unwrap()
}

/// With kernels of 2.4 pixels.
fn near() -> Camera {
    looking_from(DVec3::new(1.2, 0.9, -2.4), 160)
}

#[test]
fn wide_kernels_take_half_of_the_work() {
    let orders = [Order::Auto, Order::Centers, Order::PerPixel, Order::Slabs { thickness: 1.0 }];
    for order in orders {
        let (differences, share) =
            compare(vec![core(0.04)], &near(), &RenderSettings { order, ..colors_only() });
        assert_alike(&format!("{order:?}"), &differences);
        println!("{share:.2} of the pixels");
        assert!(share < 0.6, "{share}");
    }
    // Smaller kernels are drawn at every pixel.
    let far = looking_from(DVec3::new(2.4, 1.8, -4.8), 160);
    let (differences, share) = compare(vec![core(0.04)], &far, &colors_only());
    assert!(differences[0] == 0.0 && share == 1.0);
}

#[test]
fn all_depths_are_those_of_every_pixel() {
    let (differences, share) = compare(vec![core(0.04)], &near(), &unshaded());
    assert!(differences[0] == 0.0 && share == 1.0);
}

#[test]
fn the_picture_may_end_within_the_volume() {
    for size in [[130, 97], [101, 128], [64, 64]] {
        let pose = Pose::look_at(DVec3::new(0.3, 0.2, -1.6), DVec3::ZERO, DVec3::Y).unwrap();
        let camera = Camera::perspective(pose, 18f64.to_radians(), size).unwrap();
        let (differences, share) = compare(vec![core(0.04)], &camera, &colors_only());
        assert_alike(&format!("{size:?}"), &differences);
        assert!(share < 1.0, "{share}");
        let camera = Camera::orthographic(pose, 0.7, size).unwrap();
        let (differences, share) = compare(vec![core(0.04)], &camera, &colors_only());
        assert_alike(&format!("{size:?}, parallel"), &differences);
        assert!(share < 1.0, "{share}");
    }
}

/// Kernels as small as the filter, and less so, lie anywhere between the pixels that are drawn.
#[test]
fn narrow_kernels_among_wide_ones_are_seen() {
    let places =
        |i: usize| [0.754_877_67, 0.569_840_29, 0.438_44].map(|x: f64| (x * i as f64).fract() as f32 - 0.5);
    for (sigma, low_pass) in [(1e-4, 0.3), (0.004, 0.3), (0.01, 0.3), (1e-4, 0.01)] {
        let centers = (1..400).map(|i| Vec3::from(places(i))).collect();
        let specks = kernels(centers, Mat3::from_diagonal(Vec3::splat(sigma)), 1e-4, [1.0, 0.9, 0.2]);
        let settings = RenderSettings { low_pass, order: Order::Centers, ..colors_only() };
        let name = format!("σ = {sigma}, {low_pass} px²");
        // Of one cloud, so that the median kernel is wide.
        let clouds = vec![joined(&core(0.04), &specks)];
        let without = draw(vec![core(0.04)], &near(), &settings);
        let with = draw(clouds.clone(), &near(), &settings);
        assert!(differences(&without, &with)[100] > 10.0 * TOLERANCE, "{name}: they don't show");
        let (differences, share) = compare(clouds, &near(), &settings);
        assert_alike(&name, &differences);
        assert!(share != 1.0, "{name}: there is no lattice");
    }
}

/// One cloud of the kernels of two.
fn joined(a: &Cloud, b: &Cloud) -> Cloud {
    let mut splats = [a, b].map(|cloud| cloud.splats());
    let shapes = |splats: &Splats| -> Vec<Mat3> {
        match &splats.shapes {
            Shapes::Shared(shape) => vec![*shape; splats.centers.len()],
            Shapes::Each(shapes) => shapes.clone(),
        }
    };
    let shapes = splats.each_ref().map(shapes).concat();
    let masses = splats.each_ref().map(|splats| match &splats.strength {
        Strength::Extinction { masses } => masses.clone(),
        other => panic!("{other:?} is no extinction"),
    });
    let [first, second] = &mut splats;
    first.centers.append(&mut second.centers);
    first.colors.append(&mut second.colors);
    Cloud::new(Splats {
        shapes: Shapes::Each(shapes),
        strength: Strength::Extinction { masses: masses.concat() },
        ..splats.into_iter().next().unwrap()
    })
    .unwrap()
}

/// A kernel as dense as a stone ends in a step where it is cut off.
#[test]
fn borders_of_dense_kernels_are_seen() {
    for (sigma, optical_depth) in [(0.025, 3.0), (0.035, 6.0), (0.05, 20.0), (0.05, 0.5)] {
        let mass = optical_depth * std::f32::consts::TAU * f32::powi(sigma, 2);
        let stone = kernels(vec![Vec3::ZERO], Mat3::from_diagonal(Vec3::splat(sigma)), mass, [0.9, 0.5, 0.1]);
        let settings = RenderSettings { order: Order::Centers, ..colors_only() };
        let (differences, share) = compare(vec![stone], &near(), &settings);
        assert_alike(&format!("σ = {sigma}, τ = {optical_depth}"), &differences);
        assert!(share != 1.0, "there is no lattice");
    }
}

/// Colours are encoded by their ratio to opacities, of which there may be next to none.
#[test]
fn nothing_flashes_where_next_to_nothing_is() {
    let settings = RenderSettings { blend: Blend::Display, ..colors_only() };
    let (differences, share) = compare(vec![core(0.04)], &near(), &settings);
    assert_alike("in display space", &differences);
    assert!(share < 0.6, "{share}");
    // Waves around two bodies of different colours cancel in the opacity, but not in the colours.
    for i in 0..24 {
        let at = |x: f32| move |p: &&Vec3| (**p - Vec3::new(x, 0.0, 0.0)).length() < 0.16;
        let splats = core(0.04).splats();
        let ball = |x: f32, color: [f32; 3]| {
            let centers = splats.centers.iter().filter(at(x)).copied().collect();
            kernels(centers, Mat3::from_diagonal(Vec3::splat(0.028)), 0.002, color)
        };
        let half = 0.2 + 0.005 * i as f32;
        let clouds = vec![ball(-half, [1.0, 0.02, 0.02]), ball(half, [0.02, 0.02, 1.0])];
        let (differences, share) = compare(clouds, &near(), &settings);
        assert!(differences[0] <= TOLERANCE, "bodies {half} to either side: {}", differences[0] / TOLERANCE);
        assert!(share < 1.0, "{share}");
    }
}

#[test]
fn forms_and_opacities_keep_to_it() {
    let exact = RenderSettings { footprint: FootprintForm::Exact, ..colors_only() };
    let (differences, share) = compare(vec![core(0.04)], &near(), &exact);
    assert_alike("exact", &differences);
    assert!(share < 0.6, "{share}");
    // Where they end at 1/255 they are drawn at every pixel.
    for (least, drawn) in [(0.0, 0.0..0.6), (Strength::LEAST_OF_TRAINED, 1.0..1.001)] {
        let mut splats = core(0.04).splats();
        let peaks = vec![0.05; splats.centers.len()];
        splats.strength = Strength::Opacity { peaks, filter: OpacityFilter::Compensated, least };
        let (differences, share) = compare(vec![Cloud::new(splats).unwrap()], &near(), &colors_only());
        assert_alike("opacities", &differences);
        assert!(drawn.contains(&share), "{share}");
    }
}

#[test]
fn surfaces_cut_through_it() {
    let small = sphere(2_000, 0.2, [0.9, 0.2, 0.1]);
    for z in [-0.6, 0.0, 0.6] {
        let ball = small.clone().transformed(DAffine3::from_translation(DVec3::new(0.1, 0.0, z)));
        let (differences, share) = compare(vec![core(0.04), ball], &near(), &colors_only());
        assert_alike(&format!("a ball at {z}"), &differences);
        assert!(share < 0.95, "{share}");
    }
}

/// A dense wall hides what is behind it but for what a hole shows, which is seen in another round only.
#[test]
fn what_is_hidden_is_left_out_of_it_too() {
    let places = fog([48, 48, 24], DVec3::splat(0.04), 1.0, [1.0; 3]).splats().centers;
    let behind = fog([60; 3], DVec3::splat(0.04), 1.0, [0.9, 0.3, 0.2]).splats().in_morton_order();
    let behind =
        Cloud::new(behind).unwrap().transformed(DAffine3::from_translation(DVec3::new(0.2, 0.2, 1.8)));
    let camera = camera(2.6, 256);
    // Its rim goes across tiles, so that of two neighbours one has to be drawn again, and the other be interpolated again.
    for x in (0..16).map(|i| 0.16 + 0.012 * i as f32) {
        let is_wall = |p: &&Vec3| (p.truncate() - Vec2::new(x, 0.1)).length() > 0.05;
        let wall = places.iter().filter(is_wall).copied().collect();
        let mass = 600.0 * 0.04_f32.powi(3);
        let wall = kernels(wall, Mat3::from_diagonal(Vec3::splat(0.028)), mass, [0.3, 0.8, 0.4]);
        let scene = Scene { clouds: vec![wall, behind.clone()], lights: Vec::new() };
        let [all, rest] = [false, true].map(|occlusion| {
            let counter = Counter::default();
            let settings = RenderSettings { occlusion, ..colors_only() };
            (render(&scene, &camera, &settings, &counter).unwrap(), counter)
        });
        let (counts, rounds) = (rest.1.0.into_inner().unwrap(), rest.1.1.into_inner());
        assert!(counts.occluded > counts.splats / 4 && rounds > 1, "{counts:?}, {rounds} rounds");
        // Sums of a batch end elsewhere, and a block at its limit may be interpolated or not.
        let worst = differences(&all.0, &rest.0)[0];
        assert!(worst <= 0.125 * TOLERANCE, "a hole at {x}: {worst}");
    }
}

#[test]
fn threads_change_nothing_and_tiles_and_levels_little() {
    let scene = Scene { clouds: vec![core(0.04), sphere(2_000, 0.2, [0.9, 0.2, 0.1])], lights: Vec::new() };
    let mut first: Option<Frame> = None;
    for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
        for side in [8, 16, 32] {
            let frames = [1, 2, 3].map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let mut renderer = Renderer::with(level, side);
                pool.install(|| renderer.render(&scene, &near(), &colors_only(), &()).map(|_| ())).unwrap();
                renderer.into_frame()
            });
            for other in &frames[1..] {
                assert!(other.color == frames[0].color, "threads change {level:?}, side {side}");
            }
            let [frame, ..] = frames;
            let first = first.get_or_insert_with(|| frame.clone());
            // A block at its limit may be interpolated or not, and tiles stop where a quarter of the tolerance is left.
            let worst = differences(first, &frame)[0] / TOLERANCE;
            assert!(worst <= 0.5, "{level:?}, side {side}: {worst} tolerances");
        }
    }
}

#[test]
fn a_renderer_keeps_nothing_of_earlier_lattices() {
    let scene = Scene { clouds: vec![core(0.04)], lights: Vec::new() };
    let small = looking_from(DVec3::new(1.2, 0.9, -2.4), 96);
    let far = looking_from(DVec3::new(2.4, 1.8, -4.8), 160);
    let mut renderer = Renderer::new();
    for (camera, interpolation) in
        [(near(), true), (small, true), (far, true), (near(), false), (small, true), (near(), true)]
    {
        let settings = RenderSettings { interpolation, ..colors_only() };
        let fresh = render(&scene, &camera, &settings, &()).unwrap();
        let kept = renderer.render(&scene, &camera, &settings, &()).unwrap();
        assert!(kept.color == fresh.color, "{:?}, {interpolation}", camera.size());
    }
}
