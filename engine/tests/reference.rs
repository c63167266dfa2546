//! The references against answers that are numbers.

use glam::{DAffine3, DMat3, DVec2, DVec3, Mat3, Vec3};
use oblate_engine::cloud::oblate_factor;
use oblate_engine::color::{linear_to_srgb, srgb_to_linear};
use oblate_engine::reference::{ReferenceError, ReferenceKind, reference};
use oblate_engine::{
    Blend, Camera, Cloud, Frame, Intrinsics, Light, Material, Pose, Projection, RenderSettings, Scene,
    Shapes, Splats, Strength, Surface,
};
use std::f64::consts::TAU;
use std::sync::Mutex;

/// Camera space is the world.
const POSE: Pose = Pose { world_to_camera: DAffine3::IDENTITY };

fn camera(projection: Projection, focal: f64, size: u32) -> Camera {
    let center = DVec2::splat(f64::from(size) / 2.0);
    let intrinsics = Intrinsics { focal: DVec2::splat(focal), center };
    Camera::from_intrinsics(POSE, intrinsics, projection, [size, size]).unwrap()
}

fn perspective(focal: f64, size: u32) -> Camera {
    camera(Projection::Perspective, focal, size)
}

fn orthographic(focal: f64, size: u32) -> Camera {
    camera(Projection::Orthographic, focal, size)
}

/// Without light, and with surfels cut off where nothing is left of them.
fn unlit(low_pass: f64) -> RenderSettings {
    RenderSettings { shade: false, low_pass, cutoff: 50.0, ..RenderSettings::default() }
}

fn draw(clouds: Vec<Cloud>, camera: &Camera, settings: &RenderSettings) -> Frame {
    let scene = Scene { clouds, lights: Vec::new() };
    reference(&scene, camera, settings, ReferenceKind::R1, &|_| {}).unwrap()
}

fn cloud(centers: Vec<Vec3>, shapes: Shapes, strength: Strength, colors: Vec<[f32; 3]>) -> Cloud {
    let material = Material::default();
    Cloud::new(Splats { centers, shapes, strength, colors, normals: None, material }).unwrap()
}

/// Round kernels of one σ and mass.
fn kernels(centers: &[Vec3], sigma: f32, mass: f32, colors: &[[f32; 3]]) -> Cloud {
    let strength = Strength::Extinction { masses: vec![mass; centers.len()] };
    cloud(centers.to_vec(), Shapes::Shared(Mat3::IDENTITY * sigma), strength, colors.to_vec())
}

fn opacity_kernels(centers: &[Vec3], sigma: f32, peak: f32, colors: &[[f32; 3]]) -> Cloud {
    let strength = Strength::Opacity { peaks: vec![peak; centers.len()] };
    cloud(centers.to_vec(), Shapes::Shared(Mat3::IDENTITY * sigma), strength, colors.to_vec())
}

/// A square lattice of surfels, unit distance apart, in the plane through `center` with `normal`.
/// With σ = 0.8 the sum of their coverage is 1 within 4 exp(−2π² 0.64) = 1.3e-5.
fn plane(center: Vec3, normal: Vec3, half: i32, opacity: f32, color: [f32; 3]) -> Cloud {
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let centers: Vec<Vec3> = (-half..=half)
        .flat_map(|i| (-half..=half).map(move |j| center + tangent * i as f32 + bitangent * j as f32))
        .collect();
    let count = centers.len();
    let surface = Surface {
        areas: vec![1.0; count],
        opacities: Some(vec![opacity; count]),
        depth_tolerance: 0.8,
        coverage_floor: 0.99,
        closed: false,
    };
    let shape = Shapes::Shared(oblate_factor(normal, 0.8, f32::INFINITY));
    let mut splats = cloud(centers, shape, Strength::Surface(surface), vec![color; count]).splats().clone();
    splats.normals = Some(vec![normal; count]);
    Cloud::new(splats).unwrap()
}

fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} is not {b} within {tolerance}");
}

