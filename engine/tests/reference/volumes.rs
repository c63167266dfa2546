//! Volume kernels along rays.

use super::*;

#[test]
fn one_kernel_is_its_line_integral_at_every_pixel() {
    let (sigma, mass, center) = (0.3f32, 0.4f32, Vec3::new(0.25, -0.5, 4.0));
    let frame = draw(vec![kernels(&[center], sigma, mass, &[RED])], &perspective(20.0, 21), &unlit(0.0));
    for (at, color) in frame.color.iter().enumerate() {
        let pixel = DVec2::new((at % 21) as f64 + 0.5, (at / 21) as f64 + 0.5);
        let ray = ((pixel - 10.5) / 20.0).extend(1.0).normalize();
        let distance = center.as_dvec3().cross(ray).length() / f64::from(sigma);
        // Cut at 6σ: e⁻¹⁸ of the mass.
        let tau = f64::from(mass) / (TAU * f64::from(sigma).powi(2)) * (-0.5 * distance * distance).exp();
        let alpha = 1.0 - (-tau).exp();
        close(f64::from(color[3]), alpha, 1e-7);
        close(f64::from(color[0]), alpha, 1e-5);
        // Without a surface there is no depth; the expected one is near the densest point, which is
        // the foot of the perpendicular, moved by the kernel's own extinction by less than σ.
        if alpha > 1e-3 {
            let foot = center.as_dvec3().dot(ray) * ray.z;
            close(f64::from(frame.expected_depth[at]), foot, 0.3);
        }
        assert_eq!((frame.depth[at], frame.id[at]), (f32::INFINITY, Frame::NO_ID));
    }
}

#[test]
fn low_pass_widens_a_kernel_in_the_picture_plane() {
    let settings = unlit(0.3);
    // σ = 0.1 at z = 5 with f = 50 is 1 px.
    let frame = draw(vec![kernels(&[Vec3::Z * 5.0], 0.1, 0.01, &[RED])], &perspective(50.0, 1), &settings);
    let variance = 0.01 * 1.3;
    // f32's 0.1 squared is off by 3e-8 relative.
    close(f64::from(frame.color[0][3]), 1.0 - (-0.01f64 / (TAU * variance)).exp(), 1e-6);
    let wide = draw(vec![kernels(&[Vec3::Z * 5.0], 0.1, 0.01, &[RED])], &orthographic(10.0, 1), &settings);
    close(f64::from(wide.color[0][3]), f64::from(frame.color[0][3]), 1e-7);
}

#[test]
fn slab_of_constant_density_obeys_beer_and_lambert() {
    let mut centers = Vec::new();
    for z in 0..12 {
        for y in -7..=7 {
            for x in -7..=7 {
                centers.push(Vec3::new(x as f32, y as f32, 10.0 + z as f32));
            }
        }
    }
    let colors = vec![GREEN; centers.len()];
    let density = 0.15f64;
    let slab = kernels(&centers, 0.7, density as f32, &colors);
    let frame = draw(vec![slab], &orthographic(5.0, 15), &unlit(0.0));
    let expected = 1.0 - (-density * 12.0).exp();
    for color in &frame.color {
        // The lattice's ripple is 4 exp(−2π² 0.49) = 2.5e-4 of τ = 1.8 at most.
        close(f64::from(color[3]), expected, 2.5e-4 * 1.8 * (1.0 - expected) + 1e-6);
        close(f64::from(color[1]), f64::from(color[3]), 1e-5);
    }
}

