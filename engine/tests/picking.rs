//! Picking against what is drawn, and against answers that are known.

#![expect(clippy::unwrap_used, reason = "what is not there fails the test")]

use glam::{DAffine3, DVec2, DVec3, Mat3, Vec3, dvec3};
use oblate_engine::cloud::oblate_factor;
use oblate_engine::{
    Camera, Closed, Cloud, FootprintForm, Material, OpacityFilter, Order, Picked, Picker, Pose,
    ReferenceKind, RenderSettings, Scene, Shapes, Splats, Strength, Surface, reference, render,
};

const SIZE: [u32; 2] = [40, 32];

fn splats(centers: Vec<Vec3>, shapes: Shapes, strength: Strength) -> Splats {
    let colors = vec![[0.5; 3]; centers.len()];
    Splats {
        centers,
        shapes,
        strength,
        colors,
        harmonics: None,
        normals: None,
        material: Material::default(),
    }
}

/// A closed ball of radius 1 in surfels on a spiral of golden angles.
fn ball(count: usize, opacity: Option<f32>) -> Cloud {
    let golden_angle = std::f32::consts::PI * (3.0 - 5f32.sqrt());
    let center = |i: usize| {
        let z = 1.0 - (2.0 * i as f32 + 1.0) / count as f32;
        let turn = golden_angle * i as f32;
        (1.0 - z * z).sqrt() * Vec3::new(turn.cos(), turn.sin(), 0.0) + Vec3::Z * z
    };
    let centers: Vec<Vec3> = (0..count).map(center).collect();
    let area = 4.0 * std::f32::consts::PI / count as f32;
    let radius = 0.8 * area.sqrt();
    let factors = centers.iter().map(|n| oblate_factor(*n, radius, f32::INFINITY)).collect();
    let strength = Strength::Surface(Surface {
        areas: vec![area; count],
        opacities: opacity.map(|opacity| vec![opacity; count]),
        depth_tolerance: 2.0 * radius,
        coverage_floor: 0.9,
        closed: Closed::EVERYWHERE,
    });
    Cloud::new(splats(centers, Shapes::Each(factors), strength)).unwrap()
}

fn kernels(centers: &[Vec3], sigma: f32, strength: Strength) -> Cloud {
    Cloud::new(splats(centers.to_vec(), Shapes::Shared(Mat3::IDENTITY * sigma), strength)).unwrap()
}

fn at(cloud: Cloud, x: f64, y: f64, z: f64) -> Cloud {
    cloud.transformed(DAffine3::from_translation(dvec3(x, y, z)))
}

/// From z = 8 towards the origin.
fn camera() -> Camera {
    let pose = Pose::look_at(dvec3(0.0, 0.0, 8.0), DVec3::ZERO, DVec3::Y).unwrap();
    Camera::perspective(pose, 0.5, SIZE).unwrap()
}

fn scene(clouds: Vec<Cloud>) -> Scene {
    Scene { clouds, lights: Vec::new() }
}

fn pick(scene: &Scene, settings: &RenderSettings, pixel: DVec2) -> Option<Picked> {
    Picker::new(scene).unwrap().pick(&camera(), settings, pixel).unwrap()
}

/// Calls with what is picked at each pixel's centre, and its place in a frame.
fn at_all_pixels(scene: &Scene, settings: &RenderSettings, mut see: impl FnMut(Option<Picked>, usize)) {
    let picker = Picker::new(scene).unwrap();
    for pixel in 0..(SIZE[0] * SIZE[1]) as usize {
        let [x, y] = [pixel % SIZE[0] as usize, pixel / SIZE[0] as usize].map(|n| n as f64 + 0.5);
        see(picker.pick(&camera(), settings, DVec2::new(x, y)).unwrap(), pixel);
    }
}