fn same_picture(a: &Frame, b: &Frame, tolerance: f64) {
    for (p, q) in a.color.iter().flatten().zip(b.color.iter().flatten()) {
        close(f64::from(*p), f64::from(*q), tolerance);
    }
}

const RED: [f32; 3] = [1.0, 0.0, 0.0];
const GREEN: [f32; 3] = [0.0, 1.0, 0.0];
const WHITE: [f32; 3] = [1.0; 3];

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
fn opaque_plane_is_opaque_at_its_depth() {
    for (normal, low_pass) in
        [(Vec3::NEG_Z, 0.3), (Vec3::new(0.5, 0.3, -1.0).normalize(), 0.0), (Vec3::new(1.0, 0.0, -1.0), 0.0)]
    {
        let normal = normal.normalize();
        let center = Vec3::new(0.2, -0.1, 20.0);
        let sheet = plane(center, normal, 16, 1.0, GREEN);
        let frame = draw(vec![sheet], &perspective(40.0, 17), &unlit(low_pass));
        for (at, color) in frame.color.iter().enumerate() {
            let pixel = DVec2::new((at % 17) as f64 + 0.5, (at / 17) as f64 + 0.5);
            let ray = ((pixel - 8.5) / 40.0).extend(1.0);
            let z = normal.as_dvec3().dot(center.as_dvec3()) / normal.as_dvec3().dot(ray);
            close(f64::from(color[3]), 1.0, 1e-6);
            // f32 has 1e-6 at 20, and so have the surfels' centres and axes.
            close(f64::from(frame.depth[at]), z, 1e-4);
            close(f64::from(frame.expected_depth[at]), z, 1e-4);
            close(f64::from(Vec3::from_array(frame.normal[at]).dot(normal)), 1.0, 1e-6);
            assert!((frame.id[at] as usize) < 33 * 33);
        }
    }
}

#[test]
fn what_the_cut_off_takes_is_given_back() {
    let sheet = plane(Vec3::Z * 10.0, Vec3::NEG_Z, 9, 0.5, GREEN);
    for cutoff in [4.0, 12.25] {
        // 16×16 pixels over 4×4 surfels: their mean is that of the coverage.
        let settings = RenderSettings { cutoff, ..unlit(0.0) };
        let frame = draw(vec![sheet.clone()], &orthographic(4.0, 16), &settings);
        let mean = frame.color.iter().map(|color| f64::from(color[3])).sum::<f64>() / 256.0;
        // Without giving back it would be less by e^{-ρ/2}: .07 and .0011. 256 samples of a disc with edge
        // e^{-ρ/2}/4 resolve its area within a few per cent of that.
        close(mean, 0.5 / 0.99, 0.1 * 0.5 * (-0.5 * cutoff).exp());
    }
}

#[test]
fn plane_through_a_kernel_hides_half_of_it() {
    let fog = kernels(&[Vec3::Z * 20.0], 1.5, 4.0, &[RED]);
    let sheet = plane(Vec3::Z * 20.0, Vec3::NEG_Z, 12, 1.0, GREEN);
    let frame = draw(vec![fog, sheet], &orthographic(4.0, 9), &unlit(0.0));
    let [r, g, _, a] = frame.color[4 * 9 + 4].map(f64::from);
    let tau = 4.0 / (TAU * 2.25);
    let seen = (-0.5f64 * tau).exp();
    close(g, seen, 1e-6);
    close(r, 1.0 - seen, 1e-5);
    close(a, 1.0, 1e-6);
}

