//! Fifteen cases in which splatting breaks, each run by the engine and by what others do.
//!
//! A case has a criterion that says in numbers what is right. [`Case::run`] gives the number that each method reaches and curves
//! that show where it breaks; the tests of this crate hold ours to them, and see the baselines fail.

mod colors;
mod constant_field;
mod determinism;
mod dolly;
mod hostile;
mod levels;
mod mixed_order;
mod outside;
mod overlap;
mod precision;
mod setups;
mod step_edge;
mod thin_fog;
mod turning;
mod visibility;
mod wide_angle;
mod zoom;

use crate::curves::{Panel, Role};
use serde::Serialize;

/// One of the cases.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// From 1 to 15.
    pub number: u8,
    /// A few words: what is done to the methods.
    pub title: &'static str,
    /// What must hold, with its numbers and units: one or two sentences.
    pub criterion: &'static str,
    /// Runs it; the figures are the same on every run.
    pub run: fn() -> Findings,
}

/// What a case finds.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Findings {
    /// Where methods break and by how much.
    pub panels: Vec<Panel>,
    /// The number that each method reaches.
    pub verdicts: Vec<Verdict>,
}

/// A method's number in a case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// The method: a few words.
    pub method: String,
    /// Whose it is.
    pub role: Role,
    /// What the number is, with its unit.
    pub figure: String,
    /// The number; what isn't finite never passes.
    pub found: f64,
    /// What it may be.
    pub bound: Bound,
    /// Whether it is known to fail: a baseline that this case breaks, or an exception of ours that the documentation names.
    pub fails: bool,
}

/// What a number may be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Bound {
    /// Nothing above.
    AtMost(f64),
    /// Nothing below.
    AtLeast(f64),
}

impl Verdict {
    /// Whether the number keeps to the bound.
    pub fn passes(&self) -> bool {
        match self.bound {
            Bound::AtMost(bound) => self.found <= bound,
            Bound::AtLeast(bound) => self.found >= bound,
        }
    }

    /// Whether it passes or fails as it is known to.
    pub fn is_as_known(&self) -> bool {
        self.passes() != self.fails
    }
}

/// All cases by number.
pub const CASES: [Case; 15] = [
    wide_angle::CASE,
    outside::CASE,
    dolly::CASE,
    turning::CASE,
    overlap::CASE,
    zoom::CASE,
    thin_fog::CASE,
    constant_field::CASE,
    precision::CASE,
    hostile::CASE,
    mixed_order::CASE,
    visibility::CASE,
    determinism::CASE,
    levels::CASE,
    colors::CASE,
];
