//! Pairs of the grammar to items of the tree. Expressions are in [`expression`](super::expression).

use super::ast::{
    Block, BlockKind, Function, Item, ItemKind, ModulePath, Name, Parameter, Property, Row, TypeExpr, TypeExprKind, Use,
};
use super::grammar::Rule;
use super::lex::{CommentKind, Scan};
use super::limits::{MAX_FINDINGS, MAX_HEIGHT};
use crate::diagnostic::{Diagnostic, Diagnostics, Severity};
use crate::source::Span;
use pest::iterators::{Pair, Pairs};

/// A part that could not be built; a diagnostic says why.
#[derive(Copy, Clone, Debug)]
pub(super) struct Broken;

/// What a part was built into.
pub(super) type Built<T> = Result<T, Broken>;

/// Builds the tree of a text, or of a part of it that starts at byte `base`.
pub(super) struct Builder<'a, 't> {
    pub(super) scan: &'a Scan<'t>,
    pub(super) base: usize,
    pub(super) diagnostics: &'a mut Diagnostics,
}

/// A pair's children, taken by rule.
pub(super) struct Children<'i> {
    pairs: std::iter::Peekable<Pairs<'i, Rule>>,
}

impl<'i> Children<'i> {
    pub(super) fn of(pair: Pair<'i, Rule>) -> Self {
        Self { pairs: pair.into_inner().peekable() }
    }

    /// The next child if it has this rule.
    pub(super) fn take_rule(&mut self, rule: Rule) -> Option<Pair<'i, Rule>> {
        self.pairs.next_if(|p| p.as_rule() == rule)
    }

    /// The next child that has this rule, past any others.
    pub(super) fn find(&mut self, rule: Rule) -> Built<Pair<'i, Rule>> {
        self.pairs.by_ref().find(|p| p.as_rule() == rule).ok_or(Broken)
    }

    /// The next child that is an expression, past any others.
    pub(super) fn find_expression(&mut self) -> Built<Pair<'i, Rule>> {
        self.pairs.by_ref().find(is_expression).ok_or(Broken)
    }

    /// All remaining children that are expressions.
    pub(super) fn expressions(self) -> impl Iterator<Item = Pair<'i, Rule>> {
        self.pairs.filter(is_expression)
    }
}

impl<'i> Iterator for Children<'i> {
    type Item = Pair<'i, Rule>;

    fn next(&mut self) -> Option<Self::Item> {
        self.pairs.next()
    }
}

fn is_expression(pair: &Pair<'_, Rule>) -> bool {
    matches!(pair.as_rule(), Rule::formula | Rule::product | Rule::conditional)
}

