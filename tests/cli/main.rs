//! The whole program, run as its users run it.

#![expect(clippy::unwrap_used, reason = "what is not there fails the test")]

mod chart;
mod command_line;
mod compare;
mod convert;
mod data;
mod extract;
mod instances;
mod irregular;
mod pick;
mod place;
mod points;
mod render;
mod scene_files;
mod splats;
mod translucent;
mod volume_looks;
mod warp;
