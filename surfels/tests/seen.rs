//! Surfels of what a camera sees: no more of the mesh, and the same picture.

mod support;

use glam::{DAffine3, DVec3, dvec3};
use oblate_engine::{Camera, Cloud, Frame, Pose, RenderSettings, Scene, render};
use oblate_surfels::{Density, Mesh, SamplerSettings, primitives, sample, sample_seen};
use support::{centers, mesh_of, outward, surface, total_area};

const SIZE: u32 = 100;
/// Pixels for a slope of 1.
const FOCAL: f64 = SIZE as f64 / 2.0;

/// 90° across.
fn camera(eye: DVec3, target: DVec3) -> Camera {
    let pose = Pose::look_at(eye, target, dvec3(0.1, 1.0, 0.2)).expect("a pose");
    Camera::perspective(pose, 90f64.to_radians(), [SIZE; 2]).expect("a camera")
}

fn seen(mesh: &Mesh, camera: &Camera) -> Cloud {
    sample_seen(mesh, camera, &SamplerSettings::default()).expect("the mesh is right")
}

/// Of the whole mesh, as dense as surfels of what is seen.
fn whole(mesh: &Mesh, seen: &Cloud) -> Cloud {
    let spacing = f64::from(surface(seen).depth_tolerance) / (2.0 * f64::from(oblate_surfels::KERNEL_SIGMA));
    sample(mesh, Density::Spacing(spacing), &SamplerSettings::default()).expect("the mesh is right")
}

fn picture(cloud: Cloud, camera: &Camera) -> Frame {
    render(&Scene { clouds: vec![cloud], lights: Vec::new() }, camera, &RenderSettings::default(), &())
        .expect("the scene is right")
}

#[test]
fn a_closed_surface_has_no_backs() {
    let mesh = mesh_of(primitives::sphere(200), DAffine3::from_translation(dvec3(0.0, 0.0, 0.4)));
    let eye = dvec3(0.0, 0.0, 2.4);
    let camera = camera(eye, DVec3::ZERO);
    let cloud = seen(&mesh, &camera);
    // A sphere of radius 1 from a distance of 2 shows a quarter of itself, 1 away at the nearest. What was left out is no farther from
    // the rim than a triangle reaches, 0.03 of 2π, which has an eighth of that area.
    let share = total_area(&cloud) / mesh.area();
    assert!((share - 0.25).abs() < 0.02, "{share} of the area");
    let expected = total_area(&cloud) * FOCAL * FOCAL;
    assert!((cloud.len() as f64 / expected - 1.0).abs() < 0.1, "{} surfels for {expected}", cloud.len());
    let faces = |(center, normal): (DVec3, DVec3)| normal.dot(eye - center) > 0.0;
    assert!(centers(&cloud).into_iter().zip(outward(&cloud)).all(faces));
    assert!(surface(&cloud).closed);

    let (one, all) = (picture(cloud.clone(), &camera), picture(whole(&mesh, &cloud), &camera));
    let pixels = one.color.iter().zip(&all.color).zip(one.depth.iter().zip(&all.depth));
    let mut compared = 0;
    for ((a, b), (z, expected)) in pixels {
        // Along the rim the two have other surfels.
        if a[3] == 1.0 && b[3] == 1.0 {
            // Depths are of surfels that lie at most half a cell's sagitta from the sphere.
            assert!((z - expected).abs() < 0.01, "{z} for {expected}");
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 4.0 / 255.0), "{a:?} for {b:?}");
            compared += 1;
        }
    }
    let alpha = |frame: &Frame| frame.color.iter().map(|c| f64::from(c[3])).sum::<f64>();
    println!("{compared} pixels alike; opacities sum to {} and {}", alpha(&one), alpha(&all));
    assert!((alpha(&one) / alpha(&all) - 1.0).abs() < 0.005);
    assert!(f64::from(compared) > 0.9 * alpha(&one));
}

#[test]
fn what_is_beside_the_picture_is_left_out() {
    // A square of side 400 below the eye; the picture shows 20 × 20 of it, 10 away.
    let place = DAffine3::from_scale(DVec3::splat(200.0));
    for cells in [1, 400] {
        let mesh = mesh_of(primitives::plane(cells), place);
        let camera = camera(dvec3(3.0, 10.0, 5.0), dvec3(3.0, 0.0, 5.0));
        let cloud = seen(&mesh, &camera);
        // Up to 16 pixels and 5 spacings of a pixel on each side, and what is in the same blocks of 32 spacings of √2 or triangles of
        // side 1. It is turned by a few degrees.
        let most = (1.2_f64 * 20.0 + 2.0 * (21.0 + 32.0 * 1.42) * 0.2 + 2.0 * 1.42).powi(2);
        println!("{} surfels of {:.0}", cloud.len(), total_area(&cloud));
        assert!(total_area(&cloud) < most && total_area(&cloud) > 20.0 * 20.0);
        let expected = total_area(&cloud) / (10.0 / FOCAL).powi(2);
        assert!((cloud.len() as f64 / expected - 1.0).abs() < 0.1, "{} surfels for {expected}", cloud.len());
        // Nothing is missing in the corners.
        assert!(picture(cloud, &camera).color.iter().all(|pixel| pixel[3] > 0.999));
    }
}

#[test]
fn what_is_open_has_its_backs() {
    let mut open = primitives::sphere(60);
    open.triangles.truncate(open.triangles.len() / 2);
    let mesh = mesh_of(open, DAffine3::IDENTITY);
    let cloud = seen(&mesh, &camera(dvec3(0.0, 0.0, 3.0), DVec3::ZERO));
    assert!((total_area(&cloud) / mesh.area() - 1.0).abs() < 1e-5);
    assert!(!surface(&cloud).closed);
}

#[test]
fn nothing_seen_is_an_empty_cloud() {
    let mesh = mesh_of(primitives::sphere(20), DAffine3::IDENTITY);
    for (eye, target) in [([0.0, 0.0, 3.0], [0.0, 0.0, 9.0]), ([5.0, 0.0, 3.0], [5.0, 0.0, -9.0])] {
        let camera = camera(eye.into(), target.into());
        let cloud = seen(&mesh, &camera);
        assert!(cloud.is_empty());
        assert!(picture(cloud, &camera).color.iter().all(|pixel| pixel[3] == 0.0));
    }
}

#[test]
fn the_nearest_sets_the_spacing_as_far_as_there_may_be_surfels() {
    // A square that goes by the eye at a distance of 1, and begins behind it.
    let mesh = mesh_of(primitives::plane(30), DAffine3::from_scale(DVec3::splat(5.0)));
    let camera = camera(dvec3(0.0, 1.0, 0.0), dvec3(0.0, 1.0, -9.0));
    let spacing = |cloud: &Cloud| (total_area(cloud) / cloud.len() as f64).sqrt();
    // At the lower border of the picture, 45° down.
    let cloud = seen(&mesh, &camera);
    assert!((spacing(&cloud) * FOCAL - 1.0).abs() < 0.1, "{} pixels", spacing(&cloud) * FOCAL);
    let settings = SamplerSettings { max_surfels: 1000, ..SamplerSettings::default() };
    let few = sample_seen(&mesh, &camera, &settings).unwrap();
    assert!(few.len() <= 1000 && few.len() > 800, "{} surfels", few.len());
}