#[test]
fn layers_blend_front_to_back_with_fog_between() {
    let sheets = [(10.0, 0.5, RED), (14.0, 0.25, GREEN)]
        .map(|(z, opacity, color)| plane(Vec3::Z * z, Vec3::NEG_Z, 12, opacity, color));
    let fog = kernels(&[Vec3::Z * 12.0], 0.25, 0.2, &[[0.0, 0.0, 1.0]]);
    let [front, back] = sheets;
    let settings = RenderSettings { background: [1.0, 1.0, 1.0, 0.5], ..unlit(0.0) };
    let frame = draw(vec![back, fog, front], &orthographic(4.0, 9), &settings);
    let (near, far) = (0.5 / 0.99, 0.25 / 0.99);
    let through = (-0.2f64 / (TAU * 0.0625)).exp();
    let behind = 0.5 * (1.0 - near) * through * (1.0 - far);
    let at = 4 * 9 + 4;
    let [r, g, b, a] = frame.color[at].map(f64::from);
    // Coverage ripples by 1.3e-5.
    close(r, near + behind, 3e-5);
    close(g, (1.0 - near) * through * far + behind, 3e-5);
    close(b, (1.0 - near) * (1.0 - through) + behind, 3e-5);
    close(a, 1.0 - behind, 3e-5);
    close(f64::from(frame.depth[at]), 10.0, 1e-5);
    // Ids count through the clouds: the front sheet comes last.
    assert!(frame.id[at] as usize > 25 * 25);
}

#[test]
fn the_fifth_layer_merges_into_the_fourth() {
    let sheets: Vec<Cloud> = (0..6)
        .map(|i| plane(Vec3::Z * (10.0 + 3.0 * i as f32), Vec3::NEG_Z, 10, 0.2, [i as f32, 1.0, 0.0]))
        .collect();
    let frame = draw(sheets, &orthographic(4.0, 1), &unlit(0.0));
    let alpha = 0.2 / 0.99;
    let rest = 1.0f64 - alpha;
    // Sheets 3, 4 and 5 are one layer of three times the coverage and the mean colour 4.
    let red = alpha * (rest + 2.0 * rest * rest) + rest.powi(3) * 3.0 * alpha * 4.0;
    close(f64::from(frame.color[0][0]), red, 1e-4);
    close(f64::from(frame.color[0][3]), 1.0 - rest.powi(3) * (1.0 - 3.0 * alpha), 1e-4);
}

#[test]
fn closed_surfaces_drop_their_back() {
    let [front, back] = [(10.0, Vec3::Z), (14.0, Vec3::NEG_Z)].map(|(z, normal)| {
        let mut splats =
            plane(Vec3::Z * z, normal, 8, 1.0, if z < 12.0 { RED } else { GREEN }).splats().clone();
        let Strength::Surface(surface) = &mut splats.strength else { unreachable!() };
        surface.closed = true;
        Cloud::new(splats).unwrap()
    });
    for camera in [perspective(10.0, 1), orthographic(1.0, 1)] {
        let frame = draw(vec![front.clone(), back.clone()], &camera, &unlit(0.0));
        assert_eq!(frame.color[0].map(|c| (c * 1e3).round()), [0.0, 1e3, 0.0, 1e3]);
    }
    // Mirrored at z = 0 and moved beyond, the normals turn with the surface.
    let mirror =
        DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0)), DVec3::Z * 24.0);
    let mirrored = vec![front.transformed(mirror), back.transformed(mirror)];
    let frame = draw(mirrored, &orthographic(1.0, 1), &unlit(0.0));
    // The red sheet is at 14 now and faces the camera, the green one at 10 faces away.
    assert_eq!(frame.color[0].map(|c| (c * 1e3).round()), [1e3, 0.0, 0.0, 1e3]);
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
    let camera = orthographic(4.0, 1).with_near(5.0);
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
fn transforms_scale_masses_and_areas() {
    // Twice as large in all directions: mass × 8, area of the shadow × 4, τ × 2.
    let twice = DAffine3::from_scale(DVec3::splat(2.0));
    let fog = kernels(&[Vec3::Z * 5.0], 0.5, 0.3, &[RED]).transformed(twice);
    let frame = draw(vec![fog], &orthographic(1.0, 1), &unlit(0.0));
    close(f64::from(frame.color[0][3]), 1.0 - (-2.0 * 0.3f64 / (TAU * 0.25)).exp(), 1e-7);
    // A sheet of surfels stays a sheet of the same opacity under any affine transform.
    let affine = DAffine3::from_mat3_translation(
        DMat3::from_cols_array(&[1.2, 0.1, 0.3, -0.2, 0.8, 0.2, 0.1, -0.1, 0.9]),
        DVec3::new(-1.0, 0.0, 1.0),
    );
    let sheet = plane(Vec3::Z * 10.0, Vec3::NEG_Z, 14, 0.5, GREEN).transformed(affine);
    let frame = draw(vec![sheet], &orthographic(4.0, 9), &unlit(0.0));
    for color in &frame.color {
        close(f64::from(color[3]), 0.5 / 0.99, 2e-5);
    }
}

