//! Layers under the sun (`suite/slabs/*.vol`), all orders of scattering, against theory that is computed here by other means: no
//! random number, no ray. Both engines, to their own standard error, which is at most 0.3 % over all the rays of a scene, and the
//! error of the theory, which the first test finds.

use compiler::Options;
use runtime::frame::EngineChoice;
use std::f64::consts::PI;
use tyndall_tests::{Expectation, expectations, probe, root, text};

/// Nodes and weights of Gauss–Legendre on (0, 1).
fn gauss(n: usize) -> Vec<(f64, f64)> {
    let mut out = vec![];
    for i in 0..n {
        let mut x = (PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..100 {
            let (mut before, mut now) = (1.0, x);
            for k in 2..=n {
                let k = k as f64;
                (before, now) = (now, ((2.0 * k - 1.0) * x * now - (k - 1.0) * before) / k);
            }
            slope = n as f64 * (x * now - before) / (x * x - 1.0);
            x -= now / slope;
        }
        out.push((0.5 * (1.0 - x), 1.0 / ((1.0 - x * x) * slope * slope)));
    }
    out
}

/// Square matrices, row by row.
#[derive(Clone)]
struct Matrix(usize, Vec<f64>);

impl Matrix {
    fn of(n: usize, f: impl Fn(usize, usize) -> f64) -> Self {
        Self(n, (0..n * n).map(|i| f(i / n, i % n)).collect())
    }

    fn at(&self, i: usize, j: usize) -> f64 {
        self.1[i * self.0 + j]
    }

    fn times(&self, other: &Self) -> Self {
        Self::of(self.0, |i, j| (0..self.0).map(|k| self.at(i, k) * other.at(k, j)).sum())
    }

    fn plus(&self, other: &Self) -> Self {
        Self::of(self.0, |i, j| self.at(i, j) + other.at(i, j))
    }

    /// (1 − self)⁻¹, by Gauss and Jordan.
    fn repeated(&self) -> Self {
        let n = self.0;
        let mut a = Self::of(n, |i, j| f64::from(u8::from(i == j)) - self.at(i, j));
        let mut b = Self::of(n, |i, j| f64::from(u8::from(i == j)));
        for c in 0..n {
            let pivot = (c..n).max_by(|i, j| a.at(*i, c).abs().total_cmp(&a.at(*j, c).abs())).expect("rows");
            for j in 0..n {
                a.1.swap(c * n + j, pivot * n + j);
                b.1.swap(c * n + j, pivot * n + j);
            }
            let scale = 1.0 / a.at(c, c);
            for j in 0..n {
                a.1[c * n + j] *= scale;
                b.1[c * n + j] *= scale;
            }
            for i in (0..n).filter(|i| *i != c) {
                let factor = a.at(i, c);
                for j in 0..n {
                    a.1[i * n + j] -= factor * a.1[c * n + j];
                    b.1[i * n + j] -= factor * b.1[c * n + j];
                }
            }
        }
        b
    }
}

/// Radiance that a layer of some depth sends back and passes on at the cosines `mu` per irradiance on a plane across the zenith
/// sun's light, the direct beam left out: layers doubled from a depth at which each scatters once (van de Hulst 1963). The
/// directions are nodes of Gauss, and besides those asked for, with weight 0; the sun is one with cosine 1.
fn doubled(order: usize, depth: f64, albedo: f64, phase: &dyn Fn(f64) -> f64, mu: &[f64]) -> Vec<(f64, f64)> {
    let mut nodes = gauss(order);
    nodes.extend(mu.iter().map(|m| (*m, 0.0)));
    nodes.push((1.0, 0.0));
    let n = nodes.len();
    // Mean over azimuth of the phase function, 4π times.
    let mean = |a: f64, b: f64| {
        let across = ((1.0 - a * a) * (1.0 - b * b)).max(0.0).sqrt();
        let steps = 256;
        let at = |k: i32| phase(a * b + across * (PI * (f64::from(k) + 0.5) / f64::from(steps)).cos());
        4.0 * PI * (0..steps).map(at).sum::<f64>() / f64::from(steps)
    };
    // Quadrature leaves the lobe a little too much or too little: made whole, so that no light is lost over many orders.
    let whole: Vec<f64> = (0..n)
        .map(|j| {
            let a = nodes[j].0;
            nodes.iter().map(|(b, w)| 0.5 * w * (mean(*b, a) + mean(-b, a))).sum()
        })
        .collect();
    // So thin that what little it scatters twice, at grazing angles too, is nothing over all that it is doubled to.
    let doublings = 30;
    let thin = depth * 0.5f64.powi(doublings);
    // Radiance out at i per radiance in at j, times the weight of j: I = Σ R(i, j)·I(j); for the sun, weight 1 of its irradiance.
    let weight = |j: usize| if j + 1 == n { 1.0 / (2.0 * PI) } else { nodes[j].1 };
    let single = |sign: f64| {
        Matrix::of(n, |i, j| {
            // Nothing is scattered into the beam of the sun.
            if i + 1 == n {
                return 0.0;
            }
            let norm = (whole[i] * whole[j]).sqrt();
            0.5 * albedo * thin / nodes[i].0 * mean(sign * nodes[i].0, nodes[j].0) / norm * weight(j)
        })
    };
    let mut back = single(-1.0);
    let mut on = single(1.0);
    let mut left = thin;
    for _ in 0..doublings {
        let direct: Vec<f64> = nodes.iter().map(|(m, _)| (-left / m).exp()).collect();
        let pass = Matrix::of(n, |i, j| on.at(i, j) + if i == j { direct[i] } else { 0.0 });
        // Between the halves: down = (1 − R R)⁻¹ T, up = R down.
        let down = back.times(&back).repeated().times(&pass);
        let up = back.times(&down);
        let both = pass.times(&down);
        left *= 2.0;
        on = Matrix::of(n, |i, j| both.at(i, j) - if i == j { (-left / nodes[i].0).exp() } else { 0.0 });
        back = back.plus(&pass.times(&up));
    }
    let sun = n - 1;
    (0..mu.len()).map(|k| (back.at(order + k, sun), on.at(order + k, sun))).collect()
}

/// E₂ of the exponential integrals, ∫₀¹ e^(−x/μ) dμ, by the substitution μ = s³ that smooths its end.
fn e2(x: f64, nodes: &[(f64, f64)]) -> f64 {
    nodes.iter().map(|(s, w)| w * 3.0 * s * s * (-x / (s * s * s)).exp()).sum()
}

/// X(μ) and Y(μ) of a layer that scatters alike in all directions (Chandrasekhar 1950, chapter VIII): the source function at its two
/// faces under light from μ, in units of the first scattering. From Milne's equation J(τ) = e^(−τ/μ) + ω/2 ∫ E₁(|τ − t|)·J(t) dt on
/// cells of constant J, iterated.
fn x_and_y(depth: f64, albedo: f64, mu: f64) -> (f64, f64) {
    let cells = 600;
    let h = depth / cells as f64;
    let nodes = gauss(48);
    // ∫ of E₁ over the k-th next cell, from its own middle; and from a face.
    let table: Vec<f64> = (0..=2 * cells).map(|k| e2(0.5 * k as f64 * h, &nodes)).collect();
    let middle = |k: usize| if k == 0 { 2.0 * (1.0 - table[1]) } else { table[2 * k - 1] - table[2 * k + 1] };
    let kernel: Vec<f64> = (0..cells).map(middle).collect();
    let first: Vec<f64> = (0..cells).map(|i| (-(i as f64 + 0.5) * h / mu).exp()).collect();
    let mut j = first.clone();
    for _ in 0..400 {
        let sum = |i: usize| (0..cells).map(|k| kernel[i.abs_diff(k)] * j[k]).sum::<f64>();
        let next: Vec<f64> = (0..cells).map(|i| first[i] + 0.5 * albedo * sum(i)).collect();
        let change = next.iter().zip(&j).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
        j = next;
        if change < 1e-10 {
            break;
        }
    }
    let face = |near: &dyn Fn(usize) -> usize| -> f64 {
        (0..cells).map(|k| (table[2 * k] - table[2 * k + 2]) * j[near(k)]).sum()
    };
    (1.0 + 0.5 * albedo * face(&|k| k), (-depth / mu).exp() + 0.5 * albedo * face(&|k| cells - 1 - k))
}

/// H(μ) of a layer without bottom (Chandrasekhar 1950, chapter V): 1/H = √(1 − ω) + ω/2 ∫ μ′H(μ′)/(μ + μ′) dμ′.
fn h_function(albedo: f64, mu: f64) -> f64 {
    let nodes = gauss(96);
    let mut h = vec![1.0; nodes.len()];
    let at = |h: &[f64], mu: f64| {
        let sum: f64 = nodes.iter().zip(h).map(|((m, w), h)| w * m * h / (mu + m)).sum();
        1.0 / ((1.0 - albedo).sqrt() + 0.5 * albedo * sum)
    };
    for _ in 0..500 {
        // Half way, which damps the swing of the plain iteration.
        h = nodes.iter().zip(&h).map(|((m, _), old)| 0.5 * (old + at(&h, *m))).collect();
    }
    at(&h, mu)
}

/// What a deep layer that absorbs nothing passes on per irradiance across the beam (van de Hulst, Multiple Light Scattering,
/// 1980, chapter 5): μ₀/π · 4/3 · K(μ)K(μ₀)/(τ + 2q), K = √3/4 · H, q = 0.710446 (Milne, Hopf). What it leaves out falls as e^(−τ).
fn diffused(depth: f64, mu0: f64, mu: f64) -> f64 {
    let k = |mu: f64| 0.25 * 3.0f64.sqrt() * h_function(1.0, mu);
    mu0 / PI * 4.0 / 3.0 * k(mu) * k(mu0) / (depth + 2.0 * 0.710_446_09)
}

/// Relative error of each theory as it is computed here: see [`theory_agrees_with_itself`].
const THEORY: f64 = 3e-4;
const DIFFUSION: f64 = 1e-3;

/// Paths of each ray on the GPU and in the reference, and the largest standard error of all together.
type Effort = [(u32, f64); 2];

const fn alike(samples: u32) -> Effort {
    [(samples, 3e-3); 2]
}

/// Each ray within four standard errors of theory, and all of them together, which show more, within 3.5.
fn compare(scene: &str, effort: Effort, uncertain: f64, theory: impl Fn(&Expectation) -> Vec<f64>) {
    let path = root().join("tests/suite/slabs").join(scene);
    let theory: Vec<Vec<f64>> = expectations(&text(&path)).iter().map(theory).collect();
    for (engine, (samples, limit)) in [EngineChoice::Gpu, EngineChoice::Reference].into_iter().zip(effort) {
        let options = Options { samples: Some(samples), ..Options::probe() };
        let Some(answers) = probe(&path, options, engine) else { continue };
        let (mut mean, mut variance) = (0.0, 0.0);
        for ((ray, answer), exact) in answers.iter().zip(&theory) {
            assert_eq!(answer.error_kind, "standard-error", "{}", ray.line);
            let bands = exact.len() as f64;
            // Bands share their paths, so their errors do not average out.
            let mut relative = 0.0;
            for (band, exact) in exact.iter().enumerate() {
                let (found, error) = (answer.radiance[band], answer.error[band]);
                println!("{scene} {engine:?} {}: {found} ± {error}, theory {exact}", ray.line);
                let off = (found - exact).abs();
                assert!(off <= 4.0 * error + uncertain * exact, "{}: {found} ± {error}, not {exact}", ray.line);
                mean += (found / exact - 1.0) / bands / answers.len() as f64;
                relative += error / exact / bands;
            }
            variance += (relative / answers.len() as f64).powi(2);
        }
        let error = variance.sqrt();
        println!("{scene} {engine:?}: {mean} ± {error} apart");
        assert!(error < limit, "{scene} on {engine:?}: ± {error} shows little");
        assert!(mean.abs() < 3.5 * error + uncertain, "{scene} on {engine:?}: {mean} ± {error} apart");
    }
}

/// Four methods, where their domains meet.
#[test]
fn theory_agrees_with_itself() {
    let even = |_: f64| 0.25 / PI;
    let near = |what: &str, a: f64, b: f64, off: f64| assert!((a / b - 1.0).abs() < off, "{what}: {a} {b}");
    // Layers that scatter alike in all directions, under the sun in the zenith: X and Y against doubling.
    for (depth, albedo) in [(1.0, 0.9), (1.0, 1.0), (4.0, 1.0)] {
        let (x0, y0) = x_and_y(depth, albedo, 1.0);
        for (mu, (back, on)) in [0.3, 0.8].into_iter().zip(doubled(24, depth, albedo, &even, &[0.3, 0.8])) {
            let (x, y) = x_and_y(depth, albedo, mu);
            near("X and Y", albedo / (4.0 * PI) / (mu + 1.0) * (x * x0 - y * y0), back, THEORY);
            near("X and Y", albedo / (4.0 * PI) / (mu - 1.0) * (y * x0 - x * y0), on, THEORY);
        }
    }
    // Diffusion against doubling: 0.5 % too bright at a depth of 8, and e² times less so at every 2 more.
    for (depth, off) in [(10.0, DIFFUSION), (16.0, 1e-5)] {
        for (mu, (_, on)) in [0.4, 0.9].into_iter().zip(doubled(24, depth, 1.0, &even, &[0.4, 0.9])) {
            near("diffusion", diffused(depth, 1.0, mu), on, off);
        }
    }
    // So deep that no light comes back from the bottom: H against doubling.
    for (mu, (back, _)) in [0.2, 0.7].into_iter().zip(doubled(24, 64.0, 0.9, &even, &[0.2, 0.7])) {
        near("H", 0.9 / (4.0 * PI) / (mu + 1.0) * h_function(0.9, mu) * h_function(0.9, 1.0), back, THEORY);
    }
    // Chandrasekhar's table of H: 2.9078 at μ = 1 where nothing is absorbed.
    near("H", h_function(1.0, 1.0), 2.9078, 1e-4);
    // A forward lobe by more directions.
    let cosines = [0.4, 0.95];
    for (a, b) in doubled(24, 8.0, 0.99, &lobe, &cosines).into_iter().zip(doubled(32, 8.0, 0.99, &lobe, &cosines)) {
        near("doubling, reflected", a.0, b.0, THEORY);
        near("doubling, passed on", a.1, b.1, THEORY);
    }
}

/// Henyey and Greenstein's, g = 0.75.
fn lobe(cosine: f64) -> f64 {
    let g = 0.75;
    (1.0 - g * g) / (4.0 * PI * (1.0 + g * g - 2.0 * g * cosine).powf(1.5))
}

#[test]
fn layers_without_bottom_follow_h() {
    let mu0 = 0.8;
    compare("bottomless.vol", alike(1 << 16), THEORY, |ray| {
        let mu = ray.direction[1].abs();
        let of =
            |albedo: f64| albedo / (4.0 * PI) * mu0 / (mu + mu0) * h_function(albedo, mu) * h_function(albedo, mu0);
        [0.9, 0.7, 0.5].map(|albedo| 3.0 * of(albedo)).to_vec()
    });
}

#[test]
fn finite_layers_follow_x_and_y() {
    let mu0 = 0.6;
    compare("isotropic.vol", alike(1 << 16), THEORY, |ray| {
        let mu = ray.direction[1].abs();
        [1.0, 0.9, 0.5]
            .map(|albedo| {
                let ((x0, y0), (x, y)) = (x_and_y(1.0, albedo, mu0), x_and_y(1.0, albedo, mu));
                let strength = 3.0 * albedo / (4.0 * PI) * mu0;
                if ray.direction[1] < 0.0 {
                    strength / (mu + mu0) * (x * x0 - y * y0)
                } else {
                    strength / (mu - mu0) * (y * x0 - x * y0)
                }
            })
            .to_vec()
    });
}

#[test]
fn layers_with_a_forward_lobe_follow_adding_and_doubling() {
    compare("forward.vol", alike(160_000), THEORY, |ray| {
        let mu = ray.direction[1].abs();
        [0.99, 0.95, 0.8]
            .map(|albedo| {
                let (back, on) = doubled(24, 8.0, albedo, &lobe, &[mu])[0];
                3.0 * if ray.direction[1] < 0.0 { back } else { on }
            })
            .to_vec()
    });
}

#[test]
fn light_diffuses_through_a_deep_layer() {
    compare("deep.vol", [(1 << 19, 3e-3), (1 << 19, 3e-3)], DIFFUSION, |ray| {
        vec![10.0 * diffused(10.0, 1.0, ray.direction[1])]
    });
}
