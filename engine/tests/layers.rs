//! Many translucent surfaces, one behind the other.

#![allow(clippy::unwrap_used, reason = "a test fails where it unwraps")]

mod scenes;

use glam::{DAffine3, DVec3, Vec3};
use oblate_engine::{Camera, Cloud, Frame, Pose, ReferenceKind, RenderSettings, Scene, Strength, reference};
use scenes::*;

const COUNT: usize = 12;
const OPACITY: f32 = 0.3;

/// Colours that no two sheets share.
fn color(sheet: usize) -> [f32; 3] {
    [sheet as f32 / 11.0, (sheet * 5 % COUNT) as f32 / 11.0, (sheet * 7 % COUNT) as f32 / 11.0]
}

/// Sheets that face −z, a distance apart, the first one nearest. In a scene far ones come among near ones.
fn stack(count: usize, opacity: f32, distance: f64) -> Vec<Cloud> {
    let sheet = |i: usize| {
        let mut splats = plane(50, 0.05, color(i)).splats();
        if let Strength::Surface(surface) = &mut splats.strength {
            surface.opacities = Some(vec![opacity; splats.centers.len()]);
        }
        let middle = (count as f64 - 1.0) / 2.0;
        let shift = DVec3::Z * ((i as f64 - middle) * distance);
        Cloud::new(splats).unwrap().transformed(tilted(0.0, shift))
    };
    (0..count).map(|i| sheet(i * 5 % count)).collect()
}

fn largest_error(a: &Frame, b: &Frame) -> f32 {
    let channels = |frame: &Frame| frame.color.clone().into_iter().flatten();
    channels(a).zip(channels(b)).map(|(p, q)| (p - q).abs()).fold(0.0, f32::max)
}

fn r1(clouds: &[Cloud], camera: &Camera, settings: &RenderSettings) -> Frame {
    let scene = Scene { clouds: clouds.to_vec(), lights: Vec::new() };
    reference(&scene, camera, settings, ReferenceKind::R1, &|_| ()).unwrap()
}

#[test]
fn twelve_sheets_are_composited_one_by_one() {
    let background = [0.2, 0.9, 0.4, 1.0];
    let settings = RenderSettings { background, ..unshaded() };
    // All of the picture within all of the sheets.
    let camera = camera(3.6, 24);
    let sheets = stack(COUNT, OPACITY, 0.12);
    let frame = draw(sheets.clone(), &camera, &settings);
    let (mut expected, mut through) = ([0.0; 3], 1.0);
    for i in 0..COUNT {
        let shown = through * f64::from(OPACITY);
        expected = std::array::from_fn(|c| expected[c] + shown * f64::from(color(i)[c]));
        through -= shown;
    }
    expected = std::array::from_fn(|c| expected[c] + through * f64::from(background[c]));
    for pixel in &frame.color {
        for (value, expected) in pixel.iter().zip(expected.into_iter().chain([1.0])) {
            // A mean over a layer is right to 2e-5, a pixel is a mean of layers.
            assert!((f64::from(*value) - expected).abs() < 2e-5, "{pixel:?}, not {expected:?}");
        }
    }
    assert!(largest_error(&frame, &r1(&sheets, &camera, &settings)) < 3e-5);
}

#[test]
fn twelve_sheets_in_thin_fog_are_r1s() {
    // Sheets are as far apart as kernels are: each kernel reaches through half of them.
    let mut clouds = stack(COUNT, OPACITY, 0.15);
    clouds.push(fog([14; 3], DVec3::splat(0.15), 0.3, [0.3, 0.5, 0.9]));
    let pose = Pose::look_at(DVec3::new(1.5, 1.0, -4.0), DVec3::ZERO, DVec3::Y).unwrap();
    for camera in
        [Camera::perspective(pose, 0.5, [32; 2]).unwrap(), Camera::orthographic(pose, 2.0, [32; 2]).unwrap()]
    {
        let frame = draw(clouds.clone(), &camera, &unshaded());
        let error = largest_error(&frame, &r1(&clouds, &camera, &unshaded()));
        println!("largest error {error}");
        assert!(error <= 1.0 / 255.0, "{error}");
    }
}

