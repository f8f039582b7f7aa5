//! `vol explain`

use crate::args::{Explain, Format};
use crate::output::{Exit, document, say, trouble};
use compiler::diagnostic::{CodeInfo, all_codes, explain};
use runtime::frame::{Cause, Trouble};
use serde_json::{Value, json};

pub(super) fn run(format: Format, arguments: &Explain) -> Result<Exit, Trouble> {
    let Some(code) = &arguments.code else {
        match format {
            Format::Human => all_codes().for_each(|c| say(&format!("{}  {}\n", c.code, c.title))),
            Format::Json => {
                let codes: Vec<Value> = all_codes().map(|c| json!({ "code": c.code, "title": c.title })).collect();
                document("vol.explain", json!({ "codes": codes }));
            }
        }
        return Ok(Exit::Done);
    };
    let Some(info) = explain(code) else {
        let hint = Some("`vol explain` without a code lists all of them");
        return Err(trouble(Cause::Arguments, "E0645", format!("there is no diagnostic `{code}`"), hint));
    };
    let CodeInfo { code, title, explanation } = info;
    match format {
        Format::Human => say(&format!("{code}: {title}\n\n{}\n", explanation.trim())),
        Format::Json => document("vol.explain", json!({ "code": code, "title": title, "explanation": explanation })),
    }
    Ok(Exit::Done)
}
