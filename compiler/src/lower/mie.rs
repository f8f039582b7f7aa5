//! Scattering by spheres: `mie` becomes a table over the angle, its cross-sections become numbers. Both are known when
//! compiling, one value per band.

use super::{Lowered, Lowerer};
use crate::check::hir;
use crate::diagnostic::Diagnostic;
use crate::ir::eval::mie::{self, CrossSections, Ensemble, EnsembleError, Particles};
use crate::ir::{Binary, NodeId, Op, Table, TableId, Unary};
use crate::source::Span;

/// Errors above this are told, and above this are a warning.
const WORTH_TELLING: f64 = 1e-4;
const WORTH_WARNING: f64 = 5e-2;

/// What is asked of the spheres.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(super) enum Mie {
    Phase,
    Scattering,
    Absorption,
    Extinction,
}

impl Mie {
    fn word(self) -> &'static str {
        match self {
            Self::Phase => "mie",
            Self::Scattering => "mie_scattering",
            Self::Absorption => "mie_absorption",
            Self::Extinction => "mie_extinction",
        }
    }
}

/// What a phase function was tabulated from, by the bits of its numbers.
pub(super) type MieKey = Vec<[u64; 5]>;

impl<'s> Lowerer<'s, '_> {
    /// Arguments: radius, n, k, spread, and the cosine of a phase function.
    pub(super) fn mie(&mut self, span: Span, asked: Mie, arguments: &'s [hir::Expr]) -> Lowered<NodeId> {
        let particles = self.particles(asked, arguments)?;
        let section: fn(&CrossSections) -> f64 = match asked {
            Mie::Scattering => |s| s.scattering,
            Mie::Absorption => |s| s.absorption,
            Mie::Extinction => CrossSections::extinction,
            Mie::Phase => {
                let cosine = self.scalar(&arguments[4])?;
                let table = self.mie_table(span, &particles, arguments)?;
                let at = self.mie_key(cosine);
                return Ok(self.graph.push(Op::Lookup { table, at }));
            }
        };
        let wavelengths = self.bands.wavelengths.clone();
        let (mut values, mut worst) = (vec![], 0.0_f64);
        for (particles, wavelength) in particles.iter().zip(wavelengths) {
            let sections = match CrossSections::new(particles, wavelength) {
                Ok(sections) => sections,
                Err(error) => return self.no_such_particles(asked, &error, arguments, wavelength),
            };
            worst = worst.max(sections.error);
            values.push(section(&sections) * self.units.scale(2.0));
        }
        self.tell_of_error(span, asked, worst, "the average over sizes");
        Ok(self.graph.vector(&values))
    }

    /// One set of numbers per band, radii in metres.
    fn particles(&mut self, asked: Mie, arguments: &'s [hir::Expr]) -> Lowered<Vec<Particles>> {
        const NAMES: [&str; 4] = ["radius", "index", "k", "spread"];
        let mut known = vec![];
        for (name, argument) in NAMES.iter().zip(arguments) {
            let node = self.node(argument)?;
            let Some(values) = self.known_components(node) else {
                let (cause, why) = self.trace(argument, self.frames.len() - 1, 0);
                let mut problem =
                    Diagnostic::error("E0524", format!("`{name}` of `{}` must be known when compiling", asked.word()))
                        .at(cause, why);
                if cause != argument.span {
                    problem = problem.because(argument.span, "it decides how light is scattered");
                }
                return self.report(
                    problem
                        .note("the series of Mie's theory are summed once, by the compiler")
                        .hint("write a number, a function of `lambda`, or mix two of them: `mix(mie(…), mie(…), t)`"),
                );
            };
            known.push(values);
        }
        let metre = self.units.scale(1.0);
        let mut all = vec![];
        for band in 0..self.bands.wavelengths.len() {
            let at = |i: usize| known[i].get(band).or(known[i].first()).copied().unwrap_or(f64::NAN);
            let particles = Particles { radius: at(0) / metre, n: at(1), k: at(2), spread: at(3) };
            let Particles { radius, n, k, spread } = particles;
            let wrong = [
                (!(radius > 0.0 && radius.is_finite()), 0, "the radius of a sphere is above zero".to_owned()),
                (!(n > 0.0 && n.is_finite()), 1, format!("the index of refraction is above zero, and this is {n}")),
                (!(k >= 0.0 && k.is_finite()), 2, format!("n + ik with k below zero would make light: k is {k}")),
                (
                    !((1.0..=10.0).contains(&spread)),
                    3,
                    format!("the geometric standard deviation lies between 1 (one size) and 10, and this is {spread}"),
                ),
            ];
            if let Some((_, i, why)) = wrong.into_iter().find(|w| w.0) {
                return self.report(
                    Diagnostic::error("E0525", format!("`{}` knows no such particles", asked.word()))
                        .at(arguments[i].span, why)
                        .hint("water in air, say: `radius: 5 um, index: 1.33, spread: 1.2`"),
                );
            }
            all.push(particles);
        }
        Ok(all)
    }

    fn no_such_particles<T>(
        &mut self,
        asked: Mie,
        error: &EnsembleError,
        arguments: &[hir::Expr],
        wavelength: f64,
    ) -> Lowered<T> {
        let problem = Diagnostic::error("E0525", format!("`{}` knows no such particles", asked.word()));
        let (least, most) = mie::SIZES;
        let most = if asked == Mie::Phase { mie::LARGEST_TABULATED } else { most };
        let at = |x: f64| metres(x * wavelength / (2.0 * std::f64::consts::PI));
        self.report(match *error {
            EnsembleError::Size(x) => {
                let problem = problem
                    .at(arguments[0].span, format!("radii of {} matter, which is 2πr/λ = {x:.3e}", at(x)))
                    .note(format!("radii from {} to {} are computed at this wavelength", at(least), at(most)));
                if x < least {
                    problem.hint("far below the wavelength, `rayleigh` is exact")
                } else {
                    problem.hint("far above the wavelength, a smooth lobe will do: `henyey_greenstein(g: 0.9)`")
                }
            }
            EnsembleError::Nothing => problem
                .at(arguments[1].span, "with the index of what is around it, a sphere scatters nothing")
                .hint("the index is relative to the surroundings: 1.33 for water in air"),
        })
    }

    fn mie_table(&mut self, span: Span, particles: &[Particles], arguments: &[hir::Expr]) -> Lowered<TableId> {
        let wavelengths = self.bands.wavelengths.clone();
        let bits = |(p, w): (&Particles, &f64)| [p.radius, p.n, p.k, p.spread, *w].map(f64::to_bits);
        let key: MieKey = particles.iter().zip(&wavelengths).map(bits).collect();
        if let Some(table) = self.mie_tables.get(&key) {
            return Ok(*table);
        }
        let mut ensembles = vec![];
        for (particles, wavelength) in particles.iter().zip(wavelengths) {
            match Ensemble::new(particles, wavelength) {
                Ok(ensemble) => ensembles.push(ensemble),
                Err(error) => return self.no_such_particles(Mie::Phase, &error, arguments, wavelength),
            }
        }
        let rows = mie::tabulate(&ensembles);
        self.tell_of_error(span, Mie::Phase, rows.error, "the table between its rows");
        let sizes = ensembles.iter().map(|e| e.error).fold(0.0, f64::max);
        self.tell_of_error(span, Mie::Phase, sizes, "the average over sizes");
        let keys = rows.keys.iter().map(|k| self.free(|graph| graph.scalar(*k))).collect();
        let values = rows.values.iter().map(|v| self.free(|graph| graph.vector(v))).collect();
        let width = particles.len() as u8;
        let table = self.graph.add_table(Table { name: "mie".into(), span: Some(span), keys, values, width });
        self.mie_tables.insert(key, table);
        Ok(table)
    }

    /// Whether a node is the phase function of spheres, and nothing else.
    pub(super) fn is_mie(&self, node: NodeId) -> bool {
        matches!(self.graph.op(node), Op::Lookup { table, .. } if self.mie_tables.values().any(|t| t == table))
    }

    /// sin(θ/2) − cos(θ/2), as [`mie::key_of_cosine`].
    fn mie_key(&mut self, cosine: NodeId) -> NodeId {
        let g = &mut self.graph;
        let (one, low, half) = (g.scalar(1.0), g.scalar(-1.0), g.scalar(0.5));
        let below = g.binary(Binary::Min, cosine, one);
        let cosine = g.binary(Binary::Max, below, low);
        let (back, forth) = (g.sub(one, cosine), g.add(one, cosine));
        let (back, forth) = (g.mul(half, back), g.mul(half, forth));
        let (back, forth) = (g.unary(Unary::Sqrt, back), g.unary(Unary::Sqrt, forth));
        g.sub(back, forth)
    }

    fn tell_of_error(&mut self, span: Span, asked: Mie, error: f64, of: &str) {
        if error <= WORTH_TELLING {
            return;
        }
        let message = format!("`{}` is within {} of the exact value", asked.word(), percent(error));
        let diagnostic = if error > WORTH_WARNING {
            Diagnostic::warning("W0527", message)
        } else {
            Diagnostic::remark("N0526", message)
        };
        self.diagnostics.push(
            diagnostic
                .at(span, format!("{of} is this far off in the worst place"))
                .hint("give it a `spread`, as particles of nature have: the narrow ripples of one size vanish"),
        );
    }
}

fn percent(share: f64) -> String {
    if share >= 0.1 { format!("{:.0} %", share * 100.0) } else { format!("{:.2} %", share * 100.0) }
}

/// A length with a unit that suits it.
fn metres(length: f64) -> String {
    if length < 1e-11 {
        return format!("{:.1e} nm", length * 1e9);
    }
    let (scale, unit) = match length {
        l if l < 1e-6 => (1e9, "nm"),
        l if l < 1e-3 => (1e6, "um"),
        _ => (1e3, "mm"),
    };
    format!("{:.3} {unit}", length * scale)
}
