//! How far iso-surfels are from surfaces that are known, beside the polygons, vertices and normals of marching cubes.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod common;

use std::f64::consts::PI;

use common::cells::{Found, polygons};
use common::*;
use glam::{DVec2, DVec3};
use oblate_volumes::{GridFrame, Interpolation, IsoExtractor, Volume, Voxels};

/// A field above 0 inside, and its volume.
struct Case {
    name: &'static str,
    field: fn(DVec3) -> f64,
    volume: Volume,
    /// Of the surface, where it is known.
    area: Option<f64>,
}

impl Case {
    /// Sampled at n points along each axis of the cube from −`half` to `half`.
    fn new(name: &'static str, (n, half): (usize, f64), field: fn(DVec3) -> f64, area: Option<f64>) -> Self {
        let step = 2.0 * half / (n as f64 - 1.0);
        let frame =
            GridFrame { spacing: DVec3::splat(step), origin: DVec3::splat(-half), ..GridFrame::default() };
        Self { name, field, volume: sampled([n; 3], frame, field), area }
    }

    fn gradient(&self, p: DVec3) -> DVec3 {
        let e = 1e-5;
        let along = |axis: DVec3| ((self.field)(p + axis * e) - (self.field)(p - axis * e)) / (2.0 * e);
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
    }

    /// To the surface, in the first order.
    fn distance(&self, p: DVec3) -> f64 {
        (self.field)(p).abs() / self.gradient(p).length()
    }

    fn angle(&self, p: DVec3, normal: DVec3) -> f64 {
        let right = -self.gradient(p).normalize();
        normal.cross(right).length().atan2(normal.dot(right)).to_degrees()
    }

    /// Whether a point is so far inside the grid that central differences are that.
    fn is_inner(&self, p: DVec3) -> bool {
        let frame = self.volume.frame();
        p.abs().max_element() < -frame.origin.x - 2.5 * frame.spacing.x
    }
}

fn sphere(p: DVec3) -> f64 {
    1.0 - (p - DVec3::new(0.013, -0.021, 0.007)).length()
}

fn torus(p: DVec3) -> f64 {
    0.35 - DVec3::new(p.truncate().length() - 0.9, p.z, 0.0).length()
}

/// The signal of Marschner and Lobb, *An Evaluation of Reconstruction Filters for Volume Rendering*, 1994, less ½.
fn ripples(p: DVec3) -> f64 {
    let ripple = (12.0 * PI * (PI * p.x.hypot(p.y) / 2.0).cos()).cos();
    (1.0 - (PI * p.z / 2.0).sin() + 0.25 * (1.0 + ripple)) / 2.5 - 0.5
}

/// Three rings in a row that touch each other, blended: the sum of exponentials is smooth where the nearest ring changes.
fn genus_3(p: DVec3) -> f64 {
    const SHARPNESS: f64 = 20.0;
    let ring = |x: f64| DVec2::new(DVec2::new(p.x - x, p.y).length() - 0.35, p.z).length();
    let near: f64 = [-0.7, 0.0, 0.7].map(|x| (-SHARPNESS * ring(x)).exp()).iter().sum();
    0.12 + near.ln() / SHARPNESS
}

