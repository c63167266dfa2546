//! Case 8: a constant field.

use super::{Case, Findings};

pub(super) const CASE: Case = Case { number: 8, title: "A constant field", criterion: "", run };

fn run() -> Findings {
    Findings::default()
}
