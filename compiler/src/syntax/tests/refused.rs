//! What must be refused gracefully: depth, chains, and hostile texts.

use super::read;
use crate::syntax::format;

/// Every error of the text, by code.
fn codes(text: &str) -> Vec<&'static str> {
    let (_, diagnostics, _) = read(text);
    diagnostics.iter().map(|d| d.code).collect()
}

#[test]
fn depth_is_refused_and_does_not_overflow() {
    let n = 30_000;
    for (open, close) in [
        ("(", ")"),
        ("[", "]"),
        ("{", "}"),
        ("f(", ")"),
        ("{ let x = ", " x }"),
        ("if ", " then 1 else 2"),
        ("if a then ", " else 2"),
        ("sum(i in 0..2) ", ""),
        ("sum(i in 0..2) {", "}"),
        ("f(max(i in 0..2) -", ")"),
    ] {
        let text = format!("const a = {}1{}", open.repeat(n), close.repeat(n));
        assert_eq!(codes(&text), ["E0119"], "{open}");
        let open_only = format!("const a = {}", open.repeat(n));
        assert!(codes(&open_only).contains(&"E0119"), "{open} alone");
    }
    assert_eq!(codes(&format!("fn f(a: {}b{}) -> number = 1", "c<".repeat(n), ">".repeat(n))), ["E0119"]);
    assert_eq!(codes(&format!("{}{}", "/*".repeat(n), "*/".repeat(n))), ["E0119"]);
}

#[test]
fn chains_are_refused_and_do_not_overflow() {
    let n = 30_000;
    for (link, last) in [
        ("-", "1"),
        ("!", "a"),
        ("a^", "b"),
        ("a^-", "b"),
        ("a + ", "b"),
        ("a * ", "b"),
        ("a || ", "b"),
        ("if a then b else ", "c"),
    ] {
        assert_eq!(codes(&format!("const a = {}{last}", link.repeat(n))), ["E0119"], "{link}");
    }
    assert_eq!(codes(&format!("const a = b{}", ".c".repeat(n))), ["E0119"]);
    assert_eq!(codes(&format!("fn f(a: b{}) -> number = 1", "*c".repeat(n))), ["E0119"]);
}

#[test]
fn what_people_write_is_within_the_limits() {
    let nested = format!("const a = {}1{}", "(".repeat(60), ")".repeat(60));
    let chain = format!("const a = {}1", "b + ".repeat(250));
    let cases = format!("const a = {}1", "if b then c else ".repeat(200));
    for text in [nested, chain, cases] {
        assert!(codes(&text).is_empty());
        assert!(format(&text).is_ok());
    }
}

/// Reading again after a failure must not multiply with depth.
#[test]
fn errors_in_the_depth_are_found_in_linear_time() {
    for (open, close) in [
        ("(", ")"),
        ("f(x, ", ")"),
        ("sum(i in 0..2) { ", "}"),
        ("max(i in 0..2) { let a = ", " a }"),
        ("if a then b else if (", ") then c else d"),
        ("[1, ", "]"),
    ] {
        let text = format!("const a = {}1 ) 2{}\n", open.repeat(60), close.repeat(60)).repeat(3);
        assert!(!codes(&text).is_empty());
        let text = format!("medium m {{ a = {}1 = 2{} }}\n", open.repeat(60), close.repeat(60)).repeat(3);
        assert!(!codes(&text).is_empty());
    }
}

#[test]
fn an_error_does_not_hide_the_others() {
    let text = "medium a { k_a: 3 /m  k_s = 2 meters  phase = isotropic }
const b = 1 +
volume c { k_a = }
light sun { direction = (0, -1, 0)  irradiance = 3 lx }
fn f(x number) -> number = x
camera { from = (1, 2, 3 m }
render { accuracy = .5 }";
    let (module, _, _) = read(text);
    assert_eq!(codes(text), ["E0114", "E0110", "E0117", "E0112", "E0117", "E0126", "E0102", "E0107"]);
    assert_eq!(module.items.len(), 4);
    let unread: Vec<_> = module.unread.iter().map(|n| n.text.as_str()).collect();
    assert_eq!(unread, ["b", "c", "f"]);
}
