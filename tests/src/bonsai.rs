//! A small scene of 3D Gaussian splats, made from scratch: a little tree in a glazed pot on a wooden table. What is in
//! `examples/data/bonsai.spz`, written by `cargo run -p tyndall-tests --example bonsai`.
//!
//! Surfaces are strewn with flat splats in their tangent planes. Their light is baked in: a sun with a cosine, a sky that
//! grows with height, shade under the crown, and gloss as a lobe around the mirrored sun, which spherical harmonics of degree 3
//! hold as Σ λ_l Y_lm(axis) Y_lm(view).

use flate2::{Compression, write::GzEncoder};
use runtime::data::splats::harmonics;
use std::f64::consts::{PI, SQRT_2, TAU};
use std::io::Write;

type Vec3 = [f64; 3];

/// Towards the sun.
const SUN: Vec3 = [-0.48, 0.76, 0.44];
const COEFFICIENTS: usize = 16;

/// A splat of the scene: axes along its deviations are those of `rotation`.
#[derive(Clone, Debug)]
pub struct Made {
    /// Metres, y up.
    pub center: Vec3,
    /// Unit quaternion w, x, y, z.
    pub rotation: [f64; 4],
    /// Metres.
    pub deviations: Vec3,
    /// 0 to 1.
    pub opacity: f64,
    /// 16 times red, green, blue.
    pub harmonics: Vec<f64>,
}

/// SplitMix64: the same numbers everywhere.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    fn direction(&mut self) -> Vec3 {
        let (z, phi) = (self.between(-1.0, 1.0), self.between(0.0, TAU));
        let r = (1.0 - z * z).sqrt();
        [r * phi.cos(), z, r * phi.sin()]
    }
}

fn add(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] + b[i])
}

fn scale(a: Vec3, s: f64) -> Vec3 {
    a.map(|x| x * s)
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: Vec3) -> Vec3 {
    scale(a, 1.0 / dot(a, a).sqrt())
}

/// The rotation that takes z to a unit vector, and x as near as may be to another.
fn facing(z: Vec3, x: Vec3) -> [f64; 4] {
    let side = cross(z, x);
    let y = if dot(side, side) > 1e-9 { unit(side) } else { unit(cross(z, [0.312, 0.8, 0.511])) };
    let x = cross(y, z);
    // Columns x, y, z to a quaternion, by the largest part.
    let trace = x[0] + y[1] + z[2];
    let q = if trace > 0.0 {
        [1.0 + trace, y[2] - z[1], z[0] - x[2], x[1] - y[0]]
    } else if x[0] > y[1] && x[0] > z[2] {
        [y[2] - z[1], 1.0 + x[0] - y[1] - z[2], x[1] + y[0], z[0] + x[2]]
    } else if y[1] > z[2] {
        [z[0] - x[2], x[1] + y[0], 1.0 + y[1] - x[0] - z[2], y[2] + z[1]]
    } else {
        [x[1] - y[0], z[0] + x[2], y[2] + z[1], 1.0 + z[2] - x[0] - y[1]]
    };
    let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    q.map(|v| v / norm)
}

