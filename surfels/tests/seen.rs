//! Surfels of what a camera sees: no more of the mesh, and the same picture.

mod support;

use glam::{DAffine3, DVec3, dvec3};
use oblate_engine::{Camera, Cloud, Frame, Pose, RenderSettings, Scene, render};
use oblate_surfels::{Density, MESH_COVERAGE_FLOOR, Mesh, SamplerSettings, primitives, sample, sample_seen};
use support::{Finder, centers, mesh_of, outward, quasirandom, surface, total_area};

const SIZE: u32 = 100;
/// Pixels for a slope of 1.
const FOCAL: f64 = SIZE as f64 / 2.0;

/// 90° across.
fn camera(eye: DVec3, target: DVec3) -> Camera {
    let pose = Pose::look_at(eye, target, dvec3(0.1, 1.0, 0.2)).expect("a pose");
    Camera::perspective(pose, 90f64.to_radians(), [SIZE; 2]).expect("a camera")
}

fn seen(mesh: &Mesh, camera: &Camera) -> Vec<Cloud> {
    sample_seen(mesh, camera, &SamplerSettings::default()).expect("the mesh is right")
}

/// What is seen within an octave of depths.
fn seen_alike(mesh: &Mesh, camera: &Camera) -> Cloud {
    let [cloud] = seen(mesh, camera).try_into().expect("one cloud");
    cloud
}

/// Of the whole mesh, as dense as surfels of what is seen.
fn whole(mesh: &Mesh, seen: &Cloud) -> Cloud {
    let spacing =
        f64::from(surface(seen).depth_tolerance) / (2.0 * f64::from(oblate_surfels::MESH_SURFEL_RADIUS));
    sample(mesh, Density::Spacing(spacing), &SamplerSettings::default()).expect("the mesh is right")
}

fn picture(clouds: Vec<Cloud>, camera: &Camera) -> Frame {
    render(&Scene { clouds, lights: Vec::new() }, camera, &RenderSettings::default(), &())
        .expect("the scene is right")
}

#[test]
fn a_closed_surface_has_no_backs() {
    let mesh = mesh_of(primitives::sphere(200), DAffine3::from_translation(dvec3(0.0, 0.0, 0.4)));
    let eye = dvec3(0.0, 0.0, 2.4);
    let camera = camera(eye, DVec3::ZERO);
    let cloud = seen_alike(&mesh, &camera);
    // A sphere of radius 1 from a distance of 2 shows a quarter of itself, 1 away at the nearest. What was left out is no farther from
    // the rim than a triangle reaches, 0.03 of 2π, which has an eighth of that area.
    let share = total_area(&cloud) / mesh.area();
    assert!((share - 0.25).abs() < 0.02, "{share} of the area");
    let expected = total_area(&cloud) * FOCAL * FOCAL;
    assert!((cloud.len() as f64 / expected - 1.0).abs() < 0.1, "{} surfels for {expected}", cloud.len());
    let faces = |(center, normal): (DVec3, DVec3)| normal.dot(eye - center) > 0.0;
    assert!(centers(&cloud).into_iter().zip(outward(&cloud)).all(faces));
    assert!(surface(&cloud).closed.is_everywhere());

    let (one, all) = (picture(vec![cloud.clone()], &camera), picture(vec![whole(&mesh, &cloud)], &camera));
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
        let cloud = seen_alike(&mesh, &camera);
        // Up to 16 pixels and 5 spacings of a pixel on each side, and what is in the same blocks of 32 spacings of √2 or triangles of
        // side 1. It is turned by a few degrees.
        let most = (1.2_f64 * 20.0 + 2.0 * (21.0 + 32.0 * 1.42) * 0.2 + 2.0 * 1.42).powi(2);
        println!("{} surfels of {:.0}", cloud.len(), total_area(&cloud));
        assert!(total_area(&cloud) < most && total_area(&cloud) > 20.0 * 20.0);
        let expected = total_area(&cloud) / (10.0 / FOCAL).powi(2);
        assert!((cloud.len() as f64 / expected - 1.0).abs() < 0.1, "{} surfels for {expected}", cloud.len());
        // Nothing is missing in the corners.
        assert!(picture(vec![cloud], &camera).color.iter().all(|pixel| pixel[3] > 0.999));
    }
}

#[test]
fn a_room_has_walls() {
    let mesh = mesh_of(primitives::sphere(60), DAffine3::IDENTITY);
    for eye in [DVec3::ZERO, dvec3(0.5, 0.1, -0.3)] {
        let camera = camera(eye, dvec3(0.2, 0.3, 1.0));
        let clouds = seen(&mesh, &camera);
        assert!(clouds.iter().all(|cloud| !surface(cloud).closed.is_everywhere()), "{eye}");
        let least = picture(clouds, &camera).color.iter().map(|pixel| pixel[3]).fold(1.0, f32::min);
        assert!(least > 0.99, "{eye}: {least}");
    }
}

#[test]
fn what_is_open_has_its_backs() {
    let mut open = primitives::sphere(60);
    open.triangles.truncate(open.triangles.len() / 2);
    let mesh = mesh_of(open, DAffine3::IDENTITY);
    let clouds = seen(&mesh, &camera(dvec3(0.0, 0.0, 3.0), DVec3::ZERO));
    let area: f64 = clouds.iter().map(total_area).sum();
    assert!((area / mesh.area() - 1.0).abs() < 1e-5);
    assert!(clouds.iter().all(|cloud| !surface(cloud).closed.is_everywhere()));
}

