//! Levels of detail: what building them takes, and that what a frame takes goes with its pixels and not with the splats behind
//! them.
//!
//! `cargo bench --bench levels`, or `cargo bench --bench levels -- crowd` for a part of it.

#[expect(dead_code, reason = "the works of the other benchmarks are not drawn here")]
mod common;

use common::surfels::{Place, on_torus, surfels_at, torus_and_sphere};
use common::volumes::{ENGINE, GLASS, data, kernels, volume};
use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};
use oblate::chart::methods::way;
use oblate::engine::metrics::{Pixels, compare};
use oblate::engine::{
    Camera, Channels, Cloud, Counts, Material, Observer, Pose, RenderSettings, Renderer, Scene, Shapes,
    Splats, Strength, settle,
};
use std::cell::LazyCell;
use std::f32::consts::TAU;
use std::ops::Deref;
use std::sync::Mutex;

/// What the last frame drew.
#[derive(Default)]
struct Told(Mutex<Counts>);

impl Observer for Told {
    fn counts(&self, counts: Counts) {
        *self.0.lock().expect("nobody panics") = counts;
    }
}

fn settings(tolerance: f64, level_of_detail: f64) -> RenderSettings {
    RenderSettings { tolerance, level_of_detail, channels: Channels::Color, ..RenderSettings::default() }
}

fn camera(eye: DVec3, target: DVec3) -> Camera {
    let pose = Pose::look_at(eye, target, DVec3::Z).expect("eye and target differ");
    Camera::perspective(pose, 30f64.to_radians(), [1024; 2]).expect("the size is in range")
}

fn surfels() -> Cloud {
    Cloud::new(torus_and_sphere(1_000_000).in_morton_order()).expect("the numbers are finite")
}

/// A torus and a sphere in samples that are about evenly apart (the sequence R2 of M. Roberts, *The Unreasonable Effectiveness of
/// Quasirandom Sequences*, 2018), each as large as its share of the surface asks for: without holes, as surfels of meshes and
/// iso-surfaces are.
fn even_torus_and_sphere(count: usize) -> Splats {
    let places = (0..count).map(|i| {
        let [a, b] =
            [0.754_877_666_246_692_7, 0.569_840_290_998_053_2].map(|step| (i / 2) as f64 * step % 1.0);
        if i % 2 == 0 {
            return Place::Torus([a, b].map(|turn| turn as f32 * TAU));
        }
        let (sin, cos) = (a as f32 * TAU).sin_cos();
        let z = (2.0 * b - 1.0) as f32;
        let across = (1.0 - z * z).sqrt();
        Place::Sphere(Vec3::new(across * cos, across * sin, z))
    });
    let widest = 2.0 * EVEN_SIGMA * (1.35 * on_torus(count)).sqrt();
    surfels_at(places.collect(), |area| EVEN_SIGMA * area.sqrt(), (widest, 0.9))
}

/// In roots of a surfel's share of the surface.
const EVEN_SIGMA: f32 = 0.8;

/// Times a picture, whose scene is made then; false where it is not asked for.
fn draw(
    criterion: &mut Criterion,
    [group, name]: [&str; 2],
    scene: &impl Deref<Target = Scene>,
    (camera, settings): (&impl Deref<Target = Camera>, RenderSettings),
) -> bool {
    let mut renderer = Renderer::new();
    let told = Told::default();
    let settled = LazyCell::new(|| settle(scene, camera, &settings).expect("it can be drawn"));
    let mut group = criterion.benchmark_group(group);
    group.sample_size(10).bench_function(name, |bencher| {
        let (scene, camera) = (&**scene, &**camera);
        bencher.iter(|| {
            renderer.render(scene, camera, &settled, &told).expect("it can be drawn");
        });
    });
    let Counts { splats, culled, occluded, visible, merged, .. } = *told.0.lock().expect("nobody panics");
    if visible > 0 {
        println!("    {}", way(&settled));
        println!("    {:.1} bytes a splat", scene.bytes() as f64 / splats as f64);
        println!(
            "    {splats} splats: {culled} culled, {occluded} occluded, {visible} drawn, {merged} of them merged"
        );
    }
    visible > 0
}

/// Prints what 99.9 % of the pixels that show anything are off by with levels.
fn print_error(scene: &Scene, camera: &Camera, tolerance: f64) {
    let settled = settle(scene, camera, &settings(tolerance, 1.0)).expect("it can be drawn");
    let [on, off] = [settled.level_of_detail, 0.0].map(|level_of_detail| {
        let settings = RenderSettings { level_of_detail, ..settled };
        oblate::engine::render(scene, camera, &settings, &()).expect("it can be drawn").color
    });
    let shown = |color: &[[f32; 4]]| -> Vec<f32> {
        let pixels = color.iter().zip(&on).zip(&off);
        pixels.filter(|((_, a), b)| a[3] > 0.0 || b[3] > 0.0).flat_map(|((color, _), _)| *color).collect()
    };
    let [a, b] = [shown(&on), shown(&off)];
    let pixels = |values| Pixels { width: a.len() / 4, height: 1, channels: 4, values };
    let error = compare(pixels(&a[..]), pixels(&b[..])).expect("it shows something").p999_error;
    println!("    99.9 % of the pixels are off by {:.2}/255", 255.0 * error);
}

