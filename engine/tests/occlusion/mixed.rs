//! Volumes and surfaces that hide each other.

use crate::scenes::*;
use crate::{alike, in_order};
use glam::{DAffine3, DVec3};
use oblate_engine::{Cloud, Order, RenderSettings};

fn haze(dims: [usize; 3], z: f64, extinction: f64) -> Cloud {
    let fog = in_order(&fog(dims, DVec3::splat(0.04), extinction, [0.2, 0.6, 0.9]));
    fog.transformed(DAffine3::from_translation(DVec3::new(0.0, 0.0, z)))
}

fn screen(z: f64) -> Cloud {
    in_order(&plane(200, 0.02, [0.9, 0.5, 0.1]))
        .transformed(DAffine3::from_translation(DVec3::new(0.0, 0.0, z)))
}

#[test]
fn a_volume_before_within_and_behind_a_surface() {
    let orders = [Order::Auto, Order::Centers, Order::PerPixel];
    for (name, z, least) in [("before", -2.0, 0), ("around", 0.0, 35_000), ("behind", 2.0, 90_000)] {
        for order in orders {
            let settings = RenderSettings { order, ..unshaded() };
            let clouds = [haze([40, 40, 60], z, 1.0), screen(0.0)];
            let (_, [all, rest]) = alike(&clouds, &camera(5.0, 128), &settings);
            println!("{name}, {order:?}: {} of {} left out", rest.occluded, all.visible);
            assert!(rest.occluded >= least);
        }
    }
}

#[test]
fn a_sphere_in_fog_and_fog_in_a_sphere() {
    for (radius, least) in [(0.4, 0), (2.5, 30_000)] {
        let clouds = [haze([40; 3], 0.0, 2.0), in_order(&sphere(400_000, radius, [0.8, 0.3, 0.2]))];
        for camera in [camera(6.0, 160), camera(0.2, 160), looking_from(DVec3::new(1.2, 0.9, -0.4), 160)] {
            let (_, [all, rest]) = alike(&clouds, &camera, &unshaded());
            println!("radius {radius}: {} of {} left out", rest.occluded, all.visible);
        }
        let (_, [all, rest]) = alike(&clouds, &camera(6.0, 160), &unshaded());
        assert!(all.visible - rest.visible >= least, "{} of {}", rest.visible, all.visible);
    }
}

/// What a surface hides is known kernel by kernel, by the pixels that each touches: clusters of a thousand reach beyond a small screen.
#[test]
fn what_is_behind_a_small_screen_is_left_out() {
    // A sixth of the fog, 9000 kernels, lies behind the screen. Whole cells of eight pixels are 0.7 of it each way, kernels that reach
    // six pixels leave 0.5 to 0.6, and those that reach through it, a fifth, are seen. Tilted, it cuts through the fog.
    for (degrees, least) in [(0.0, 2000), (40.0, 1000)] {
        // 0.96 on a side, before fog of 2.4 × 2.4 × 0.6 that begins 0.1 behind it.
        let small = plane(48, 0.02, [0.9, 0.5, 0.1]).transformed(tilted(degrees, DVec3::new(0.0, 0.0, -0.4)));
        let clouds = [haze([60, 60, 15], 0.0, 1.0), in_order(&small)];
        for order in [Order::Auto, Order::Centers] {
            let settings = RenderSettings { order, ..unshaded() };
            let (_, [all, rest]) = alike(&clouds, &camera(8.0, 256), &settings);
            println!("{degrees}°, {order:?}: {} of {} left out", rest.occluded, all.visible);
            assert!(rest.occluded >= least, "{} of {}", rest.occluded, all.visible);
        }
    }
}