#[test]
fn nothing_seen_is_no_cloud() {
    let mesh = mesh_of(primitives::sphere(20), DAffine3::IDENTITY);
    for (eye, target) in [([0.0, 0.0, 3.0], [0.0, 0.0, 9.0]), ([5.0, 0.0, 3.0], [5.0, 0.0, -9.0])] {
        let camera = camera(eye.into(), target.into());
        let clouds = seen(&mesh, &camera);
        assert!(clouds.is_empty());
        assert!(picture(clouds, &camera).color.iter().all(|pixel| pixel[3] == 0.0));
    }
}

#[test]
fn where_pixels_are_as_wide_as_their_depth_nothing_is_smeared() {
    let mesh = mesh_of(primitives::sphere(60), DAffine3::IDENTITY);
    let pose = Pose::look_at(dvec3(0.0, 0.0, 1.5), DVec3::ZERO, DVec3::Y).expect("a pose");
    // One pixel for a slope of 1; of the sphere the tangent cone has slopes up to 2/√5: an area of 0.8 π.
    let camera = Camera::perspective(pose, 2.0 * 24_f64.atan(), [48; 2]).expect("a camera");
    let frame = picture(seen(&mesh, &camera), &camera);
    let mut sum = 0.0;
    for (index, color) in frame.color.iter().enumerate() {
        let [x, y] = [index % 48, index / 48].map(|i| (i as f64 - 23.5).abs());
        assert!(x.max(y) < 4.0 || color[3] < 1e-3, "{} at {x}, {y}", color[3]);
        sum += f64::from(color[3]);
    }
    // What is a few pixels tall covers a little too much.
    println!("opacities sum to {sum}");
    assert!((sum / (0.8 * std::f64::consts::PI) - 1.0).abs() < 0.15, "{sum}");
}

/// A square of side 2r below an eye, at a distance of 1, that looks along it.
fn floor(r: f64) -> (Mesh, Camera) {
    let mesh = mesh_of(primitives::plane(30), DAffine3::from_scale(DVec3::splat(r)));
    (mesh, camera(dvec3(0.0, 1.0, 0.0), dvec3(0.0, 1.0, -9.0)))
}

#[test]
fn each_octave_of_depths_has_a_spacing_of_its_own() {
    let (mesh, camera) = floor(60.0);
    let clouds = seen(&mesh, &camera);
    let spacing = |cloud: &Cloud| (total_area(cloud) / cloud.len() as f64).sqrt() * FOCAL;
    // The lower border of the picture lies 45° down, at a depth of 1.
    assert_eq!(clouds.len(), 6, "up to 60");
    let forward = camera.pose().forward();
    for (number, cloud) in clouds.iter().enumerate() {
        let least = f64::from(1 << number);
        assert!((spacing(cloud) / least - 1.0).abs() < 0.1, "{number}: {} pixels", spacing(cloud));
        let depths = centers(cloud).into_iter().map(|at| forward.dot(at - camera.pose().eye()));
        let (near, far) = depths.fold((f64::INFINITY, 0.0_f64), |(a, b), z| (a.min(z), b.max(z)));
        // Blocks of 32 cells end where they do, and half of one that the octave ends in is finer still.
        let block = 32.0 * least / FOCAL;
        assert!(number == 0 || near > least, "{number} begins at {near}");
        assert!(far < 2.0 * least + 4.0 * 1.8 * block, "{number} ends at {far}");
    }
    let total: usize = clouds.iter().map(Cloud::len).sum();
    let settings = SamplerSettings { max_surfels: 1000, ..SamplerSettings::default() };
    let few = sample_seen(&mesh, &camera, &settings).unwrap();
    let kept: usize = few.iter().map(Cloud::len).sum();
    println!("{total} surfels; {kept} of at most 1000");
    assert!(kept <= 1000 && kept > 700, "{kept} surfels");
}

#[test]
fn where_octaves_meet_surfels_cover_as_evenly_as_elsewhere() {
    let (mesh, along) = floor(40.0);
    let pixel = 1.0 / FOCAL;
    for camera in [along, camera(dvec3(0.3, 1.0, 0.0), dvec3(7.0, -1.0, -9.0))] {
        let clouds = seen(&mesh, &camera);
        assert!(clouds.len() >= 5);
        let finders: Vec<Finder> = clouds
            .iter()
            .map(|cloud| Finder::new(cloud, 2.5 * f64::from(surface(cloud).depth_tolerance)))
            .collect();
        let depth = |at: DVec3| camera.pose().forward().dot(at - camera.pose().eye());
        let (mut least, mut most, mut places) = (f64::INFINITY, 0.0_f64, 0);
        for i in 0..6000 {
            // As many in each octave, within the picture.
            let [u, v] = quasirandom(i);
            let ahead = (u * 3.4).exp();
            let forward = camera.pose().forward().with_y(0.0).normalize();
            let across = forward.cross(DVec3::Y);
            let at = camera.pose().eye().with_y(0.0) + (forward + across * 0.8 * (2.0 * v - 1.0)) * ahead;
            if depth(at) < 1.0 + 5.0 * pixel || at.abs().max_element() > 39.0 {
                continue;
            }
            let coverage: f64 = finders.iter().map(|finder| finder.coverage(at, DVec3::Y)).sum();
            (least, most, places) = (least.min(coverage), most.max(coverage), places + 1);
        }
        println!("{places} places: Σw from {least} to {most}");
        assert!(places > 4000);
        assert!(least >= f64::from(MESH_COVERAGE_FLOOR) && most <= 1.15);
    }
}
