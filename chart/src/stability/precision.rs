//! Case 9: far away and flat.

use super::{Case, Findings};

pub(super) const CASE: Case = Case { number: 9, title: "Far away and flat", criterion: "", run };

fn run() -> Findings {
    Findings::default()
}
