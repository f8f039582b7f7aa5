//! Generated texts: formatting is stable and keeps the tree, and nothing makes the parser panic.

use super::{SNIPPETS, read, show};
use crate::syntax::format;
use proptest::prelude::*;

/// Space that may stand between any two tokens; comments too.
fn space() -> impl Strategy<Value = &'static str> {
    prop_oneof![
        8 => Just(" "),
        3 => Just("  "),
        2 => Just("\n"),
        1 => Just("\n\n\n"),
        1 => Just(" // words\n"),
        1 => Just("\n// own line\n"),
        1 => Just(" /* a */ "),
        1 => Just("\n/* b */"),
        1 => Just(" /* c\n d */\n"),
    ]
}

fn name() -> impl Strategy<Value = String> {
    prop_oneof![Just("p"), Just("density"), Just("text"), Just("λ"), Just("x"), Just("use"), Just("fbm")]
        .prop_map(str::to_owned)
}

fn literal() -> impl Strategy<Value = String> {
    prop_oneof![
        Just("1"),
        Just("0.5"),
        Just("1_0e-2"),
        Just("8km"),
        Just("2 m^-1"),
        Just("2 m ^ 2"),
        Just("#fff"),
        Just("#AbcdEf01"),
        Just("\"a\\\"b // c\""),
        Just("true"),
        Just("(1, 2, 3)"),
        Just("( 1 ,2)m"),
        Just("[1,2 , 3]"),
        Just("3x4"),
        Just("3 x 4"),
    ]
    .prop_map(str::to_owned)
}

/// Expressions as lists of tokens, so that any space can be put between them.
fn expression() -> impl Strategy<Value = Vec<String>> {
    let words = |w: &[&str]| w.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>();
    let leaf = prop_oneof![literal().prop_map(|l| vec![l]), name().prop_map(|n| vec![n])];
    leaf.prop_recursive(5, 40, 4, move |inner| {
        let operator = prop_oneof![
            Just("+"),
            Just("-"),
            Just("*"),
            Just("/"),
            Just("^"),
            Just("<"),
            Just("=="),
            Just("!="),
            Just(">="),
            Just("&&"),
            Just("||"),
        ];
        // The left side stands in parentheses of its own: `8 km ^ 2` would give the power to the unit.
        let binary = (inner.clone(), operator, inner.clone())
            .prop_map(move |(a, op, b)| [words(&["(", "("]), a, words(&[")", op]), b, words(&[")"])].concat());
        let bare =
            (inner.clone(), prop_oneof![Just("+"), Just("*"), Just("-")], inner.clone()).prop_map(|(a, op, b)| {
                [vec!["(".to_owned()], a, vec![")".to_owned(), op.to_owned(), "(".to_owned()], b, vec![")".to_owned()]]
                    .concat()
            });
        let prefix = (prop_oneof![Just("-"), Just("!")], inner.clone())
            .prop_map(|(op, a)| [vec![op.to_owned(), "(".to_owned()], a, vec![")".to_owned()]].concat());
        let call = (name(), inner.clone(), inner.clone()).prop_map(|(f, a, b)| {
            [vec![f, "(".to_owned()], a, vec![",".to_owned(), "n".to_owned(), ":".to_owned()], b, vec![")".to_owned()]]
                .concat()
        });
        let member = inner
            .clone()
            .prop_map(|a| [vec!["(".to_owned()], a, vec![")".to_owned(), ".".to_owned(), "x".to_owned()]].concat());
        let block = (inner.clone(), inner.clone(), any::<bool>()).prop_map(move |(a, b, semicolon)| {
            let end = if semicolon { vec![";".to_owned()] } else { vec![] };
            [
                vec!["{".to_owned(), "let".to_owned(), "q".to_owned(), "=".to_owned(), "(".to_owned()],
                a,
                vec![")".to_owned()],
                end,
                vec!["q".to_owned(), "*".to_owned()],
                b,
                vec!["}".to_owned()],
            ]
            .concat()
        });
        let reduce = (inner.clone(), inner.clone()).prop_map(move |(a, b)| {
            [words(&["sum", "(", "i", "in", "0", ".."]), a, words(&[")", "("]), b, words(&[")"])].concat()
        });
        let choice = (inner.clone(), inner.clone(), inner).prop_map(move |(c, a, b)| {
            [words(&["(", "if"]), c, words(&["then"]), a, words(&["else"]), b, words(&[")"])].concat()
        });
        prop_oneof![binary, bare, prefix, call, member, block, reduce, choice]
    })
}

