//! Comparisons that go on after the first that fails.

use std::fmt::{Debug, Display};

/// What is not as it should be of one file.
pub(crate) struct Agreement {
    file: String,
    problems: Vec<String>,
}

impl Agreement {
    pub(crate) fn new(file: &str) -> Self {
        Self { file: file.to_owned(), problems: Vec::new() }
    }

    pub(crate) fn into_problems(self) -> Vec<String> {
        self.problems
    }

    pub(crate) fn problem(&mut self, problem: impl Display) {
        self.problems.push(format!("{}: {problem}", self.file));
    }

    /// That two things are equal.
    pub(crate) fn same<T: PartialEq<U> + Debug, U: Debug>(&mut self, what: &str, found: T, expected: U) {
        if found != expected {
            self.problem(format!("{what} is {found:?}, others say {expected:?}"));
        }
    }

    /// That numbers differ by at most `tolerance`.
    pub(crate) fn near(&mut self, what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
        if found.len() != expected.len() || distance(found, expected) > tolerance {
            self.problem(format!("{what} is {found:?}, others say {expected:?}, give or take {tolerance:e}"));
        }
    }
}

/// The largest difference; infinite where something is not a number.
pub(crate) fn distance(a: &[f64], b: &[f64]) -> f64 {
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, |most, d| if d.is_nan() { f64::INFINITY } else { most.max(d) })
}
