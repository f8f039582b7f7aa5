//! The engines: what turns a compiled scene into numbers.

pub mod reference;
