//! How surfels widen with the distance from the eye.

use crate::frustum::clip;
use glam::DVec3;
use oblate_engine::{Camera, Projection};

/// Levels above the first; where they end, cells stay as they are.
const MOST_LEVELS: u32 = 24;

/// How wide surfels are, beside the narrowest: as pixels in proportion to their depth, and 1 at least.
///
/// Cells are that wide or narrower, by less than a half: those of a level are twice as wide as those of the one below, and nest.
/// What blurs the pieces of surface in them follows the depth itself, without steps. So where levels meet surfels cover as evenly as
/// elsewhere: between pieces that lack nothing, blurred by a σ that changes slowly, Σw is off by half the second derivative of σ²
/// along the surface, at most the square of the blur's share of the depth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Grading {
    slope: DVec3,
    offset: f64,
}

impl Grading {
    /// The same everywhere.
    pub(crate) const EVEN: Self = Self { slope: DVec3::ZERO, offset: 1.0 };

    /// As a camera's pixels are, beside those at a depth above 0.
    pub(crate) fn of_pixels(camera: &Camera, nearest: f64) -> Self {
        match camera.projection() {
            Projection::Orthographic => Self::EVEN,
            Projection::Perspective => {
                let slope = camera.pose().forward() / nearest;
                Self { slope, offset: -slope.dot(camera.pose().eye()) }
            }
        }
    }

    /// The same for places of which `origin` is the origin, in units of `unit`.
    pub(crate) fn in_units(self, (origin, unit): (DVec3, f64)) -> Self {
        Self { slope: self.slope * unit, offset: self.unbounded(origin) }
    }

    /// The width at a place, beside the narrowest.
    pub(crate) fn width(&self, place: DVec3) -> f64 {
        self.unbounded(place).max(1.0)
    }

    /// The highest level whose cells are nowhere in a box too wide: its middle and half its lengths along the axes.
    pub(crate) fn level_in_box(&self, middle: DVec3, half: DVec3) -> u32 {
        level(self.unbounded(middle) - self.slope.abs().dot(half))
    }

    /// What has the levels that boxes have in the mean over all places in them, if each has one as a whole; those of the first level
    /// have half such a side.
    pub(crate) fn of_boxes(self, half: f64) -> Self {
        let share = 1.0 / (1.0 + self.slope.abs().element_sum() * half);
        Self { slope: self.slope * share, offset: self.offset * share }
    }

    /// The parts of a convex polygon by their levels.
    pub(crate) fn parts(&self, mut polygon: Vec<DVec3>) -> impl Iterator<Item = (u32, Vec<DVec3>)> {
        let widths = polygon.iter().map(|p| self.unbounded(*p));
        let (least, most) = widths.fold((f64::INFINITY, 1.0_f64), |(a, b), w| (a.min(w), b.max(w)));
        let [first, last] = [least, most].map(level);
        (first..=last).map(move |number| {
            if number == last {
                return (number, std::mem::take(&mut polygon));
            }
            let end = side(number + 1);
            let part = clip(polygon.clone(), |p| end - self.unbounded(p));
            polygon = clip(std::mem::take(&mut polygon), |p| self.unbounded(p) - end);
            (number, part)
        })
    }

    fn unbounded(&self, place: DVec3) -> f64 {
        self.slope.dot(place) + self.offset
    }
}

/// The side of a level's cells, beside the first's.
pub(crate) fn side(level: u32) -> f64 {
    f64::from(level).exp2()
}

/// The highest level whose cells are no wider than that.
fn level(width: f64) -> u32 {
    // Below 1, and if it is no number, 0.
    (width.log2() as u32).min(MOST_LEVELS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn area(polygon: &[DVec3]) -> f64 {
        let [first, rest @ ..] = polygon else { return 0.0 };
        rest.windows(2).map(|pair| (pair[0] - first).cross(pair[1] - first)).sum::<DVec3>().length() / 2.0
    }

    #[test]
    fn levels_are_whole_octaves() {
        let cases =
            [(-3.0, 0), (0.5, 0), (1.0, 0), (1.9, 0), (2.0, 1), (3.9, 1), (1024.0, 10), (f64::NAN, 0)];
        for (width, expected) in cases {
            assert_eq!(level(width), expected, "{width}");
        }
        assert_eq!(level(f64::INFINITY), MOST_LEVELS);
        assert_eq!(side(3), 8.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn parts_are_the_polygon_each_in_its_octave(corners in prop::array::uniform9(-1.0..30.0)) {
            let triangle = [0, 3, 6].map(|i| DVec3::from_slice(&corners[i..]));
            let grading = Grading { slope: DVec3::new(0.3, 0.8, -0.2), offset: 0.7 };
            let mut sum = 0.0;
            for (number, part) in grading.parts(triangle.to_vec()) {
                sum += area(&part);
                for corner in part {
                    let width = grading.width(corner);
                    prop_assert!(width > side(number) * (1.0 - 1e-12) && width < side(number + 1) * (1.0 + 1e-12));
                }
            }
            prop_assert!((sum - area(&triangle)).abs() < 1e-9);
        }

        #[test]
        fn nowhere_in_a_box_are_cells_too_wide(
            middle in prop::array::uniform3(0.0..40.0),
            half in prop::array::uniform3(0.0..10.0),
        ) {
            let grading = Grading { slope: DVec3::new(0.3, 0.8, -0.2), offset: 0.7 };
            let [middle, half] = [middle, half].map(DVec3::from);
            let corners = (0..8).map(|i| {
                let sign = [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { -1.0 } else { 1.0 });
                grading.width(middle + half * DVec3::from(sign))
            });
            let least = corners.fold(f64::INFINITY, f64::min);
            // Up to the roundings of some tens.
            let found = side(grading.level_in_box(middle, half));
            prop_assert!(found <= least * (1.0 + 1e-12) && least < 2.0 * found * (1.0 + 1e-12));
        }

        #[test]
        fn units_change_no_width(place in prop::array::uniform3(-9.0..9.0), origin in prop::array::uniform3(-9.0..9.0)) {
            let grading = Grading { slope: DVec3::new(0.3, 0.8, -0.2), offset: 0.7 };
            let [place, origin] = [place, origin].map(DVec3::from);
            let (width, same) = (grading.width(place), grading.in_units((origin, 0.1)).width((place - origin) / 0.1));
            prop_assert!((width - same).abs() < 1e-12);
        }
    }
}