/// The emission–absorption integral in the world with densities as they are defined, by the midpoint rule.
fn summed(
    splats: &[(DVec3, DMat3, f64, DVec3)],
    origin: DVec3,
    direction: DVec3,
    range: [f64; 2],
) -> [f64; 4] {
    const STEPS: usize = 8000;
    let step = (range[1] - range[0]) / STEPS as f64;
    let (mut color, mut depth) = (DVec3::ZERO, 0.0);
    for i in 0..STEPS {
        let x = origin + direction * (range[0] + step * (i as f64 + 0.5));
        let (mut extinction, mut source) = (0.0, DVec3::ZERO);
        for (center, covariance, mass, own) in splats {
            let (d, inverse) = (x - center, covariance.inverse());
            let density =
                mass * (-0.5 * d.dot(inverse * d)).exp() / (TAU.powf(1.5) * covariance.determinant().sqrt());
            extinction += density;
            source += density * *own;
        }
        let tau = extinction * step * direction.length();
        color += source * step * direction.length() * (-depth - 0.5 * tau).exp();
        depth += tau;
    }
    [color.x, color.y, color.z, 1.0 - (-depth).exp()]
}

#[test]
fn mixture_is_the_integral_summed_in_the_world() {
    let pose = Pose::look_at(DVec3::new(3.0, -4.0, 5.0), DVec3::new(0.2, 0.1, 0.0), DVec3::Z).unwrap();
    let placed = DAffine3::from_mat3_translation(
        DMat3::from_cols_array(&[0.9, 0.2, -0.1, -0.3, 1.1, 0.2, 0.1, 0.3, -0.8]),
        DVec3::new(0.1, -0.2, 0.3),
    );
    let centers: Vec<Vec3> =
        (0..8).map(|i| Vec3::new((i % 2) as f32, (i / 2 % 2) as f32, (i / 4) as f32) - 0.5).collect();
    let factors: Vec<Mat3> = (0..8)
        .map(|i| oblate_factor(Vec3::new(1.0, i as f32 - 4.0, 2.0), 0.6, 1.0 + 0.3 * i as f32))
        .collect();
    let colors: Vec<[f32; 3]> =
        (0..8).map(|i| [i as f32 / 8.0, (i % 3) as f32 / 2.0, (i % 2) as f32]).collect();
    let masses: Vec<f32> = (0..8).map(|i| 0.5 + 0.5 * i as f32).collect();
    let strength = Strength::Extinction { masses: masses.clone() };
    let fog = cloud(centers.clone(), Shapes::Each(factors.clone()), strength, colors.clone());
    let size = [7, 5];
    for projection in [Projection::Perspective, Projection::Orthographic] {
        let focal = DVec2::new(9.0, 12.0) / if projection == Projection::Perspective { 1.0 } else { 7.0 };
        let intrinsics = Intrinsics { focal, center: DVec2::new(3.0, 2.8) };
        let near = 6.7;
        let camera =
            Camera::from_intrinsics(pose, intrinsics, projection, size).unwrap().with_near(near).unwrap();
        let low_pass = 0.3;
        let frame = draw(vec![fog.clone().transformed(placed)], &camera, &unlit(low_pass));

        let camera_to_world = pose.world_to_camera.inverse();
        let splats: Vec<_> = (0..8)
            .map(|i| {
                let center = placed.transform_point3(centers[i].as_dvec3());
                let factor = placed.matrix3 * factors[i].as_dmat3();
                let z = match projection {
                    Projection::Perspective => pose.world_to_camera.transform_point3(center).z,
                    Projection::Orthographic => 1.0,
                };
                let filter = DMat3::from_diagonal((low_pass * z * z / (focal * focal)).extend(0.0));
                let rotation = camera_to_world.matrix3;
                let covariance = factor * factor.transpose() + rotation * filter * rotation.transpose();
                let mass = f64::from(masses[i]) * placed.matrix3.determinant().abs();
                (center, covariance, mass, DVec3::from_array(colors[i].map(f64::from)))
            })
            .collect();
        for (at, color) in frame.color.iter().enumerate() {
            let pixel = DVec2::new((at % 7) as f64 + 0.5, (at / 7) as f64 + 0.5);
            let on_plane = (pixel - intrinsics.center) / focal;
            let (origin, direction) = match projection {
                Projection::Perspective => (DVec3::ZERO, on_plane.extend(1.0)),
                Projection::Orthographic => (on_plane.extend(0.0), DVec3::Z),
            };
            let origin = camera_to_world.transform_point3(origin);
            let direction = camera_to_world.transform_vector3(direction);
            let expected = summed(&splats, origin, direction, [near, near + 10.0]);
            for (value, expected) in color.iter().zip(expected) {
                // The midpoint rule's own error is (1.2e-3/σ)²/24 of a variation of order 1: 1e-6.
                close(f64::from(*value), expected, 1e-5);
            }
        }
    }
}

