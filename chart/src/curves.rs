//! Curves in panels: what is drawn of a measurement.

use serde::Serialize;

/// Whose a curve or a verdict is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// What the engine does when nothing else is asked for.
    Default,
    /// What it does when asked for.
    Ours,
    /// What others do.
    Baseline,
    /// What is right: a reference's own figure, an analytic value.
    Truth,
    /// A closed-form estimate.
    Estimate,
}

impl Role {
    /// Whether it is what others do.
    pub fn is_of_others(self) -> bool {
        self == Self::Baseline
    }
}

/// An axis of a panel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Axis {
    /// What it shows, with its unit.
    pub label: String,
    /// Whether it is logarithmic; then values at or below 0 are not drawn.
    pub is_log: bool,
}

impl Axis {
    /// An axis of equal steps.
    pub fn linear(label: &str) -> Self {
        Self { label: label.into(), is_log: false }
    }

    /// An axis of equal ratios.
    pub fn log(label: &str) -> Self {
        Self { label: label.into(), is_log: true }
    }
}

/// A line through measured or computed points.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Curve {
    /// In the legend: a few words.
    pub name: String,
    /// Whose it is.
    pub role: Role,
    /// Along the axes, finite, by ascending x.
    pub points: Vec<[f64; 2]>,
}

impl Curve {
    /// A curve.
    pub fn new(name: impl Into<String>, role: Role, points: impl IntoIterator<Item = [f64; 2]>) -> Self {
        Self { name: name.into(), role, points: points.into_iter().collect() }
    }
}

/// Curves over common axes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Panel {
    /// What is seen: one line.
    pub title: String,
    /// Across.
    pub x: Axis,
    /// Upwards.
    pub y: Axis,
    /// The largest y that passes, where there is such a bound: drawn as a line across.
    pub bound: Option<f64>,
    /// At least one.
    pub curves: Vec<Curve>,
}

impl Panel {
    /// Errors along x, `y` in words, on a logarithmic axis, with a bound.
    pub fn of_errors(title: &str, x: Axis, y: &str, bound: f64, curves: Vec<Curve>) -> Self {
        Self { title: title.into(), x, y: Axis::log(y), bound: Some(bound), curves }
    }
}
