#![no_main]
// The program's own modules: its scene files are not part of the library.
#![allow(dead_code, reason = "most of what these modules do is for other commands")]

#[path = "../../src/check.rs"]
mod check;
#[path = "../../src/description.rs"]
mod description;
#[path = "../../src/notation.rs"]
mod notation;
#[path = "../../src/scene_file/mod.rs"]
mod scene_file;
#[path = "../../src/transfer.rs"]
mod transfer;

libfuzzer_sys::fuzz_target!(|text: &str| {
    let _ = scene_file::parse(text, std::path::Path::new(""));
});
