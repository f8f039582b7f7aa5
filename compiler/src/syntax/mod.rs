//! Text to syntax tree. pest's `Rule` never leaves this room.

pub mod ast;
