//! What backends are predicted to need for a scene, as plain data.

use crate::ir::Backend;
use std::fmt::Write as _;

/// What a backend is predicted to make of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Forecast {
    /// Which.
    pub backend: Backend,
    /// Its word in the language.
    pub word: &'static str,
    /// What it needs, or why it cannot draw the scene.
    pub outcome: Outcome,
}

/// See [`Forecast`].
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// It can draw the scene.
    Drawn {
        /// How many pieces; 0 where closed forms do.
        pieces: f64,
        /// What they are: samples on a ray that meets media, paths of a pixel, slabs, Gaussians.
        of: &'static str,
        /// Of drawing, on the machine on which the rates were measured, if media filled the picture.
        milliseconds: f64,
        /// The largest error, as a share of display white.
        error: f64,
    },
    /// It cannot, for this reason.
    Refused(String),
}

/// A line for each backend, the one that was taken marked.
#[must_use]
pub fn print_forecasts(forecasts: &[Forecast], taken: &str) -> String {
    let mut out = String::new();
    for forecast in forecasts {
        let mark = if forecast.word == taken { "*" } else { " " };
        let _ = write!(out, "  {mark} {:<10}", forecast.word);
        let _ = match &forecast.outcome {
            Outcome::Drawn { pieces, milliseconds, error, .. } if *pieces == 0.0 => {
                writeln!(out, "closed forms, {milliseconds:.1} ms, error {error:.1e} of white")
            }
            Outcome::Drawn { pieces, of, milliseconds, error } => {
                writeln!(out, "{pieces:.0} {of}, {milliseconds:.1} ms, error {error:.1e} of white")
            }
            Outcome::Refused(why) => writeln!(out, "{why}"),
        };
    }
    out
}