#[test]
fn surfaces_are_picked_as_they_are_drawn() {
    let scene = scene(vec![
        at(ball(1500, None), -0.7, 0.0, 0.3),
        at(ball(1000, None), 0.5, 0.2, -0.4),
        at(ball(700, Some(0.2)), 0.6, -0.6, 1.5),
    ]);
    let settings = RenderSettings { footprint: FootprintForm::Exact, ..RenderSettings::default() };
    let frame = render(&scene, &camera(), &settings, &()).unwrap();
    let first = [0, 1500, 2500];
    let (mut compared, mut ties, mut empty, mut through) = (0, 0, 0, 0);
    at_all_pixels(&scene, &settings, |picked, pixel| {
        let alpha = frame.color[pixel][3];
        let Some(picked) = picked else {
            empty += 1;
            // What no ray sees is not drawn either.
            assert!(alpha < 1e-6, "pixel {pixel} has {alpha}");
            return;
        };
        assert!((picked.opacity - f64::from(alpha)).abs() < 1e-3);
        assert_eq!(first[picked.cloud] + picked.splat as u32, picked.id);
        let middle = camera().pose().world_to_camera.transform_point3(picked.position);
        assert!((middle.z - picked.depth).abs() < 1e-9);
        if alpha < 0.999 {
            return;
        }
        // Half of what is seen is in front of the same depth; singles are within 1e-6 of z = 8 and layers' means of their σ.
        assert!((picked.depth - f64::from(frame.median_depth[pixel])).abs() < 1e-3);
        if frame.depth[pixel] == frame.median_depth[pixel] {
            compared += 1;
            ties += usize::from(picked.id != frame.id[pixel]);
        } else {
            // Through the ball of glass.
            through += usize::from(picked.cloud != 2);
        }
    });
    println!("{compared} pixels compared, {ties} ties, {through} through glass, {empty} empty");
    assert!(compared > 100 && through > 50 && empty > 200);
    // A sample at the very outline, without weight, is in front for single precision and not there in double precision, or
    // the other way round: r is right to 1e-5 or so of 12, of which each pixel has some ten samples.
    assert!(100 * ties <= compared, "{ties}");
}

#[test]
fn volumes_are_picked_at_their_median() {
    // Twenty kernels along the view, 0.1 apart and as wide, each with an optical depth of 0.5 at its middle.
    let centers: Vec<Vec3> = (0..20).map(|i| Vec3::Z * (1.0 - 0.1 * i as f32)).collect();
    let sigma = 0.1_f32;
    // ∫ along a line through the middle is m / (2π σ²).
    let mass = |depth: f32| depth * std::f32::consts::TAU * sigma * sigma;
    let volume =
        |depth: f32| kernels(&centers, sigma, Strength::Extinction { masses: vec![mass(depth); 20] });
    let settings =
        RenderSettings { low_pass: 0.0, order: Order::Slabs { thickness: 0.5 }, ..RenderSettings::default() };
    let middle = DVec2::new(20.0, 16.0);
    // Each kernel is smooth over its neighbours' distances: extinction is 5 a unit from z = 1.05 down. T∞ is e^{−10}: half of
    // what is seen is in front at ln 2 / 5 = 0.139 behind that, in the second kernel. Ripple and ends take what ±0.02 is for.
    let thick = pick(&scene(vec![volume(0.5)]), &settings, middle).unwrap();
    assert_eq!(thick.splat, 1);
    assert!((thick.depth - (8.0 - 1.05 + 0.139)).abs() < 0.02, "{thick:?}");
    assert!((thick.opacity - 1.0).abs() < 1e-4);
    // A faint one is picked in its middle, between the tenth and the eleventh.
    let faint = pick(&scene(vec![volume(1e-4)]), &settings, middle).unwrap();
    assert!(faint.splat == 9 || faint.splat == 10, "{faint:?}");
    assert!((faint.depth - 7.95).abs() < 1e-3 && (faint.opacity - 2e-3).abs() < 1e-5, "{faint:?}");
    // Behind the near plane what is left of it.
    let near = camera().with_near(7.55).unwrap();
    let picked =
        Picker::new(&scene(vec![volume(0.5)])).unwrap().pick(&near, &settings, middle).unwrap().unwrap();
    assert!((picked.depth - (7.55 + 0.139)).abs() < 0.02 && picked.splat == 7, "{picked:?}");
    // A surface in it hides what is behind, and is picked where it lets less than half through to it.
    let before = |z: f64| scene(vec![volume(0.5), at(ball(4000, None), 0.0, 0.0, z)]);
    assert_eq!(pick(&before(-0.3), &settings, middle).unwrap().cloud, 0);
    assert_eq!(pick(&before(-0.05), &settings, middle).unwrap().cloud, 1);
    assert_eq!(pick(&scene(vec![]), &settings, middle), None);
    assert_eq!(pick(&before(-0.3), &settings, DVec2::new(1.0, 1.0)), None);
}

