//! How different two shown pictures are: plain statistics, and FLIP for what a person would see.

mod flip;

pub use flip::{PIXELS_PER_DEGREE, flip};

use super::{ImageError, Shown};

/// The difference of two pictures of one size, over all channels in 0 … 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Largest absolute difference of a channel.
    pub max: f64,
    /// Root of the mean square.
    pub rms: f64,
    /// Mean absolute difference.
    pub mean_abs: f64,
    /// Mean of the FLIP map: 0 for pictures that look the same, 1 at most.
    pub flip: f64,
    /// FLIP of each pixel, row by row from the top.
    pub flip_map: Vec<f32>,
}

/// Compares two pictures as seen at the usual distance from a screen ([`PIXELS_PER_DEGREE`]).
///
/// # Errors
/// `E0620` when the sizes differ or a picture does not have as many pixels as it says.
pub fn compare(reference: &Shown, test: &Shown) -> Result<Difference, ImageError> {
    let flip_map = flip(reference, test, PIXELS_PER_DEGREE)?;
    let (mut max, mut squares, mut sum) = (0.0_f64, 0.0, 0.0);
    for (a, b) in reference.pixels.iter().zip(&test.pixels) {
        for (a, b) in a.iter().zip(b) {
            let d = (f64::from(*a) - f64::from(*b)).abs();
            max = max.max(d);
            squares += d * d;
            sum += d;
        }
    }
    let n = (3 * flip_map.len()) as f64;
    let mean = flip_map.iter().map(|v| f64::from(*v)).sum::<f64>() / flip_map.len() as f64;
    Ok(Difference { max, rms: (squares / n).sqrt(), mean_abs: sum / n, flip: mean, flip_map })
}

/// Pictures can be compared if they have the same, not empty, size.
fn check_sizes(a: &Shown, b: &Shown) -> Result<(), ImageError> {
    let whole = |p: &Shown| u64::from(p.width) * u64::from(p.height) == p.pixels.len() as u64 && !p.pixels.is_empty();
    if (a.width, a.height) != (b.width, b.height) || !whole(a) || !whole(b) {
        let size = |p: &Shown| format!("{} × {} ({} pixels)", p.width, p.height, p.pixels.len());
        return Err(ImageError::write(format!("pictures of {} and {} cannot be compared", size(a), size(b))));
    }
    Ok(())
}
