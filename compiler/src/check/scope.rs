//! What an expression can see, and the places where expressions stand.

use super::hir::{GridId, Input, LocalId};
use super::types::Ty;
use crate::resolve::ModuleId;
use std::fmt;

/// A set of implicit inputs.
#[derive(Copy, Clone, Debug, PartialEq, Eq)]
pub(super) struct Inputs(u8);

impl Inputs {
    pub(super) const NONE: Self = Self(0);
    pub(super) const TIME: Self = Self(1);
    pub(super) const LAMBDA: Self = Self(2);
    pub(super) const POSITION: Self = Self(4);
    pub(super) const DIRECTION: Self = Self(8);
    pub(super) const ALTITUDE: Self = Self(16);
    pub(super) const COS_THETA: Self = Self(32);
    /// A value that may change from frame to frame.
    pub(super) const FRAME: Self = Self::TIME;
    /// A strength per band.
    pub(super) const BANDS: Self = Self::TIME.and(Self::LAMBDA);
    /// A field.
    pub(super) const FIELD: Self = Self::BANDS.and(Self::POSITION).and(Self::DIRECTION);

    pub(super) const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    pub(super) fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    pub(super) fn of(input: Input) -> Self {
        match input {
            Input::Position => Self::POSITION,
            Input::Direction => Self::DIRECTION,
            Input::Lambda => Self::LAMBDA,
            Input::Time => Self::TIME,
            Input::Altitude => Self::ALTITUDE,
            Input::CosTheta => Self::COS_THETA,
        }
    }
}

/// Where an expression stands.
#[derive(Clone, Debug)]
pub(super) enum Place {
    /// The body of a function, or a default of one of its parameters.
    Function(String),
    /// The value of a constant.
    Constant(String),
    /// The default or range of a param.
    Param(String),
    /// The rows of a table or transfer function.
    Table(String),
    /// A property.
    Property { block: &'static str, name: &'static str },
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Function(name) => write!(f, "the function `{name}`"),
            Self::Constant(name) => write!(f, "the constant `{name}`"),
            Self::Param(name) => write!(f, "the param `{name}`"),
            Self::Table(name) => write!(f, "`{name}`"),
            Self::Property { block, name } => write!(f, "`{block}.{name}`"),
        }
    }
}

/// What an expression may use besides names.
#[derive(Clone, Debug)]
pub(super) struct Context {
    pub(super) place: Place,
    pub(super) inputs: Inputs,
    /// Whether live controls may be used.
    pub(super) params: bool,
    /// Whether functions of `cos_theta` get it by themselves.
    pub(super) phase: bool,
}

impl Context {
    /// Known when compiling: no param, no input.
    pub(super) fn fixed(place: Place) -> Self {
        Self { place, inputs: Inputs::NONE, params: false, phase: false }
    }

    /// May follow params, and these inputs.
    pub(super) fn live(place: Place, inputs: Inputs) -> Self {
        Self { place, inputs, params: true, phase: false }
    }
}

/// A name bound by a parameter, `let` or loop.
#[derive(Clone, Debug)]
pub(super) struct Local {
    pub(super) name: String,
    pub(super) bound: Bound,
}

/// What a local name stands for.
#[derive(Copy, Clone, Debug)]
pub(super) enum Bound {
    Value(LocalId, Ty),
    /// A parameter of type `grid`: the function is checked anew for each grid.
    Grid(GridId),
    /// Its value is wrong and was reported.
    Error,
}

/// What one expression tree sees.
#[derive(Clone, Debug)]
pub(super) struct Scope {
    pub(super) module: ModuleId,
    pub(super) context: Context,
    pub(super) locals: Vec<Local>,
    next: u32,
}

impl Scope {
    pub(super) fn new(module: ModuleId, context: Context) -> Self {
        Self { module, context, locals: vec![], next: 0 }
    }

    /// An id that no other local of the tree has.
    pub(super) fn fresh(&mut self) -> LocalId {
        self.next += 1;
        LocalId(self.next - 1)
    }

    pub(super) fn bind(&mut self, name: &str, bound: Bound) {
        self.locals.push(Local { name: name.to_owned(), bound });
    }

    /// Binds a new local value.
    pub(super) fn bind_value(&mut self, name: &str, ty: Ty) -> LocalId {
        let id = self.fresh();
        self.bind(name, if ty.is_error() { Bound::Error } else { Bound::Value(id, ty) });
        id
    }

    pub(super) fn find(&self, name: &str) -> Option<Bound> {
        self.locals.iter().rev().find(|l| l.name == name).map(|l| l.bound)
    }
}

impl Scope {
    /// A scope that sees other names but draws its ids from the same tree; give it back with [`Self::adopt`].
    pub(super) fn nested(&self, module: ModuleId, context: Context) -> Self {
        Self { module, context, locals: vec![], next: self.next }
    }

    pub(super) fn adopt(&mut self, inner: &Self) {
        self.next = self.next.max(inner.next);
    }
}
