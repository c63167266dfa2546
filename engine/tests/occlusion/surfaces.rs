//! Surfaces behind surfaces.

use crate::scenes::*;
use crate::{alike, in_order};
use glam::{DAffine3, DVec3, Vec3};
use oblate_engine::{Camera, Cloud, Pose, RenderSettings, Renderer, Scene, Strength};

/// Spheres in each other.
fn nested(count: usize, closed: bool) -> Vec<Cloud> {
    (0..6)
        .map(|i| {
            let radius = 0.7_f32.powi(i);
            let mut splats =
                sphere(count, radius, [0.9 - 0.15 * i as f32, 0.1 + 0.15 * i as f32, 0.4]).splats();
            if let Strength::Surface(surface) = &mut splats.strength {
                surface.closed = closed.into();
            }
            Cloud::new(splats.in_morton_order()).unwrap()
        })
        .collect()
}

/// A dense wall at z, `half` wide to either side, without the surfels whose centres `is_open`.
fn wall(z: f32, half: f32, color: [f32; 3], is_open: impl Fn(f32, f32) -> bool) -> Cloud {
    let side = 160;
    let spacing = 2.0 * half / side as f32;
    let at = |i: usize| (i as f32 + 0.5) * spacing - half;
    let points: Vec<_> = (0..side * side)
        .map(|i| Vec3::new(at(i % side), at(i / side), z))
        .filter(|p| !is_open(p.x, p.y))
        .map(|p| (p, Vec3::NEG_Z))
        .collect();
    in_order(&surfels(&points, spacing * spacing, color, false))
}

fn with_opacity(cloud: &Cloud, opacity: f32) -> Cloud {
    let mut splats = cloud.splats();
    if let Strength::Surface(surface) = &mut splats.strength {
        surface.opacities = Some(vec![opacity; surface.areas.len()]);
    }
    Cloud::new(splats).unwrap()
}

fn parallel(size: u32) -> Camera {
    let pose = Pose::look_at(DVec3::new(0.3, 0.4, -4.0), DVec3::ZERO, DVec3::Y).unwrap();
    Camera::orthographic(pose, 2.4, [size; 2]).unwrap()
}

#[test]
fn most_of_nested_spheres_is_left_out() {
    for closed in [true, false] {
        let clouds = nested(80_000, closed);
        let mut cameras = vec![camera(4.2, 256), parallel(256)];
        // Seen from within there is less to hide.
        let inside = [looking_from(DVec3::new(0.2, 0.1, -0.93), 256)];
        cameras.extend(inside);
        for (number, camera) in cameras.iter().enumerate() {
            let (frame, [all, rest]) = alike(&clouds, camera, &RenderSettings::default());
            let left_out = 1.0 - rest.visible as f64 / all.visible as f64;
            println!("closed: {closed}, camera {number}: {left_out:.3} of {} left out", all.visible);
            assert!(frame.color[128 * 256 + 128][3] > 0.9);
            // Clusters are large here: what is near the outer one of the six spheres is drawn, too.
            assert!(left_out > if number < 2 { 0.6 } else { 0.9 }, "{left_out}");
        }
    }
}

#[test]
fn in_pictures_of_a_few_squares_nothing_is_guessed() {
    let clouds: Vec<_> = (0..8).map(|i| wall(0.3 * i as f32, 2.5, [0.9, 0.1, 0.1], |_, _| false)).collect();
    // Sixteen squares of eight pixels, and nine.
    for (size, leaves_out) in [(32, true), (24, false)] {
        let (_, [_, rest]) = alike(&clouds, &camera(4.2, size), &RenderSettings::default());
        assert_eq!(rest.occluded > 0, leaves_out, "{size}");
    }
}

#[test]
fn a_hole_of_a_pixel_shows_what_is_far_behind() {
    let camera = camera(4.0, 256);
    // Surfels are 3/4 of a pixel apart and reach into the hole: about a pixel of it stays open.
    let pixel = camera.pixel_width_at(4.0) as f32;
    let half = 40.0 * pixel;
    let hole =
        |x: f32, y: f32| (x - 0.5 * pixel).abs() < 1.6 * pixel && (y + 3.5 * pixel).abs() < 1.6 * pixel;
    let walls = |is_open: &dyn Fn(f32, f32) -> bool| {
        let mut clouds = vec![wall(0.0, 1.5 * half, [0.9, 0.1, 0.1], is_open)];
        clouds.extend((1..8).map(|i| {
            let z = 0.5 * i as f32;
            // The hole goes on through all but the last one.
            let along = |x: f32, y: f32| is_open(x * 4.0 / (4.0 + z), y * 4.0 / (4.0 + z));
            let [red, green] = [[0.9, 0.1, 0.1], [0.1, 0.9, 0.1]];
            if i < 7 { wall(z, half, red, along) } else { wall(z, half, green, |_, _| false) }
        }));
        clouds
    };
    let (closed, [all, rest]) = alike(&walls(&|_, _| false), &camera, &unshaded());
    assert!(rest.occluded > all.visible / 8, "{} of {}", rest.occluded, all.visible);
    let (open, [all, rest]) = alike(&walls(&hole), &camera, &unshaded());
    assert!(rest.occluded > all.visible / 8, "{} of {}", rest.occluded, all.visible);
    let greenest =
        |frame: &oblate_engine::Frame| frame.color.iter().map(|c| c[1] - c[0]).fold(-1.0, f32::max);
    assert!(greenest(&closed) <= 0.0, "{}", greenest(&closed));
    assert!(greenest(&open) > 0.1, "{}", greenest(&open));
}

