//! Whole pictures: transforms, R2, cameras, threads, refusals.

use super::*;

#[test]
fn transforms_scale_masses_and_areas() {
    // Twice as large in all directions: mass × 8, area of the shadow × 4, τ × 2.
    let twice = DAffine3::from_scale(DVec3::splat(2.0));
    let fog = kernels(&[Vec3::Z * 5.0], 0.5, 0.3, &[RED]).transformed(twice);
    let frame = draw(vec![fog], &orthographic(1.0, 1), &unlit(0.0));
    close(f64::from(frame.color[0][3]), 1.0 - (-2.0 * 0.3f64 / (TAU * 0.25)).exp(), 1e-7);
    // A sheet of surfels that cover half of it stays that under any affine transform.
    let affine = DAffine3::from_mat3_translation(
        DMat3::from_cols_array(&[1.2, 0.1, 0.3, -0.2, 0.8, 0.2, 0.1, -0.1, 0.9]),
        DVec3::new(-1.0, 0.0, 1.0),
    );
    let sheet = thinned(&plane(Vec3::Z * 10.0, Vec3::NEG_Z, 14, 1.0, GREEN)).transformed(affine);
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
    let mut splats = plane(Vec3::Z * 10.0, Vec3::NEG_Z, 40, 1.0, WHITE).splats();
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
        RenderSettings { outline: 0.0, ..fine },
        RenderSettings { background: [0.0, f32::NAN, 0.0, 0.0], ..fine },
    ] {
        assert!(matches!(refused(settings, ReferenceKind::R1, vec![]), SceneError::Setting { .. }));
    }
    let none = ReferenceKind::R2 { samples: 0 };
    assert!(matches!(refused(fine, none, vec![]), SceneError::Setting { .. }));
    let dark = vec![Light::Directional { towards: DVec3::ZERO, color: WHITE }];
    assert!(matches!(refused(fine, ReferenceKind::R1, dark), SceneError::Light { index: 0, .. }));
    let lost =
        kernels(&[Vec3::Z], 1.0, 1.0, &[RED]).transformed(DAffine3::from_scale(DVec3::splat(f64::INFINITY)));
    let scene = Scene { clouds: vec![lost], lights: Vec::new() };
    let found = reference(&scene, &perspective(1.0, 1), &fine, ReferenceKind::R1, &|_| {});
    assert_eq!(found, Err(SceneError::Transform { cloud: 0 }));
}
