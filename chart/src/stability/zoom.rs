//! Case 6: zoom.

use super::{Case, Findings};

pub(super) const CASE: Case = Case { number: 6, title: "Zoom", criterion: "", run };

fn run() -> Findings {
    Findings::default()
}