fn encode(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// What a piece of surface looks like: linear albedo, and the strength and sharpness of its gloss.
#[derive(Copy, Clone)]
struct Finish {
    albedo: Vec3,
    gloss: f64,
}

struct Maker {
    random: Random,
    splats: Vec<Made>,
}

impl Maker {
    /// A flat splat of half widths along x (near `along`) and across it.
    fn flat(
        &mut self,
        center: Vec3,
        normal: Vec3,
        along: Vec3,
        (length, width): (f64, f64),
        finish: Finish,
        light: f64,
    ) {
        let sun = unit(SUN);
        let lit = dot(normal, sun).max(0.0);
        let sky = 0.5 + 0.5 * normal[1];
        let shade = [1.15, 1.02, 0.82].map(|s| s * lit * light);
        let ambient = [0.20, 0.24, 0.32].map(|a| a * sky * (0.35 + 0.65 * light));
        let color: Vec3 = std::array::from_fn(|c| encode((finish.albedo[c] * (shade[c] + ambient[c])).min(1.0)));
        let mut sh = vec![0.0; 3 * COEFFICIENTS];
        for c in 0..3 {
            sh[c] = (color[c] - 0.5) / harmonics(0, [0.0, 0.0, 1.0])[0];
        }
        if finish.gloss > 0.0 && light > 0.0 {
            // The lobe is seen from where the sun is mirrored to; directions lead from the eye.
            let mirrored = add(scale(normal, 2.0 * dot(normal, sun)), scale(sun, -1.0));
            let basis = harmonics(3, scale(mirrored, -1.0));
            // A lobe that falls off with its degree, zero in the mean so that the colour above stays.
            let falloff = [0.0, 0.85, 0.7, 0.5];
            for (k, b) in basis.iter().enumerate() {
                let l = (k as f64).sqrt() as usize;
                for c in 0..3 {
                    sh[3 * k + c] += finish.gloss * light * falloff[l] * b;
                }
            }
        }
        self.splats.push(Made {
            center,
            rotation: facing(normal, along),
            deviations: [length, width, 0.12 * width],
            opacity: 0.94,
            harmonics: sh,
        });
    }

    fn vary(&mut self, albedo: Vec3, by: f64) -> Vec3 {
        let common = self.random.between(1.0 - by, 1.0 + by);
        albedo.map(|a| a * common * self.random.between(1.0 - 0.3 * by, 1.0 + 0.3 * by))
    }

    /// The top of a round table, with rings of grain, and the shadow of the tree on it.
    fn table(&mut self, count: usize) {
        for i in 0..count {
            // Evenly strewn by the golden angle.
            let r = 0.62 * ((i as f64 + 0.5) / count as f64).sqrt();
            let phi = i as f64 * PI * (3.0 - 5.0_f64.sqrt());
            let at = [r * phi.cos(), 0.0, r * phi.sin()];
            let grain = 0.88 + 0.12 * (48.0 * (at[2] + 0.03 * (7.0 * at[0]).sin())).sin();
            let albedo = self.vary([0.36 * grain, 0.21 * grain, 0.115 * grain], 0.06);
            // The crown's shadow, softly; the foot of the pot.
            let toward = |height: f64| [at[0] + SUN[0] / SUN[1] * height, at[2] + SUN[2] / SUN[1] * height];
            let under = |height: f64, radius: f64| {
                let [x, z] = toward(height);
                1.0 / (1.0 + (-(x.hypot(z) - radius) / 0.022).exp())
            };
            let light = (under(0.44, 0.18).max(0.16)) * under(0.07, 0.115).max(0.12);
            let foot = 1.0 - 0.55 * (-((r - 0.11) / 0.03).powi(2)).exp();
            self.flat(
                at,
                [0.0, 1.0, 0.0],
                [1.0, 0.0, 0.0],
                (0.017, 0.011),
                Finish { albedo, gloss: 0.10 },
                light * foot,
            );
        }
    }

    /// A surface of revolution: its radius and the slope of that over height.
    fn pot(&mut self, count: usize) {
        let radius = |h: f64| 0.105 + 0.03 * (h / 0.13).powi(2) + if h > 0.112 { 0.012 } else { 0.0 };
        for i in 0..count {
            let h = 0.13 * (i as f64 + 0.5) / count as f64;
            let phi = i as f64 * PI * (3.0 - 5.0_f64.sqrt());
            let out = [phi.cos(), 0.0, phi.sin()];
            let slope = 0.06 * h / (0.13 * 0.13);
            let normal = unit([out[0], -slope, out[2]]);
            let at = add(scale(out, radius(h)), [0.0, h, 0.0]);
            let drip = 0.5 + 0.5 * (5.0 * phi).sin() * (9.0 * phi + 1.0).cos();
            let glaze: Vec3 = if h < 0.045 + 0.02 * drip { [0.30, 0.15, 0.085] } else { [0.035, 0.16, 0.24] };
            let gloss = if h < 0.045 + 0.02 * drip { 0.05 } else { 0.5 };
            let albedo = self.vary(glaze, 0.08);
            let light = 0.35 + 0.65 * (h / 0.06).min(1.0);
            self.flat(at, normal, [0.0, 1.0, 0.0], (0.0115, 0.0105), Finish { albedo, gloss }, light);
        }
        // Moss on top.
        for i in 0..count / 3 {
            let r = 0.126 * ((i as f64 + 0.5) / (count / 3) as f64).sqrt();
            let phi = i as f64 * PI * (3.0 - 5.0_f64.sqrt());
            let bump = 0.012 * (1.0 - (r / 0.13).powi(2)) + 0.003 * self.random.unit();
            let at = [r * phi.cos(), 0.121 + bump, r * phi.sin()];
            let tilt = scale(self.random.direction(), 0.35);
            let albedo = self.vary([0.10, 0.17, 0.035], 0.35);
            let near = 0.3 + 0.5 * (r / 0.126);
            self.flat(
                at,
                unit(add([0.0, 1.0, 0.0], tilt)),
                [1.0, 0.0, 0.0],
                (0.008, 0.007),
                Finish { albedo, gloss: 0.0 },
                near,
            );
        }
    }

    /// A limb along a quadratic Bézier curve.
    fn limb(&mut self, [a, b, c]: [Vec3; 3], (thick, thin): (f64, f64), count: usize) {
        for i in 0..count {
            let t = (i as f64 + 0.5) / count as f64;
            let curve = |i: usize| (1.0 - t).powi(2) * a[i] + 2.0 * t * (1.0 - t) * b[i] + t * t * c[i];
            let slope = |i: usize| 2.0 * (1.0 - t) * (b[i] - a[i]) + 2.0 * t * (c[i] - b[i]);
            let (at, along) = ([curve(0), curve(1), curve(2)], unit([slope(0), slope(1), slope(2)]));
            let side = unit(cross(along, [0.3, 0.1, 0.95]));
            let up = cross(side, along);
            let phi = i as f64 * 2.4;
            let normal = add(scale(side, phi.cos()), scale(up, phi.sin()));
            let radius = thick + (thin - thick) * t;
            let ridge = 0.75 + 0.25 * (3.0 * phi + 20.0 * t).sin();
            let albedo = self.vary([0.17 * ridge, 0.105 * ridge, 0.062 * ridge], 0.2);
            let light = 0.75 - 0.35 * t;
            let place = add(at, scale(normal, radius * 0.8));
            self.flat(
                place,
                normal,
                along,
                (0.55 * radius + 0.008, 0.45 * radius),
                Finish { albedo, gloss: 0.02 },
                light,
            );
        }
    }

    /// A cushion of leaves.
    fn crown(&mut self, center: Vec3, radii: Vec3, count: usize) {
        for _ in 0..count {
            let out = self.random.direction();
            // Most near the surface, few below.
            let depth = self.random.unit().powf(0.35);
            let low = if out[1] < 0.0 { 0.55 } else { 1.0 };
            let at: Vec3 =
                std::array::from_fn(|i| center[i] + depth * radii[i] * out[i] * if i == 1 { low } else { 1.0 });
            let surface = unit(std::array::from_fn(|i| out[i] / radii[i]));
            let normal = unit(add(surface, scale(self.random.direction(), 0.75)));
            let young = self.random.unit().powi(3);
            let albedo = self.vary([0.085 + 0.14 * young, 0.19 + 0.14 * young, 0.035 + 0.03 * young], 0.3);
            let open = 0.5 + 0.5 * dot(surface, unit(SUN));
            let light = depth.powi(3) * (0.2 + 0.8 * open);
            let size = self.random.between(0.0045, 0.0085);
            let along = unit(add(self.random.direction(), [0.0, -0.3, 0.0]));
            self.flat(at, normal, along, (1.5 * size, 0.75 * size), Finish { albedo, gloss: 0.16 }, light);
        }
    }
}

/// The scene.
#[must_use]
pub fn splats() -> Vec<Made> {
    let mut m = Maker { random: Random(2026), splats: vec![] };
    m.table(1500);
    m.pot(700);
    let (foot, bend, top) = ([0.0, 0.12, 0.0], [-0.13, 0.25, 0.03], [0.04, 0.40, 0.0]);
    m.limb([foot, bend, top], (0.03, 0.011), 260);
    m.limb([[-0.055, 0.235, 0.014], [-0.10, 0.27, 0.02], [-0.17, 0.29, 0.045]], (0.013, 0.006), 80);
    m.limb([[-0.03, 0.30, 0.01], [0.05, 0.32, -0.02], [0.14, 0.335, -0.035]], (0.012, 0.006), 80);
    m.limb([[-0.045, 0.27, 0.01], [-0.03, 0.31, 0.06], [0.01, 0.33, 0.12]], (0.010, 0.005), 50);
    m.crown([0.045, 0.445, 0.0], [0.125, 0.062, 0.11], 1500);
    m.crown([-0.185, 0.315, 0.05], [0.085, 0.042, 0.08], 850);
    m.crown([0.165, 0.355, -0.04], [0.092, 0.044, 0.082], 900);
    m.crown([0.015, 0.355, 0.13], [0.075, 0.036, 0.068], 650);
    m.splats
}

/// The bytes of an SPZ file of version 3, before compression.
#[must_use]
pub fn stream(splats: &[Made]) -> Vec<u8> {
    let mut out = b"NGSP\x03\0\0\0".to_vec();
    out.extend((splats.len() as u32).to_le_bytes());
    // Degree 3; 16 bits behind the point: positions to 8 micrometres, up to 128 m.
    out.extend([3, 16, 0, 0]);
    let byte = |x: f64| x.round().clamp(0.0, 255.0) as u8;
    for s in splats {
        out.extend(s.center.iter().flat_map(|x| ((x * 65536.0).round() as i32).to_le_bytes().into_iter().take(3)));
    }
    out.extend(splats.iter().map(|s| byte(255.0 * s.opacity)));
    out.extend(splats.iter().flat_map(|s| [0, 1, 2].map(|c| byte((s.harmonics[c] * 0.15 + 0.5) * 255.0))));
    out.extend(splats.iter().flat_map(|s| s.deviations.map(|d| byte((d.ln() + 10.0) * 16.0))));
    for s in splats {
        let [w, x, y, z] = s.rotation;
        let q = [x, y, z, w];
        let largest = (1..4).fold(0, |best, i| if q[i].abs() > q[best].abs() { i } else { best });
        let word = (0..4).filter(|i| *i != largest).fold(largest as u32, |word, i| {
            let v = q[i] * q[largest].signum();
            word << 10 | u32::from(v < 0.0) << 9 | (v.abs() * SQRT_2 * 511.0).round() as u32
        });
        out.extend(word.to_le_bytes());
    }
    // Four bits suffice, and compress.
    let coarse = |x: f64| byte((x * 8.0).round() * 16.0 + 128.0);
    out.extend(splats.iter().flat_map(|s| s.harmonics[3..].iter().map(|x| coarse(*x))));
    out
}

/// The file.
///
/// # Panics
/// Never: memory is written.
#[must_use]
pub fn file() -> Vec<u8> {
    let mut gzip = GzEncoder::new(vec![], Compression::best());
    gzip.write_all(&stream(&splats())).and_then(|()| gzip.finish()).expect("memory can be written")
}
