//! Case 10: hostile input.

use super::{Case, Findings};

pub(super) const CASE: Case = Case { number: 10, title: "Hostile input", criterion: "", run };

fn run() -> Findings {
    Findings::default()
}
