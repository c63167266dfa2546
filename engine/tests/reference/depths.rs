//! Median depth.

use super::*;

fn half() -> f64 {
    2f64.ln()
}

/// A kernel of σ = ½ at z = 5 that has an optical depth on its axis.
fn kernel(optical_depth: f64) -> Cloud {
    kernels(&[Vec3::Z * 5.0], 0.5, (optical_depth * TAU * 0.25) as f32, &[RED])
}

#[test]
fn a_kernel_lets_half_through_at_a_quantile() {
    // z + σΦ⁻¹(ln 2/τ), with shares whose quantiles are in every table.
    let shares = [(0.5, 0.0), (0.25, -0.674_489_75), (0.841_344_746, 1.0), (0.022_750_132, -2.0)];
    for camera in [perspective(10.0, 1), orthographic(1.0, 1)] {
        for (share, quantile) in shares {
            let frame = draw(vec![kernel(half() / share)], &camera, &unlit(0.0));
            // Masses and depths are f32: 6e-8 of τ, of which a quantile here moves by less than 5 times; 2.4e-7 of z.
            close(f64::from(frame.median_depth[0]), 5.0 + 0.5 * quantile, 6e-7);
        }
        let frame = draw(vec![kernel(0.999 * half())], &camera, &unlit(0.0));
        assert_eq!(frame.median_depth[0], f32::INFINITY);
        // The near plane leaves the farther half: Φ = ½ + ¼.
        let frame = draw(vec![kernel(4.0 * half())], &camera.with_near(5.0).unwrap(), &unlit(0.0));
        close(f64::from(frame.median_depth[0]), 5.0 + 0.5 * 0.674_489_75, 6e-7);
    }
}

/// Unit lattice of kernels from z = 10 on: extinction begins at z = 9.5, and is even from 3 behind that on, where the
/// kernels that are missing before it would have ended (4.3σ, 1e-5).
fn slab(density: f32) -> Cloud {
    let place = |i: i32| Vec3::new((i % 15 - 7) as f32, (i / 15 % 15 - 7) as f32, 10.0 + (i / 225) as f32);
    let centers: Vec<Vec3> = (0..225 * 12).map(place).collect();
    kernels(&centers, 0.7, density, &vec![GREEN; centers.len()])
}

#[test]
fn a_slab_lets_half_through_at_ln_2_over_its_extinction() {
    let camera = orthographic(5.0, 7);
    for density in [0.07, 0.1, 0.2] {
        let depth = half() / f64::from(density);
        for kind in [ReferenceKind::R1, ReferenceKind::R2 { samples: 9 }] {
            let scene = Scene { clouds: vec![slab(density)], lights: Vec::new() };
            let frame = reference(&scene, &camera, &unlit(0.3), kind, &|_| {}).unwrap();
            for median in &frame.median_depth {
                // The lattice ripples by 2.5e-4 across the ray, and by 2.5e-4/2π along it.
                close(f64::from(*median), 9.5 + depth, 2.5e-4 * depth + 5e-5);
            }
        }
    }
}

#[test]
fn surfaces_are_where_half_passes_if_what_is_before_lets_more_through() {
    let camera = orthographic(4.0, 5);
    let sheet = |z: f32, opacity: f32| plane(Vec3::Z * z, Vec3::NEG_Z, 8, opacity, RED);
    let median = |clouds: Vec<Cloud>| f64::from(draw(clouds, &camera, &unlit(0.0)).median_depth[12]);
    // Half of the light is left at 14.12.
    close(median(vec![slab(0.15), sheet(13.0, 1.0)]), 13.0, 1e-5);
    close(median(vec![slab(0.15), sheet(16.0, 1.0)]), 9.5 + half() / 0.15, 2e-3);
    // Of two that let 0.6 through each it is the farther one; fog between them takes its share.
    assert_eq!(median(vec![sheet(12.0, 0.4)]), f64::INFINITY);
    close(median(vec![sheet(12.0, 0.4), sheet(20.0, 0.4)]), 20.0, 1e-5);
    let expected = 12.0 + 1.2f64.ln() / 0.05;
    let fog = slab(0.05).transformed(DAffine3::from_translation(DVec3::Z * 2.5));
    close(median(vec![sheet(12.0, 0.4), fog, sheet(20.0, 0.4)]), expected, 2e-3);
}

#[test]
fn kernels_by_their_centres_let_half_through_at_one_of_them() {
    // 0.7² < ½: the second one in distance, which is the first in the cloud.
    let centers = [5.1, 5.0, 5.2].map(|z| Vec3::Z * z);
    let frame =
        draw(vec![opacity_kernels(&centers, 0.5, 0.3, &[RED; 3])], &orthographic(4.0, 1), &unlit(0.0));
    close(f64::from(frame.median_depth[0]), 5.1, 1e-6);
}

#[test]
fn a_pixel_that_an_edge_divides_is_as_deep_as_its_larger_part() {
    // As above for coverage: a sheet to the right of x = ±½, seen through a filter of σ = 4, hides 0.45 or 0.55 of what
    // is behind.
    let camera = orthographic(0.025, 1);
    let right_of = |x: f32| {
        let mut splats = plane(Vec3::Z * 10.0, Vec3::NEG_Z, 40, 1.0, WHITE).splats();
        splats.centers.retain(|center| center.x > x);
        let count = splats.centers.len();
        splats.colors.truncate(count);
        splats.normals = None;
        let Strength::Surface(surface) = &mut splats.strength else { unreachable!() };
        surface.areas.truncate(count);
        surface.opacities = None;
        Cloud::new(splats).unwrap()
    };
    let wall = || plane(Vec3::Z * 20.0, Vec3::NEG_Z, 40, 1.0, GREEN);
    for (edge, behind, expected) in
        [(0.25, true, 20.0), (-0.75, true, 10.0), (0.25, false, f64::INFINITY), (-0.75, false, 10.0)]
    {
        let mut clouds = vec![right_of(edge)];
        clouds.extend(behind.then(wall));
        let scene = Scene { clouds, lights: Vec::new() };
        let kind = ReferenceKind::R2 { samples: 1024 };
        let frame = reference(&scene, &camera, &unlit(0.01), kind, &|_| {}).unwrap();
        let median = f64::from(frame.median_depth[0]);
        assert!(median == expected || (median - expected).abs() < 1e-5, "{median}, not {expected}");
    }
}
