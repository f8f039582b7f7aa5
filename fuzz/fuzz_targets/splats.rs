//! Any bytes as a file of splats: as they are, and compressed behind the start of an SPZ file. Good seeds are in `fuzz/seeds/splats`; run
//! with `-- -dict=fuzz/ply.dict -max_len=4000`.
#![no_main]

use flate2::{Compression, write::GzEncoder};
use libfuzzer_sys::fuzz_target;
use runtime::data::Memory;
use runtime::data::splats::read_splats_from;
use std::io::Write;
use std::path::Path;

fn read(bytes: Vec<u8>) {
    let length = bytes.len();
    if let Ok((splats, _)) = read_splats_from(&Memory::one("a", bytes), Path::new("a")) {
        assert!(splats.len() <= 1040 * length);
        assert!(splats.centers().iter().flatten().all(|x| x.is_finite()));
    }
}

fuzz_target!(|bytes: &[u8]| {
    read(bytes.to_vec());
    let mut packed = GzEncoder::new(vec![], Compression::fast());
    if packed.write_all(b"NGSP").and_then(|()| packed.write_all(bytes)).is_ok()
        && let Ok(packed) = packed.finish()
    {
        read(packed);
    }
});
