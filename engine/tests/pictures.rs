//! Scenes whose picture is a number.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod scenes;

use glam::{DAffine3, DMat3, DVec3, Mat3, Vec3};
use oblate_engine::{
    Blend, Camera, Channels, Cloud, FootprintForm, Frame, Light, Material, OpacityFilter, Order, Pose,
    ReferenceKind, RenderSettings, Renderer, Scene, SceneError, Splats, Strength, reference, render,
};
use scenes::*;

/// The pixels of the middle square, half the picture wide.
fn middle(frame: &Frame) -> impl Iterator<Item = usize> {
    let (width, height) = (frame.width, frame.height);
    (height / 4..height * 3 / 4).flat_map(move |y| (width / 4..width * 3 / 4).map(move |x| y * width + x))
}

fn extremes(values: impl Iterator<Item = f32>) -> [f32; 2] {
    values.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
}

#[test]
fn constant_density_attenuates_exponentially() {
    // A box of constant extinction, 60 units deep, seen from 4000 units away: all rays are nearly parallel,
    // the path through a face is L over the cosine. The lattice ripple of σ = 0.7 is 4e^{−2π²σ²} = 0.03 %.
    let extinction = 0.02;
    for (spacing, dims) in [(DVec3::ONE, [60, 60, 60]), (DVec3::new(1.0, 1.0, 2.0), [60, 60, 30])] {
        for yaw in [0.0, 20.0, 45.0, 70.0, 90.0_f64] {
            let cloud = fog(dims, spacing, extinction, [1.0; 3]);
            let eye = DMat3::from_rotation_y(yaw.to_radians()) * DVec3::NEG_Z * 4000.0;
            let pose = Pose::look_at(eye, DVec3::ZERO, DVec3::Y).unwrap();
            // 24 units from top to bottom: well inside the box's 60, even where the path is shortest.
            let camera = Camera::perspective(pose, 2.0 * (12.0 / 4000.0_f64).atan(), [48; 2]).unwrap();
            let frame = draw(vec![cloud], &camera, &unshaded());
            let (mut worst, mut seen) = (0.0_f64, 0);
            for (index, pixel) in frame.color.iter().enumerate() {
                let (x, y) = ((index % 48) as f64 + 0.5, (index / 48) as f64 + 0.5);
                let [enters, leaves] = path_through_box(&camera, [x, y], 30.0);
                // Rays that pass within 4σ of an edge of the box see it rounded by the kernels.
                let near_edge = |p: DVec3| p.abs().cmpgt(DVec3::splat(30.0 - 5.6)).bitmask().count_ones() > 1;
                if near_edge(enters) || near_edge(leaves) {
                    continue;
                }
                let expected = 1.0 - (-extinction * enters.distance(leaves)).exp();
                worst = worst.max((f64::from(pixel[3]) / expected - 1.0).abs());
                seen += 1;
            }
            assert!(seen > 500, "only {seen} pixels are far from an edge");
            println!("spacing {spacing}, yaw {yaw}: {worst}");
            assert!(worst <= 0.005, "spacing {spacing}, yaw {yaw}: {worst}");
        }
    }
}

/// Where the ray enters and leaves the cube of half side `half` around the origin.
fn path_through_box(camera: &Camera, [x, y]: [f64; 2], half: f64) -> [DVec3; 2] {
    let to_camera = camera.pose().world_to_camera;
    let intrinsics = camera.intrinsics();
    let in_camera = DVec3::new(
        (x - intrinsics.center.x) / intrinsics.focal.x,
        (y - intrinsics.center.y) / intrinsics.focal.y,
        1.0,
    );
    let direction = (to_camera.matrix3.transpose() * in_camera).normalize();
    let eye = camera.pose().eye();
    let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..3 {
        let (a, b) = ((-half - eye[axis]) / direction[axis], (half - eye[axis]) / direction[axis]);
        near = near.max(a.min(b));
        far = far.min(a.max(b));
    }
    [eye + direction * near, eye + direction * far]
}