#[test]
fn medians_are_those_of_the_reference() {
    // Fog around a ball of glass, as R1 integrates it by steps.
    let centers: Vec<Vec3> = (0..300)
        .map(|i| {
            Vec3::new(
                (i % 10) as f32 * 0.4 - 1.8,
                (i / 10 % 6) as f32 * 0.4 - 1.0,
                (i / 60) as f32 * 0.4 - 1.0,
            )
        })
        .collect();
    let fog = kernels(&centers, 0.3, Strength::Extinction { masses: vec![0.2; centers.len()] });
    let scene =
        scene(vec![fog, at(ball(900, Some(0.3)), 0.3, 0.0, 0.0), at(ball(900, None), -0.5, 0.0, -2.0)]);
    let settings = RenderSettings::default();
    let frame = reference(&scene, &camera(), &settings, ReferenceKind::R1, &|_| {}).unwrap();
    let mut compared = [0; 3];
    at_all_pixels(&scene, &settings, |picked, pixel| {
        let alpha = f64::from(frame.color[pixel][3]);
        let opacity = picked.map_or(0.0, |picked| picked.opacity);
        assert!((opacity - alpha).abs() < 1e-6, "{opacity} where R1 has {alpha}");
        if let Some(picked) = picked.filter(|_| alpha > 1.0 - 1e-7) {
            // Half of all is half of what is seen: depths agree to the single precision of the frame.
            let wanted = f64::from(frame.median_depth[pixel]);
            assert!((picked.depth - wanted).abs() < 2e-6 * wanted, "{picked:?}, R1 {wanted}");
            compared[picked.cloud] += 1;
        }
    });
    println!("{compared:?} pixels compared of fog, glass and the ball behind");
    assert!(compared[0] > 20, "{compared:?}");
}

#[test]
fn trained_splats_are_picked_whole() {
    // Nearer ones last, as ids go; the first that takes the sum of optical depths to half of what is seen.
    let centers: Vec<Vec3> = (0..5).map(|i| Vec3::Z * (i as f32 * 0.05)).collect();
    let opacities = |peaks: [f32; 5]| {
        let strength =
            Strength::Opacity { peaks: peaks.to_vec(), filter: OpacityFilter::Classic, least: 0.0 };
        scene(vec![kernels(&centers, 0.2, strength)])
    };
    let settings = RenderSettings::default();
    // Within where they end, and outside.
    let ended = |x: f64| {
        let strength = Strength::Opacity { peaks: vec![0.6; 5], filter: OpacityFilter::Classic, least: 0.5 };
        pick(&scene(vec![kernels(&centers, 0.2, strength)]), &settings, DVec2::new(x, 16.0))
    };
    assert!(ended(20.0).is_some() && ended(22.0).is_none());
    assert!(pick(&opacities([0.6; 5]), &settings, DVec2::new(22.0, 16.0)).is_some());
    let picked = |peaks: [f32; 5], pixel: DVec2| pick(&opacities(peaks), &settings, pixel).unwrap();
    // T: 0.8, 0.64, 0.512, 0.4096, 0.32768; half of what is seen at 0.664.
    let middle = picked([0.2; 5], DVec2::new(20.0, 16.0));
    assert_eq!((middle.splat, middle.id), (3, 3));
    assert!((middle.opacity - (1.0 - 0.8_f64.powi(5))).abs() < 1e-3, "{middle:?}");
    // One that is opaque enough.
    assert_eq!(picked([0.2, 0.2, 0.99, 0.2, 0.2], DVec2::new(20.0, 16.0)).splat, 2);
    assert_eq!(picked([0.2, 0.2, 0.2, 0.2, 0.9], DVec2::new(20.0, 16.0)).splat, 4);
    // A ball whose front is at z = 0.1 goes through the middle one, of which half lies before it.
    let beside = |opacity, peaks| {
        let mut scene = opacities(peaks);
        scene.clouds.push(at(ball(4000, opacity), 0.0, 0.0, -0.9));
        pick(&scene, &settings, DVec2::new(20.0, 16.0)).unwrap()
    };
    // T: 0.85 at z = 0.2 where 0.84 of it is before the ball, 0.72 at 0.15 (0.69), 0.64 at 0.1; then the ball, at half of all.
    let opaque = beside(None, [0.2; 5]);
    assert_eq!(opaque.cloud, 1);
    assert!((opaque.depth - 7.9).abs() < 0.05 && opaque.opacity > 0.999, "{opaque:?}");
    assert_eq!(beside(None, [0.2, 0.2, 0.2, 0.2, 0.9]).id, 4);
}

