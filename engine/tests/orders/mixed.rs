//! Surfaces, volumes and splats in one another, each scene within a level of R1 but for one-pixel edges.

use super::scenes::{camera, kernels, looking_from, plane, smooth, sphere, tilted};
use super::*;
use oblate_engine::Pose;

fn view() -> Camera {
    looking_from(DVec3::new(2.5, 2.0, -4.5), 40)
}

fn moved(cloud: &Cloud, x: f64, y: f64, z: f64) -> Cloud {
    cloud.clone().transformed(tilted(0.0, DVec3::new(x, y, z)))
}

fn check(name: &str, clouds: &[Cloud], camera: &Camera) {
    let r1 = truth(clouds, camera, &ordered(SLABS));
    let places = smooth(&r1, clouds, camera);
    let seen = places.iter().filter(|i| r1.color[**i][3] > 0.1).count();
    assert!(
        seen > 400 && places.len() > r1.color.len() * 6 / 10,
        "{name}: {seen} of {} are seen",
        places.len()
    );
    for order in GENERAL {
        // Less than a level: a kernel of opacity ends where it falls below the tolerance, and several end in a pixel.
        let settings = RenderSettings { tolerance: LEVEL / 8.0, ..ordered(order) };
        let frame = draw(clouds.to_vec(), camera, &settings);
        let found = apart_at(&places, &frame, &r1);
        println!(
            "{name}, {order:?}: {:.1} dB, 99.9 % {:.5}, largest {:.5}, mean {:.6}",
            found.psnr_db, found.p999_error, found.max_error, found.mean_error
        );
        assert!(order != SLABS || found.max_error <= LEVEL, "{name}: {found:?}");
    }
}

#[test]
fn an_opaque_mesh_in_fog() {
    check("opaque mesh in fog", &[haze(13, 0.19, 0.8), sphere(2000, 0.7, [0.9, 0.4, 0.1])], &view());
}

#[test]
fn a_translucent_quad_between_splats() {
    let mut quad = plane(26, 0.06, [0.9, 0.8, 0.2]).splats();
    let Strength::Surface(surface) = &mut quad.strength else { unreachable!() };
    surface.opacities = Some(vec![0.5; surface.areas.len()]);
    let quad = Cloud::new(quad).unwrap().transformed(tilted(25.0, DVec3::ZERO));
    check("translucent quad between splats", &[trained(), quad], &view());
}

#[test]
fn an_ear_in_front_of_a_body() {
    // Surfels of the body have a radius of 0.04, so 0.1 is well beyond the tolerance of its depth.
    let towards = DVec3::new(2.5, 2.0, -4.5).normalize() * (0.7 + 0.1 + 0.2);
    let ear = moved(&sphere(600, 0.2, [0.1, 0.5, 0.9]), towards.x, towards.y, towards.z);
    let body = sphere(3000, 0.7, [0.9, 0.6, 0.5]);
    check("ear in front of a body", &[haze(13, 0.19, 0.8), body, ear], &view());
}

#[test]
fn a_splat_cloud_inside_a_volume() {
    check("cloud inside a volume", &[haze(13, 0.19, 0.6), trained()], &view());
}

#[test]
fn two_overlapping_volumes() {
    let other = painted(&haze(12, 0.17, 0.8), |p| [0.8, 0.5 + 0.3 * p.x, 0.1])
        .transformed(tilted(35.0, DVec3::new(0.6, 0.2, 0.4)));
    check("two overlapping volumes", &[moved(&haze(12, 0.19, 0.8), -0.4, 0.0, 0.0), other], &view());
}

#[test]
fn the_camera_inside_all() {
    let pose = Pose::look_at(DVec3::new(0.3, 0.25, -0.9), DVec3::ZERO, DVec3::Y).unwrap();
    let camera = Camera::perspective(pose, 1.0, [32; 2]).unwrap();
    let ball = moved(&sphere(1500, 0.4, [0.9, 0.4, 0.1]), -0.1, -0.1, 0.3);
    let other = painted(&haze(9, 0.25, 0.4), |p| [0.8, 0.5 + 0.3 * p.x, 0.1]);
    check(
        "camera inside all",
        &[haze(13, 0.19, 0.6), ball, moved(&other, 0.3, 0.0, -0.2), trained()],
        &camera,
    );
}

/// Before the near plane but for Φ(−3.2) of an optical depth of a thousand: a sheet far behind changes nothing of what shows.
/// They differ by rounding alone.
#[test]
fn what_the_near_plane_leaves_is_the_same_before_a_sheet() {
    let (sigma, near) = (0.3, 4.0);
    let mass = 1000.0 * std::f32::consts::TAU * sigma * sigma;
    let center = Vec3::new(0.0, 0.0, near - 3.2 * sigma - 5.0);
    let dense = kernels(vec![center], Mat3::from_diagonal(Vec3::splat(sigma)), mass, [0.2, 0.6, 0.9]);
    let camera = camera(5.0, 33).with_near(f64::from(near)).unwrap();
    let sheet = moved(&plane(100, 0.1, [1.0, 0.5, 0.0]), 0.0, 0.0, 2.0);
    for order in [Order::Centers, Order::PerPixel] {
        let settings = RenderSettings { footprint: FootprintForm::Affine, ..ordered(order) };
        let picture = |clouds| draw(clouds, &camera, &settings).color[16 * 33 + 16];
        let [alone, sheet_alone, both] =
            [vec![dense.clone()], vec![sheet.clone()], vec![dense.clone(), sheet.clone()]].map(picture);
        assert!((0.4..0.6).contains(&alone[3]), "{order:?}: {alone:?}");
        for channel in 0..4 {
            let expected = alone[channel] + (1.0 - alone[3]) * sheet_alone[channel];
            assert!((both[channel] - expected).abs() < 1e-5, "{order:?}: {both:?} over {alone:?}");
        }
    }
}
