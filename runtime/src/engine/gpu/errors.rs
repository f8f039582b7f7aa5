//! What can go wrong on a GPU, as values: wgpu reports most of it through callbacks, which are gathered here.

use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

/// What kind of failure it is.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub enum GpuErrorKind {
    /// The machine has no adapter, or none of the name asked for.
    NoAdapter,
    /// The adapter cannot hold what the scene needs.
    TooLarge,
    /// The adapter cannot blend 32-bit floating point.
    Unblendable,
    /// The device went away: driver reset, unplugged, or a watchdog.
    DeviceLost,
    /// The adapter's memory is full.
    OutOfMemory,
    /// wgpu refused what was asked of it: a mistake in this program.
    Validation,
    /// The driver failed.
    Driver,
}

impl GpuErrorKind {
    /// Its diagnostic code.
    #[must_use]
    pub fn code(self) -> &'static str {
        match self {
            Self::NoAdapter => "E0630",
            Self::TooLarge | Self::Unblendable => "E0631",
            Self::DeviceLost => "E0632",
            Self::OutOfMemory => "E0633",
            Self::Validation => "E0634",
            Self::Driver => "E0635",
        }
    }
}

/// A failure of the GPU engine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpuError {
    /// What kind.
    pub kind: GpuErrorKind,
    /// One sentence, lower case, no full stop.
    pub message: String,
    /// What to try, if there is something.
    pub hint: Option<String>,
}

impl GpuError {
    pub(super) fn new(kind: GpuErrorKind, message: impl Into<String>) -> Self {
        Self { kind, message: message.into(), hint: None }
    }

    pub(super) fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }

    pub(super) fn lost(message: &str) -> Self {
        let what = if message.is_empty() { String::new() } else { format!(": {message}") };
        Self::new(GpuErrorKind::DeviceLost, format!("the graphics device was lost{what}"))
            .hint("try again, or draw with `--engine cpu`; if it happens again, the system log has the driver's reason")
    }

    fn from_wgpu(error: &wgpu::Error) -> Self {
        match error {
            wgpu::Error::OutOfMemory { .. } => Self::new(GpuErrorKind::OutOfMemory, "the graphics memory is full")
                .hint("close other programs that use it, make grids smaller, or draw with `--engine cpu`"),
            wgpu::Error::Validation { description, .. } => {
                let message =
                    format!("the GPU engine asked for something that wgpu refuses: {}", one_line(description));
                Self::new(GpuErrorKind::Validation, message)
                    .hint("this is a mistake in Tyndall; please report it with the scene, and draw with `--engine cpu`")
            }
            wgpu::Error::Internal { description, .. } => {
                Self::new(GpuErrorKind::Driver, format!("the graphics driver failed: {}", one_line(description)))
                    .hint("update the driver, or draw with `--engine cpu`")
            }
        }
    }
}

impl fmt::Display for GpuError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for GpuError {}

/// Drivers and wgpu answer in paragraphs; a diagnostic is one sentence.
fn one_line(text: &str) -> String {
    text.split('\n').map(str::trim).filter(|l| !l.is_empty()).collect::<Vec<_>>().join("; ")
}

#[derive(Debug, Default)]
struct State {
    first: Option<GpuError>,
    lost: Option<GpuError>,
}

/// Collects what a device reports through its callbacks.
#[derive(Clone, Debug)]
pub(super) struct Watch {
    device: wgpu::Device,
    state: Arc<Mutex<State>>,
}

impl Watch {
    /// Listens to a device. wgpu calls back on the thread of the failing call, so that [`Watch::check`] after a call sees it.
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let shared = Arc::new(Mutex::new(State::default()));
        let state = Arc::clone(&shared);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
            // The first one is the cause; what follows are consequences.
            state.first.get_or_insert_with(|| GpuError::from_wgpu(&error));
        }));
        let state = Arc::clone(&shared);
        device.set_device_lost_callback(move |_, message| {
            let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
            state.lost.get_or_insert_with(|| GpuError::lost(&one_line(&message)));
        });
        Self { device: device.clone(), state: shared }
    }

    fn lost(&self) -> Option<GpuError> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).lost.clone()
    }

    /// Whether anything failed since the last check. A lost device stays lost.
    ///
    /// # Errors
    /// What failed first.
    pub(super) fn check(&self) -> Result<(), GpuError> {
        if let Some(lost) = self.lost() {
            return Err(lost);
        }
        let first = self.state.lock().unwrap_or_else(PoisonError::into_inner).first.take();
        let Some(error) = first else { return Ok(()) };
        // A device that is gone refuses everything; that it is gone is said in a poll alone.
        let _ = self.poll(wgpu::PollType::Poll);
        Err(self.lost().unwrap_or(error))
    }

    /// Waits for a submission.
    ///
    /// # Errors
    /// When the device is lost or failed before or meanwhile.
    pub(super) fn wait(&self, index: wgpu::SubmissionIndex) -> Result<(), GpuError> {
        self.check()?;
        let polled = self.poll(wgpu::PollType::Wait { submission_index: Some(index), timeout: None });
        self.check()?;
        polled
    }

    fn poll(&self, poll: wgpu::PollType) -> Result<(), GpuError> {
        // wgpu panics when the driver reports a lost device from within a wait; there is no other way to learn of it.
        match catch_unwind(AssertUnwindSafe(|| self.device.poll(poll))) {
            Ok(Ok(_)) => Ok(()),
            Ok(Err(error)) => Err(GpuError::lost(&error.to_string())),
            Err(_) => Err(GpuError::lost("the driver stopped answering")),
        }
    }
}
