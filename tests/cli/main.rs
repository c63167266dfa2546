//! The whole program, run as its users run it.

mod command_line;
mod compare;
mod place;
mod render;
mod scene_files;
