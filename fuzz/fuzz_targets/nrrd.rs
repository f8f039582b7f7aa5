//! Any bytes as NRRD: attached, and detached with the same bytes as data.
#![no_main]

use libfuzzer_sys::fuzz_target;
use runtime::data::{Memory, read_volume_from};
use std::path::Path;

fuzz_target!(|bytes: &[u8]| {
    // The magic line is given, so that no time is lost on finding it.
    let file = [b"NRRD0004\n", bytes].concat();
    let files = Memory::one("a.nrrd", file).and("a", bytes);
    if let Ok((volume, _)) = read_volume_from(&files, Path::new("a.nrrd")) {
        let (low, high) = volume.range();
        assert!(low.is_finite() && low <= high);
        assert!(volume.bytes().len() <= 1040 * (bytes.len() + 9));
    }
});
