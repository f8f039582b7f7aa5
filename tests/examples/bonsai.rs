//! Writes `examples/data/bonsai.spz`; see [`tyndall_tests::bonsai`].

fn main() -> std::io::Result<()> {
    let path = tyndall_tests::root().join("examples/data/bonsai.spz");
    std::fs::write(path, tyndall_tests::bonsai::file())
}
