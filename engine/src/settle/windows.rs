//! Where it is tried how a picture can be drawn.

use crate::camera::Camera;
use crate::cull::{find_affordable, touched_part};
use crate::scene::RenderSettings;
use crate::view::SceneView;
use std::ops::Range;

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
    let mut places: Vec<u32> = (0..all).collect();
    places.sort_unstable_by_key(|place| dithered([place / count[1], place % count[1]]));
    let rounds =
        |rounds: Range<u32>| rounds.flat_map(|round| places.iter().map(move |place| round * all + place));
    Some([0..1, 1..1 + OTHERS].map(|numbers| rounds(numbers).filter_map(window).collect()))
}

/// In which order places of an 8×8 grid are taken so that any first few are spread over all: that of ordered dithering.
///
/// B. E. Bayer, *An optimum method for two-level rendition of continuous-tone pictures*, 1973.
fn dithered([row, column]: [u32; 2]) -> u32 {
    (0..WINDOWS.ilog2()).fold(0, |key, bit| 4 * key + (2 * ((row ^ column) >> bit & 1)) + (row >> bit & 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of the first 4ⁿ places each square of 64/4ⁿ has one.
    #[test]
    fn the_first_few_are_spread_over_all() {
        let mut places: Vec<[u32; 2]> = (0..64).map(|place| [place / 8, place % 8]).collect();
        places.sort_by_key(|place| dithered(*place));
        for (count, side) in [(4, 4), (16, 2), (64, 1)] {
            let mut squares: Vec<[u32; 2]> =
                places[..count].iter().map(|place| place.map(|number| number / side)).collect();
            squares.sort_unstable();
            squares.dedup();
            assert_eq!(squares.len(), count, "{places:?}");
        }
    }
}
