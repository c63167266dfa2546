//! Case 7: thin fog.

use super::{Case, Findings};

pub(super) const CASE: Case = Case { number: 7, title: "Thin fog", criterion: "", run };

fn run() -> Findings {
    Findings::default()
}
