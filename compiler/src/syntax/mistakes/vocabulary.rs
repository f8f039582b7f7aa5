//! The rules of the grammar in words.

use crate::syntax::grammar::Rule;

/// What a rule of the grammar is called in a message.
#[derive(Copy, Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Category {
    Item,
    Property,
    Value,
    Name,
    Type,
    Mark(&'static str),
    Operator,
}

impl Category {
    pub(super) fn phrase(self) -> &'static str {
        match self {
            Self::Item => "an item",
            Self::Property => "a property",
            Self::Value => "a value",
            Self::Name => "a name",
            Self::Type => "a type",
            Self::Mark(mark) => mark,
            Self::Operator => "an operator",
        }
    }
}

pub(super) fn category(rule: Rule) -> Option<Category> {
    Some(match rule {
        Rule::item => Category::Item,
        Rule::property => Category::Property,
        Rule::formula
        | Rule::product
        | Rule::conditional
        | Rule::if_word
        | Rule::numeric
        | Rule::number
        | Rule::group
        | Rule::list
        | Rule::block
        | Rule::reference
        | Rule::reduce
        | Rule::reduce_word
        | Rule::argument
        | Rule::string
        | Rule::color
        | Rule::boolean
        | Rule::negate
        | Rule::not
        | Rule::row => Category::Value,
        Rule::name | Rule::parameter => Category::Name,
        Rule::type_expression | Rule::type_factor | Rule::type_name | Rule::type_one | Rule::type_group => {
            Category::Type
        }
        Rule::or
        | Rule::and
        | Rule::equal
        | Rule::not_equal
        | Rule::less
        | Rule::less_equal
        | Rule::greater
        | Rule::greater_equal
        | Rule::add
        | Rule::subtract
        | Rule::multiply
        | Rule::divide
        | Rule::power => Category::Operator,
        Rule::equals => Category::Mark("`=`"),
        Rule::colon => Category::Mark("`:`"),
        Rule::comma => Category::Mark("`,`"),
        Rule::arrow => Category::Mark("`->`"),
        Rule::range_dots => Category::Mark("`..`"),
        Rule::in_word => Category::Mark("`in`"),
        Rule::then_word => Category::Mark("`then`"),
        Rule::else_word => Category::Mark("`else`"),
        Rule::open_paren => Category::Mark("`(`"),
        Rule::close_paren => Category::Mark("`)`"),
        Rule::open_brace => Category::Mark("`{`"),
        Rule::close_brace => Category::Mark("`}`"),
        Rule::close_bracket => Category::Mark("`]`"),
        Rule::open_angle => Category::Mark("`<`"),
        Rule::close_angle => Category::Mark("`>`"),
        Rule::path_separator => Category::Mark("`::`"),
        _ => return None,
    })
}
