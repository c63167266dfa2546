#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| oblate_fuzz::open("a_4x3x2_u8.raw.gz", bytes));
