//! Closed surfaces and volumes seen from inside.

#![expect(clippy::unwrap_used, reason = "what is not there fails the test")]

mod scenes;

use glam::{DAffine3, DVec3};
use oblate_engine::simd::Level;
use oblate_engine::{
    Camera, Closed, Cloud, Frame, Light, Order, Pose, Projection, ReferenceKind, RenderSettings, Renderer,
    Scene, Strength, reference,
};
use scenes::{draw, sphere, unshaded};

const SIZE: u32 = 48;

fn camera(eye: DVec3, is_parallel: bool) -> Camera {
    camera_of(eye, is_parallel.then_some(0.5))
}

/// Of a height, if rays are parallel.
fn camera_of(eye: DVec3, height: Option<f64>) -> Camera {
    let pose = Pose::look_at(eye, eye + DVec3::Z, DVec3::Y).unwrap();
    if let Some(height) = height {
        Camera::orthographic(pose, height, [SIZE; 2]).unwrap()
    } else {
        Camera::perspective(pose, 1.2, [SIZE; 2]).unwrap()
    }
}

fn ball(closed: Closed) -> Cloud {
    let mut splats = sphere(4000, 1.0, [0.25, 0.5, 0.75]).splats();
    let Strength::Surface(surface) = &mut splats.strength else { unreachable!("they are surfels") };
    surface.closed = closed;
    // Elsewhere, and turned: what counts is where it is in the world.
    Cloud::new(splats).unwrap().transformed(DAffine3::from_axis_angle(DVec3::ONE.normalize(), 0.7))
}

fn pictures(closed: Closed, camera: &Camera, settings: &RenderSettings) -> [Frame; 2] {
    let scene = Scene { clouds: vec![ball(closed)], lights: Vec::new() };
    let exact = reference(&scene, camera, settings, ReferenceKind::R1, &|_| ()).unwrap();
    [draw(scene.clouds, camera, settings), exact]
}

fn least_alpha(frame: &Frame) -> f32 {
    frame.color.iter().map(|pixel| pixel[3]).fold(1.0, f32::min)
}

#[test]
fn who_is_in_a_body_sees_its_walls() {
    for is_parallel in [false, true] {
        for eye in [DVec3::ZERO, DVec3::new(0.3, -0.2, 0.5)] {
            for frame in pictures(Closed::EVERYWHERE, &camera(eye, is_parallel), &unshaded()) {
                // Coverage is even to 1 %, and whole from its floor of 0.98 on.
                assert!(least_alpha(&frame) > 0.99, "{eye}, {is_parallel}: {}", least_alpha(&frame));
            }
        }
    }
}

#[test]
fn a_body_is_where_it_stands() {
    // Stretched along x, mirrored and moved, and with levels of detail: the eye is within 3 of the middle along x alone.
    let place = DAffine3::from_scale_rotation_translation(
        DVec3::new(3.0, 1.0, -1.0),
        glam::DQuat::from_rotation_z(0.4),
        DVec3::new(10.0, 20.0, 30.0),
    );
    for levels in [false, true] {
        let mut cloud = Cloud::new(sphere(4000, 1.0, [1.0; 3]).splats()).unwrap();
        if levels {
            cloud = cloud.with_levels();
        }
        let cloud = cloud.transformed(place);
        let seen = |from: DVec3| {
            let eye = place.transform_point3(from);
            let frame = draw(vec![cloud.clone()], &camera(eye, false), &unshaded());
            (least_alpha(&frame), frame.depth[(SIZE * SIZE / 2 + SIZE / 2) as usize])
        };
        assert!(seen(DVec3::new(0.8, 0.0, 0.0)).0 > 0.99, "{levels}");
        // The far side of a body that is seen from outside isn't: what is nearest is its front, at a distance of 3.
        assert!((seen(DVec3::new(0.0, 0.0, 4.0)).1 - 3.0).abs() < 0.02, "{levels}");
    }
}

#[test]
fn what_the_near_plane_opens_shows_its_other_side() {
    // From 2 before the middle the nearest place is 1 away: with the near plane behind it one looks at the far wall from inside.
    for is_parallel in [false, true] {
        let camera = camera(DVec3::NEG_Z * 2.0, is_parallel).with_near(1.3).unwrap();
        for frame in pictures(Closed::EVERYWHERE, &camera, &unshaded()) {
            let middle = frame.depth[(SIZE * SIZE / 2 + SIZE / 2) as usize];
            // σ of a surfel is 0.8 √(4π/4000) = 0.045: within 3.5 of them the wall is 0.013 flatter than a plane.
            assert!((middle - 3.0).abs() < 0.013, "{is_parallel}: {middle}");
        }
    }
}

