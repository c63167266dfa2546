//! Case 12: surfaces behind surfaces.

use super::{Case, Findings};

pub(super) const CASE: Case = Case { number: 12, title: "Surfaces behind surfaces", criterion: "", run };

fn run() -> Findings {
    Findings::default()
}
