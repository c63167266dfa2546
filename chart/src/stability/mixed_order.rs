//! Case 11: mixed order.

use super::{Case, Findings};

pub(super) const CASE: Case = Case { number: 11, title: "Mixed order", criterion: "", run };

fn run() -> Findings {
    Findings::default()
}