#[test]
fn a_lattice_of_surfels_covers_evenly_to_87_degrees() {
    // σ = 0.8 of the spacing ripples by 4e^{−2π²·0.64} = 1.3e-5 an axis; what is left is the cut-off's 0.2 %.
    // Surfels of half the area keep coverage from saturating.
    let (width, length, spacing) = (80, 4000, 0.05);
    let points: Vec<_> = (0..width * length)
        .map(|i| {
            let place = [(i % width) as f32 - 39.5, (i / width) as f32 - 1999.5];
            (Vec3::new(place[0], place[1], 0.0) * spacing, Vec3::NEG_Z)
        })
        .collect();
    let mut splats = surfels(&points, spacing * spacing, [1.0; 3], false).splats();
    if let Strength::Surface(surface) = &mut splats.strength {
        surface.areas.iter_mut().for_each(|area| *area *= 0.5);
        surface.coverage_floor = 1.0;
    }
    let cloud = Cloud::new(splats).unwrap();
    for degrees in [0.0, 30.0, 60.0, 75.0, 87.0] {
        for pixels_apart in [5.0, 1.0, 0.25] {
            // 16 pixels high: at most 64 of the lattice's 80 across and, at 87°, 1220 of its 4000 along.
            let pose = camera(60.0, 16).pose();
            let camera =
                Camera::orthographic(pose, 16.0 * f64::from(spacing) / pixels_apart, [16; 2]).unwrap();
            let tilted = cloud.clone().transformed(tilted(degrees, DVec3::ZERO));
            let frame = draw(vec![tilted], &camera, &unshaded());
            let [low, high] = extremes(middle(&frame).map(|i| frame.color[i][3] * 2.0));
            println!("{degrees}°, {pixels_apart} px apart: coverage {low} to {high}");
            assert!(low >= 0.99 && high <= 1.01, "{degrees}°, {pixels_apart} px: coverage {low} to {high}");
        }
    }
}

#[test]
fn a_plane_has_its_depth() {
    for degrees in [0.0, 30.0, 60.0] {
        let cloud = plane(400, 0.1, [1.0; 3]).transformed(tilted(degrees, DVec3::ZERO));
        // Depth is the mean inside the filter: at a slope of k a pixel it is off by about k² h²,
        // at most 6e-5 here at 60°.
        let camera = camera(30.0, 128);
        for footprint in [FootprintForm::Auto, FootprintForm::Affine, FootprintForm::Exact] {
            let frame = draw(vec![cloud.clone()], &camera, &RenderSettings { footprint, ..unshaded() });
            let normal = DMat3::from_rotation_x(degrees.to_radians()) * DVec3::NEG_Z;
            let mut worst = 0.0_f64;
            for i in middle(&frame) {
                let pixel = glam::DVec2::new((i % 128) as f64 + 0.5, (i / 128) as f64 + 0.5);
                let across = (pixel - camera.intrinsics().center) / camera.intrinsics().focal;
                let ray = camera.pose().world_to_camera.matrix3.transpose() * across.extend(1.0);
                let expected = normal.dot(-camera.pose().eye()) / normal.dot(ray);
                worst = worst.max((f64::from(frame.depth[i]) / expected - 1.0).abs());
                assert!(frame.color[i][3] == 1.0);
                let seen = DVec3::from(frame.normal[i].map(f64::from));
                assert!(seen.dot(normal) > 0.999_99, "normal {seen}");
            }
            println!("{degrees}°, {footprint:?}: {worst}");
            assert!(worst <= 1e-4, "{degrees}°, {footprint:?}: depth off by {worst}");
        }
    }
}

