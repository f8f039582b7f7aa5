//! `vol new`

use crate::args::{Format, New};
use crate::output::{Exit, document, say, trouble};
use runtime::frame::{Cause, Trouble};
use serde_json::json;
use std::fs::{self, OpenOptions};
use std::io::{ErrorKind, Write};

const SCENE: &str = include_str!("starter.vol");

pub(super) fn run(format: Format, arguments: &New) -> Result<Exit, Trouble> {
    let folder = &arguments.folder;
    let refuse = |what: String| trouble(Cause::Input, "E0620", what, None);
    fs::create_dir_all(folder).map_err(|e| refuse(format!("`{}` cannot be made: {e}", folder.display())))?;
    let path = folder.join("scene.vol");
    let name = path.display();
    // Never over something that is there, however it came there.
    let file = OpenOptions::new().write(true).create_new(true).open(&path);
    let written = file.and_then(|mut f| f.write_all(SCENE.as_bytes()));
    written.map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists => {
            trouble(Cause::Input, "E0646", format!("`{name}` is there already"), Some("choose another folder"))
        }
        _ => refuse(format!("`{name}` cannot be written: {error}")),
    })?;
    match format {
        Format::Human => say(&format!("{name}\ntry: vol render {name} -o {}\n", folder.join("scene.png").display())),
        Format::Json => document("vol.new", json!({ "ok": true, "scene": name.to_string() })),
    }
    Ok(Exit::Done)
}
