//! What is seen from afar is what is seen from nearby, where rays are parallel.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod scenes;

use glam::{DVec3, Mat3, Vec3};
use oblate_engine::{Camera, Frame, Order, Pose, RenderSettings};
use scenes::{draw, unshaded};

/// From a million times as far away as it is deep single precision would tell only eight depths of it apart.
#[test]
fn parallel_rays_show_from_afar_what_they_show_from_nearby() {
    let ball = scenes::sphere(3000, 1.0, [0.9, 0.5, 0.1]);
    let two = [Vec3::new(0.9, 0.1, 0.0), Vec3::new(0.8, -0.1, 0.7)];
    let mist = scenes::kernels(two.to_vec(), Mat3::IDENTITY * 0.4, 0.4, [0.1, 0.3, 0.9]);
    let seen_from = |distance: f64, near: f64| {
        let eye = DVec3::new(0.6, 0.48, 0.64) * distance;
        let pose = Pose::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap();
        let camera = Camera::orthographic(pose, 3.0, [48; 2]).unwrap().with_near(near).unwrap();
        let settings = RenderSettings { order: Order::Centers, ..unshaded() };
        draw(vec![ball.clone(), mist.clone()], &camera, &settings)
    };
    let nearby = seen_from(8.0, 0.0);
    let cut = seen_from(8.0, 7.5);
    let largest = |a: &Frame, b: &Frame| {
        let channels = a.color.as_flattened().iter().zip(b.color.as_flattened());
        channels.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    assert!(largest(&nearby, &cut) > 0.1, "the near plane cuts nothing");
    for beyond in [1e3, 8e6] {
        let [afar, cut_afar] = [0.0, beyond + 7.5].map(|near| seen_from(8.0 + beyond, near));
        // Depths differ by a millionth of 16 to 32 times as much as the scene is deep, and colours change from one side of the ball to the other.
        let errors = [largest(&nearby, &afar), largest(&cut, &cut_afar)];
        assert!(errors.iter().all(|error| *error < 1e-3), "{errors:?} from {beyond}");
        let depths = |f: &Frame| [f.depth.clone(), f.expected_depth.clone(), f.median_depth.clone()].concat();
        for (near, far) in depths(&nearby).iter().zip(depths(&afar)) {
            let off = (f64::from(far) - f64::from(*near) - beyond).abs();
            // To half a unit in the last place.
            assert!(*near == far || off <= 1e-4 + 6e-8 * beyond, "{near} {far}");
        }
    }
}
