#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| lodpack_fuzz::tree(bytes));
