//! Clouds and cameras that several tests draw.
#![allow(
    dead_code,
    unreachable_pub,
    clippy::unwrap_used,
    reason = "a module that several test programs share"
)]

use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};
use oblate_engine::cloud::oblate_factor;
use oblate_engine::{
    Camera, Cloud, Counts, Frame, Material, Observer, Pose, RenderSettings, Scene, Shapes, Splats, Stage,
    Strength, Surface, render,
};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// Keeps the counts of a frame, and in how many rounds it was drawn.
#[derive(Default)]
pub struct Counter(pub Mutex<Counts>, pub AtomicUsize);

impl Observer for Counter {
    fn begin(&self, stage: Stage) {
        self.1.fetch_add(usize::from(stage == Stage::Footprint), Relaxed);
    }

    fn counts(&self, counts: Counts) {
        *self.0.lock().unwrap() = counts;
    }
}

/// A camera `distance` in front of the origin on the −z side, looking along +z with +y up.
pub fn camera(distance: f64, size: u32) -> Camera {
    looking_from(DVec3::new(0.0, 0.0, -distance), size)
}

/// A 30° camera that looks at the origin.
pub fn looking_from(eye: DVec3, size: u32) -> Camera {
    let up = if eye.normalize().y.abs() > 0.99 { DVec3::Z } else { DVec3::Y };
    let pose = Pose::look_at(eye, DVec3::ZERO, up).unwrap();
    Camera::perspective(pose, 30f64.to_radians(), [size; 2]).unwrap()
}

/// Colours as they are.
pub fn unshaded() -> RenderSettings {
    RenderSettings { shade: false, ..RenderSettings::default() }
}

/// Draws without an observer.
pub fn draw(clouds: Vec<Cloud>, camera: &Camera, settings: &RenderSettings) -> Frame {
    render(&Scene { clouds, lights: Vec::new() }, camera, settings, &()).unwrap()
}

/// A lattice of extinction kernels, σ = 0.7 of its spacing, that fills a box with a constant extinction.
pub fn fog(dims: [usize; 3], spacing: DVec3, extinction: f64, color: [f32; 3]) -> Cloud {
    let corner = -0.5 * (DVec3::new(dims[0] as f64, dims[1] as f64, dims[2] as f64) - 1.0) * spacing;
    let mut centers = Vec::new();
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                centers.push((corner + DVec3::new(i as f64, j as f64, k as f64) * spacing).as_vec3());
            }
        }
    }
    let mass = (extinction * spacing.x * spacing.y * spacing.z) as f32;
    kernels(centers, Mat3::from_diagonal(spacing.as_vec3() * 0.7), mass, color)
}

/// Equal extinction kernels.
pub fn kernels(centers: Vec<Vec3>, factor: Mat3, mass: f32, color: [f32; 3]) -> Cloud {
    let count = centers.len();
    Cloud::new(Splats {
        centers,
        shapes: Shapes::Shared(factor),
        strength: Strength::Extinction { masses: vec![mass; count] },
        colors: vec![color; count],
        harmonics: None,
        normals: None,
        material: Material::UNLIT,
    })
    .unwrap()
}

/// One surfel at each point with a normal, each of the same area, σ = 0.8 √area.
pub fn surfels(points: &[(Vec3, Vec3)], area: f32, color: [f32; 3], closed: bool) -> Cloud {
    let radius = 0.8 * area.sqrt();
    Cloud::new(Splats {
        centers: points.iter().map(|(center, _)| *center).collect(),
        shapes: Shapes::Each(points.iter().map(|(_, n)| oblate_factor(*n, radius, f32::INFINITY)).collect()),
        strength: Strength::Surface(Surface {
            areas: vec![area; points.len()],
            opacities: None,
            depth_tolerance: radius,
            coverage_floor: 0.98,
            closed: closed.into(),
        }),
        colors: vec![color; points.len()],
        harmonics: None,
        normals: Some(points.iter().map(|(_, normal)| *normal).collect()),
        material: Material::UNLIT,
    })
    .unwrap()
}

/// A square lattice of surfels in the plane z = 0, facing −z, `side` surfels along an edge.
pub fn plane(side: usize, spacing: f32, color: [f32; 3]) -> Cloud {
    let middle = (side as f32 - 1.0) / 2.0;
    let points: Vec<_> = (0..side * side)
        .map(|i| {
            let place = Vec3::new((i % side) as f32 - middle, (i / side) as f32 - middle, 0.0);
            (place * spacing, Vec3::NEG_Z)
        })
        .collect();
    surfels(&points, spacing * spacing, color, false)
}

/// A sphere of evenly spread surfels (Fibonacci lattice, whose coverage is even to about 1 % only).
pub fn sphere(count: usize, radius: f32, color: [f32; 3]) -> Cloud {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let points: Vec<_> = (0..count)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let across = (1.0 - z * z).sqrt();
            let normal = DVec3::new(cos * across, sin * across, z).as_vec3();
            (normal * radius, normal)
        })
        .collect();
    let area = 4.0 * std::f32::consts::PI * radius * radius / count as f32;
    let mut splats = surfels(&points, area, color, true).splats();
    if let Strength::Surface(surface) = &mut splats.strength {
        surface.coverage_floor = 0.95;
    }
    Cloud::new(splats).unwrap()
}

/// A rotation about the x axis and a shift.
pub fn tilted(degrees: f64, shift: DVec3) -> DAffine3 {
    DAffine3::from_mat3_translation(DMat3::from_rotation_x(degrees.to_radians()), shift)
}

/// Depths of neighbours that differ by more pixel widths than this are an edge: a slope of 83°.
const STEEP: f64 = 8.0;

/// Pixels in whose 3×3 neighbourhood the first surface is of one cloud and its depth goes on.
pub fn smooth(frame: &Frame, clouds: &[Cloud], camera: &Camera) -> Vec<usize> {
    let cloud_of = |id: u32| {
        let mut left = id as usize;
        clouds.iter().position(|cloud| left.checked_sub(cloud.len()).map(|rest| left = rest).is_none())
    };
    let goes_on = |place: usize, other: usize| {
        let [a, b] = [place, other].map(|i| (cloud_of(frame.id[i]), f64::from(frame.depth[i])));
        a.0 == b.0 && (a.0.is_none() || (a.1 - b.1).abs() <= STEEP * camera.pixel_width_at(a.1))
    };
    let neighbours = |place: usize| {
        let [x, y] = [place % frame.width, place / frame.width];
        let rows = y.saturating_sub(1)..(y + 2).min(frame.height);
        rows.flat_map(move |v| (x.saturating_sub(1)..(x + 2).min(frame.width)).map(move |u| (u, v)))
    };
    let inside = |place: &usize| neighbours(*place).all(|(u, v)| goes_on(*place, v * frame.width + u));
    (0..frame.color.len()).filter(inside).collect()
}
