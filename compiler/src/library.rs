//! The standard library: `.vol` texts carried in the compiler, parsed once per process.

use crate::diagnostic::Diagnostics;
use crate::source::SourceId;
use crate::syntax::{self, ast};
use std::sync::LazyLock;

/// One module of the library.
#[derive(Debug)]
pub struct LibraryModule {
    /// As in `use std::noise::fbm`: `noise`.
    pub word: &'static str,
    /// As diagnostics print it: `std::noise`.
    pub name: &'static str,
    /// Its text.
    pub text: &'static str,
}

/// All modules. In every compilation they are the sources 1, 2, … in this order, so that their spans stay true.
pub const MODULES: &[LibraryModule] = &[
    LibraryModule { word: "phase", name: "std::phase", text: include_str!("../../library/phase.vol") },
    LibraryModule { word: "noise", name: "std::noise", text: include_str!("../../library/noise.vol") },
    LibraryModule { word: "color", name: "std::color", text: include_str!("../../library/color.vol") },
    LibraryModule { word: "shape", name: "std::shape", text: include_str!("../../library/shape.vol") },
    LibraryModule { word: "media", name: "std::media", text: include_str!("../../library/media.vol") },
    LibraryModule { word: "shade", name: "std::shade", text: include_str!("../../library/shade.vol") },
];

/// The trees of [`MODULES`], and what the parser had to say (nothing, or the library itself is at fault).
pub fn parsed() -> &'static (Vec<ast::Module>, Diagnostics) {
    static PARSED: LazyLock<(Vec<ast::Module>, Diagnostics)> = LazyLock::new(|| {
        let mut diagnostics = Diagnostics::default();
        let parse = |(i, m): (usize, &LibraryModule)| syntax::parse(SourceId(i as u32 + 1), m.text, &mut diagnostics);
        let trees = MODULES.iter().enumerate().map(parse).collect();
        (trees, diagnostics)
    });
    &PARSED
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_parses() {
        assert_eq!(parsed().1, Diagnostics::default());
    }
}
