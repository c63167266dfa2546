//! Case 1: off the axis and wide angles.

use super::{Case, Findings};

pub(super) const CASE: Case = Case {
    number: 1,
    title: "Off the axis and wide angles",
    criterion: "One splat up to 70° off the axis, σ/distance .005 to .2, round, needle and tilted surfel: exact within 1e-3 of the true opacity; the affine form within 1.1 times its estimate; where rays are parallel all forms agree within 1e-6.",
    run,
};

fn run() -> Findings {
    Findings::default()
}
