//! Surfels, layers and their light.

use super::*;

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
fn what_the_outline_takes_is_given_back() {
    let sheet = thinned(&plane(Vec3::Z * 10.0, Vec3::NEG_Z, 9, 1.0, GREEN));
    for outline in [4.0, 12.25] {
        // 16×16 pixels over 4×4 surfels: their mean is that of the coverage.
        let settings = RenderSettings { outline, ..unlit(0.0) };
        let frame = draw(vec![sheet.clone()], &orthographic(4.0, 16), &settings);
        let mean = frame.color.iter().map(|color| f64::from(color[3])).sum::<f64>() / 256.0;
        // Without giving back it would be less by e^{-ρ/2}: .07 and .0011. 256 samples of a disc with edge
        // e^{-ρ/2}/4 resolve its area within a few per cent of that.
        close(mean, 0.5 / 0.99, 0.1 * 0.5 * (-0.5 * outline).exp());
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
    let (near, far) = (0.5, 0.25);
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

/// Sheets 3 apart from z = 10 on, the nearest with number 0; what is red in them is their number.
fn stack(count: usize, opacity: f32) -> Vec<Cloud> {
    let sheet = |i| plane(Vec3::Z * (10.0 + 3.0 * i as f32), Vec3::NEG_Z, 10, opacity, [i as f32, 1.0, 0.0]);
    (0..count).map(sheet).collect()
}

#[test]
fn twelve_layers_are_composited_one_by_one() {
    // Far ones first: the order in a scene has no meaning.
    let mut sheets = stack(12, 0.3);
    sheets.reverse();
    let frame = draw(sheets, &orthographic(4.0, 1), &unlit(0.0));
    let (mut red, mut through) = (0.0, 1.0);
    for i in 0..12 {
        red += through * 0.3 * f64::from(i);
        through *= 0.7;
    }
    // f32's 0.3 and coverage that ripples by 1.3e-5.
    close(f64::from(frame.color[0][0]), red, 1e-4);
    close(f64::from(frame.color[0][1]), 1.0 - through, 3e-5);
    close(f64::from(frame.color[0][3]), 1.0 - through, 3e-5);
}

#[test]
fn the_last_of_64_layers_takes_the_rest() {
    let frame = draw(stack(66, 0.02), &orthographic(4.0, 1), &unlit(0.0));
    let rest = 0.98f64;
    // Sheets 63, 64 and 65 are one layer of the mean colour 64 that counts as three.
    let last = 1.0 - rest.powi(3);
    let before: f64 = (0..63).map(|i| 0.02 * rest.powi(i) * f64::from(i)).sum();
    close(f64::from(frame.color[0][0]), before + rest.powi(63) * last * 64.0, 1e-3);
    close(f64::from(frame.color[0][3]), 1.0 - rest.powi(63) * (1.0 - last), 3e-5);
}

#[test]
fn closed_surfaces_drop_their_back() {
    let [front, back] = [(10.0, Vec3::Z), (14.0, Vec3::NEG_Z)].map(|(z, normal)| {
        let mut splats = plane(Vec3::Z * z, normal, 8, 1.0, if z < 12.0 { RED } else { GREEN }).splats();
        let Strength::Surface(surface) = &mut splats.strength else { unreachable!() };
        surface.closed = Closed::EVERYWHERE;
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
    // The mean of normals is 1 long but for rounding.
    shown(vec![behind])[..3].iter().for_each(|channel| close(*channel, 0.0, 1e-15));
}

#[test]
fn display_blending_works_on_encoded_colours() {
    let sheet = plane(Vec3::Z * 10.0, Vec3::NEG_Z, 8, 0.5, [0.8, 0.2, 0.0]);
    let background = [0.1, 0.4, 1.0, 1.0];
    let settings = RenderSettings { blend: Blend::Display, background, ..unlit(0.0) };
    let frame = draw(vec![sheet], &orthographic(1.0, 1), &settings);
    for (channel, [front, back]) in [[0.8, 0.1], [0.2, 0.4], [0.0, 1.0]].into_iter().enumerate() {
        let mixed = 0.5 * (linear_to_srgb(front) + linear_to_srgb(back));
        close(f64::from(frame.color[0][channel]), f64::from(srgb_to_linear(mixed)), 3e-5);
    }
    close(f64::from(frame.color[0][3]), 1.0, 1e-6);
}