fn cases() -> Vec<Case> {
    vec![
        Case::new("sphere", (40, 1.3), sphere, Some(4.0 * PI)),
        Case::new("torus", (64, 1.4), torus, Some(4.0 * PI * PI * 0.9 * 0.35)),
        Case::new("Marschner-Lobb", (200, 1.0), ripples, None),
        Case::new("genus 3", (96, 1.25), genus_3, None),
    ]
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

/// Marching cubes' normals: central differences at the ends of an edge, interpolated.
fn vertex_normal(case: &Case, vertex: DVec3) -> DVec3 {
    let volume = &case.volume;
    let index = volume.index_to_world().inverse().transform_point3(vertex);
    let low = (index + 1e-9).floor();
    let share = (index - low).max_element();
    let axis = (index - low).max_position();
    let at = |p: DVec3| {
        let index = [p.x, p.y, p.z].map(|i| i as usize);
        volume.gradient(index).as_dvec3()
    };
    let upper = low + DVec3::AXES[axis];
    if share < 1e-9 { -at(low) } else { -at(low).lerp(at(upper), share) }.normalize()
}

/// Distances and angles in the mean over all surfels, polygons and vertices well inside the grid.
///
/// Surfels on the trilinear interpolant are nearer to a surface than polygons are, where it bends as much along the grid's axes as
/// elsewhere. The ripples don't: there it is the interpolant itself that is farther away, a third at 200³ as at 128³.
#[test]
fn places_and_normals_beside_marching_cubes() {
    for case in cases() {
        let step = case.volume.frame().spacing.x;
        let found: Vec<Found> =
            polygons(&case.volume, 0.0).into_iter().filter(|f| case.is_inner(f.centroid)).collect();
        let of_centroids = mean(found.iter().map(|f| case.distance(f.centroid))) / step;
        let vertices = || found.iter().flat_map(|f| f.vertices.iter().copied());
        let of_vertices = mean(vertices().map(|v| case.distance(v))) / step;
        let mc_angle = mean(vertices().map(|v| case.angle(v, vertex_normal(&case, v))));
        let extractor = IsoExtractor::new(&case.volume);
        let [linear, cubic] = [Interpolation::Trilinear, Interpolation::Tricubic].map(|interpolation| {
            let surfels = extractor.extract(0.0, interpolation).unwrap();
            let origin = case.volume.frame().origin;
            let placed: Vec<(DVec3, DVec3)> = surfels
                .iter()
                .map(|s| (s.center.as_dvec3() + origin, s.normal().as_dvec3()))
                .filter(|(p, _)| case.is_inner(*p))
                .collect();
            let distance = mean(placed.iter().map(|(p, _)| case.distance(*p))) / step;
            (distance, mean(placed.iter().map(|(p, n)| case.angle(*p, *n))))
        });
        println!(
            "{}: marching cubes' centroids {of_centroids:.2e} steps, vertices {of_vertices:.2e}, normals \
             {mc_angle:.3}°; trilinear {:.2e}, {:.3}°; tricubic {:.2e}, {:.3}°",
            case.name, linear.0, linear.1, cubic.0, cubic.1
        );
        let most = if case.name == "Marschner-Lobb" { 1.4 } else { 1.1 };
        assert!(linear.0 <= most * of_centroids, "{}: {} {of_centroids}", case.name, linear.0);
        assert!(cubic.0 <= 0.5 * of_vertices, "{}: {} {of_vertices}", case.name, cubic.0);
        assert!(linear.1 <= 1.3 * mc_angle, "{}: {} {mc_angle}", case.name, linear.1);
        assert!(cubic.1 <= 0.5 * mc_angle, "{}: {} {mc_angle}", case.name, cubic.1);
    }
}

/// Places are on the interpolant within 1e-4 of the range, areas within 0.5 % of what they are, and each polygon's own.
#[test]
fn residuals_and_areas() {
    for case in cases() {
        let extractor = IsoExtractor::new(&case.volume);
        let surfels = extractor.extract(0.0, Interpolation::Trilinear).unwrap();
        let to_index = case.volume.index_to_world().inverse();
        let [low, high] = case.volume.value_range().unwrap();
        let residual = surfels
            .iter()
            .filter_map(|s| {
                let index = to_index.transform_point3(s.center.as_dvec3() + case.volume.frame().origin);
                case.volume.sample(index)
            })
            .fold(0.0_f32, |most, value| most.max(value.abs()));
        assert!(residual <= 1e-4 * (high - low), "{}: {residual}", case.name);
        let reference: f64 = polygons(&case.volume, 0.0).iter().map(|f| f.polygon.area).sum();
        let area = surfels.area();
        println!("{}: residual {residual:e}, area {area:.5}, {reference:.5}, {:?}", case.name, case.area);
        // Single precision.
        assert!((area / reference - 1.0).abs() < 1e-5, "{}: {area} {reference}", case.name);
        if let Some(right) = case.area {
            assert!((area / right - 1.0).abs() < 5e-3, "{}: {area} {right}", case.name);
        }
    }
}

/// Surfels are those of the polygons, one for one: areas, and covariances in the plane that is across the normal.
#[test]
fn noise_has_the_polygons_of_its_cells() {
    let mut random = Random(3);
    for (name, frame) in frames() {
        let values = (0..1000).map(|_| (random.next() * 255.0) as u8).collect();
        let volume = Volume::new([10; 3], Voxels::U8(values), frame).unwrap();
        // Between two values: no polygon without an area.
        let extractor = IsoExtractor::new(&volume);
        let surfels = extractor.extract(100.5, Interpolation::Trilinear).unwrap();
        let mut found = polygons(&volume, 100.5);
        let least_face = 1e-6;
        found.retain(|f| f.polygon.area > least_face);
        // Both in the order of cells, sheets of one cell by area.
        let mut areas: Vec<f64> = surfels.iter().map(|s| f64::from(s.area)).collect();
        let mut right: Vec<f64> = found.iter().map(|f| f.polygon.area).collect();
        areas.sort_by(f64::total_cmp);
        right.sort_by(f64::total_cmp);
        assert_eq!(areas.len(), right.len(), "{name}");
        for (area, right) in areas.iter().zip(&right) {
            assert!((area - right).abs() < 1e-4 * right + 1e-6, "{name}: {area} {right}");
        }
        // σ² along both half-axes: the trace of the polygon's covariance in its plane and of the blur.
        let total = |axes: [glam::Vec3; 2]| axes.iter().map(|a| f64::from(a.length_squared())).sum::<f64>();
        let sum: f64 = surfels.iter().map(|s| total(s.half_axes)).sum();
        assert!(sum > 0.0 && surfels.iter().all(|s| s.half_axes[0].length() >= s.half_axes[1].length()));
    }
}