fn item() -> impl Strategy<Value = Vec<String>> {
    let words = |w: &[&str]| w.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>();
    let property = expression().prop_map(move |e| [vec!["k_a".to_owned(), "=".to_owned()], e].concat());
    let block = proptest::collection::vec(property, 0..4)
        .prop_map(move |ps| [words(&["medium", "cloud", "{"]), ps.concat(), words(&["}"])].concat());
    let constant = expression().prop_map(move |e| [words(&["const", "c", "="]), e].concat());
    let param = (expression(), expression())
        .prop_map(move |(a, b)| [words(&["param", "c", "="]), a, words(&["in", "0", ".."]), b].concat());
    let function = expression().prop_map(move |e| {
        [
            words(&[
                "fn", "f", "(", "a", ":", "vec3", "<", "length", ">", ")", "->", "1", "/", "length", "^", "2", "=",
            ]),
            e,
        ]
        .concat()
    });
    let rows = (expression(), expression()).prop_map(move |(a, b)| {
        [
            words(&["transfer", "t", "{", "-", "1", "m", ":", "("]),
            a,
            words(&[")", ",", "3", "/", "m", "2", ":", "("]),
            b,
            words(&[")", "}"]),
        ]
        .concat()
    });
    let import = Just(words(&["use", "std", "::", "noise", "::", "{", "a", ",", "b", "}"]));
    prop_oneof![3 => block, 2 => constant, 1 => param, 1 => function, 1 => rows, 1 => import]
}

/// A text of the language, with any space between its tokens.
fn text() -> impl Strategy<Value = String> {
    proptest::collection::vec(item(), 1..4)
        .prop_flat_map(|items| {
            let tokens = items.concat();
            let count = tokens.len();
            (Just(tokens), proptest::collection::vec(space(), count))
        })
        .prop_map(|(tokens, spaces)| {
            tokens.iter().zip(spaces).map(|(token, space)| format!("{token}{space}")).collect()
        })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(192) })]

    #[test]
    fn formatting_keeps_the_tree_and_is_stable(text in text()) {
        let (before, diagnostics, rendered) = read(&text);
        prop_assert!(diagnostics.iter().all(|d| matches!(d.code, "E0120" | "W0101")), "{text}\n{rendered}");
        if !diagnostics.has_errors() {
            let once = format(&text).expect("a text without errors is formatted");
            let (after, ..) = read(&once);
            prop_assert_eq!(show::module(&before), show::module(&after), "{}\n{}", text, once);
            prop_assert_eq!(&format(&once).expect("formatted text is read again"), &once);
            let significant = |t: &str| t.split_whitespace().collect::<String>();
            prop_assert_eq!(significant(&text), significant(&once));
        }
    }

    #[test]
    fn any_characters_are_survived(text in ".{0,80}") {
        read(&text);
        let _ = format(&text);
    }

    #[test]
    fn broken_texts_are_survived(cuts in proptest::collection::vec((0..6000usize, 0..6000usize, 0..40usize), 1..4), which in 0..5usize) {
        let mut text = SNIPPETS[which].1.to_owned();
        for (from, to, length) in cuts {
            let boundary = |at: usize, text: &str| (0..=at % (text.len() + 1)).rev().find(|i| text.is_char_boundary(*i)).unwrap_or(0);
            let (from, end) = (boundary(from, &text), boundary(from % (text.len() + 1) + length, &text).max(boundary(from, &text)));
            let piece = text[from..end].to_owned();
            text.replace_range(from..end, "");
            let to = boundary(to, &text);
            text.insert_str(to, &piece[..boundary(length / 2, &piece)]);
        }
        let (_, diagnostics, _) = read(&text);
        prop_assert_eq!(format(&text).is_err(), diagnostics.has_errors());
    }
}
