//! Expressions: the grammar's flat chains to trees, by precedence, without recursing along a chain.

use super::ast::{Argument, BinaryOp, Expr, ExprKind, Name, ReduceOp, UnaryOp};
use super::grammar::Rule;
use super::limits::MAX_HEIGHT;
use super::tree::{Broken, Builder, Built, Children};
use crate::diagnostic::Diagnostic;
use crate::source::Span;
use pest::iterators::Pair;

/// An expression under construction.
struct Node {
    expr: Expr,
    /// Height of its tree.
    height: usize,
    /// Whether it stands in parentheses of its own.
    grouped: bool,
    /// Where it ends in a bare number that a following `/` would divide.
    bare_number: Option<Span>,
}

/// An operator that waits for its right side.
enum Waiting {
    Prefix(UnaryOp, Span),
    Infix(BinaryOp, Span),
}

impl Waiting {
    /// How tightly it binds.
    fn strength(&self) -> u8 {
        match self {
            Self::Prefix(..) => PREFIX_STRENGTH,
            Self::Infix(op, _) => strength(*op),
        }
    }
}

const PREFIX_STRENGTH: u8 = 6;

fn strength(op: BinaryOp) -> u8 {
    match op {
        BinaryOp::Or => 1,
        BinaryOp::And => 2,
        BinaryOp::Equal
        | BinaryOp::NotEqual
        | BinaryOp::Less
        | BinaryOp::LessEqual
        | BinaryOp::Greater
        | BinaryOp::GreaterEqual => 3,
        BinaryOp::Add | BinaryOp::Subtract => 4,
        BinaryOp::Multiply | BinaryOp::Divide => 5,
        BinaryOp::Power => 7,
    }
}

const COMPARISON_STRENGTH: u8 = 3;

fn binary(rule: Rule) -> Option<BinaryOp> {
    Some(match rule {
        Rule::or => BinaryOp::Or,
        Rule::and => BinaryOp::And,
        Rule::equal => BinaryOp::Equal,
        Rule::not_equal => BinaryOp::NotEqual,
        Rule::less => BinaryOp::Less,
        Rule::less_equal => BinaryOp::LessEqual,
        Rule::greater => BinaryOp::Greater,
        Rule::greater_equal => BinaryOp::GreaterEqual,
        Rule::add => BinaryOp::Add,
        Rule::subtract => BinaryOp::Subtract,
        Rule::multiply => BinaryOp::Multiply,
        Rule::divide => BinaryOp::Divide,
        Rule::power => BinaryOp::Power,
        _ => return None,
    })
}

impl Builder<'_, '_> {
    /// Any expression of the grammar.
    pub(super) fn expression(&mut self, pair: Pair<'_, Rule>) -> Built<Expr> {
        self.node(pair).map(|n| n.expr)
    }

    fn node(&mut self, pair: Pair<'_, Rule>) -> Built<Node> {
        match pair.as_rule() {
            Rule::conditional => self.conditional(pair),
            _ => self.chain(pair),
        }
    }

    /// A node over parts whose highest has height `below`.
    fn over(&mut self, kind: ExprKind, span: Span, below: usize) -> Built<Node> {
        if below >= MAX_HEIGHT {
            return Err(self.too_high(span));
        }
        Ok(Node { expr: Expr { kind, span }, height: below + 1, grouped: false, bare_number: None })
    }

    fn conditional(&mut self, pair: Pair<'_, Rule>) -> Built<Node> {
        let words: Vec<Span> =
            pair.clone().into_inner().filter(|p| p.as_rule() == Rule::if_word).map(|p| self.span(&p)).collect();
        let mut parts: Vec<Node> = Children::of(pair).expressions().map(|p| self.node(p)).collect::<Built<_>>()?;
        let mut result = parts.pop().ok_or(Broken)?;
        for word in words.into_iter().rev() {
            let accept = parts.pop().ok_or(Broken)?;
            let condition = parts.pop().ok_or(Broken)?;
            let below = result.height.max(accept.height).max(condition.height);
            let span = word.to(result.expr.span);
            let kind = ExprKind::If {
                condition: Box::new(condition.expr),
                accept: Box::new(accept.expr),
                reject: Box::new(result.expr),
            };
            result = self.over(kind, span, below)?;
        }
        Ok(result)
    }