#[test]
fn r2_is_r1_without_a_low_pass() {
    let scene = Scene { clouds: mixed_scene(), lights: Vec::new() };
    let settings = RenderSettings { low_pass: 1e-18, ..RenderSettings::default() };
    let [one, two] = [ReferenceKind::R1, ReferenceKind::R2 { samples: 4 }]
        .map(|kind| reference(&scene, &perspective(60.0, 16), &settings, kind, &|_| {}).unwrap());
    // Rays 1e-9 px apart; a relative slope of 1e3 a pixel at most.
    same_picture(&one, &two, 1e-6);
    assert_eq!(one.id, two.id);
}

#[test]
fn r2_filters_a_faint_kernel_as_r1_does() {
    // Where α is τ, filtering one is filtering the other; α < 2e-3 makes the difference 2e-6.
    let scene = Scene { clouds: vec![kernels(&[Vec3::Z * 5.0], 0.1, 1e-4, &[WHITE])], lights: Vec::new() };
    let settings = unlit(0.3);
    let [one, two] = [ReferenceKind::R1, ReferenceKind::R2 { samples: 4096 }]
        .map(|kind| reference(&scene, &orthographic(10.0, 7), &settings, kind, &|_| {}).unwrap());
    let peak = f64::from(one.color[24][3]);
    assert!(peak > 1e-3);
    same_picture(&one, &two, 5e-3 * peak);
}

#[test]
fn r2_averages_what_is_seen_and_not_optical_depth() {
    // An opaque edge: half of a pixel's rays pass it.
    let mut splats = plane(Vec3::Z * 10.0, Vec3::NEG_Z, 40, 1.0, WHITE).splats().clone();
    // Scaled to 1/40 px, so that the border's own blur is small beside the filter.
    let camera = orthographic(0.025, 1);
    let keep: Vec<usize> = (0..splats.centers.len()).filter(|&i| splats.centers[i].x > 0.0).collect();
    splats.centers = keep.iter().map(|&i| splats.centers[i]).collect();
    splats.colors.truncate(keep.len());
    splats.normals = None;
    let Strength::Surface(surface) = &mut splats.strength else { unreachable!() };
    surface.areas.truncate(keep.len());
    surface.opacities = None;
    let settings = unlit(0.01);
    let scene = Scene { clouds: vec![Cloud::new(splats).unwrap()], lights: Vec::new() };
    let kind = ReferenceKind::R2 { samples: 4096 };
    let frame = reference(&scene, &camera, &settings, kind, &|_| {}).unwrap();
    // The sheet begins at x = 0.5 of its own units, an eighth of the filter's σ of 4, and is soft over 0.8:
    // Φ(−0.5/4) = 0.450, with the softness of half a unit.
    close(f64::from(frame.color[0][3]), 0.45, 0.03);
}

#[test]
fn perspective_from_afar_is_orthographic() {
    let scene = || {
        let far = DAffine3::from_translation(DVec3::Z * 1e6);
        mixed_scene().into_iter().map(move |cloud| cloud.transformed(far)).collect::<Vec<_>>()
    };
    for settings in [unlit(0.3), RenderSettings::default()] {
        let far = draw(scene(), &perspective(4.0 * 1e6, 16), &settings);
        let parallel = draw(scene(), &orthographic(4.0, 16), &settings);
        // Depths of 10 in 1e6 change scale by 1e-5.
        same_picture(&far, &parallel, 1e-3);
    }
}

