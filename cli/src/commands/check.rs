//! `vol check`

use super::read;
use crate::args::{Check, Format};
use crate::output::{Exit, complain, count, diagnostics, diagnostics_json, document};
use runtime::frame::{FileLoader, findings};
use serde_json::{Value, json};

pub(super) fn run(format: Format, arguments: &Check) -> Exit {
    let loader = FileLoader::default();
    let (mut errors, mut warnings) = (0, 0);
    let mut files: Vec<Value> = vec![];
    for name in &arguments.scenes {
        let (found, sources) = match read(&loader, name) {
            Ok(text) => {
                let mut checked = compiler::check(name, &text, &loader);
                if let Some(program) = &checked.program {
                    checked.diagnostics.0.extend(findings(program, None).0);
                }
                (checked.diagnostics, checked.sources)
            }
            Err(trouble) => (trouble.diagnostics, trouble.sources),
        };
        let (e, w) = count(&found);
        errors += e;
        warnings += w;
        match format {
            Format::Human => diagnostics(&found, &sources),
            Format::Json => files.push(json!({ "file": name, "diagnostics": diagnostics_json(&found, &sources) })),
        }
    }
    let failed = errors > 0 || (warnings > 0 && arguments.deny.is_some());
    match format {
        Format::Json => {
            document("vol.check", json!({ "ok": !failed, "errors": errors, "warnings": warnings, "files": files }));
        }
        Format::Human if errors + warnings > 0 => complain(&format!("{}\n", summary(errors, warnings))),
        Format::Human => {}
    }
    if failed { Exit::Input } else { Exit::Done }
}

fn summary(errors: usize, warnings: usize) -> String {
    let of = |n: usize, what: &str| match n {
        0 => None,
        1 => Some(format!("1 {what}")),
        n => Some(format!("{n} {what}s")),
    };
    [of(errors, "error"), of(warnings, "warning")].into_iter().flatten().collect::<Vec<_>>().join(", ")
}
