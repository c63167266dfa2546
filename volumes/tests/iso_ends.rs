//! From where iso-surfaces that end at the border of their grid show no backs.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod common;

use common::*;
use glam::{DMat3, DVec3};
use oblate_engine::{Camera, Closed, Cloud, Frame, Pose, RenderSettings, Scene, Strength, render};
use oblate_volumes::{GridFrame, IsoSettings, Volume, iso_surfels};

fn cloud(volume: &Volume) -> Cloud {
    iso_surfels(volume, 0.0, &IsoSettings::default()).unwrap()
}

/// A ball whose middle is a sample.
fn ball(dims: [usize; 3], frame: GridFrame, middle: [usize; 3], sign: f64) -> Volume {
    let steps = frame.direction * DMat3::from_diagonal(frame.spacing);
    let middle = frame.origin + steps * DVec3::from(middle.map(|i| i as f64));
    sampled(dims, frame, |p| sign * (4.3 * frame.spacing.max_element() - (p - middle).length()))
}

/// Whether a point, in steps, is in all half-spaces.
fn is_within(closed: &Closed, frame: GridFrame, steps: DVec3) -> bool {
    let Closed::Within(planes) = closed else { panic!("the body has no gaps") };
    let point = frame.direction * (frame.spacing * steps);
    planes.iter().all(|plane| plane.normal.dot(point) >= plane.offset)
}

#[test]
fn bodies_end_at_the_faces_they_reach() {
    let dims = [20, 24, 18];
    for (name, frame) in frames() {
        let closed = |volume: &Volume| surface(&cloud(volume)).closed;
        let middle = DVec3::new(9.5, 11.5, 8.5);
        let beyond = |axis: usize, last: bool| {
            let border = if last { (dims[axis] - 1) as f64 + 0.01 } else { -0.01 };
            let mut point = middle;
            point[axis] = border;
            point
        };
        let all_faces = || (0..3).flat_map(|axis| [false, true].map(|last| (axis, last)));
        let whole = closed(&ball(dims, frame, [9, 11, 8], 1.0));
        assert!(whole.is_everywhere(), "{name}");
        // Around a sample of an edge of the grid.
        let cut = closed(&ball(dims, frame, [9, 23, 0], 1.0));
        assert!(is_within(&cut, frame, middle), "{name}");
        for (axis, last) in all_faces() {
            let reached = (axis, last) == (1, true) || (axis, last) == (2, false);
            assert_eq!(is_within(&cut, frame, beyond(axis, last)), !reached, "{name}: {axis} {last}");
        }
        // All but a ball: no polygon is at the border, and every face is reached.
        let cavity = closed(&ball(dims, frame, [9, 11, 8], -1.0));
        assert!(is_within(&cavity, frame, middle), "{name}");
        for (axis, last) in all_faces() {
            assert!(!is_within(&cavity, frame, beyond(axis, last)), "{name}: {axis} {last}");
        }
    }
    let frame = GridFrame::default();
    let holed = sampled([11; 3], frame, |p| {
        if p == DVec3::new(5.0, 5.0, 8.0) { f64::NAN } else { 3.0 - (p - DVec3::splat(5.0)).length() }
    });
    assert_eq!(surface(&cloud(&holed)).closed, Closed::Sided);
}

/// A half of a ball that is cut open below: seen from above it has no backs, seen from below it has them, as it has where it is
/// translucent.
#[test]
fn backs_are_seen_through_the_face_alone() {
    let frame = GridFrame { origin: DVec3::new(3.0, -7.0, 11.0), ..GridFrame::default() };
    let volume = ball([20, 20, 12], frame, [9, 9, 0], 1.0);
    let whole = cloud(&volume);
    let as_if = |closed: Closed| {
        let mut splats = whole.splats();
        let Strength::Surface(surface) = &mut splats.strength else { unreachable!() };
        surface.closed = closed;
        Cloud::new(splats).unwrap().transformed(whole.cloud_to_world())
    };
    let picture = |cloud: &Cloud, height: f64, orthographic: bool| -> Frame {
        let target = DVec3::new(12.0, 2.0, 13.0);
        let eye = target + DVec3::new(8.0, -9.0, height);
        let pose = Pose::look_at(eye, target, DVec3::Z).unwrap();
        let camera = if orthographic {
            Camera::orthographic(pose, 14.0, [48; 2]).unwrap()
        } else {
            Camera::perspective(pose, 0.8, [48; 2]).unwrap()
        };
        let scene = Scene { clouds: vec![cloud.clone()], lights: Vec::new() };
        render(&scene, &camera, &RenderSettings::default(), &()).unwrap()
    };
    for orthographic in [false, true] {
        let all = |height| {
            [Closed::EVERYWHERE, Closed::Sided].map(|closed| picture(&as_if(closed), height, orthographic))
        };
        for (height, has_backs) in [(9.0, false), (-9.0, true)] {
            let [without, with] = all(height);
            let found = picture(&whole, height, orthographic);
            assert!(found.color == if has_backs { &with } else { &without }.color, "from {height}");
            assert!(with.color != without.color);
        }
    }
    let translucent = IsoSettings { opacity: 0.5, ..IsoSettings::default() };
    let translucent = iso_surfels(&volume, 0.0, &translucent).unwrap();
    assert_eq!(surface(&translucent).closed, Closed::Sided);
}
