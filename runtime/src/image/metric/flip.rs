//! LDR-FLIP: Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild, "FLIP: A Difference Evaluator for
//! Alternating Images", Proc. ACM Comput. Graph. Interact. Tech. 3(2), 2020. Names and constants are the paper's.

use super::super::{ImageError, Shown, srgb_decode};
use compiler::ir::XYZ_FROM_RGB;
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Pixels per degree of the visual field at 0.7 m from a screen 0.7 m wide with 3840 pixels across.
pub const PIXELS_PER_DEGREE: f64 = 0.7 * 3840.0 / 0.7 * PI / 180.0;

/// Exponents and break points of the paper's sections 4.1.3 and 4.2.
const Q_C: f64 = 0.7;
const P_C: f64 = 0.4;
const P_T: f64 = 0.95;
const Q_F: f64 = 0.5;
/// Width of the features that the eye sees best, in degrees.
const FEATURE_WIDTH: f64 = 0.082;

/// Contrast sensitivity as a sum of two Gaussians a √(π/b) e^(−π²x²/b), x in degrees: achromatic, red-green, blue-yellow.
const CONTRAST: [[(f64, f64); 2]; 3] =
    [[(1.0, 0.0047), (0.0, 1e-5)], [(1.0, 0.0053), (0.0, 1e-5)], [(34.1, 0.04), (13.5, 0.025)]];

/// The map of perceived differences, 0 to 1 per pixel, row by row from the top. Not symmetric by definition, though it
/// nearly is.
///
/// # Errors
/// `E0620` when the sizes differ, are zero, or do not fit the pixels.
pub fn flip(reference: &Shown, test: &Shown, pixels_per_degree: f64) -> Result<Vec<f32>, ImageError> {
    super::check_sizes(reference, test)?;
    let (a, b) = (Seen::new(reference, pixels_per_degree), Seen::new(test, pixels_per_degree));
    // The largest colour difference there is: between green and blue.
    let c_max = hyab(hunt(DVec3::Y), hunt(DVec3::Z)).powf(Q_C);
    let pixels = a.colour.par_iter().zip(&b.colour).zip(a.edges.par_iter().zip(&b.edges));
    let pixels = pixels.zip(a.points.par_iter().zip(&b.points));
    Ok(pixels
        .map(|(((ca, cb), (ea, eb)), (pa, pb))| {
            let colour = redistribute(hyab(*ca, *cb).powf(Q_C), c_max);
            let feature = (ea - eb).abs().max((pa - pb).abs());
            let feature = (feature / 2.0_f64.sqrt()).powf(Q_F).clamp(0.0, 1.0);
            colour.powf(1.0 - feature).clamp(0.0, 1.0) as f32
        })
        .collect())
}

/// Brings colour differences to 0 … 1: linearly up to `P_C · c_max`, compressed above.
fn redistribute(difference: f64, c_max: f64) -> f64 {
    let limit = P_C * c_max;
    if difference < limit {
        P_T / limit * difference
    } else {
        P_T + (difference - limit) / (c_max - limit) * (1.0 - P_T)
    }
}

/// What the eye takes from a picture.
struct Seen {
    /// Blurred by contrast sensitivity, in Hunt-adjusted CIELab.
    colour: Vec<DVec3>,
    edges: Vec<f64>,
    points: Vec<f64>,
}

impl Seen {
    fn new(picture: &Shown, ppd: f64) -> Self {
        let (width, height) = (picture.width as usize, picture.height as usize);
        let opponent: Vec<DVec3> = picture
            .pixels
            .par_iter()
            .map(|pixel| opponent_from_rgb(DVec3::from_array(pixel.map(|v| srgb_decode(f64::from(v))))))
            .collect();
        let plane = |c: usize| -> Vec<f64> { opponent.iter().map(|v| v[c]).collect() };

        let blurred: [Vec<f64>; 3] = std::array::from_fn(|c| blur(&plane(c), width, height, CONTRAST[c], ppd));
        let colour = (0..width * height)
            .into_par_iter()
            .map(|n| {
                let rgb = rgb_from_opponent(DVec3::new(blurred[0][n], blurred[1][n], blurred[2][n]));
                hunt(rgb.clamp(DVec3::ZERO, DVec3::ONE))
            })
            .collect();

        let lightness: Vec<f64> = opponent.iter().map(|v| (v.x + 16.0) / 116.0).collect();
        let features = |kernel: fn(f64, f64) -> f64| -> Vec<f64> {
            let sigma = 0.5 * FEATURE_WIDTH * ppd;
            let along = balanced(&taps((3.0 * sigma).ceil() as i32, |x| kernel(x, sigma)));
            let across = normalised(&taps((3.0 * sigma).ceil() as i32, |x| gauss(x, sigma)));
            let x = convolve(&lightness, width, height, &along, &across);
            let y = convolve(&lightness, width, height, &across, &along);
            x.iter().zip(&y).map(|(x, y)| x.hypot(*y)).collect()
        };
        let edges = features(|x, sigma| -x * gauss(x, sigma));
        let points = features(|x, sigma| (x * x / (sigma * sigma) - 1.0) * gauss(x, sigma));
        Self { colour, edges, points }
    }
}

