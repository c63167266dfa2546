//! The best of each trade between time and error, as far as times can tell.

use serde::Serialize;

/// A way must be quicker or more accurate by this share to beat another.
pub const MARGIN: f64 = 0.1;

/// How a way stands beside the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Standing {
    /// Nothing beats it, nor would if it had taken longer by as much as times vary.
    Best,
    /// Nothing beats it, by less than times vary: another run may find otherwise.
    Close,
    /// Another is no worse in both time and error, and better in one by more than [`MARGIN`].
    Beaten,
}

impl Standing {
    /// Whether it is on the front.
    pub fn is_on_front(self) -> bool {
        self != Self::Beaten
    }
}

/// How some pairs (time, error) stand, where the same thing may take `variation` times as long the next time. Pairs with the same
/// error are most often the same picture, drawn in the same way: they make each other no less certain. What isn't finite is beaten.
pub fn front(points: &[[f64; 2]], variation: f64) -> Vec<Standing> {
    let beats = |a: [f64; 2], b: [f64; 2]| {
        let is_no_worse = a[0] <= b[0] && a[1] <= b[1];
        is_no_worse && (a[0] < b[0] * (1.0 - MARGIN) || a[1] < b[1] * (1.0 - MARGIN))
    };
    let standing = |point: &[f64; 2]| {
        let [time, error] = *point;
        let slower = [time * variation, error];
        if !time.is_finite() || !error.is_finite() || points.iter().any(|other| beats(*other, *point)) {
            Standing::Beaten
        } else if points.iter().any(|other| other[1] != error && beats(*other, slower)) {
            Standing::Close
        } else {
            Standing::Best
        }
    };
    points.iter().map(standing).collect()
}

#[cfg(test)]
mod tests {
    use super::Standing::{Beaten, Best, Close};
    use super::*;

    #[test]
    fn the_best_are_those_that_nothing_beats() {
        let points =
            [[1.0, 5.0], [2.0, 3.0], [2.5, 3.0], [4.0, 1.0], [4.0, 6.0], [1.05, 4.9], [f64::NAN, 0.0]];
        // The sixth is slower than the first by less than can be told, and the first no worse by less.
        assert_eq!(front(&points, 1.0), [Best, Best, Beaten, Best, Beaten, Best, Beaten]);
    }

    #[test]
    fn what_a_little_more_time_would_change_is_close() {
        // The first two take as long and differ in error; the third is quicker than all.
        let points = [[2.0, 3.0], [2.1, 1.0], [1.0, 9.0]];
        assert_eq!(front(&points, 1.2), [Close, Best, Best]);
        assert_eq!(front(&[[2.0, 3.0], [1.9, 1.0], [1.0, 9.0]], 1.2), [Beaten, Best, Best]);
        // The same picture twice.
        assert_eq!(front(&[[2.0, 3.0], [2.1, 3.0], [1.0, 9.0]], 1.3), [Best; 3]);
        // By itself a way is the best however long it takes.
        assert_eq!(front(&[[7.0, 0.0]], 3.0), [Best]);
    }
}