    /// A `formula` or `product`: operands between operators.
    fn chain(&mut self, pair: Pair<'_, Rule>) -> Built<Node> {
        let mut done: Vec<Node> = vec![];
        let mut waiting: Vec<Waiting> = vec![];
        for part in pair.into_inner() {
            let span = self.span(&part);
            match part.as_rule() {
                Rule::negate => waiting.push(Waiting::Prefix(UnaryOp::Negate, span)),
                Rule::not => waiting.push(Waiting::Prefix(UnaryOp::Not, span)),
                Rule::member => {
                    let object = done.pop().ok_or(Broken)?;
                    let field = self.find_name(&mut Children::of(part))?;
                    let span = object.expr.span.to(span);
                    let below = object.height;
                    let kind = ExprKind::Member { object: Box::new(object.expr), field };
                    done.push(self.over(kind, span, below)?);
                }
                rule => match binary(rule) {
                    None => done.push(self.primary(part)?),
                    Some(op) => {
                        let limit = strength(op) + u8::from(op == BinaryOp::Power);
                        while waiting.last().is_some_and(|w| w.strength() >= limit) {
                            self.apply(&mut done, &mut waiting)?;
                        }
                        waiting.push(Waiting::Infix(op, span));
                    }
                },
            }
        }
        while !waiting.is_empty() {
            self.apply(&mut done, &mut waiting)?;
        }
        done.pop().ok_or(Broken)
    }

    /// Gives the operator that waits on top its right side.
    fn apply(&mut self, done: &mut Vec<Node>, waiting: &mut Vec<Waiting>) -> Built<()> {
        let right = done.pop().ok_or(Broken)?;
        let node = match waiting.pop().ok_or(Broken)? {
            Waiting::Prefix(op, op_span) => {
                let span = op_span.to(right.expr.span);
                let bare_number = right.bare_number;
                let kind = ExprKind::Unary { op, operand: Box::new(right.expr) };
                Node { bare_number, ..self.over(kind, span, right.height)? }
            }
            Waiting::Infix(op, op_span) => {
                let left = done.pop().ok_or(Broken)?;
                if strength(op) == COMPARISON_STRENGTH {
                    self.refuse_chained(&left, op_span);
                }
                if op == BinaryOp::Divide {
                    self.warn_of_divided_unit(&left, &right);
                }
                let span = left.expr.span.to(right.expr.span);
                let below = left.height.max(right.height);
                let bare_number = right.bare_number.filter(|_| matches!(op, BinaryOp::Multiply | BinaryOp::Divide));
                let kind = ExprKind::Binary { op, op_span, left: Box::new(left.expr), right: Box::new(right.expr) };
                Node { bare_number, ..self.over(kind, span, below)? }
            }
        };
        done.push(node);
        Ok(())
    }

    fn refuse_chained(&mut self, left: &Node, op_span: Span) {
        if let ExprKind::Binary { op, op_span: first, .. } = &left.expr.kind
            && strength(*op) == COMPARISON_STRENGTH
            && !left.grouped
        {
            self.report(
                Diagnostic::error("E0120", "comparisons do not chain")
                    .at(op_span, "a second comparison")
                    .because(*first, "of the result of this one")
                    .hint("compare twice and join with `&&`, as in `0 < x && x < 1`"),
            );
        }
    }

    /// `1/2 deg` reads like half a degree, and is not.
    fn warn_of_divided_unit(&mut self, left: &Node, right: &Node) {
        let ExprKind::Quantity { value, unit, power } = &right.expr.kind else { return };
        let (Some(number), ExprKind::Number(_), false) = (left.bare_number, &value.kind, right.grouped) else { return };
        let text = |span: Span| &self.scan.text[span.range()];
        let (above, below, divisor) = (text(number), text(value.span), text(right.expr.span));
        let unit = if *power == 1 { unit.text.clone() } else { format!("{}^{power}", unit.text) };
        let warning = Diagnostic::warning("W0101", format!("the unit belongs to the divisor: this is {above} / ({divisor})"))
            .at(number.to(right.expr.span), format!("divides by `{divisor}`"))
            .note("a unit binds more tightly than any operator")
            .hint(format!("write `({above} / {below}) * {unit}` for a fraction of the unit, or `{above} / ({divisor})` to keep the meaning"));
        self.report(warning);
    }

    fn primary(&mut self, pair: Pair<'_, Rule>) -> Built<Node> {
        let span = self.span(&pair);
        match pair.as_rule() {
            Rule::numeric => self.numeric(pair),
            Rule::reference => self.reference(pair),
            Rule::group => self.group(pair),
            Rule::reduce => self.reduce(pair),
            Rule::block => self.block(pair),
            Rule::list => {
                let parts: Vec<Node> = Children::of(pair).expressions().map(|p| self.node(p)).collect::<Built<_>>()?;
                let (parts, below) = split(parts);
                self.over(ExprKind::List(parts), span, below)
            }
            Rule::string => {
                let text = self.string(&pair);
                self.over(ExprKind::String(text), span, 0)
            }
            Rule::color => {
                let color = color(pair.as_str()).ok_or(Broken)?;
                self.over(ExprKind::Color(color), span, 0)
            }
            Rule::boolean => self.over(ExprKind::Bool(pair.as_str() == "true"), span, 0),
            _ => Err(Broken),
        }
    }