#[test]
fn a_closed_sphere_has_no_hole() {
    // 26 directions, zoom ¼ to 4 around one surfel a pixel.
    let cloud = sphere(20_000, 1.0, [1.0; 3]);
    for direction in directions() {
        for zoom in [0.25, 0.5, 1.0, 2.0, 4.0] {
            let size = (80.0 * zoom) as u32;
            let camera = looking_from(direction * 5.0, size);
            let frame = draw(vec![cloud.clone()], &camera, &unshaded());
            // Inside the outline by two pixels and three surfel radii.
            let outline = (1.0 / 5.0_f64).asin().tan() * camera.intrinsics().focal.x;
            let inside = outline * (1.0 - 3.0 * 0.8 * 0.025) - 2.0;
            for (i, pixel) in frame.color.iter().enumerate() {
                let place =
                    glam::DVec2::new((i % size as usize) as f64 + 0.5, (i / size as usize) as f64 + 0.5);
                if place.distance(camera.intrinsics().center) < inside {
                    assert!(pixel[3] >= 0.999, "{direction}, zoom {zoom}: alpha {} at {place}", pixel[3]);
                }
            }
        }
    }
}

#[test]
fn surfels_make_one_picture_in_any_order() {
    // Along a spiral each is far from the next, so that tiles list them one by one; along a curve through space they are listed by eights.
    let mut apart = sphere(6000, 1.0, [1.0; 3]).splats();
    apart.colors = apart.centers.iter().map(|center| (*center * 0.5 + 0.5).to_array()).collect();
    let [apart, together] =
        [apart.clone(), apart.in_morton_order()].map(|splats| Cloud::new(splats).unwrap());
    let stretched = DAffine3::from_scale(DVec3::new(1.0, 0.6, 1.3));
    for (transform, footprint) in [
        (DAffine3::IDENTITY, FootprintForm::Auto),
        (DAffine3::IDENTITY, FootprintForm::Exact),
        (stretched, FootprintForm::Auto),
    ] {
        let settings = RenderSettings { footprint, ..unshaded() };
        let camera = looking_from(DVec3::new(2.0, -1.0, 3.0), 160);
        let [a, b] = [&apart, &together]
            .map(|cloud| draw(vec![cloud.clone().transformed(transform)], &camera, &settings));
        assert!(a.color.iter().filter(|pixel| pixel[3] > 0.99).count() > 3000);
        // Sums of a few dozen numbers in two orders.
        let near = |(a, b): (&f32, &f32)| (a - b).abs() <= 2e-5 || a == b;
        for (place, (a, b)) in a.color.iter().zip(&b.color).enumerate() {
            assert!(a.iter().zip(b).all(near), "{footprint:?}, pixel {place}: {a:?}, {b:?}");
        }
        let depths = a.depth.iter().zip(&b.depth);
        assert!(depths.into_iter().all(near), "{footprint:?}");
    }
}

#[test]
fn a_crease_lets_nothing_through() {
    // Two faces that meet at a right angle, seen from between them: along the edge the coverage of each falls to
    // a half, and however the two fall into layers, the halves make a whole. (Seen from aside one face fades
    // faster than the other, and coverage itself has a dip; clip lines would mend that.)
    let (side, spacing) = (240, 0.0125);
    let out = -f64::from(spacing) * side as f64 / 2.0;
    let face = plane(side, spacing, [0.0; 3]).transformed(tilted(0.0, DVec3::new(0.0, 0.0, out)));
    let turned = face.clone().transformed(tilted(90.0, DVec3::ZERO));
    for pixels_apart in [0.3, 0.7, 1.0, 2.0, 5.0] {
        // The faces look along −z and +y and meet in the line y = 1.5, z = −1.5.
        let edge = DVec3::new(0.0, -out, out);
        let pose = Pose::look_at(edge + DVec3::new(0.0, 5.0, -5.0), edge, DVec3::X).unwrap();
        let camera = Camera::orthographic(pose, 48.0 * f64::from(spacing) / pixels_apart, [48; 2]).unwrap();
        let frame = draw(vec![face.clone(), turned.clone()], &camera, &unshaded());
        let [least, _] = extremes(frame.color.iter().map(|pixel| pixel[3]));
        println!("{pixels_apart} px apart: least alpha {least}");
        assert!(least >= 0.999, "{pixels_apart} px apart: alpha {least}");
    }
}

