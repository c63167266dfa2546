//! Where it is tried how a picture can be drawn.

use crate::camera::Camera;
use crate::cull::{find_affordable, touched_part};
use crate::scene::RenderSettings;
use crate::view::SceneView;

/// Windows along a side of what the scene touches of the picture, and pixels along a side of a window.
const WINDOWS: u32 = 8;
const WINDOW: u32 = 6;

/// How many times as many windows there are elsewhere, which check what these say.
pub(super) const OTHERS: u32 = 3;

/// Parts of so many pixels, four times as many as windows have, are one window: where much lies in a pixel, windows together would see
/// splats several times.
const WHOLE: u64 = 4 * (WINDOWS * WINDOW).pow(2) as u64;

/// Cameras that see windows of the part of the picture that the scene may touch: each in a random place of its share of that; and
/// [`OTHERS`] times as many elsewhere. Any first few of either are spread over all. A small part is one window, beside which there are no others. `None` where nothing is in
/// the picture; none in pictures that are smaller than a window.
pub(super) fn windows(view: SceneView) -> Option<[Vec<Camera>; 2]> {
    let SceneView { camera, settings, .. } = view;
    let mut visible = Vec::new();
    // Spheres around what merged splats stand for are wider than what they show.
    let every_splat = RenderSettings { budget: None, level_of_detail: 0.0, ..*settings };
    find_affordable(SceneView { settings: &every_splat, ..view }, &mut visible);
    if visible.is_empty() {
        return None;
    }
    let part = touched_part(camera, visible.iter());
    let side = |axis: usize| {
        let [low, high] = part.map(|corner| corner[axis]);
        // A window at least, if there is room for one.
        let missing = (f64::from(WINDOW) - (high - low)).max(0.0).ceil();
        let length = camera.size()[axis];
        let low = (low - missing).max(0.0) as u32;
        low..length.min((high + missing).ceil() as u32)
    };
    let sides = [side(0), side(1)];
    let lengths = sides.each_ref().map(|side| side.len() as u32);
    let count = lengths.map(|length| (length / WINDOW).min(WINDOWS));
    let all = count[0] * count[1];
    if all > 0 && u64::from(lengths[0]) * u64::from(lengths[1]) <= WHOLE {
        let corner = sides.map(|side| side.start as i32);
        return Some([camera.part(corner, lengths).into_iter().collect(), Vec::new()]);
    }
    let corner = |number: u32, axis: usize| {
        let room = lengths[axis] - WINDOW;
        let place = [number % all / count[1], number % count[1]][axis];
        // Weyl's sequence: even, and in step with nothing in the picture.
        let step = f64::from(number) * [0.754_877_67, 0.569_840_29][axis];
        let share = (f64::from(place) + step.fract()) / f64::from(count[axis]);
        (sides[axis].start + (f64::from(room) * share) as u32) as i32
    };
    let window = |number: u32| camera.part([corner(number, 0), corner(number, 1)], [WINDOW; 2]).ok();
    Some([0..all, all..(1 + OTHERS) * all].map(|numbers| spread(numbers.filter_map(window).collect())))
}

/// The same windows, any first few of which are spread over all: by steps of the golden section.
fn spread(windows: Vec<Camera>) -> Vec<Camera> {
    let count = windows.len();
    let are_prime = |step: &usize| (2..=*step).all(|i| !(step.is_multiple_of(i) && count.is_multiple_of(i)));
    let step = (count * 618 / 1000..).find(are_prime).unwrap_or(1);
    (0..count).map(|number| windows[number * step % count]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pose;
    use glam::DVec3;

    /// Of eight rows of eight the first few lie in as many rows and as many columns.
    #[test]
    fn the_first_few_are_spread_over_all() {
        let pose = Pose::look_at(DVec3::ZERO, DVec3::Y, DVec3::Z).unwrap();
        let picture = Camera::perspective(pose, 1.0, [64; 2]).unwrap();
        let one = |width: u32| picture.part([0; 2], [width, 1]).unwrap();
        for count in [0, 1, 2, 3, 7, 12, 56, 64] {
            let numbers: Vec<u32> =
                spread((1..=count).map(one).collect()).iter().map(|camera| camera.size()[0] - 1).collect();
            let mut sorted = numbers.clone();
            sorted.sort_unstable();
            assert_eq!(sorted, (0..count).collect::<Vec<_>>());
            if count == 64 {
                let mut rows: Vec<u32> = numbers[..4].iter().map(|number| number / 8).collect();
                let mut columns: Vec<u32> = numbers[..4].iter().map(|number| number % 8).collect();
                rows.sort_unstable();
                columns.sort_unstable();
                rows.dedup();
                columns.dedup();
                assert_eq!([rows.len(), columns.len()], [4, 4], "{numbers:?}");
            }
        }
    }
}
