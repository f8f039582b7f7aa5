//! `vol doctor`

use crate::args::Format;
use crate::output::{Exit, document, say};
use runtime::engine::gpu::{AdapterReport, adapters, cache_folder};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

/// Something that is not there, and what would help.
struct Missing {
    what: &'static str,
    help: &'static str,
}

pub(super) fn run(format: Format) -> Exit {
    let adapters = adapters();
    let cache = cache_folder();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let fonts = fonts();
    let mut missing = vec![];
    if adapters.is_empty() {
        missing.push(Missing {
            what: "no graphics adapter: scenes are drawn by the processor, exactly but slowly",
            help: "install a driver; the package mesa-vulkan-drivers has one in software that needs no hardware",
        });
    }
    if cache.is_none() {
        missing.push(Missing {
            what: "no folder for compiled pipelines: drivers compile each scene anew",
            help: "set XDG_CACHE_HOME or HOME to a folder that can be written",
        });
    }
    if fonts.is_empty() {
        missing.push(Missing {
            what: "no fonts: text in scenes will have nothing to draw with",
            help: "install some, for example the package fonts-dejavu",
        });
    }
    match format {
        Format::Human => human(&adapters, cache.as_deref(), cores, &fonts, &missing),
        Format::Json => {
            let list: Vec<Value> = adapters.iter().map(adapter).collect();
            let missing: Vec<Value> = missing.iter().map(|m| json!({ "what": m.what, "help": m.help })).collect();
            let body = json!({
                "program": env!("CARGO_PKG_VERSION"),
                "system": format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
                "cores": cores,
                "engines": if list.is_empty() { vec!["cpu", "reference"] } else { vec!["gpu", "cpu", "reference"] },
                "adapters": list,
                "pipeline_cache": cache.map(|p| p.display().to_string()),
                "fonts": fonts.len(),
                "missing": missing,
            });
            document("vol.doctor", body);
        }
    }
    Exit::Done
}

fn adapter(a: &AdapterReport) -> Value {
    json!({
        "name": a.name,
        "api": a.api,
        "kind": a.kind.name(),
        "driver": a.driver,
        "max_grid": a.max_grid,
        "max_grids": a.max_grids,
        "max_storage": a.max_storage,
        "timestamps": a.timestamps,
        "pipeline_cache": a.pipeline_cache,
    })
}

fn human(adapters: &[AdapterReport], cache: Option<&Path>, cores: usize, fonts: &[PathBuf], missing: &[Missing]) {
    let yes = |b: bool| if b { "yes" } else { "no" };
    say(&format!(
        "vol {} on {} {}, {cores} cores\n",
        env!("CARGO_PKG_VERSION"),
        std::env::consts::OS,
        std::env::consts::ARCH
    ));
    for a in adapters {
        say(&format!("adapter  {} ({}, {}), {}\n", a.name, a.api, a.kind.name(), a.driver));
        say(&format!(
            "         grids up to {} voxels a side, {} at once; buffers up to {} MiB\n",
            a.max_grid,
            a.max_grids,
            a.max_storage >> 20
        ));
        say(&format!(
            "         measures its own time: {}; keeps compiled pipelines: {}\n",
            yes(a.timestamps),
            yes(a.pipeline_cache)
        ));
    }
    if let Some(path) = cache {
        say(&format!("cache    {}\n", path.display()));
    }
    say(&format!("fonts    {}\n", fonts.len()));
    for m in missing {
        say(&format!("missing  {}\n         {}\n", m.what, m.help));
    }
}

/// Font files in the usual folders.
fn fonts() -> Vec<PathBuf> {
    let home = std::env::var_os("HOME").map(PathBuf::from);
    let mut folders: Vec<PathBuf> =
        ["/usr/share/fonts", "/usr/local/share/fonts", "/Library/Fonts", "/System/Library/Fonts"]
            .into_iter()
            .map(PathBuf::from)
            .collect();
    folders.extend(std::env::var_os("WINDIR").map(|w| Path::new(&w).join("Fonts")));
    folders.extend(home.iter().flat_map(|h| [".fonts", ".local/share/fonts", "Library/Fonts"].map(|f| h.join(f))));
    let mut found = vec![];
    // Links can make circles.
    let mut left = 4096;
    while let Some(folder) = folders.pop() {
        let Ok(entries) = fs::read_dir(&folder) else { continue };
        for path in entries.flatten().map(|e| e.path()) {
            left -= 1;
            if left == 0 {
                return found;
            }
            let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
            if path.is_dir() {
                folders.push(path);
            } else if ["ttf", "otf", "ttc", "otc"].contains(&ending.as_str()) {
                found.push(path);
            }
        }
    }
    found
}