impl<'t> Builder<'_, 't> {
    /// Where a pair stands. Pairs go on over the space skipped in search of more; the span ends with the last token.
    pub(super) fn span(&self, pair: &Pair<'_, Rule>) -> Span {
        let span = pair.as_span();
        let (start, end) = (self.base + span.start(), self.base + span.end());
        let tokens = self.scan.tokens.partition_point(|t| t.start < end);
        let last = tokens.checked_sub(1).map_or(end, |i| self.scan.tokens[i].end);
        Span::new(self.scan.source, start, end.min(last).max(start))
    }

    pub(super) fn name(&self, pair: &Pair<'_, Rule>) -> Name {
        Name { text: pair.as_str().to_owned(), span: self.span(pair) }
    }

    /// The name that comes next among the children.
    pub(super) fn find_name(&self, children: &mut Children<'_>) -> Built<Name> {
        children.find(Rule::name).map(|p| self.name(&p))
    }

    /// The items under a `module` or `lone_item`; broken ones are left out and their names returned.
    pub(super) fn items(&mut self, pairs: Pairs<'_, Rule>) -> (Vec<Item>, Vec<Name>) {
        let (mut items, mut unread) = (vec![], vec![]);
        for pair in pairs.flat_map(Pair::into_inner).filter(|p| p.as_rule() == Rule::item) {
            let name = pair.clone().into_inner().flat_map(Pair::into_inner).find(|p| p.as_rule() == Rule::name);
            match self.item(pair) {
                Ok(item) => items.push(item),
                Err(Broken) => unread.extend(name.map(|n| self.name(&n))),
            }
        }
        (items, unread)
    }

    fn item(&mut self, pair: Pair<'_, Rule>) -> Built<Item> {
        let span = self.span(&pair);
        let docs = self.docs_before(span.start as usize);
        let inner = pair.into_inner().next().ok_or(Broken)?;
        let rule = inner.as_rule();
        let children = Children::of(inner);
        let kind = match rule {
            Rule::use_item => self.use_item(children),
            Rule::const_item => self.const_item(children),
            Rule::param_item => self.param_item(children),
            Rule::function_item => self.function_item(children),
            Rule::table_item => {
                let (name, rows) = self.rows_item(children)?;
                Ok(ItemKind::Table { name, rows })
            }
            Rule::transfer_item => {
                let (name, rows) = self.rows_item(children)?;
                Ok(ItemKind::Transfer { name, rows })
            }
            Rule::named_block | Rule::plain_block => self.block_item(children),
            _ => Err(Broken),
        }?;
        Ok(Item { docs, kind, span })
    }

    fn use_item(&mut self, mut children: Children<'_>) -> Built<ItemKind> {
        children.find(Rule::use_word)?;
        let from = children.next().ok_or(Broken)?;
        let of_file = from.as_rule() == Rule::file_use;
        let mut path = vec![];
        let mut names = None;
        let mut file = None;
        for part in from.into_inner() {
            match part.as_rule() {
                Rule::name => path.push(self.name(&part)),
                Rule::string => file = Some((self.string(&part), self.span(&part))),
                Rule::use_list => {
                    let listed = part.into_inner().filter(|p| p.as_rule() == Rule::name);
                    names = Some(listed.map(|p| self.name(&p)).collect());
                }
                _ => {}
            }
        }
        let names = match names {
            Some(names) => names,
            None => vec![path.pop().ok_or(Broken)?],
        };
        let module = match file {
            Some((path, span)) if of_file => ModulePath::File { path, span },
            _ => ModulePath::Library(path),
        };
        Ok(ItemKind::Use(Use { module, names }))
    }

    fn const_item(&mut self, mut children: Children<'_>) -> Built<ItemKind> {
        let name = self.find_name(&mut children)?;
        let value = self.expression(children.find_expression()?)?;
        Ok(ItemKind::Const { name, value })
    }

    fn param_item(&mut self, mut children: Children<'_>) -> Built<ItemKind> {
        let name = self.find_name(&mut children)?;
        let default = self.expression(children.find_expression()?)?;
        let range = match children.take_rule(Rule::param_range) {
            None => None,
            Some(range) => {
                let mut ends = Children::of(range);
                let first = self.expression(ends.find_expression()?)?;
                Some((first, self.expression(ends.find_expression()?)?))
            }
        };
        Ok(ItemKind::Param { name, default, range })
    }

    fn function_item(&mut self, mut children: Children<'_>) -> Built<ItemKind> {
        let name = self.find_name(&mut children)?;
        let mut parameters = vec![];
        let mut result = Err(Broken);
        let mut body = Err(Broken);
        for child in children {
            match child.as_rule() {
                Rule::parameter => parameters.push(self.parameter(child)?),
                Rule::type_expression => result = self.type_expression(child),
                Rule::formula | Rule::conditional => body = self.expression(child),
                _ => {}
            }
        }
        Ok(ItemKind::Function(Function { name, parameters, result: result?, body: body? }))
    }

    fn parameter(&mut self, pair: Pair<'_, Rule>) -> Built<Parameter> {
        let mut children = Children::of(pair);
        let name = self.find_name(&mut children)?;
        let ty = self.type_expression(children.find(Rule::type_expression)?)?;
        let default = children.expressions().next().map(|d| self.expression(d)).transpose()?;
        Ok(Parameter { name, ty, default })
    }

    fn type_expression(&mut self, pair: Pair<'_, Rule>) -> Built<TypeExpr> {
        let mut children = Children::of(pair);
        let mut ty = self.type_factor(children.find(Rule::type_factor)?)?;
        let mut height = 0;
        while let Some(op) = children.next() {
            height += 1;
            if height > MAX_HEIGHT {
                return Err(self.too_high(self.span(&op)));
            }
            let right = self.type_factor(children.find(Rule::type_factor)?)?;
            let span = ty.span.to(right.span);
            let (left, right) = (Box::new(ty), Box::new(right));
            let kind = match op.as_rule() {
                Rule::divide => TypeExprKind::Quotient(left, right),
                _ => TypeExprKind::Product(left, right),
            };
            ty = TypeExpr { kind, span };
        }
        Ok(ty)
    }

    fn type_factor(&mut self, pair: Pair<'_, Rule>) -> Built<TypeExpr> {
        let mut children = Children::of(pair);
        let atom = children.next().ok_or(Broken)?;
        let span = self.span(&atom);
        let kind = match atom.as_rule() {
            Rule::type_one => TypeExprKind::One,
            Rule::type_group => {
                let inner = Children::of(atom).find(Rule::type_expression)?;
                self.type_expression(inner)?.kind
            }
            _ => {
                let mut parts = Children::of(atom);
                let name = self.find_name(&mut parts)?;
                let of = parts.find(Rule::type_expression).ok().map(|p| self.type_expression(p)).transpose()?;
                TypeExprKind::Named { name, of: of.map(Box::new) }
            }
        };
        let ty = TypeExpr { kind, span };
        match children.find(Rule::type_exponent) {
            Err(Broken) => Ok(ty),
            Ok(exponent) => {
                let span = span.to(self.span(&exponent));
                Ok(TypeExpr { kind: TypeExprKind::Power(Box::new(ty), self.whole_power(exponent)?), span })
            }
        }
    }

    fn rows_item(&mut self, mut children: Children<'_>) -> Built<(Name, Vec<Row>)> {
        let name = self.find_name(&mut children)?;
        let rows = children.filter(|p| p.as_rule() == Rule::row);
        Ok((name, rows.map(|r| self.row(r)).collect::<Built<_>>()?))
    }

    /// A row of a table or transfer function.
    pub(super) fn row(&mut self, pair: Pair<'_, Rule>) -> Built<Row> {
        let mut children = Children::of(pair);
        let key = self.expression(children.find_expression()?)?;
        let values: Vec<_> = children.expressions().map(|v| self.expression(v)).collect::<Built<_>>()?;
        let span = values.last().map_or(key.span, |v| key.span.to(v.span));
        Ok(Row { key, values, span })
    }

    fn block_item(&mut self, mut children: Children<'_>) -> Built<ItemKind> {
        let word = children.next().ok_or(Broken)?;
        let kind = block_kind(word.as_str()).ok_or(Broken)?;
        let name = children.take_rule(Rule::name).map(|n| self.name(&n));
        // A property that cannot be built has been reported; the others may still have something to say.
        let properties =
            children.filter(|p| p.as_rule() == Rule::property).filter_map(|p| self.property(p).ok()).collect();
        Ok(ItemKind::Block(Block { kind, word: self.span(&word), name, properties }))
    }

    /// `name = value`.
    pub(super) fn property(&mut self, pair: Pair<'_, Rule>) -> Built<Property> {
        let mut children = Children::of(pair);
        let name = self.find_name(&mut children)?;
        Ok(Property { name, value: self.expression(children.find_expression()?)? })
    }

    /// The `///` comments between the token before byte `start` and that byte.
    fn docs_before(&self, start: usize) -> Option<String> {
        let before = self.scan.tokens.partition_point(|t| t.start < start);
        let from = before.checked_sub(1).map_or(0, |i| self.scan.tokens[i].end);
        docs(self.scan, CommentKind::ItemDoc, from, start)
    }

    /// Adds a finding, unless there are too many.
    pub(super) fn report(&mut self, diagnostic: Diagnostic) {
        // Warnings must not crowd out an error: what has errors may not pass for read.
        let room = if diagnostic.severity == Severity::Error { 2 * MAX_FINDINGS } else { MAX_FINDINGS };
        if self.diagnostics.0.len() < room {
            self.diagnostics.push(diagnostic);
        }
    }

    /// Reports that the tree would become too high.
    pub(super) fn too_high(&mut self, span: Span) -> Broken {
        let message = format!("more than {MAX_HEIGHT} operations hang on each other here");
        self.report(
            Diagnostic::error("E0119", message).at(span, "one too many").hint("name parts of it with `let` or `const`"),
        );
        Broken
    }
}

/// The word of a block, back to its kind.
pub(super) fn block_kind(word: &str) -> Option<BlockKind> {
    BlockKind::ALL.into_iter().find(|k| k.word() == word)
}

/// The doc comments of one kind within `from..to`, joined, without markers.
pub(super) fn docs(scan: &Scan<'_>, kind: CommentKind, from: usize, to: usize) -> Option<String> {
    let first = scan.comments.partition_point(|c| c.start < from);
    let comments = scan.comments[first..].iter().take_while(|c| c.start < to).filter(|c| c.kind == kind);
    let lines: Vec<&str> = comments
        .map(|c| {
            let line = &scan.text[c.start + 3..c.end];
            line.strip_prefix(' ').unwrap_or(line)
        })
        .collect();
    (!lines.is_empty()).then(|| lines.join("\n"))
}