#[test]
fn light_falls_as_the_material_says() {
    let normal = Vec3::new(0.0, -0.6, -0.8);
    let sheet = || vec![plane(Vec3::Z * 20.0, normal, 20, 1.0, [0.5, 1.0, 0.0])];
    let camera = orthographic(4.0, 1);
    let settings = RenderSettings { low_pass: 0.0, ..RenderSettings::default() };
    let shown = |lights: Vec<Light>| {
        let scene = Scene { clouds: sheet(), lights };
        reference(&scene, &camera, &settings, ReferenceKind::R1, &|_| {}).unwrap().color[0].map(f64::from)
    };
    // Headlight: n·l = n·h = 0.8, coefficients 0.3, 0.7, 0.2, exponent 20.
    let highlight = 0.2 * 0.8f64.powi(20);
    let [r, g, b, _] = shown(Vec::new());
    for (value, color) in [(r, 0.5), (g, 1.0), (b, 0.0)] {
        close(value, color * (0.3 + 0.7 * 0.8) + highlight, 1e-6);
    }
    // From above (−y): n·l = 0.6; half-way (0, −1, −1)/√2 gives n·h = 1.4/√2. No ambient light.
    let up = Light::Directional { towards: DVec3::NEG_Y * 3.0, color: [2.0, 2.0, 2.0] };
    let [_, g, b, _] = shown(vec![up]);
    let highlight = 2.0 * 0.2 * (1.4 / 2f64.sqrt()).powi(20);
    close(g, 2.0 * 0.7 * 0.6 + highlight, 1e-5);
    close(b, highlight, 1e-5);
    // A point light on the normal at the sheet, and ambient light alone.
    let position = DVec3::new(0.0, 0.0, 20.0) + normal.as_dvec3() * 5.0;
    let [_, g, b, _] = shown(vec![Light::Point { position, color: WHITE }]);
    // Half-way between the normal and −z: n·h = cos(½ acos 0.8) = √0.9.
    let highlight = 0.2 * 0.9f64.sqrt().powi(20);
    close(g, 0.7 + highlight, 1e-5);
    close(b, highlight, 1e-5);
    let [_, g, b, _] = shown(vec![Light::Ambient { color: [0.5; 3] }]);
    close(g, 0.15, 1e-6);
    close(b, 0.0, 1e-9);
    // From behind nothing is lit.
    let behind = Light::Directional { towards: DVec3::Z, color: WHITE };
    assert_eq!(shown(vec![behind])[..3], [0.0; 3]);
}

#[test]
fn a_kernel_without_a_normal_is_fully_lit() {
    let opaque = || vec![kernels(&[Vec3::Z * 5.0], 1.0, 300.0, &[[0.5; 3]])];
    let frame = draw(opaque(), &orthographic(1.0, 1), &RenderSettings::default());
    close(f64::from(frame.color[0][0]), 0.5, 1e-5);
    let mut splats = opaque()[0].splats().clone();
    // Turned to the viewer: n·l = 0.6.
    splats.normals = Some(vec![Vec3::new(0.0, 0.8, 0.6)]);
    let frame = draw(vec![Cloud::new(splats).unwrap()], &orthographic(1.0, 1), &RenderSettings::default());
    close(f64::from(frame.color[0][0]), 0.5 * (0.3 + 0.7 * 0.6) + 0.2 * 0.6f64.powi(20), 1e-5);
}

#[test]
fn display_blending_works_on_encoded_colours() {
    let sheet = plane(Vec3::Z * 10.0, Vec3::NEG_Z, 8, 0.495, [0.8, 0.2, 0.0]);
    let background = [0.1, 0.4, 1.0, 1.0];
    let settings = RenderSettings { blend: Blend::Display, background, ..unlit(0.0) };
    let frame = draw(vec![sheet], &orthographic(1.0, 1), &settings);
    for (channel, [front, back]) in [[0.8, 0.1], [0.2, 0.4], [0.0, 1.0]].into_iter().enumerate() {
        let mixed = 0.5 * (linear_to_srgb(front) + linear_to_srgb(back));
        close(f64::from(frame.color[0][channel]), f64::from(srgb_to_linear(mixed)), 3e-5);
    }
    close(f64::from(frame.color[0][3]), 1.0, 1e-6);
}

