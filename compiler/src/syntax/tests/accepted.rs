//! Whole texts that must be read without a word.

use super::{SNIPPETS, read_clean, show};
use crate::syntax::ast::ItemKind;
use crate::syntax::{grammar, lex};

#[test]
fn every_snippet_of_the_contract_is_read() {
    for (name, text) in SNIPPETS {
        let module = read_clean(text);
        assert!(!module.items.is_empty(), "{name}");
        assert!(module.unread.is_empty(), "{name}");
    }
}

/// The lexer cuts a text where the grammar does: each smallest pair starts and ends with a token.
#[test]
fn tokens_agree_with_the_grammar() {
    for (name, text) in SNIPPETS {
        let scan = lex::scan(crate::source::SourceId(0), text);
        assert!(scan.problems.is_empty(), "{name}");
        let mut covered = vec![false; scan.tokens.len()];
        let pairs = grammar::read(grammar::Rule::module, text).unwrap_or_else(|e| panic!("{name}: {e:?}"));
        for pair in pairs.flatten().filter(|p| p.clone().into_inner().next().is_none() && !p.as_str().is_empty()) {
            let (start, end) = (pair.as_span().start(), pair.as_span().end());
            let first = scan.tokens.partition_point(|t| t.start < start);
            let token = scan.tokens[first];
            assert_eq!((token.start, token.end), (start, end), "{name}: {}", pair.as_str());
            covered[first] = true;
        }
        let missed = |i: usize| !covered[i] && scan.word(i) != "x";
        assert_eq!((0..covered.len()).find(|i| missed(*i)).map(|i| scan.word(i)), None, "{name}");
    }
}

#[test]
fn docs_are_kept_on_their_item() {
    let module =
        read_clean("//! Top.\n//!  more\n\n/// One.\n/// Two.\n//// not this\nconst a = 1\n/// Three.\n\nconst b = 2");
    assert_eq!(module.docs.as_deref(), Some("Top.\n more"));
    let docs: Vec<_> = module.items.iter().map(|i| i.docs.as_deref()).collect();
    assert_eq!(docs, [Some("One.\nTwo."), Some("Three.")]);
}

#[test]
fn spans_end_where_the_text_does() {
    let text = "const a = (1 + 2) * f(x) // no\n\n medium b { k_a = 3 /m   } \n";
    let module = read_clean(text);
    let spans: Vec<_> = module.items.iter().map(|i| &text[i.span.range()]).collect();
    assert_eq!(spans, ["const a = (1 + 2) * f(x)", "medium b { k_a = 3 /m   }"]);
    let ItemKind::Const { value, .. } = &module.items[0].kind else { panic!() };
    assert_eq!(&text[value.span.range()], "(1 + 2) * f(x)");
}

#[test]
fn an_empty_text_is_a_module() {
    for text in ["", "\n", "// only words", "\u{FEFF}const a = 1", "const a = 1\r\nconst b = 2\r\n"] {
        read_clean(text);
    }
}

#[test]
fn item_words_are_names_elsewhere() {
    let module = read_clean("const text = image + light\nconst fn = use\nmedium medium { transfer = param(camera) }");
    assert_eq!(
        show::module(&module),
        "docs None\nconst text (+ image light)\nconst fn use\nmedium medium [transfer param(camera)]\n"
    );
}
