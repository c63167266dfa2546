//! What is seen of splats while they are read, and what it says of their file.

use crate::Note;
use crate::splats::Trained;
use std::sync::{Mutex, PoisonError};

/// Ranges of fewer splats than this say nothing.
const ENOUGH: usize = 101;

/// A third half-axis is flat up to this share of the longest.
const FLAT: f32 = 0.01;

/// σ below which the finest of many splats is, in files that hold σ itself.
const SMALL_SIGMA: f32 = 0.05;

/// Ranges of the numbers of splats, as files have them. Merging is in any order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    splats: usize,
    /// The smallest and largest number that stands for an opacity.
    opacity: [f32; 2],
    log_scale: [f32; 2],
    /// The largest logarithm of the third half-axis over the longest.
    third: f32,
}

impl Default for Seen {
    fn default() -> Self {
        let none = [f32::INFINITY, f32::NEG_INFINITY];
        Self { splats: 0, opacity: none, log_scale: none, third: f32::NEG_INFINITY }
    }
}

impl Seen {
    /// Adds a splat whose opacity is written as `opacity`.
    pub(crate) fn add(&mut self, opacity: f32, trained: &Trained) {
        let [a, b, c] = trained.log_scales;
        let longest = a.max(b).max(c);
        let third = if longest == c { 0.0 } else { c - longest };
        self.merge(&Self { splats: 1, opacity: [opacity; 2], log_scale: [a.min(b).min(c), longest], third });
    }

    fn merge(&mut self, other: &Self) {
        self.splats += other.splats;
        self.opacity = union(self.opacity, other.opacity);
        self.log_scale = union(self.log_scale, other.log_scale);
        self.third = self.third.max(other.third);
    }

    /// Adds what was seen by one of several threads.
    pub(crate) fn merge_into(&self, all: &Mutex<Self>) {
        all.lock().unwrap_or_else(PoisonError::into_inner).merge(self);
    }

    /// Whether all third half-axes are next to nothing.
    pub(crate) fn is_flat(&self) -> bool {
        self.third <= FLAT.ln()
    }

    /// That numbers look as if they were none of those that the format has: of many splats.
    pub(crate) fn doubts(&self) -> Vec<Note> {
        let (mut notes, [least, most]) = (Vec::new(), self.opacity);
        if self.splats < ENOUGH {
            return notes;
        }
        if least >= 0.0 && most <= 1.0 && least < most {
            notes.push(Note::Assumed(format!(
                "opacities are logits, as the format has them, though all numbers lie from {least} to {most}: perhaps \
                 they are opacities already"
            )));
        }
        let [least, most] = self.log_scale;
        if least > 0.0 && least < SMALL_SIGMA && least < most {
            notes.push(Note::Assumed(format!(
                "scales are logarithms, as the format has them, though all lie from {least} to {most}: perhaps they \
                 are lengths"
            )));
        }
        notes
    }
}

fn union([low, high]: [f32; 2], [lower, higher]: [f32; 2]) -> [f32; 2] {
    [low.min(lower), high.max(higher)]
}
