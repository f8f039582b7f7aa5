//! Values of parameters: `--set density=6`, `--set "height=2 km"`, `--set "tint=#ff8040"`.

use compiler::diagnostic::{Diagnostic, Diagnostics, Severity};
use compiler::ir::{FieldScene, Param, ParamType};
use compiler::loader::NoFiles;

/// A value for every parameter of a scene, in the graph's units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Params(pub Vec<Vec<f64>>);

impl Params {
    /// What the scene says.
    #[must_use]
    pub fn defaults(scene: &FieldScene) -> Self {
        Self(scene.params.iter().map(|p| scaled(scene, p, &p.default)).collect())
    }

    /// The scene's values with some of them set: `name=value`, where the value is an expression of the language with its
    /// unit, or a bare number in SI. The last one of a name counts.
    ///
    /// Errors are `E0640` for a name that is no parameter, `E0641` for a value that does not fit; a value out of the
    /// parameter's range is used and draws the warning `W0640`.
    #[must_use]
    pub fn from_sets<S: AsRef<str>>(scene: &FieldScene, sets: &[S]) -> (Self, Diagnostics) {
        let (mut params, mut found) = (Self::defaults(scene), Diagnostics::default());
        for set in sets {
            match assign(scene, set.as_ref(), &mut found) {
                Ok((index, value)) => params.0[index] = scaled(scene, &scene.params[index], &value),
                Err(diagnostic) => found.push(*diagnostic),
            }
        }
        (params, found)
    }
}

fn scaled(scene: &FieldScene, param: &Param, si: &[f64]) -> Vec<f64> {
    let factor = scene.units.scale(param.dimension[0]);
    si.iter().map(|v| v * factor).collect()
}

type Refusal = Box<Diagnostic>;

/// Which parameter, and its value in SI.
fn assign(scene: &FieldScene, set: &str, found: &mut Diagnostics) -> Result<(usize, Vec<f64>), Refusal> {
    let Some((name, text)) = set.split_once('=') else {
        let message = format!("`--set {set}` has no value");
        return Err(Diagnostic::error("E0641", message).hint("write `--set name=value`").into());
    };
    let (name, text) = (name.trim(), text.trim());
    let Some(index) = scene.params.iter().position(|p| p.name == name) else {
        let mut unknown = Diagnostic::error("E0640", format!("the scene has no parameter `{name}`"));
        let names: Vec<String> = scene.params.iter().map(|p| format!("`{}`", p.name)).collect();
        unknown = match names.len() {
            0 => unknown.note("it has no parameters at all"),
            _ => unknown.note(format!("its parameters are {}", names.join(", "))),
        };
        return Err(unknown.hint(format!("declare one: `param {name} = 1`")).into());
    };
    let param = &scene.params[index];
    let value = value(param, name, text)?;
    if let Some((low, high)) = param.range
        && value.iter().any(|v| *v < low || *v > high)
    {
        let range = format!("{} .. {}", with_unit(low, param), with_unit(high, param));
        found.push(
            Diagnostic::warning("W0640", format!("`{name}` is set to {text}, outside its range {range}"))
                .note("it is used as it is"),
        );
    }
    Ok((index, value))
}

/// A number with the SI unit of the parameter.
pub(crate) fn with_unit(value: f64, param: &Param) -> String {
    let unit = dimension(param.dimension);
    if unit.is_empty() { format!("{value}") } else { format!("{value} {unit}") }
}

/// A product of SI units.
fn dimension(exponents: [f64; 4]) -> String {
    let part = |(unit, exponent): (&str, f64)| match exponent {
        0.0 => None,
        1.0 => Some(unit.to_owned()),
        e => Some(format!("{unit}^{e}")),
    };
    ["m", "s", "lx", "px"].into_iter().zip(exponents).filter_map(part).collect::<Vec<_>>().join("·")
}

fn value(param: &Param, name: &str, text: &str) -> Result<Vec<f64>, Refusal> {
    let refuse = |why: String| Refusal::from(Diagnostic::error("E0641", format!("`--set {name}={text}`: {why}")));
    let width = usize::from(param.ty.node_type().width());
    // What most people type needs no compiler.
    if let Ok(number) = text.parse::<f64>() {
        if !number.is_finite() {
            return Err(refuse("the value is not finite".into()));
        }
        return match param.ty {
            ParamType::Bool => Err(refuse(format!("`{name}` is `true` or `false`"))),
            ParamType::Color => Err(refuse(format!("`{name}` is a colour, such as `#ff8040`"))),
            ParamType::Float(_) => Ok(vec![number; width]),
        };
    }
    // In parentheses, so that nothing but one expression is read; on a line of its own, for the sake of comments.
    let scene = format!("param value = ({text}\n)\n");
    let compiled = compiler::compile("--set", &scene, &NoFiles, &compiler::Options::default());
    let first = compiled.diagnostics.iter().find(|d| d.severity == Severity::Error);
    // An empty scene may well be refused for what it lacks; what counts is whether there is a value.
    let parsed = compiled.program.as_ref().and_then(|p| p.lowered.params.first());
    let Some(given) = parsed else {
        let why = first.map_or_else(|| "it is no value".into(), |d| d.message.clone());
        let mut refusal = refuse(why);
        refusal.hints.extend(first.into_iter().flat_map(|d| d.hints.clone()));
        return Err(refusal);
    };
    let bare = given.dimension == [0.0; 4];
    if given.dimension != param.dimension && !bare {
        let name_of = |d| Some(dimension(d)).filter(|u| !u.is_empty()).unwrap_or_else(|| "no unit".into());
        let (has, wants) = (name_of(given.dimension), name_of(param.dimension));
        return Err(refuse(format!("the value has the dimension {has}, `{name}` has {wants}")));
    }
    let describe = |ty: ParamType| match ty {
        ParamType::Bool => "true or false".to_owned(),
        ParamType::Float(1) => "one number".to_owned(),
        ParamType::Float(n) => format!("{n} numbers"),
        ParamType::Color => "a colour".to_owned(),
    };
    match (param.ty, given.ty) {
        (ParamType::Float(_), ParamType::Float(1)) => Ok(vec![given.default[0]; width]),
        (wanted, given_ty) if wanted == given_ty => Ok(given.default.clone()),
        (wanted, given_ty) => Err(refuse(format!("it is {}, `{name}` is {}", describe(given_ty), describe(wanted)))),
    }
}
