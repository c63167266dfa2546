//! Closed surfaces seen from inside.

#![expect(clippy::unwrap_used, reason = "what is not there fails the test")]

mod scenes;

use glam::{DAffine3, DVec3};
use oblate_engine::{
    Camera, Closed, Cloud, Frame, Pose, ReferenceKind, RenderSettings, Scene, Strength, reference,
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