fn gauss(x: f64, sigma: f64) -> f64 {
    (-x * x / (2.0 * sigma * sigma)).exp()
}

fn taps(radius: i32, f: impl Fn(f64) -> f64) -> Vec<f64> {
    (-radius..=radius).map(|x| f(f64::from(x))).collect()
}

fn normalised(kernel: &[f64]) -> Vec<f64> {
    let sum: f64 = kernel.iter().sum();
    kernel.iter().map(|k| k / sum).collect()
}

/// Positive weights sum to 1 and negative ones to −1.
fn balanced(kernel: &[f64]) -> Vec<f64> {
    let positive: f64 = kernel.iter().filter(|k| **k > 0.0).sum();
    let negative: f64 = -kernel.iter().filter(|k| **k < 0.0).sum::<f64>();
    kernel.iter().map(|k| k / if *k > 0.0 { positive } else { negative }).collect()
}

/// Weighted by a sum of two Gaussians, each of which separates into rows and columns.
fn blur(plane: &[f64], width: usize, height: usize, terms: [(f64, f64); 2], ppd: f64) -> Vec<f64> {
    // Three standard deviations of the widest term of all channels.
    let radius = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * ppd).ceil() as i32;
    let kernel = |b: f64| taps(radius, |x| (-PI * PI * (x / ppd).powi(2) / b).exp());
    let sum = |b: f64| kernel(b).iter().sum::<f64>();
    let weight = |(a, b): (f64, f64)| a * (PI / b).sqrt() * sum(b) * sum(b);
    let total = weight(terms[0]) + weight(terms[1]);
    let mut out = vec![0.0; plane.len()];
    for term in terms.into_iter().filter(|(a, _)| *a > 0.0) {
        let k = normalised(&kernel(term.1));
        let share = weight(term) / total;
        for (out, v) in out.iter_mut().zip(convolve(plane, width, height, &k, &k)) {
            *out += share * v;
        }
    }
    out
}

/// Rows with one kernel, columns with the other; the border repeats.
fn convolve(plane: &[f64], width: usize, height: usize, rows: &[f64], columns: &[f64]) -> Vec<f64> {
    let radius = rows.len() / 2;
    let mut middle = vec![0.0; plane.len()];
    middle.par_chunks_mut(width).zip(plane.par_chunks(width)).for_each(|(out, row)| {
        let padded: Vec<f64> = (0..width + 2 * radius).map(|x| row[x.saturating_sub(radius).min(width - 1)]).collect();
        for (x, out) in out.iter_mut().enumerate() {
            *out = padded[x..x + rows.len()].iter().zip(rows).map(|(v, k)| v * k).sum();
        }
    });
    let radius = columns.len() / 2;
    let mut result = vec![0.0; plane.len()];
    result.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
        for (n, k) in columns.iter().enumerate() {
            let from = (y + n).saturating_sub(radius).min(height - 1) * width;
            for (out, v) in out.iter_mut().zip(&middle[from..from + width]) {
                *out += v * k;
            }
        }
    });
    result
}

fn xyz_from_rgb() -> DMat3 {
    DMat3::from_cols_array_2d(&XYZ_FROM_RGB).transpose()
}

/// Linearised CIELab, called YCxCz.
fn opponent_from_rgb(rgb: DVec3) -> DVec3 {
    let v = xyz_from_rgb() * rgb / (xyz_from_rgb() * DVec3::ONE);
    DVec3::new(116.0 * v.y - 16.0, 500.0 * (v.x - v.y), 200.0 * (v.y - v.z))
}

fn rgb_from_opponent(v: DVec3) -> DVec3 {
    let y = (v.x + 16.0) / 116.0;
    let relative = DVec3::new(v.y / 500.0 + y, y, y - v.z / 200.0);
    xyz_from_rgb().inverse() * (relative * (xyz_from_rgb() * DVec3::ONE))
}

/// CIELab with chroma scaled by lightness: dark colours differ less (the Hunt effect).
fn hunt(rgb: DVec3) -> DVec3 {
    let v = xyz_from_rgb() * rgb / (xyz_from_rgb() * DVec3::ONE);
    let delta: f64 = 6.0 / 29.0;
    let f = |t: f64| if t > delta.powi(3) { t.cbrt() } else { t / (3.0 * delta * delta) + 4.0 / 29.0 };
    let lightness = 116.0 * f(v.y) - 16.0;
    let scale = 0.01 * lightness;
    DVec3::new(lightness, scale * 500.0 * (f(v.x) - f(v.y)), scale * 200.0 * (f(v.y) - f(v.z)))
}

/// City-block in lightness, Euclidean in chroma: right for large differences too.
fn hyab(a: DVec3, b: DVec3) -> f64 {
    let d = a - b;
    d.x.abs() + d.y.hypot(d.z)
}
