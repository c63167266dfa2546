//! Two sheets of surfels, one close behind the other: the front one hides the back one and has no holes.

use super::scenes::surfels;
use super::*;
use oblate_engine::Pose;

const SIZE: u32 = 16;
/// Between surfels; a pixel is 1 wide.
const SPACING: f32 = 1.5;
const RED: [f32; 3] = [1.0, 0.0, 0.0];
const GREEN: [f32; 3] = [0.0, 1.0, 0.0];

/// A sheet that fills the picture when it is tilted about the x axis, shifted along its normal.
fn sheet(degrees: f32, behind: f32, color: [f32; 3]) -> Cloud {
    let tilt = Mat3::from_rotation_x(degrees.to_radians());
    // So far that no border is seen: four pixels and six surfels beyond the picture's, and as much farther as the back
    // sheet is displaced.
    let reach = |length: f32| (length / SPACING).ceil() as i32 + 6;
    let half = SIZE as f32 / 2.0 + 4.0;
    let (across, along) = (reach(half), reach((half + behind) / degrees.to_radians().cos()));
    let points: Vec<_> = (-along..=along)
        .flat_map(|j| (-across..=across).map(move |i| Vec3::new(i as f32, j as f32, 0.0) * SPACING))
        .map(|p| (tilt * (p + Vec3::Z * behind), tilt * Vec3::NEG_Z))
        .collect();
    surfels(&points, SPACING * SPACING, color, false)
}

#[test]
fn the_back_sheet_does_not_leak_and_the_front_one_has_no_holes() {
    let pose = Pose::look_at(DVec3::NEG_Z * 2000.0, DVec3::ZERO, DVec3::Y).unwrap();
    let camera = Camera::orthographic(pose, f64::from(SIZE), [SIZE; 2]).unwrap();
    let radius = 0.8 * SPACING;
    // How far along z a layer may find what belongs to it: a radius and three σ_z, and as far as a sample may lie from
    // its plane, in the filter of the pixel.
    let reach = |degrees: f32| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let (width, filter) = ((radius * cos).powi(2), unshaded().low_pass as f32);
        let sigma_z = radius * sin * (filter / (width + filter)).sqrt();
        let from_plane = sin / cos * filter * (unshaded().outline as f32 / (width + filter)).sqrt();
        radius + 3.0 * sigma_z + from_plane
    };
    for degrees in [0.0, 30.0, 60.0, 75.0, 85.0, 88.0] {
        let front = sheet(degrees, 0.0, RED);
        let alone = draw(vec![front.clone()], &camera, &unshaded());
        let hole = alone.color.iter().map(|c| 1.0 - f64::from(c[3])).fold(0.0, f64::max);
        println!("{degrees}°: hole {hole:.5}");
        assert!(hole <= LEVEL, "{degrees}°: a hole of {hole}");
        for radii in [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 10.0] {
            let back = sheet(degrees, radii * radius, GREEN);
            let frame = draw(vec![front.clone(), back], &camera, &unshaded());
            let largest = |channel: fn(&[f32; 4]) -> f32| frame.color.iter().map(channel).fold(0.0, f32::max);
            let (leak, hole) = (largest(|c| c[1]), largest(|c| 1.0 - c[3]));
            println!("{degrees}°, {radii} radii: leak {leak:.5}, hole {hole:.5}");
            assert!(f64::from(hole) <= LEVEL, "{degrees}°, {radii} radii: a hole of {hole}");
            let is_behind = radii * radius / degrees.to_radians().cos() > reach(degrees);
            assert!(!is_behind || f64::from(leak) <= LEVEL, "{degrees}°, {radii} radii: a leak of {leak}");
        }
    }
}

/// Surfels seen edge-on, as along a silhouette, hang before two sheets, one ten pixels behind the other. Their planes go through both.
#[test]
fn what_is_seen_edge_on_does_not_make_one_of_sheets_behind_it() {
    let pose = Pose::look_at(DVec3::NEG_Z * 2000.0, DVec3::ZERO, DVec3::Y).unwrap();
    let camera = Camera::orthographic(pose, f64::from(SIZE), [SIZE; 2]).unwrap();
    let steep = Mat3::from_rotation_y(89_f32.to_radians()) * Vec3::NEG_Z;
    // The filter reaches 3.5 √0.3 pixels, planes are followed 15 times as far, 29, and a layer takes what is 1 behind. Followed 30 times as
    // far they made what is seen beside the edge half green. Those of surfels of a twentieth of the filter are followed 3.5 times as far, 7.
    for (spacing, fars) in [(SPACING, [34.0, 40.0, 50.0]), (0.03, [18.0, 24.0, 30.0])] {
        let count = (20.0 * SPACING / spacing) as i32;
        let edge: Vec<_> =
            (-count..=count).map(|j| (Vec3::new(0.2 * SPACING, j as f32 * spacing, 0.0), steep)).collect();
        let edge = surfels(&edge, spacing * spacing, RED, false);
        for far in fars {
            let clouds = vec![edge.clone(), sheet(0.0, far - 10.0, RED), sheet(0.0, far, GREEN)];
            let frame = draw(clouds, &camera, &unshaded());
            let leak = frame.color.iter().map(|c| c[1]).fold(0.0, f32::max);
            assert!(f64::from(leak) <= LEVEL, "{spacing}, {far}: a leak of {leak}");
        }
    }
}