#[test]
fn a_fence_is_taken_for_a_wall_and_what_is_behind_is_seen_through_it() {
    let camera = camera(4.0, 256);
    let pixel = camera.pixel_width_at(4.0) as f32;
    // A quarter of it is open, in slits that surfels, 3/4 of a pixel apart, do not close: so squares of eight pixels seem covered.
    let is_open = |x: f32, _: f32| (x / (16.0 * pixel)).rem_euclid(1.0) < 0.25;
    let mut clouds = vec![wall(0.0, 60.0 * pixel, [0.9, 0.1, 0.1], is_open)];
    clouds.extend((1..6).map(|i| wall(0.3 * i as f32, 50.0 * pixel, [0.1, 0.9, 0.1], |_, _| false)));
    let (frame, [all, rest]) = alike(&clouds, &camera, &unshaded());
    assert!(rest.occluded > all.visible / 8, "{} of {}", rest.occluded, all.visible);
    let greenest = frame.color.iter().map(|c| c[1] - c[0]).fold(-1.0, f32::max);
    assert!(greenest > 0.5, "{greenest}");
    let rounds = |occlusion: bool| {
        let (scene, counter) =
            (Scene { clouds: clouds.clone(), lights: Vec::new() }, crate::scenes::Counter::default());
        let settings = RenderSettings { occlusion, ..unshaded() };
        oblate_engine::render(&scene, &camera, &settings, &counter).unwrap();
        counter.1.into_inner()
    };
    assert_eq!(rounds(false), 1);
    assert!(rounds(true) > 1, "the first wall behind the fence was not missing");
}

#[test]
fn where_little_is_hidden_all_is_drawn_at_once() {
    // Two spheres beside each other, a third of one behind the other: less than a fifth of what is seen.
    let one = in_order(&sphere(60_000, 0.5, [0.3, 0.6, 0.9]));
    let clouds = [DVec3::ZERO, DVec3::new(0.6, 0.0, 1.5)]
        .map(|to| one.clone().transformed(DAffine3::from_translation(to)));
    let (_, [all, rest]) = alike(&clouds, &camera(4.0, 256), &RenderSettings::default());
    assert_eq!(rest.occluded, 0);
    assert_eq!(rest.visible, all.visible);
}

#[test]
fn glass_that_is_nearly_opaque_hides_only_what_it_may() {
    let camera = camera(4.0, 128);
    for opacity in [0.5, 0.97, 0.999, 0.9991] {
        let clouds: Vec<_> = (0..8)
            .map(|i| {
                let [z, half] = [0.3 * i as f32, 1.4 - 0.1 * i as f32];
                with_opacity(&wall(z, half, [0.1 * i as f32, 1.0, 0.5], |_, _| false), opacity)
            })
            .collect();
        let (_, [all, rest]) = alike(&clouds, &camera, &unshaded());
        println!("α = {opacity}: {} of {} left out", rest.occluded, all.visible);
        // A quarter of a tolerance of 1/255: 0.999 lets a little more through, so two walls count.
        assert!(opacity < 0.99 || rest.occluded > all.visible / 3);
    }
}

#[test]
fn rows_of_spheres_at_the_borders_of_the_picture() {
    let one = in_order(&sphere(40_000, 0.5, [0.3, 0.6, 0.9]));
    for shift in [DVec3::ZERO, DVec3::new(0.9, -0.8, 0.0), DVec3::new(-0.65, 1.0, 0.3)] {
        let clouds: Vec<_> = (0..45)
            .map(|i| {
                let place =
                    DVec3::new(f64::from(i % 3) - 1.0, f64::from(i / 3 % 3) - 1.0, 1.3 * f64::from(i / 9));
                one.clone().transformed(DAffine3::from_translation(0.75 * place + shift))
            })
            .collect();
        for camera in [camera(3.0, 150), camera(0.9, 150), parallel(150)] {
            let (_, [all, rest]) = alike(&clouds, &camera, &RenderSettings::default());
            println!("{} of {} left out", rest.occluded, all.visible);
            assert!(rest.occluded > 0);
        }
    }
}

#[test]
fn the_picture_is_the_same_for_any_number_of_threads_and_side_of_tiles() {
    let clouds = nested(60_000, true);
    let scene = Scene { clouds, lights: Vec::new() };
    let draw = |threads: usize, side: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut renderer = Renderer::with(oblate_engine::simd::Level::best(), side);
        let counter = crate::scenes::Counter::default();
        let settings = RenderSettings::default();
        pool.install(|| renderer.render(&scene, &camera(4.2, 200), &settings, &counter).map(|_| ())).unwrap();
        (renderer.into_frame(), counter.0.into_inner().unwrap())
    };
    let [one, three] = [1, 3].map(|threads| draw(threads, 32));
    assert!(one.1.occluded > 0);
    assert_eq!(one, three);
    // Sums begin at tiles: rounding differs.
    let small = draw(2, 8);
    assert!(small.1.occluded > 0);
    for (a, b) in one.0.color.iter().zip(&small.0.color) {
        assert!((0..4).all(|i| (a[i] - b[i]).abs() < 1e-4), "{a:?}, {b:?}");
    }
}