#[test]
fn coinciding_kernels_mix_their_colours() {
    let at = Vec3::Z * 3.0;
    let frame = draw(vec![kernels(&[at, at], 0.5, 1.0, &[RED, GREEN])], &perspective(1.0, 1), &unlit(0.0));
    let alpha = 1.0 - (-2.0f64 / (TAU * 0.25)).exp();
    let [r, g, b, a] = frame.color[0].map(f64::from);
    for (value, expected) in [(r, 0.5 * alpha), (g, 0.5 * alpha), (b, 0.0), (a, alpha)] {
        close(value, expected, 1e-6);
    }
}

#[test]
fn order_along_the_ray_decides_between_separate_kernels() {
    let centers = [Vec3::Z * 9.0, Vec3::Z * 3.0];
    let frame = draw(vec![kernels(&centers, 0.5, 1.0, &[RED, GREEN])], &orthographic(1.0, 1), &unlit(0.0));
    let alpha = 1.0 - (-1.0f64 / (TAU * 0.25)).exp();
    let [r, g, ..] = frame.color[0].map(f64::from);
    close(g, alpha, 1e-6);
    close(r, alpha * (1.0 - alpha), 1e-6);
}

#[test]
fn opacity_kernels_alone_are_composited_whole_by_distance() {
    // They overlap, so an integral would mix them; the nearer centre comes second in the cloud.
    let centers = [Vec3::new(0.0, 0.0, 5.1), Vec3::Z * 5.0];
    let frame =
        draw(vec![opacity_kernels(&centers, 0.5, 0.6, &[RED, GREEN])], &perspective(10.0, 1), &unlit(0.0));
    let [r, g, _, a] = frame.color[0].map(f64::from);
    for (value, expected) in [(g, 0.6), (r, 0.24), (a, 0.84)] {
        close(value, expected, 1e-6);
    }
    // At 45° to the view axis a smaller z is not a smaller distance.
    let centers = [Vec3::new(5.0, 0.0, 4.9), Vec3::new(4.8, 0.0, 5.0)];
    let shifted = Intrinsics { focal: DVec2::splat(10.0), center: DVec2::new(-9.5, 0.5) };
    let camera = Camera::from_intrinsics(POSE, shifted, Projection::Perspective, [1, 1]).unwrap();
    let frame = draw(vec![opacity_kernels(&centers, 0.5, 0.6, &[RED, GREEN])], &camera, &unlit(0.0));
    assert!(frame.color[0][1] > 0.5 && frame.color[0][0] < 0.3, "{:?}", frame.color[0]);
}

#[test]
fn low_pass_dims_an_opacity_kernel_by_its_area() {
    let at = [Vec3::Z * 5.0];
    let frame = draw(vec![opacity_kernels(&at, 0.1, 0.8, &[RED])], &perspective(50.0, 1), &unlit(0.3));
    close(f64::from(frame.color[0][3]), 0.8 / 1.3, 1e-6);
}