#[test]
fn instances_are_told_apart_and_may_move() {
    let one = ball(500, None);
    let mut scene = scene(
        (0..100).map(|i| at(one.clone(), f64::from(i % 10) - 4.5, f64::from(i / 10) - 4.5, 0.0)).collect(),
    );
    scene.clouds.push(at(one.clone(), 0.0, 0.0, -50.0));
    let settings = RenderSettings::default();
    let middle = DVec2::new(20.0, 16.0);
    let mut picker = Picker::new(&scene).unwrap();
    let before = picker.pick(&camera(), &settings, middle).unwrap().unwrap();
    assert!([44, 45, 54, 55].contains(&before.cloud), "{before:?}");
    assert_eq!(before.id as usize, before.cloud * 500 + before.splat);
    // The last one comes to the front, half as large.
    let small = DAffine3::from_scale(DVec3::splat(0.5));
    let to_front = DAffine3::from_translation(dvec3(0.0, 0.0, 4.0)) * small;
    scene.clouds[100] = one.transformed(to_front);
    picker.update(&scene).unwrap();
    let after = picker.pick(&camera(), &settings, middle).unwrap().unwrap();
    assert_eq!(after.cloud, 100);
    // Its front is at z = 4.5 of the world, 3.5 from the eye; samples lie a little inside.
    assert!((after.depth - 3.5).abs() < 0.01, "{after:?}");
    assert_eq!(Some(after), pick(&scene, &settings, middle));
}

#[test]
fn numbers_of_any_size_are_refused_or_answered() {
    let one = ball(100, None);
    let mut scene = scene(vec![one.clone().transformed(DAffine3::from_scale(DVec3::splat(f64::NAN)))]);
    assert!(Picker::new(&scene).is_err());
    // What the picture does not see, for any reason, is not picked; nothing panics.
    for scale in [0.0, 1e-300, 1e-30, 1e30, 1e300] {
        scene.clouds = vec![one.clone().transformed(DAffine3::from_scale(DVec3::splat(scale))), one.clone()];
        let picker = Picker::new(&scene).unwrap();
        let settings = RenderSettings::default();
        for pixel in [DVec2::splat(20.0), DVec2::new(f64::NAN, 1.0), DVec2::splat(1e300), DVec2::splat(-1e9)]
        {
            let picked = picker.pick(&camera(), &settings, pixel).unwrap();
            assert!(picked.is_none_or(|picked| picked.opacity > 0.0));
        }
        let wrong = RenderSettings { low_pass: -1.0, ..settings };
        assert!(picker.pick(&camera(), &wrong, DVec2::ZERO).is_err());
    }
}
