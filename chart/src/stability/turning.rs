//! Case 4: turning.

use super::{Case, Findings};

pub(super) const CASE: Case = Case { number: 4, title: "Turning", criterion: "", run };

fn run() -> Findings {
    Findings::default()
}
