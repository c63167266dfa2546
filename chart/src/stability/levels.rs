//! Case 14: what is left out.

use super::{Case, Findings};

pub(super) const CASE: Case = Case { number: 14, title: "What is left out", criterion: "", run };

fn run() -> Findings {
    Findings::default()
}