fn directions() -> Vec<DVec3> {
    let steps = [-1.0, 0.0, 1.0];
    let all = steps.iter().flat_map(|x| steps.iter().flat_map(|y| steps.map(|z| DVec3::new(*x, *y, z))));
    all.filter(|d| *d != DVec3::ZERO).map(DVec3::normalize).collect()
}

#[test]
fn an_edge_before_a_body_shows_no_fringe() {
    // A half-plane before a wall, both white, then both lit from the front, where they return 0.7: however much of
    // a pixel the edge covers, there is nothing darker between them.
    let front = plane(60, 0.1, [1.0; 3]).transformed(tilted(0.0, DVec3::new(3.0, 0.0, -2.0)));
    let wall = plane(200, 0.1, [1.0; 3]).transformed(tilted(0.0, DVec3::new(0.0, 0.0, 2.0)));
    let lit = |cloud: &Cloud| lambert(cloud).transformed(cloud.cloud_to_world());
    let cases = [
        (vec![front.clone(), wall.clone()], unshaded(), 1.0),
        (vec![lit(&front), lit(&wall)], RenderSettings::default(), 0.7),
    ];
    for (clouds, settings, expected) in cases {
        let frame = draw(clouds, &camera(12.0, 64), &settings);
        for i in middle(&frame) {
            let [red, green, blue, alpha] = frame.color[i];
            assert!(
                [red, green, blue].iter().all(|c| (c - expected).abs() < 1e-3),
                "{:?} at {i}",
                frame.color[i]
            );
            assert!(alpha > 0.999, "alpha {alpha} at {i}");
            // And the depth jumps between the two without a value between them.
            let depth = frame.depth[i];
            assert!((depth - 10.0).abs() < 0.05 || (depth - 14.0).abs() < 0.05, "depth {depth} at {i}");
        }
    }
}

#[test]
fn a_plane_hides_what_is_behind_it_and_half_of_what_it_cuts() {
    let kernel = kernels(vec![Vec3::ZERO], Mat3::from_diagonal(Vec3::splat(1.0)), 4.0, [0.0, 1.0, 0.0]);
    let camera = camera(50.0, 32);
    // A ray through the middle of a kernel of mass m has τ = m/(2πσ²), σ² with the filter's share and the
    // cut-off's gain.
    let filtered = 1.0 + 0.3 * camera.pixel_width_at(50.0).powi(2);
    let gain = 1.0 / (1.0 - (-0.5 * 12.25_f64).exp());
    let whole = 4.0 * gain / (std::f64::consts::TAU * filtered);
    for (shift, share) in [(4.5, 1.0), (0.0, 0.5), (1.0, 0.841_345), (-4.5, 0.0)] {
        let wall = plane(400, 0.1, [1.0, 0.0, 0.0]).transformed(tilted(0.0, DVec3::new(0.0, 0.0, shift)));
        let frame = draw(vec![wall, kernel.clone()], &camera, &unshaded());
        // The four pixels around the centre, a half pixel off in x and y.
        let off = camera.pixel_width_at(50.0).powi(2) * 0.5 / filtered;
        let expected = 1.0 - (-whole * (-0.5 * off).exp() * share).exp();
        let pixel = frame.color[16 * 32 + 16];
        assert!((f64::from(pixel[1]) - expected).abs() < 1e-3, "wall at {shift}: {pixel:?}, not {expected}");
        assert!((pixel[0] + pixel[1] - 1.0).abs() < 1e-3, "{pixel:?}");
    }
}

