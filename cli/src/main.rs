//! `vol`: arguments, files and printing. Everything else lives in `compiler` and `runtime`.

mod args;
mod commands;
mod output;

use clap::Parser;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use output::Exit;
use std::panic;
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

/// What a panic said, for [`internal_error`]; panics that are caught on the way are nobody's business.
static PANIC: Mutex<String> = Mutex::new(String::new());

fn main() -> ExitCode {
    quiet_drivers();
    panic::set_hook(Box::new(|info| {
        *PANIC.lock().unwrap_or_else(PoisonError::into_inner) = info.to_string();
    }));
    let exit = panic::catch_unwind(run).unwrap_or_else(|_| internal_error());
    ExitCode::from(exit as u8)
}

/// Mesa's layer for choosing a device asks for a Wayland display, and libwayland complains on standard error where there is
/// none. `vol` chooses its device itself, so the layer is switched off, unless the user says otherwise.
#[expect(unsafe_code, reason = "changes the environment before any other thread exists")]
fn quiet_drivers() {
    const SWITCH: &str = "NODEVICE_SELECT";
    if std::env::var_os(SWITCH).is_none() {
        // SAFETY: the first thing that main does; there is one thread.
        unsafe { std::env::set_var(SWITCH, "1") };
    }
}

fn run() -> Exit {
    match args::Arguments::try_parse() {
        Ok(arguments) => commands::run(arguments),
        Err(error) => usage(&error),
    }
}

/// Help and version are no errors; an unknown command is told which there are.
fn usage(error: &clap::Error) -> Exit {
    if error.kind() == ErrorKind::InvalidSubcommand
        && let Some(ContextValue::String(name)) = error.get(ContextKind::InvalidSubcommand)
    {
        output::complain(&format!("error: there is no command `{name}`\n"));
        output::complain(&format!("help: the commands are {}\n", args::command_names().join(", ")));
        return Exit::Usage;
    }
    // Closed pipes are not worth a word.
    let _ = error.print();
    if error.use_stderr() { Exit::Usage } else { Exit::Done }
}

fn internal_error() -> Exit {
    let what = PANIC.lock().unwrap_or_else(PoisonError::into_inner);
    output::complain(&format!(
        "error: `vol` made a mistake: {what}\nhelp: this is not your scene's fault; please report it with the scene and the command line\n"
    ));
    Exit::Machine
}
