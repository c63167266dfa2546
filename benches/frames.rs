//! Whole frames at 1024²: T1 a semi-transparent volume, T2 an iso-surface of it, T4 a million opaque surfels.
//!
//! T1 and T2 need the engine volume (`OBLATE_DATA`, else `../shared/data`) and say so where it is missing.
//! `cargo bench --bench frames`

use criterion::{Criterion, criterion_group, criterion_main};
use glam::{DVec3, Vec3};
use oblate::engine::cloud::oblate_factor;
use oblate::engine::{
    Blend, Camera, Cloud, Light, Material, Pose, RenderSettings, Scene, Shapes, Splats, Strength, Surface,
    render,
};
use oblate::importers::{OpenOptions, Opened, open};
use oblate::volumes::{IsoSettings, KernelSettings, TransferFunction, Volume, iso_surfels, to_kernels};
use std::f32::consts::{PI, TAU};
use std::path::PathBuf;

const SIZE: [u32; 2] = [1024; 2];

/// Value, sRGB colour, opacity per unit length.
const TRANSFER: &str = "transfer 1
strength opacity_per_unit
color srgb
0    0    0    0     0
8    0    0    0     0
20   0.45 0.5  0.6   0.006
60   0.5  0.5  0.55  0.01
80   0.55 0.45 0.35  0.02
140  0.75 0.65 0.5   0.05
180  0.9  0.85 0.8   0.08
220  0.95 0.4  0.2   0.6
255  1.0  0.5  0.2   0.8
";

fn engine_volume() -> Option<Volume> {
    let data = std::env::var_os("OBLATE_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    let path = data.join("volumes/engine.vti");
    match open(&path, &OpenOptions::default()) {
        Ok(Opened::Volume(volume)) => Some(volume),
        _ => {
            eprintln!("{} is missing: T1 and T2 are skipped", path.display());
            None
        }
    }
}

fn camera(eye: DVec3, target: DVec3) -> Camera {
    let pose = Pose::look_at(eye, target, DVec3::Z).expect("eye and target differ");
    Camera::perspective(pose, 30f64.to_radians(), SIZE).expect("the size is in range")
}

/// Half the surfels on a torus, half on a sphere that it surrounds, in random places.
fn torus_and_sphere(count: usize) -> Cloud {
    let mut state = 3_u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1_u64 << 24) as f32
    };
    let radius = 0.006 * (1e6 / count as f32).sqrt();
    let (mut centers, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..count {
        let (u, w) = (random() * TAU, random() * TAU);
        if i % 2 == 0 {
            let normal = Vec3::new(w.cos() * u.cos(), w.cos() * u.sin(), w.sin());
            centers.push(Vec3::new(u.cos(), u.sin(), 0.0) + normal * 0.35);
            normals.push(normal);
            colors.push([3.0 * u, 3.0 * u + 2.0, 2.0 * w + 4.0].map(|x| 0.5 + 0.45 * x.cos()));
        } else {
            let z = 2.0 * random() - 1.0;
            let normal = Vec3::new(u.cos() * (1.0 - z * z).sqrt(), u.sin() * (1.0 - z * z).sqrt(), z);
            centers.push(normal * 0.5 + Vec3::Z * 0.55);
            normals.push(normal);
            colors.push((0.5 + 0.4 * (normal * 9.0).map(f32::sin)).to_array());
        }
    }
    // Random places leave gaps of several mean distances: discs of the given radius cover them.
    let area = (4.0 * PI * PI * 0.35 + PI) / count as f32;
    Cloud::new(Splats {
        shapes: Shapes::Each(
            normals.iter().map(|n| oblate_factor(*n, radius / 2.0, f32::INFINITY)).collect(),
        ),
        strength: Strength::Surface(Surface {
            areas: vec![area; count],
            opacities: None,
            depth_tolerance: radius,
            coverage_floor: 0.5,
            closed: true,
        }),
        centers,
        colors,
        harmonics: None,
        normals: Some(normals),
        material: Material::default(),
    })
    .expect("the numbers are finite")
}

fn frames(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("frame");
    group.sample_size(10);
    let settings = RenderSettings {
        blend: Blend::Display,
        background: [0.0, 0.0, 0.0, 1.0],
        ..RenderSettings::default()
    };
    if let Some(volume) = engine_volume() {
        let camera = camera(DVec3::new(457.5, -285.0, 352.25), DVec3::new(127.5, 127.5, 63.5));
        let transfer: TransferFunction = TRANSFER.parse().expect("the text above is a transfer function");
        let kernels =
            to_kernels(&volume, &transfer, &KernelSettings::default()).expect("the volume is finite");
        let headlight = Light::Directional { towards: -camera.pose().forward(), color: [1.0; 3] };
        let scene = Scene { clouds: vec![kernels], lights: vec![headlight] };
        group.bench_function("T1 shaded", |b| b.iter(|| render(&scene, &camera, &settings, &())));
        let unshaded = RenderSettings { shade: false, ..settings };
        group.bench_function("T1 unshaded", |b| b.iter(|| render(&scene, &camera, &unshaded, &())));
        group.bench_function("T2 extract", |b| {
            b.iter(|| iso_surfels(&volume, 100.0, &IsoSettings::default()))
        });
        let surface = iso_surfels(&volume, 100.0, &IsoSettings::default()).expect("100 is finite");
        let scene = Scene { clouds: vec![surface], lights: Vec::new() };
        group.bench_function("T2 draw", |b| b.iter(|| render(&scene, &camera, &settings, &())));
    }
    let camera = camera(DVec3::new(3.0, -3.6, 2.6), DVec3::new(0.0, 0.0, 0.2));
    let scene = Scene { clouds: vec![torus_and_sphere(1_000_000)], lights: Vec::new() };
    group.bench_function("T4 1 M surfels", |b| b.iter(|| render(&scene, &camera, &settings, &())));
    group.finish();
}

criterion_group!(benches, frames);
criterion_main!(benches);