#[test]
fn a_sheet_seen_edge_on_hides_nothing() {
    // Parallel rays along a sheet: its surfels cover nothing, however wide the pixel's filter makes them.
    let pose = Pose::look_at(DVec3::NEG_Z * 5.0, DVec3::ZERO, DVec3::Y).unwrap();
    let camera = Camera::orthographic(pose, 2.0, [32; 2]).unwrap();
    let steps = || (0..40).map(|i| i as f32 * 0.05 - 0.975);
    let points: Vec<_> =
        steps().flat_map(|x| steps().map(move |z| (Vec3::new(x, 0.0, z - 2.0), Vec3::Y))).collect();
    let wall = || plane(80, 0.05, [0.8; 3]);
    let alone = draw(vec![wall()], &camera, &unshaded());
    let behind = draw(vec![surfels(&points, 0.05 * 0.05, [0.2; 3], false), wall()], &camera, &unshaded());
    for pixel in middle(&alone) {
        let [alone, behind] = [&alone, &behind].map(|frame| frame.color[pixel]);
        // Rounding of the sheet's normal: 1e-7 of 40 surfels' coverage.
        assert!((0..4).all(|i| (alone[i] - behind[i]).abs() < 1e-4), "{behind:?}, the wall alone {alone:?}");
        assert!(behind[3] > 0.99);
    }
}

#[test]
fn the_side_that_is_seen_has_the_normal_and_the_light() {
    let plane = plane(60, 0.1, [1.0; 3]);
    let lit = Light::Directional { towards: DVec3::Z, color: [1.0; 3] };
    for (eye_z, bright) in [(-10.0, 0.0), (10.0, 0.7)] {
        let scene = Scene { clouds: vec![lambert(&plane)], lights: vec![lit] };
        let view = looking_from(DVec3::new(0.0, 0.0, eye_z), 16);
        let frame = render(&scene, &view, &RenderSettings::default(), &()).unwrap();
        for i in middle(&frame) {
            let normal = DVec3::from(frame.normal[i].map(f64::from));
            assert!(normal.distance(DVec3::Z * eye_z.signum()) < 1e-4, "from {eye_z}: normal {normal}");
            assert!((frame.color[i][0] - bright).abs() < 1e-4, "from {eye_z}: {:?}", frame.color[i]);
        }
    }
}

/// The same surfels, returning diffuse light only.
#[test]
fn unlit_splats_show_their_colours_whatever_the_lights() {
    let color = [0.2, 0.5, 0.8];
    let surface = plane(20, 0.05, color);
    let extinction = kernels(vec![Vec3::ZERO], Mat3::IDENTITY, 1e4, color);
    let mut trained = extinction.splats();
    trained.strength = Strength::Opacity { peaks: vec![1.0], filter: OpacityFilter::Classic, least: 0.0 };
    let camera = camera(5.0, 9);
    let aside = Light::Directional { towards: DVec3::new(0.6, 0.0, -0.8), color: [0.5; 3] };
    let ambient = Light::Ambient { color: [0.3, 0.0, 2.0] };
    for cloud in [surface, extinction, Cloud::new(trained).unwrap()] {
        for lights in [vec![], vec![aside], vec![ambient], vec![ambient, aside]] {
            let scene = Scene { clouds: vec![cloud.clone()], lights };
            let settings = RenderSettings::default();
            let drawn = render(&scene, &camera, &settings, &()).unwrap();
            let r1 = reference(&scene, &camera, &settings, ReferenceKind::R1, &|_| ()).unwrap();
            for frame in [drawn, r1] {
                let pixel = frame.color[40];
                for (found, expected) in pixel.into_iter().zip([color[0], color[1], color[2], 1.0]) {
                    // Opacity in the middle is at least 1 − 1e-4; the early stop leaves 1e-3 of what is behind.
                    assert!((found - expected).abs() < 1e-3, "{pixel:?} with {:?}", scene.lights);
                }
            }
        }
    }
}

