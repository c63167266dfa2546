//! Case 15: colour spaces and flags.

use super::{Case, Findings};

pub(super) const CASE: Case = Case { number: 15, title: "Colour spaces and flags", criterion: "", run };

fn run() -> Findings {
    Findings::default()
}