    fn numeric(&mut self, pair: Pair<'_, Rule>) -> Built<Node> {
        let span = self.span(&pair);
        let mut children = Children::of(pair);
        let first = children.next().ok_or(Broken)?;
        if first.as_rule() == Rule::size {
            let parts: Vec<_> = first.into_inner().filter(|p| p.as_rule() == Rule::size_part).collect();
            let [width, height] = parts.as_slice() else { return Err(Broken) };
            let kind = ExprKind::Size(self.size_part(width), self.size_part(height));
            return self.over(kind, span, 0);
        }
        let number_span = self.span(&first);
        let value = self.number(first.as_str(), number_span);
        match children.take_rule(Rule::unit_suffix) {
            None => {
                let node = self.over(ExprKind::Number(value), span, 0)?;
                Ok(Node { bare_number: Some(span), ..node })
            }
            Some(suffix) => {
                let value = Box::new(Expr { kind: ExprKind::Number(value), span: number_span });
                let (unit, power) = self.unit(suffix)?;
                self.over(ExprKind::Quantity { value, unit, power }, span, 1)
            }
        }
    }

    fn size_part(&mut self, pair: &Pair<'_, Rule>) -> u32 {
        pair.as_str().replace('_', "").parse().unwrap_or_else(|_| {
            let problem = Diagnostic::error("E0108", "this size is out of range").at(self.span(pair), "");
            self.report(problem.note(format!("a size is a whole number of pixels up to {}", u32::MAX)));
            1
        })
    }

    fn number(&mut self, written: &str, span: Span) -> f64 {
        let digits = written.replace('_', "");
        let value: f64 = digits.parse().unwrap_or(f64::INFINITY);
        let mantissa = digits.split(['e', 'E']).next().unwrap_or("");
        let vanished = value == 0.0 && mantissa.contains(|c: char| ('1'..='9').contains(&c));
        if value.is_finite() && !vanished {
            return value;
        }
        let message = if vanished { "this number is too small" } else { "this number is too large" };
        self.report(
            Diagnostic::error("E0108", message)
                .at(span, "")
                .note("numbers are IEEE doubles: about 5e-324 to 1.8e308, with 16 digits"),
        );
        1.0
    }

    fn unit(&mut self, suffix: Pair<'_, Rule>) -> Built<(Name, i32)> {
        let mut children = Children::of(suffix);
        let unit = self.name(&children.find(Rule::unit)?);
        let power = children.take_rule(Rule::unit_power).map(|p| self.whole_power(p)).transpose()?;
        Ok((unit, power.unwrap_or(1)))
    }

    /// The whole number, with its sign, in a `unit_power` or `type_exponent`.
    pub(super) fn whole_power(&mut self, pair: Pair<'_, Rule>) -> Built<i32> {
        let span = self.span(&pair);
        let mut negative = false;
        let mut power = None;
        for part in pair.into_inner() {
            match part.as_rule() {
                Rule::negate => negative = true,
                Rule::whole_number => power = part.as_str().replace('_', "").parse::<i32>().ok(),
                _ => {}
            }
        }
        // Far beyond any physics, and small enough that exponents add up without care.
        match power.filter(|p| *p <= 1000) {
            Some(power) => Ok(if negative { -power } else { power }),
            None => {
                self.report(
                    Diagnostic::error("E0108", "this power is out of range").at(span, "").note("powers go up to 1000"),
                );
                Err(Broken)
            }
        }
    }

    fn group(&mut self, pair: Pair<'_, Rule>) -> Built<Node> {
        let span = self.span(&pair);
        let suffix = pair.clone().into_inner().find(|p| p.as_rule() == Rule::unit_suffix);
        let close = pair.clone().into_inner().find(|p| p.as_rule() == Rule::close_paren).ok_or(Broken)?;
        let inner_span = Span { end: self.span(&close).end, ..span };
        let mut parts: Vec<Node> = Children::of(pair).expressions().map(|p| self.node(p)).collect::<Built<_>>()?;
        if parts.len() == 1 {
            let mut node = parts.pop().ok_or(Broken)?;
            node.expr.span = inner_span;
            if let Some(suffix) = suffix {
                let written = &self.scan.text[self.span(&suffix).range()];
                let problem = Diagnostic::error("E0111", format!("`{written}` must follow a number or a tuple"));
                self.report(
                    problem
                        .at(self.span(&suffix), "follows a value in parentheses")
                        .hint(format!("multiply: `{} * {written}`", short(&self.scan.text[inner_span.range()]))),
                );
            }
            return Ok(Node { grouped: true, bare_number: None, ..node });
        }
        let (parts, below) = split(parts);
        let tuple = self.over(ExprKind::Tuple(parts), inner_span, below)?;
        match suffix {
            None => Ok(tuple),
            Some(suffix) => {
                let (unit, power) = self.unit(suffix)?;
                self.over(ExprKind::Quantity { value: Box::new(tuple.expr), unit, power }, span, tuple.height)
            }
        }
    }

