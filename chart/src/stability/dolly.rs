//! Case 3: through a splat.

use super::{Case, Findings};

pub(super) const CASE: Case = Case { number: 3, title: "Through a splat", criterion: "", run };

fn run() -> Findings {
    Findings::default()
}
