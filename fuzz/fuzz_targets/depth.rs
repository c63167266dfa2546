#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| oblate_fuzz::depth(bytes));
