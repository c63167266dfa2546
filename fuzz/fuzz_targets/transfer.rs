#![no_main]

use oblate::volumes::TransferFunction;

libfuzzer_sys::fuzz_target!(|text: &str| {
    let _ = text.parse::<TransferFunction>();
});