    fn reference(&mut self, pair: Pair<'_, Rule>) -> Built<Node> {
        let span = self.span(&pair);
        let mut children = Children::of(pair);
        let name = self.find_name(&mut children)?;
        let Some(list) = children.take_rule(Rule::arguments) else {
            return self.over(ExprKind::Name(name.text), span, 0);
        };
        let mut arguments = vec![];
        let mut below = 0;
        for argument in list.into_inner().filter(|p| p.as_rule() == Rule::argument) {
            let mut parts = Children::of(argument);
            let name = parts.take_rule(Rule::name).map(|n| self.name(&n));
            let value = self.node(parts.find_expression()?)?;
            below = below.max(value.height);
            arguments.push(Argument { name, value: value.expr });
        }
        self.over(ExprKind::Call { function: name, arguments }, span, below)
    }

    fn reduce(&mut self, pair: Pair<'_, Rule>) -> Built<Node> {
        let span = self.span(&pair);
        let mut children = Children::of(pair);
        let op = match children.find(Rule::reduce_word)?.as_str() {
            "sum" => ReduceOp::Sum,
            "product" => ReduceOp::Product,
            "max" => ReduceOp::Max,
            _ => ReduceOp::Min,
        };
        let variable = self.find_name(&mut children)?;
        let start = self.node(children.find_expression()?)?;
        let end = self.node(children.find_expression()?)?;
        children.find(Rule::close_paren)?;
        let body = children.next().ok_or(Broken)?;
        let body = if body.as_rule() == Rule::block { self.block(body)? } else { self.chain(body)? };
        let below = start.height.max(end.height).max(body.height);
        let span = span_until(span, body.expr.span);
        let (start, end, body) = (Box::new(start.expr), Box::new(end.expr), Box::new(body.expr));
        self.over(ExprKind::Reduce { op, variable, start, end, body }, span, below)
    }

    fn block(&mut self, pair: Pair<'_, Rule>) -> Built<Node> {
        let span = self.span(&pair);
        let mut lets = vec![];
        let mut last = Err(Broken);
        let mut below = 0;
        for part in pair.into_inner() {
            match part.as_rule() {
                Rule::binding => {
                    let mut children = Children::of(part);
                    let name = self.find_name(&mut children)?;
                    let value = self.node(children.find_expression()?)?;
                    below = below.max(value.height);
                    lets.push((name, value.expr));
                }
                Rule::formula | Rule::conditional => last = self.node(part),
                _ => {}
            }
        }
        let last = last?;
        below = below.max(last.height);
        self.over(ExprKind::Block { lets, last: Box::new(last.expr) }, span, below)
    }

    /// The contents of a string, escapes resolved.
    pub(super) fn string(&self, pair: &Pair<'_, Rule>) -> String {
        let written = pair.as_str();
        let mut rest = &written[1..written.len() - 1];
        let mut out = String::with_capacity(rest.len());
        while let Some(at) = rest.find('\\') {
            out.push_str(&rest[..at]);
            let mut chars = rest[at + 1..].chars();
            match chars.next() {
                Some('n') => out.push('\n'),
                Some('t') => out.push('\t'),
                // The scan has refused numbers that are no character.
                Some('u') => {
                    let (digits, after) = rest[at + 3..].split_once('}').unwrap_or(("", ""));
                    out.extend(u32::from_str_radix(digits, 16).ok().and_then(char::from_u32));
                    rest = after;
                    continue;
                }
                Some(other) => out.push(other),
                None => {}
            }
            rest = chars.as_str();
        }
        out.push_str(rest);
        out
    }
}

fn split(nodes: Vec<Node>) -> (Vec<Expr>, usize) {
    let below = nodes.iter().map(|n| n.height).max().unwrap_or(0);
    (nodes.into_iter().map(|n| n.expr).collect(), below)
}

fn span_until(start: Span, end: Span) -> Span {
    Span { end: end.end, ..start }
}

/// A source excerpt that fits into a hint.
pub(super) fn short(text: &str) -> &str {
    if text.len() <= 40 && !text.contains('\n') { text } else { "(…)" }
}

fn color(written: &str) -> Option<[u8; 4]> {
    let digits = written.strip_prefix('#')?;
    let number = u32::from_str_radix(digits, 16).ok()?;
    Some(match digits.len() {
        3 => {
            let nibble = |shift: u32| ((number >> shift) & 15) as u8 * 17;
            [nibble(8), nibble(4), nibble(0), 255]
        }
        6 => {
            let [_, r, g, b] = number.to_be_bytes();
            [r, g, b, 255]
        }
        8 => number.to_be_bytes(),
        _ => return None,
    })
}