fn lambert(cloud: &Cloud) -> Cloud {
    let material = Material { emission: 0.0, ambient: 0.0, diffuse: 0.7, specular: 0.0, exponent: 1.0 };
    Cloud::new(Splats { material, ..cloud.splats() }).unwrap()
}

#[test]
fn the_thinnest_media_add_up() {
    // 1000 kernels of τ = 2e-8 each: colour, alpha and depth are those of one of 2e-5.
    let centers: Vec<Vec3> = (0..1000).map(|i| Vec3::new(0.0, 0.0, 10.0 + i as f32 * 1e-3)).collect();
    let view = Camera::orthographic(camera(10.0, 1).pose(), 1e-3, [1; 2]).unwrap();
    let mass = (2e-8 * std::f64::consts::TAU) as f32;
    let cloud = kernels(centers, Mat3::IDENTITY, mass, [1.0; 3]);
    let frame = draw(vec![cloud], &view, &unshaded());
    let expected = 2e-5 / (1.0 - (-0.5 * 12.25_f64).exp());
    for value in [frame.color[0][0], frame.color[0][3]] {
        assert!((f64::from(value) / expected - 1.0).abs() < 1e-3, "{value} is not {expected}");
    }
    assert!((frame.expected_depth[0] - 20.5).abs() < 0.01, "{}", frame.expected_depth[0]);
}

#[test]
fn nothing_and_next_to_nothing_can_be_drawn() {
    let view = camera(5.0, 1);
    assert_eq!(draw(Vec::new(), &view, &unshaded()), Frame::new(1, 1));
    let squashed = DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.0));
    let huge = DAffine3::from_scale(DVec3::splat(1e15));
    let mirrored = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    for transform in [squashed, huge, mirrored, DAffine3::ZERO] {
        let clouds = vec![
            fog([4; 3], DVec3::splat(0.2), 1.0, [0.5; 3]).transformed(transform),
            sphere(100, 0.5, [0.5; 3]).transformed(transform),
        ];
        for settings in [unshaded(), RenderSettings { low_pass: 0.0, ..RenderSettings::default() }] {
            let frame = draw(clouds.clone(), &view, &settings);
            assert!(frame.color[0].iter().all(|c| c.is_finite()), "{transform}: {:?}", frame.color[0]);
        }
    }
}

#[test]
fn colours_and_masses_beyond_measure_stay_numbers() {
    let view = camera(5.0, 9);
    for (color, mass) in [(1e30, 1e30), (1e30, f32::MAX), (1e33, 1e30), (1e33, 1.0), (1e-30, f32::MAX)] {
        let kernel = |size: f32| {
            kernels(vec![Vec3::ZERO; 3], Mat3::from_diagonal(Vec3::splat(size)), mass, [color; 3])
        };
        for order in [Order::Auto, Order::Centers, Order::PerPixel] {
            for footprint in [FootprintForm::Auto, FootprintForm::Exact] {
                let settings = RenderSettings { order, footprint, ..unshaded() };
                let frame = draw(vec![kernel(1e-17), kernel(0.3)], &view, &settings);
                let middle = frame.color[40];
                assert!(
                    frame.color.iter().flatten().all(|c| c.is_finite()),
                    "{color:e}, {mass:e}: {middle:?}"
                );
                // Of such a mass it is opaque, and its own colour.
                let is_opaque = mass < 1e29 || (middle[0] / color - 1.0).abs() < 1e-4 && middle[3] > 0.9999;
                assert!(is_opaque, "{color:e}, {mass:e}: {middle:?}");
            }
        }
    }
}