#[test]
fn a_classic_low_pass_widens_an_opacity_kernel_and_leaves_its_peak() {
    // σ is 1 px, √1.3 px with the filter; the first and last pixels of three are 1 px off. A point is drawn as the filter is.
    for (sigma, variance) in [(0.1, 1.3_f64), (0.0, 0.3)] {
        let mut splats = opacity_kernels(&[Vec3::Z * 5.0], sigma, 0.8, &[RED]).splats();
        splats.strength = Strength::Opacity { peaks: vec![0.8], filter: OpacityFilter::Classic, least: 0.0 };
        let cloud = Cloud::new(splats).unwrap();
        for camera in [perspective(50.0, 3), orthographic(10.0, 3)] {
            let frame = draw(vec![cloud.clone()], &camera, &unlit(0.3));
            // 1 px is 0.02 of the distance: a ray's own tilt changes r by 4e-4 of it.
            close(f64::from(frame.color[4][3]), 0.8, 1e-6);
            close(f64::from(frame.color[3][3]), 0.8 * (-0.5 / variance).exp(), 2e-4);
        }
    }
    let bare = opacity_kernels(&[Vec3::Z * 5.0], 0.1, 0.8, &[RED]);
    let mut classic = bare.splats();
    classic.strength = Strength::Opacity { peaks: vec![0.8], filter: OpacityFilter::Classic, least: 0.0 };
    let [bare, classic] = [bare, Cloud::new(classic).unwrap()]
        .map(|cloud| draw(vec![cloud], &perspective(50.0, 5), &unlit(0.0)));
    assert_eq!(bare, classic, "there is no filter");
}

#[test]
fn opacity_kernels_beside_others_are_spread_along_the_ray() {
    let fog = opacity_kernels(&[Vec3::Z * 20.0], 1.5, 0.75, &[RED]);
    let sheet = plane(Vec3::Z * 20.0, Vec3::NEG_Z, 12, 1.0, GREEN);
    let frame = draw(vec![fog, sheet], &orthographic(4.0, 1), &unlit(0.0));
    // Half of τ = −ln(1/4) is before the sheet.
    close(f64::from(frame.color[0][0]), 0.5, 1e-5);
    close(f64::from(frame.color[0][1]), 0.5, 1e-5);
}

#[test]
fn near_plane_cuts_kernels_and_drops_surfels() {
    let at = [Vec3::Z * 5.0];
    let camera = orthographic(4.0, 1).with_near(5.0).unwrap();
    let frame = draw(vec![kernels(&at, 0.5, 1.0, &[RED])], &camera, &unlit(0.0));
    close(f64::from(frame.color[0][3]), 1.0 - (-0.5f64 / (TAU * 0.25)).exp(), 1e-7);
    let frame = draw(vec![opacity_kernels(&at, 0.5, 0.75, &[RED])], &camera, &unlit(0.0));
    close(f64::from(frame.color[0][3]), 0.5, 1e-7);
    let sheet = plane(Vec3::Z * 4.9, Vec3::NEG_Z, 5, 1.0, GREEN);
    assert_eq!(draw(vec![sheet], &camera, &unlit(0.0)), Frame::new(1, 1));
    // A kernel around the eye is seen from inside: half of it is before a pinhole camera.
    let frame = draw(vec![kernels(&[Vec3::ZERO], 0.5, 1.0, &[RED])], &perspective(4.0, 1), &unlit(0.3));
    close(f64::from(frame.color[0][3]), 1.0 - (-0.5f64 / (TAU * 0.25)).exp(), 1e-7);
}

#[test]
fn a_kernel_without_a_normal_returns_ambient_light() {
    let opaque = || vec![kernels(&[Vec3::Z * 5.0], 1.0, 300.0, &[[0.5; 3]])];
    let frame = draw(opaque(), &orthographic(1.0, 1), &RenderSettings::default());
    close(f64::from(frame.color[0][0]), 0.5 * 0.3, 1e-5);
    let mut splats = opaque()[0].splats();
    // Turned to the viewer: n·l = 0.6.
    splats.normals = Some(vec![Vec3::new(0.0, 0.8, 0.6)]);
    let frame = draw(vec![Cloud::new(splats).unwrap()], &orthographic(1.0, 1), &RenderSettings::default());
    close(f64::from(frame.color[0][0]), 0.5 * (0.3 + 0.7 * 0.6) + 0.2 * 0.6f64.powi(20), 1e-5);
}
