//! Case 2: beside the picture and through the camera plane.

use super::{Case, Findings};

pub(super) const CASE: Case =
    Case { number: 2, title: "Beside the picture and through the camera plane", criterion: "", run };

fn run() -> Findings {
    Findings::default()
}