/// Fog, a tilted sheet through it, trained kernels.
fn mixed_scene() -> Vec<Cloud> {
    let centers: Vec<Vec3> = (0..60)
        .map(|i| Vec3::new((i % 5) as f32 - 2.0, (i / 5 % 4) as f32 - 1.5, 10.0 + (i / 20) as f32))
        .collect();
    let colors: Vec<[f32; 3]> = (0..60).map(|i| [i as f32 / 60.0, 0.5, 1.0 - i as f32 / 60.0]).collect();
    let sheet = plane(Vec3::Z * 11.0, Vec3::new(0.6, 0.0, -0.8), 3, 0.7, GREEN);
    let trained = opacity_kernels(&[Vec3::new(1.0, 1.0, 12.0)], 0.4, 0.9, &[RED]);
    vec![kernels(&centers, 0.7, 0.3, &colors), sheet, trained]
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let scene = Scene { clouds: mixed_scene(), lights: Vec::new() };
    let camera = perspective(60.0, 27);
    for kind in [ReferenceKind::R1, ReferenceKind::R2 { samples: 5 }] {
        let frames = [1, 2, 5].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| reference(&scene, &camera, &RenderSettings::default(), kind, &|_| {}).unwrap())
        });
        assert!(frames[0] == frames[1] && frames[0] == frames[2]);
        assert!(frames[0].id.iter().any(|&id| id != Frame::NO_ID));
    }
}

#[test]
fn progress_counts_every_row() {
    let rows = Mutex::new(Vec::new());
    let note = |row| rows.lock().unwrap().push(row);
    let scene = Scene::default();
    let frame = reference(&scene, &perspective(1.0, 21), &unlit(0.3), ReferenceKind::R1, &note).unwrap();
    assert_eq!(frame, Frame::new(21, 21));
    let mut rows = rows.into_inner().unwrap();
    rows.sort_unstable();
    assert_eq!((rows.len(), rows.last()), (3, Some(&21)));
}

#[test]
fn wrong_numbers_are_refused() {
    let refused = |settings: RenderSettings, kind, lights| {
        let scene = Scene { clouds: Vec::new(), lights };
        reference(&scene, &perspective(1.0, 1), &settings, kind, &|_| {}).unwrap_err()
    };
    let fine = RenderSettings::default();
    for settings in [
        RenderSettings { low_pass: -1.0, ..fine },
        RenderSettings { low_pass: f64::NAN, ..fine },
        RenderSettings { cutoff: 0.0, ..fine },
        RenderSettings { background: [0.0, f32::NAN, 0.0, 0.0], ..fine },
    ] {
        assert!(matches!(refused(settings, ReferenceKind::R1, vec![]), ReferenceError::Value { .. }));
    }
    let none = ReferenceKind::R2 { samples: 0 };
    assert!(matches!(refused(fine, none, vec![]), ReferenceError::Value { .. }));
    let dark = vec![Light::Directional { towards: DVec3::ZERO, color: WHITE }];
    assert_eq!(refused(fine, ReferenceKind::R1, dark), ReferenceError::Light { index: 0 });
    let lost =
        kernels(&[Vec3::Z], 1.0, 1.0, &[RED]).transformed(DAffine3::from_scale(DVec3::splat(f64::INFINITY)));
    let scene = Scene { clouds: vec![lost], lights: Vec::new() };
    let found = reference(&scene, &perspective(1.0, 1), &fine, ReferenceKind::R1, &|_| {});
    assert_eq!(found, Err(ReferenceError::Transform { cloud: 0 }));
}
