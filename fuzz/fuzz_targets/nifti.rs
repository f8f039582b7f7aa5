//! Any bytes as NIfTI: single file, packed, and as the header of a pair whose voxels are the same bytes.
#![no_main]

use libfuzzer_sys::fuzz_target;
use runtime::data::{Memory, read_volume_from};
use std::path::Path;

fuzz_target!(|bytes: &[u8]| {
    let files = Memory::one("a.hdr", bytes).and("a.img", bytes);
    if let Ok((volume, _)) = read_volume_from(&files, Path::new("a.hdr")) {
        let (low, high) = volume.range();
        assert!(low.is_finite() && low <= high);
        assert!(volume.bytes().len() <= 1040 * bytes.len());
    }
});