/// A sheet of which the left half is cut out, before a wall of half its width: what shows first is the sheet, the wall or nothing.
#[test]
fn what_is_cut_out_is_no_surface() {
    let mut splats = plane(50, 0.05, [1.0; 3]).splats();
    let Strength::Surface(surface) = &mut splats.strength else { unreachable!("they are surfels") };
    surface.opacities =
        Some(splats.centers.iter().map(|center| f32::from(u8::from(center.x > 0.0))).collect());
    let sheet = Cloud::new(splats).unwrap();
    let mut wall = plane(50, 0.05, [0.5; 3]).splats();
    for center in &mut wall.centers {
        center.y = 0.5 * center.y - 0.625;
    }
    let wall = Cloud::new(wall).unwrap().transformed(tilted(0.0, DVec3::Z));
    let camera = camera(3.6, 32);
    let clouds = [sheet.transformed(tilted(0.0, DVec3::ZERO)), wall];
    for frame in [draw(clouds.to_vec(), &camera, &unshaded()), r1(&clouds, &camera, &unshaded())] {
        for (pixel, color) in frame.color.iter().enumerate() {
            let [x, y] =
                [pixel % 32, pixel / 32].map(|at| (at as f64 + 0.5 - 16.0) / camera.intrinsics().focal.x);
            // Edges, at 3.6 and 4.6 before the camera, are a few surfels wide.
            if (x * 3.6).abs() < 0.2 || (y * 4.6).abs() < 0.2 {
                continue;
            }
            let is_cut_out = color[3] < 0.5 || frame.depth[pixel] > 4.0;
            let expected = [3.6, 4.6, f64::INFINITY];
            let found = f64::from(frame.depth[pixel]);
            let matches = |expected: f64| found == expected || (found - expected).abs() < 1e-3;
            assert!(expected.into_iter().any(matches), "{pixel}: {found}");
            let shows = frame.id[pixel] != Frame::NO_ID && frame.normal[pixel] != [0.0; 3];
            assert_eq!((color[3] > 0.5, is_cut_out), (shows, !matches(3.6)), "{pixel}: {color:?} at {found}");
        }
        let count = |depth: f64| frame.depth.iter().filter(|z| (f64::from(**z) - depth).abs() < 1e-3).count();
        assert!(count(3.6) > 400 && count(4.6) > 150, "{} and {}", count(3.6), count(4.6));
        assert!(frame.depth.iter().filter(|z| **z == f32::INFINITY).count() > 150);
    }
}

/// Of 67 sheets, a quarter of the light passes all; in a picture so many pixels wide, which is R1's.
fn opacity_of_67_sheets(pixels: u32) -> f64 {
    let sheets = stack(67, 0.02, 0.05);
    let pose = Pose::look_at(DVec3::Z * -5.0, DVec3::ZERO, DVec3::Y).unwrap();
    let camera = Camera::orthographic(pose, 2.0, [pixels; 2]).unwrap();
    let frame = draw(sheets.clone(), &camera, &unshaded());
    assert!(largest_error(&frame, &r1(&sheets, &camera, &unshaded())) < 3e-5);
    f64::from(frame.color[(pixels * pixels / 2 + pixels / 2) as usize][3])
}

#[test]
fn beyond_64_layers_the_last_takes_the_rest() {
    let alpha = opacity_of_67_sheets(24);
    assert!((alpha - (1.0 - 0.98f64.powi(67))).abs() < 1e-4, "{alpha}");
}

/// Sheets a third of the filter's σ apart are nearer to each other than layers are thick: few layers, each as opaque as its sheets are together.
#[test]
fn layers_of_several_sheets_are_as_opaque_as_these() {
    let alpha = opacity_of_67_sheets(8);
    assert!((alpha - (1.0 - 0.98f64.powi(67))).abs() < 1e-3, "{alpha}");
}

/// A white wall with a red sheet of each opacity a fifth of a pixel before or behind it, which share layers, on its left half: the wall is as opaque as ever,
/// and a clear sheet has no colour.
#[test]
fn opaque_sheets_stay_opaque_beside_others() {
    let camera = camera(5.0, 32);
    for (opacity, behind) in [(0.0, -0.02), (0.0, 0.02), (0.3, 0.02), (0.9, 0.02), (0.9, -0.02)] {
        let mut splats = plane(50, 0.05, [1.0, 0.0, 0.0]).splats();
        let Strength::Surface(surface) = &mut splats.strength else { unreachable!("they are surfels") };
        surface.opacities = Some(vec![opacity; splats.centers.len()]);
        for center in &mut splats.centers {
            center.x -= 1.25;
        }
        let wall = plane(50, 0.05, [1.0; 3]).transformed(tilted(0.0, DVec3::ZERO));
        let sheet = Cloud::new(splats).unwrap().transformed(tilted(0.0, DVec3::Z * behind));
        let clouds = [wall, sheet];
        for frame in [draw(clouds.to_vec(), &camera, &unshaded()), r1(&clouds, &camera, &unshaded())] {
            for (pixel, color) in frame.color.iter().enumerate() {
                let [x, y] = [pixel % 32, pixel / 32].map(|at| at as f64 + 0.5 - 16.0);
                // The wall fills the middle half of the picture.
                if x.abs() > 5.0 || y.abs() > 5.0 {
                    continue;
                }
                // Where the sheet ends, in the middle, as much of it as a single sheet may cover too much, 7 %, counts beside the wall.
                let least = if x.abs() < 3.0 { 0.93 } else { 0.999 };
                assert!(color[3] > least, "{opacity} at {behind}: {pixel}: {color:?}");
                assert!(opacity > 0.0 || color[1] > least, "{opacity} at {behind}: {pixel}: {color:?}");
            }
        }
    }
}

