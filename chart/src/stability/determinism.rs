//! Case 13: the same again.

use super::{Case, Findings};

pub(super) const CASE: Case = Case { number: 13, title: "The same again", criterion: "", run };

fn run() -> Findings {
    Findings::default()
}