#[test]
fn what_cannot_be_drawn_is_refused() {
    let view = camera(5.0, 1);
    let refused = |scene: &Scene, settings: &RenderSettings| render(scene, &view, settings, &()).unwrap_err();
    let (empty, fine) = (Scene::default(), RenderSettings::default());
    for settings in [
        RenderSettings { low_pass: -1.0, ..fine },
        RenderSettings { low_pass: f64::NAN, ..fine },
        RenderSettings { tolerance: 2.0, ..fine },
        RenderSettings { cutoff: 0.0, ..fine },
        RenderSettings { outline: 0.0, ..fine },
        RenderSettings { background: [0.0, 0.0, 0.0, 2.0], ..fine },
    ] {
        assert!(matches!(refused(&empty, &settings), SceneError::Setting { .. }));
    }
    let dark = Light::Directional { towards: DVec3::ZERO, color: [1.0; 3] };
    let scene = Scene { clouds: Vec::new(), lights: vec![dark] };
    assert!(matches!(refused(&scene, &fine), SceneError::Light { index: 0, .. }));
    let lost = sphere(10, 1.0, [1.0; 3]).transformed(DAffine3::from_scale(DVec3::splat(f64::NAN)));
    let scene = Scene { clouds: vec![lost], lights: Vec::new() };
    assert!(matches!(refused(&scene, &fine), SceneError::Transform { cloud: 0 }));
    assert!(camera(5.0, 1).with_near(-1.0).is_err() && camera(5.0, 1).with_near(f64::NAN).is_err());
}

#[test]
fn threads_change_no_bit() {
    let clouds = vec![
        fog([20, 20, 20], DVec3::splat(0.1), 1.0, [0.2, 0.5, 0.9]),
        sphere(5000, 0.7, [0.9, 0.3, 0.1]),
        plane(50, 0.05, [0.8; 3]).transformed(tilted(40.0, DVec3::ZERO)),
    ];
    let view = looking_from(DVec3::new(2.0, 1.5, -4.0), 100);
    let frames: Vec<Frame> = [1, 2, 5]
        .into_iter()
        .map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| draw(clouds.clone(), &view, &RenderSettings::default()))
        })
        .collect();
    assert!(frames[0].color.iter().any(|pixel| pixel[3] > 0.5));
    assert!(frames.iter().all(|frame| bits(frame) == bits(&frames[0])));
}

fn bits(frame: &Frame) -> Vec<u32> {
    let channels = frame.color.iter().flatten().chain(&frame.depth).chain(&frame.expected_depth);
    let numbers = channels.chain(frame.normal.iter().flatten()).map(|c| c.to_bits());
    numbers.chain(frame.id.iter().copied()).collect()
}

#[test]
fn a_camera_inside_a_fog_neither_flashes_nor_loses_it() {
    // Inside a constant fog with a wall at distance L the wall shows through with e^{−κL}, wherever the
    // camera stands between the kernels.
    let extinction = 0.2;
    for step in 0..8 {
        let shift = f64::from(step) * 0.125;
        let fog = fog([30, 30, 60], DVec3::ONE, extinction, [0.0; 3]);
        let wall = plane(120, 0.25, [1.0; 3]).transformed(tilted(0.0, DVec3::new(0.0, 0.0, 6.0)));
        let eye = DVec3::new(0.3, -0.2, -3.0 + shift);
        let pose = Pose::look_at(eye, eye + DVec3::Z, DVec3::Y).unwrap();
        let camera = Camera::perspective(pose, 0.6, [24; 2]).unwrap();
        let frame = draw(vec![fog, wall], &camera, &unshaded());
        let mut worst = 0.0_f64;
        for (i, pixel) in frame.color.iter().enumerate() {
            let place = glam::DVec2::new((i % 24) as f64 + 0.5, (i / 24) as f64 + 0.5);
            let ray = ((place - camera.intrinsics().center) / camera.intrinsics().focal).extend(1.0);
            let expected = (-extinction * (9.0 - shift) * ray.length()).exp();
            worst = worst.max((f64::from(pixel[0]) - expected).abs());
        }
        println!("shift {shift}: {worst}");
        assert!(worst < 0.005, "shift {shift}: {worst}");
    }
}