/// A red sheet before a green wall, nearer than a layer is thick, seen face on and at a slant: the wall's colour shows as far as the sheet lets it through.
#[test]
fn near_sheets_hide_the_colours_of_far_ones() {
    for (opacity, degrees, gap) in
        [(1.0, 0.0, 0.02), (1.0, 40.0, 0.02), (0.38, 0.0, 0.02), (0.38, 40.0, 0.03)]
    {
        let pose = Pose::look_at(DVec3::new(0.0, 0.0, -5.0), DVec3::ZERO, DVec3::Y).unwrap();
        let camera = Camera::orthographic(pose, 1.6, [24; 2]).unwrap();
        let mut splats = plane(50, 0.05, [1.0, 0.0, 0.0]).splats();
        let Strength::Surface(surface) = &mut splats.strength else { unreachable!("they are surfels") };
        surface.opacities = Some(vec![opacity; splats.centers.len()]);
        let turned = tilted(degrees, DVec3::ZERO);
        let before = turned * DAffine3::from_translation(DVec3::NEG_Z * gap);
        let wall = plane(50, 0.05, [0.0, 1.0, 0.0]).transformed(turned);
        let clouds = [wall, Cloud::new(splats).unwrap().transformed(before)];
        for frame in [draw(clouds.to_vec(), &camera, &unshaded()), r1(&clouds, &camera, &unshaded())] {
            for pixel in &frame.color {
                // Coverage of both ripples by 1 %.
                let error = (pixel[0] - opacity).abs().max((pixel[1] - (1.0 - opacity)).abs());
                assert!(error < 0.01 && pixel[3] > 0.999, "{opacity} at {degrees}°: {pixel:?}");
            }
        }
    }
}

/// Two sheets of one layer that cover a pixel no more than once, of a cloud that covers evenly (a floor of 1): their colours mix, in R1, too.
#[test]
fn half_covered_sheets_lie_beside_each_other() {
    let half = |color: [f32; 3], shift: f64| {
        let mut splats = plane(50, 0.05, color).splats();
        let Strength::Surface(surface) = &mut splats.strength else { unreachable!("they are surfels") };
        surface.areas.iter_mut().for_each(|area| *area *= 0.45);
        surface.coverage_floor = 1.0;
        Cloud::new(splats).unwrap().transformed(tilted(0.0, DVec3::Z * shift))
    };
    let clouds = [half([1.0, 0.0, 0.0], 0.0), half([0.0, 1.0, 0.0], 0.02)];
    let pose = Pose::look_at(DVec3::Z * -5.0, DVec3::ZERO, DVec3::Y).unwrap();
    let camera = Camera::orthographic(pose, 1.6, [24; 2]).unwrap();
    for frame in [draw(clouds.to_vec(), &camera, &unshaded()), r1(&clouds, &camera, &unshaded())] {
        for pixel in &frame.color {
            // Coverage ripples by 1 %.
            let error = pixel[..2].iter().map(|c| (c - 0.45).abs()).fold(0.0, f32::max);
            assert!(error < 0.01, "{pixel:?}");
        }
    }
}

/// A surfel like a sun in the corner of a picture takes no digits from a dim sheet in the rest of the tile, however they are listed.
#[test]
fn a_bright_surfel_leaves_the_rest_of_its_tile_as_it_is() {
    let sheet = plane(50, 0.05, [0.25, 0.1, 0.01]);
    let sun = surfels(&[(Vec3::new(-0.8, -0.8, -3.0), Vec3::NEG_Z)], 1e-4, [1e9; 3], false);
    let pose = Pose::look_at(DVec3::Z * -5.0, DVec3::ZERO, DVec3::Y).unwrap();
    let camera = Camera::orthographic(pose, 2.0, [8; 2]).unwrap();
    let alone = draw(vec![sheet.clone()], &camera, &unshaded());
    for clouds in [vec![sheet.clone(), sun.clone()], vec![sun, sheet]] {
        let frame = draw(clouds, &camera, &unshaded());
        let corner = |[left, top]: [usize; 2]| {
            let pixels = (0..9).map(move |i| (top + i / 3) * 8 + left + i % 3);
            pixels
                .flat_map(|i| (0..4).map(move |c| [i, c]))
                .map(|[i, c]| (frame.color[i][c] - alone.color[i][c]).abs())
        };
        let error = |place| corner(place).fold(0.0, f32::max);
        // It shines in one corner of the picture, which is one tile. Sums in another order round otherwise.
        let dim = [[0, 0], [5, 0], [0, 5], [5, 5]].into_iter().filter(|place| error(*place) < 1e-5).count();
        assert_eq!(dim, 3);
    }
}