#[test]
fn one_sided_sheets_have_no_backs_from_anywhere() {
    for is_parallel in [false, true] {
        for frame in pictures(Closed::OneSided, &camera(DVec3::ZERO, is_parallel), &unshaded()) {
            assert!(frame.color.iter().all(|pixel| pixel[3] == 0.0));
        }
        // Backs show along the outline.
        let outside = camera_of(DVec3::NEG_Z * 3.0, is_parallel.then_some(3.0));
        let [one_sided, body, open] = [Closed::OneSided, Closed::EVERYWHERE, Closed::Nowhere]
            .map(|closed| pictures(closed, &outside, &unshaded()));
        for [one_sided, body, open] in [0, 1].map(|i| [&one_sided[i], &body[i], &open[i]]) {
            assert!(one_sided.color == body.color && body.color != open.color, "{is_parallel}");
        }
    }
}

/// Mean and median depths in even fog, from its middle: the mean of z over e^{−τ} and where τ = ln 2, in closed form. Parallel rays also see what lies
/// behind the eye.
#[test]
fn depths_in_fog_around_the_eye_are_where_light_is_lost() {
    let fog = scenes::fog([32; 3], DVec3::splat(1.0 / 16.0), 1.0, [1.0; 3]);
    let scene = Scene { clouds: vec![fog], lights: Vec::new() };
    let perspective = scenes::camera(0.3, 33);
    let parallel = Camera::orthographic(perspective.pose(), 1.0, [33; 2]).unwrap();
    let from_behind = parallel.with_near(-5.0).unwrap();
    for order in [Order::Auto, Order::Slabs { thickness: 0.5 }, Order::Centers] {
        for camera in [perspective, parallel, from_behind] {
            for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
                let settings = RenderSettings { order, ..unshaded() };
                let mut renderer = Renderer::with(level, 16);
                let frame = renderer.render(&scene, &camera, &settings, &()).unwrap();
                for (place, (mean, median)) in
                    frame.expected_depth.iter().zip(&frame.median_depth).enumerate()
                {
                    let pixel =
                        [place % 33, place / 33].map(|at| at as f64 + 0.5 - camera.intrinsics().center.x);
                    let slopes = pixel.map(|at| at / camera.intrinsics().focal.x);
                    // Extinction along z, and where the fog begins and ends.
                    let is_parallel = camera.projection() == Projection::Orthographic;
                    let k =
                        if is_parallel { 1.0 } else { (1.0 + slopes[0].powi(2) + slopes[1].powi(2)).sqrt() };
                    let (begin, end) = ((-0.7_f64).max(camera.near()), 1.3);
                    let length = end - begin;
                    let left = (-k * length).exp();
                    let expected = [begin + 1.0 / k - length * left / (1.0 - left), begin + 2.0_f64.ln() / k];
                    let errors =
                        [f64::from(*mean) - expected[0], f64::from(*median) - expected[1]].map(f64::abs);
                    // σ is 0.044, by which the box's ends are blurred; sorted kernels lose light at their centres, a sixteenth apart.
                    let most = [0.02, if order == Order::Centers { 0.02 + 1.0 / 32.0 } else { 0.02 }];
                    let what = format!("{order:?}, {level:?}, near {}, pixel {place}", camera.near());
                    assert!(
                        errors[0] < most[0] && errors[1] < most[1],
                        "{what}: mean {mean}, median {median}, not {expected:?}"
                    );
                }
            }
        }
    }
}

/// With parallel rays the eye is nowhere: what lies behind it shows the side, and has the light, that it has from farther back.
#[test]
fn parallel_rays_show_what_is_behind_the_eye_as_from_farther_back() {
    let scene = Scene {
        clouds: vec![ball(Closed::Nowhere)],
        lights: vec![Light::Directional { towards: DVec3::new(0.3, 0.6, -0.8), color: [1.0; 3] }],
    };
    let pictures = [0.0, -5.0].map(|z| {
        let camera = camera_of(DVec3::new(0.0, 0.0, z), Some(2.4)).with_near(-5.0 - z).unwrap();
        let settings = RenderSettings::default();
        let frame = oblate_engine::render(&scene, &camera, &settings, &()).unwrap();
        let exact = reference(&scene, &camera, &settings, ReferenceKind::R1, &|_| ()).unwrap();
        [(frame, z), (exact, z)]
    });
    let [within, back] = pictures;
    for ((within, z), (back, from)) in within.iter().zip(&back) {
        assert!(back.color.iter().filter(|color| color[3] > 0.99).count() > 500);
        for (pixel, color) in back.color.iter().enumerate() {
            // Single precision has the ball's places from −1 to 1 as exactly as those from 4 to 6, or more so.
            let off = (0..4).map(|c| (color[c] - within.color[pixel][c]).abs()).fold(0.0, f32::max);
            assert!(off < 2e-3, "{pixel}: {:?}, not {color:?}", within.color[pixel]);
            if color[3] > 0.99 {
                let turned =
                    (0..3).map(|axis| back.normal[pixel][axis] * within.normal[pixel][axis]).sum::<f32>();
                let farther = f64::from(back.depth[pixel] - within.depth[pixel]);
                assert!(
                    turned > 0.999 && (farther - (z - from)).abs() < 1e-3,
                    "{pixel}: {turned}, {farther}"
                );
            }
        }
    }
}
