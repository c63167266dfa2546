//! Colours that depend on the view.

use super::*;

/// The constant part of a colour, display-encoded.
const GREY: f64 = 0.5;

/// A grey splat whose red changes by `coefficient` times one function, as seen along `direction` (in world space,
/// which `to_world` takes the cloud's to): its red, display-encoded.
fn seen(number: usize, coefficient: f32, direction: DVec3, to_world: DMat3) -> f64 {
    let degree = [0, 1, 1, 1, 2, 2, 2, 2, 2, 3, 3, 3, 3, 3, 3, 3][number + 1];
    let mut coefficients = vec![[0.0; 3]; [3, 8, 15][usize::from(degree) - 1]];
    coefficients[number][0] = coefficient;
    let mut splats = opacity_kernels(&[Vec3::ZERO], 0.3, 1.0, &[[srgb_to_linear(GREY as f32); 3]]).splats();
    splats.harmonics = Some(Harmonics { degree, coefficients });
    splats.material = Material::UNLIT;
    let cloud = Cloud::new(splats).unwrap().transformed(DAffine3::from_mat3(to_world));
    let (up, _) = direction.any_orthonormal_pair();
    let pose = Pose::look_at(direction * -5.0, DVec3::ZERO, up).unwrap();
    let perspective = Camera::perspective(pose, 0.5, [1, 1]).unwrap();
    let orthographic = Camera::orthographic(pose, 2.0, [1, 1]).unwrap();
    let scene = Scene { clouds: vec![cloud], lights: Vec::new() };
    let mut reds = Vec::new();
    for camera in [perspective, orthographic] {
        for blend in [Blend::Linear, Blend::Display] {
            let settings = RenderSettings { blend, ..unlit(0.0) };
            for kind in [ReferenceKind::R1, ReferenceKind::R2 { samples: 1 }] {
                let frame = reference(&scene, &camera, &settings, kind, &|_| {}).unwrap();
                let [red, green, _, alpha] = frame.color[0];
                assert!((alpha - 1.0).abs() < 1e-6);
                close(f64::from(linear_to_srgb(green)), GREY, 1e-6);
                reds.push(f64::from(linear_to_srgb(red)));
            }
        }
    }
    // The middle ray meets the centre, where the splat is opaque: camera, blending and reference make no difference.
    reds.iter().for_each(|red| close(*red, reds[0], 1e-6));
    reds[0]
}

#[test]
fn every_function_has_its_sign_and_size() {
    // By hand: with N = √((2l + 1)/4π (l − m)!/(l + m)!), times √2 for m ≠ 0, the functions are N times these
    // polynomials, in the order and with the signs of trained scenes.
    let on = |n: f64| (n / (2.0 * TAU)).sqrt();
    let half = 0.5 * on(5.0);
    type Polynomial = fn(f64, f64, f64) -> f64;
    let functions: [(f64, Polynomial); 15] = [
        (on(3.0), |_, y, _| -y),
        (on(3.0), |_, _, z| z),
        (on(3.0), |x, _, _| -x),
        (on(15.0), |x, y, _| x * y),
        (on(15.0), |_, y, z| -y * z),
        (half, |_, _, z| 3.0 * z * z - 1.0),
        (on(15.0), |x, _, z| -x * z),
        (on(15.0) / 2.0, |x, y, _| x * x - y * y),
        (on(35.0 / 8.0), |x, y, _| -y * (3.0 * x * x - y * y)),
        (on(105.0), |x, y, z| x * y * z),
        (on(21.0 / 8.0), |_, y, z| -y * (5.0 * z * z - 1.0)),
        (on(7.0) / 2.0, |_, _, z| z * (5.0 * z * z - 3.0)),
        (on(21.0 / 8.0), |x, _, z| -x * (5.0 * z * z - 1.0)),
        (on(105.0) / 2.0, |x, y, z| z * (x * x - y * y)),
        (on(35.0 / 8.0), |x, y, _| -x * (x * x - 3.0 * y * y)),
    ];
    let directions = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(2.0, -3.0, 6.0) / 7.0];
    for (number, (size, polynomial)) in functions.into_iter().enumerate() {
        for d in directions {
            let expected = GREY + 0.25 * size * polynomial(d.x, d.y, d.z);
            // Coefficients are kept in 16 bits, a pixel in single precision.
            close(seen(number, 0.25, d, DMat3::IDENTITY), expected, 1e-5);
        }
    }
}

#[test]
fn numbers_of_trained_scenes() {
    // The constants that programs of such scenes have, along z.
    close(seen(1, 0.5, DVec3::Z, DMat3::IDENTITY), 0.5 + 0.5 * 0.488_602_5, 1e-5);
    close(seen(5, 0.5, DVec3::Z, DMat3::IDENTITY), 0.5 + 0.5 * 2.0 * 0.315_391_6, 1e-5);
    close(seen(11, 0.5, DVec3::Z, DMat3::IDENTITY), 0.5 + 0.5 * 2.0 * 0.373_176_3, 1e-5);
}

#[test]
fn harmonics_turn_and_are_mirrored_with_their_cloud() {
    let constant = 0.488_602_5;
    // The cloud's x points along the world's z: seen along z it is seen along its own x, whose function is −x.
    let turned = DMat3::from_rotation_y(-std::f64::consts::FRAC_PI_2);
    assert!((turned * DVec3::X - DVec3::Z).length() < 1e-12);
    close(seen(2, 0.5, DVec3::Z, turned), 0.5 - 0.5 * constant, 1e-5);
    // Mirrored and drawn out: seen along −z of its own, whatever the lengths.
    let mirrored = DMat3::from_diagonal(DVec3::new(1.0, 3.0, -2.0));
    close(seen(1, 0.5, DVec3::Z, mirrored), 0.5 - 0.5 * constant, 1e-5);
}

#[test]
fn a_sum_below_nothing_is_black() {
    // 0.5 − 2 · 0.4886 < 0.
    close(seen(1, -2.0, DVec3::Z, DMat3::IDENTITY), 0.0, 1e-9);
}
