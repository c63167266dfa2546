//! The best of each trade between time and error.

/// A way must be quicker or more accurate by this share to beat another: medians of one run and the next differ by as much.
pub const MARGIN: f64 = 0.1;

/// Which of some pairs (time, error) are the best: no other one is no worse in both, and better in one by more than [`MARGIN`].
/// What isn't finite is never among them.
pub fn front(points: &[[f64; 2]]) -> Vec<bool> {
    let beats = |a: [f64; 2], b: [f64; 2]| {
        let is_no_worse = a[0] <= b[0] && a[1] <= b[1];
        is_no_worse && (a[0] < b[0] * (1.0 - MARGIN) || a[1] < b[1] * (1.0 - MARGIN))
    };
    let is_best = |point: &[f64; 2]| {
        point.iter().all(|x| x.is_finite()) && !points.iter().any(|other| beats(*other, *point))
    };
    points.iter().map(is_best).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_are_those_that_nothing_beats() {
        let points =
            [[1.0, 5.0], [2.0, 3.0], [2.5, 3.0], [4.0, 1.0], [4.0, 6.0], [1.05, 4.9], [f64::NAN, 0.0]];
        // The sixth is slower than the first by less than can be told, and the first no worse by less.
        assert_eq!(front(&points), [true, true, false, true, false, true, false]);
    }
}