/// A million splats, and as many in one place as a scan may have.
fn building(criterion: &mut Criterion) {
    let coincident = || {
        let count = 100_000;
        Cloud::new(Splats {
            centers: vec![Vec3::ONE; count],
            shapes: Shapes::Shared(Mat3::IDENTITY),
            strength: Strength::Extinction { masses: vec![1.0; count] },
            colors: vec![[0.5; 3]; count],
            harmonics: None,
            normals: None,
            material: Material::default(),
        })
        .expect("the numbers are finite")
    };
    let mut group = criterion.benchmark_group("building");
    group.sample_size(10);
    let cloud = LazyCell::new(surfels);
    group.bench_function("1 M surfels", |bencher| {
        bencher.iter_batched(|| cloud.clone(), Cloud::with_levels, BatchSize::PerIteration);
    });
    let cloud = LazyCell::new(coincident);
    group.bench_function("100 k in one place", |bencher| {
        bencher.iter_batched(|| cloud.clone(), Cloud::with_levels, BatchSize::PerIteration);
    });
    group.finish();
}

/// One cloud in side³ places, which together fill what it fills alone.
fn crowd(cloud: &Cloud, side: u32) -> Scene {
    let bounds = cloud.bounds().expect("it has splats");
    let (middle, size) = ((bounds[0] + bounds[1]) / 2.0, bounds[1] - bounds[0]);
    let scale = DMat3::from_diagonal(DVec3::splat(1.0 / f64::from(side)));
    let place = |i: u32| {
        let cell = DVec3::new(f64::from(i % side), f64::from(i / side % side), f64::from(i / side / side));
        let corner = (cell + 0.5 - 0.5 * f64::from(side)) * size / f64::from(side);
        DAffine3::from_mat3_translation(scale, middle + corner - scale * middle)
    };
    let clouds = (0..side.pow(3)).map(|i| cloud.clone().transformed(place(i))).collect();
    Scene { clouds, lights: Vec::new() }
}

/// Twice the usual one.
const TOLERANCE: f64 = 2.0 / 255.0;

/// From afar enough to see all of a box.
fn overview([low, high]: [DVec3; 2]) -> Camera {
    let (middle, size) = ((low + high) / 2.0, (high - low).length());
    camera(middle + DVec3::new(1.2, -1.5, 1.05).normalize() * size * 1.9, middle)
}

/// One surface in 1, 8 and 64 million samples.
fn finer(criterion: &mut Criterion) {
    for millions in [1, 8, 64] {
        let scene = LazyCell::new(|| {
            let splats = even_torus_and_sphere(millions * 1_000_000).in_morton_order();
            let cloud = Cloud::new(splats).expect("the numbers are finite").with_levels_for(TOLERANCE);
            Scene { clouds: vec![cloud], lights: Vec::new() }
        });
        let camera = LazyCell::new(|| overview(scene.clouds[0].bounds().expect("it has splats")));
        let view = (&camera, settings(TOLERANCE, 1.0));
        if draw(criterion, ["a surface in ever finer samples", &format!("{millions} M")], &scene, view) {
            print_error(&scene, &camera, TOLERANCE);
        }
    }
}

/// 1, 8 and 64 copies in one view.
fn growth(criterion: &mut Criterion) {
    type Make = fn() -> Cloud;
    let with_levels: Make = || surfels().with_levels_for(TOLERANCE);
    let volume: Make = || kernels(&volume(ENGINE), GLASS).with_levels_for(TOLERANCE);
    for (group, make, is_there) in
        [("crowd of surfels", with_levels, true), ("crowd of volumes", volume, data(ENGINE).is_file())]
    {
        if !is_there {
            continue;
        }
        let cloud = LazyCell::new(make);
        for side in [1, 2, 4] {
            let scene = LazyCell::new(|| crowd(&cloud, side));
            let name = format!("{}", side.pow(3));
            let bounds = LazyCell::new(|| {
                scene
                    .clouds
                    .iter()
                    .filter_map(Cloud::bounds)
                    .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
                    .expect("it has splats")
            });
            let camera = LazyCell::new(|| overview(*bounds));
            draw(criterion, [group, &name], &scene, (&camera, settings(TOLERANCE, 1.0)));
        }
    }
}

/// The engine from ever farther away.
fn minified(criterion: &mut Criterion) {
    if !data(ENGINE).is_file() {
        return;
    }
    let middle = DVec3::new(127.5, 127.5, 63.5);
    let cloud = LazyCell::new(|| kernels(&volume(ENGINE), GLASS).with_levels());
    for zoom in [1.0, 2.0, 4.0, 8.0, 16.0] {
        let scene = LazyCell::new(|| Scene { clouds: vec![cloud.clone()], lights: Vec::new() });
        let camera = camera(middle + DVec3::new(330.0, -412.5, 288.75) * zoom, middle);
        for (name, levels) in [("all splats", 0.0), ("levels", 1.0)] {
            draw(
                criterion,
                [&format!("engine at 1/{zoom}"), name],
                &scene,
                (&&camera, settings(1.0 / 255.0, levels)),
            );
        }
    }
}

criterion_group!(benches, building, finer, growth, minified);
criterion_main!(benches);