#[test]
fn a_renderer_shows_nothing_of_earlier_pictures() {
    // A ball, some fog, both or neither, in a few tiles of the picture, here and there.
    let ball = |x| sphere(400, 0.3, [0.9, 0.4, 0.1]).transformed(DAffine3::from_translation(DVec3::X * x));
    let cloud = |y| {
        fog([6; 3], DVec3::splat(0.1), 2.0, [0.2, 0.5, 0.9])
            .transformed(DAffine3::from_translation(DVec3::Y * y))
    };
    let scene = |clouds| Scene { clouds, lights: Vec::new() };
    let scenes = [
        scene(vec![ball(-1.5)]),
        scene(vec![ball(1.5)]),
        scene(vec![cloud(1.5), ball(-1.5)]),
        scene(vec![cloud(-1.5)]),
        scene(Vec::new()),
        scene(vec![ball(0.0), cloud(0.0)]),
    ];
    let plain = unshaded();
    let green = RenderSettings { background: [0.0, 0.5, 0.0, 0.5], ..plain };
    let display = RenderSettings { blend: Blend::Display, ..green };
    let colors = RenderSettings { channels: Channels::Color, ..display };
    let mut renderer = Renderer::new();
    for (settings, size) in [(plain, 96), (green, 96), (display, 96), (colors, 96), (plain, 96), (plain, 72)]
    {
        for number in [0, 1, 0, 2, 3, 4, 5, 4] {
            let (scene, camera) = (&scenes[number], camera(8.0, size));
            let fresh = render(scene, &camera, &settings, &()).unwrap();
            let kept = renderer.render(scene, &camera, &settings, &()).unwrap();
            assert!(*kept == fresh, "scene {number}, {size} pixels, {settings:?}");
        }
    }
}

/// A few colours are display-encoded once, many whenever they are drawn: by one curve.
#[test]
fn few_colors_are_shown_as_many_are() {
    let cloud = |count: usize, nudge: f32| {
        let mut splats = fog([18; 3], DVec3::splat(0.1), 2.0, [0.0; 3]).splats();
        for (i, color) in splats.colors.iter_mut().enumerate() {
            let own = (i * 7 % count) as f32;
            *color = [0.9 / (1.0 + own), 0.002 * own, 0.3 + nudge * i as f32];
        }
        vec![Cloud::new(splats).unwrap()]
    };
    let camera = scenes::camera(20.0, 32);
    let settings = RenderSettings { blend: Blend::Display, ..unshaded() };
    for count in [1, 5, 200] {
        let [few, many] = [0.0, 1e-9].map(|nudge| draw(cloud(count, nudge), &camera, &settings).color);
        let off = few.iter().flatten().zip(many.iter().flatten()).map(|(a, b)| (a - b).abs());
        let most = off.fold(0.0, f32::max);
        // The curve is within 2e-6 when it is drawn; a millionth of blue is added.
        assert!(most <= 1e-5, "{count} colours: {most:e}");
        assert!(few.iter().any(|color| color[3] > 0.5), "{count} colours: nothing shows");
    }
}

/// A ball is the same picture however large it is, made so or scaled: by rounding alone, powers of two would change nothing.
#[test]
fn sizes_change_nothing() {
    let lit = RenderSettings::default();
    let ball = |size: f32| lambert(&sphere(4000, size, [0.8, 0.5, 0.2]));
    let expected = draw(vec![ball(1.0)], &camera(6.0, 48), &lit);
    for size in [1e-12, 1e-9, 1e-5, 1e5, 1e9, 1e12] {
        let made = ball(size as f32);
        let scaled = ball(1.0).transformed(DAffine3::from_scale(DVec3::splat(size)));
        for cloud in [made.clone(), scaled, made.with_levels_for(1.0 / 255.0)] {
            let frame = draw(vec![cloud], &camera(6.0 * size, 48), &lit);
            for (found, expected) in frame.color.iter().flatten().zip(expected.color.iter().flatten()) {
                assert!((found - expected).abs() < 2e-3, "{found}, not {expected}, {size:e} in size");
            }
        }
    }
}
