//! What the tricky points of the grammar are read as.

use super::{read, read_clean, show};
use crate::syntax::ast::{Expr, ItemKind};

fn value(text: &str) -> Expr {
    let module = read_clean(&format!("const it = {text}"));
    assert_eq!(module.items.len(), 1, "{text}");
    let ItemKind::Const { value, .. } = &module.items[0].kind else { panic!("{text}") };
    value.clone()
}

#[track_caller]
fn shows(text: &str, expected: &str) {
    assert_eq!(show::expr(&value(text)), expected, "{text}");
}

#[test]
fn units_bind_tightest_and_take_their_power() {
    shows("8 km", "8'km");
    shows("8km", "8'km");
    shows("2 m^-1", "2'm^-1");
    shows("2 m^ -1", "2'm^-1");
    shows("(0, 1, 0) m", "<0 1 0>'m");
    shows("-3 deg", "(neg 3'deg)");
    shows("0.2 /m", "(/ 0.2 m)");
    shows("(8 km)^2", "(^ 8'km 2)");
    shows("lx * m^2", "(* lx (^ m 2))");
    shows("2 * 3 m * x", "(* (* 2 3'm) x)");
    shows("(1, 2) m.x", "<1 2>'m.x");
    shows("sphere(center: (0,1,0) m, radius: 1 m)", "sphere(center:<0 1 0>'m, radius:1'm)");
}

#[test]
fn operators_have_their_order() {
    shows("1 + 2 * 3 ^ 4", "(+ 1 (* 2 (^ 3 4)))");
    shows("1 - 2 - 3", "(- (- 1 2) 3)");
    shows("a / b / c * d", "(* (/ (/ a b) c) d)");
    shows("a ^ b ^ c", "(^ a (^ b c))");
    shows("-a ^ b", "(neg (^ a b))");
    shows("-a * b", "(* (neg a) b)");
    shows("a * -b ^ c", "(* a (neg (^ b c)))");
    shows("lambda^-4", "(^ lambda (neg 4))");
    shows("a ^ -b ^ c", "(^ a (neg (^ b c)))");
    shows("a ^ -b * c", "(* (^ a (neg b)) c)");
    shows("- -a", "(neg (neg a))");
    shows("!a && b || c", "(|| (&& (not a) b) c)");
    shows("a || b && c", "(|| a (&& b c))");
    shows("a + 1 < b * 2 && c == d", "(&& (< (+ a 1) (* b 2)) (== c d))");
    shows("!a == b", "(== (not a) b)");
    shows("(a + b) * c", "(* (+ a b) c)");
    shows("-p.y / 8 km", "(/ (neg p.y) 8'km)");
    shows("5.8e-3 /km * (680 nm / lambda)^4", "(* (/ 0.0058 km) (^ (/ 680'nm lambda) 4))");
}

#[test]
fn conditionals_are_loosest() {
    shows("if a then b else c + 1", "(if a b (+ c 1))");
    shows("if a < 1 then if b then 1 else 2 else 3", "(if (< a 1) (if b 1 2) 3)");
    shows("if a then 1 else if b then 2 else if c then 3 else 4", "(if a 1 (if b 2 (if c 3 4)))");
    shows("1 + (if a then b else c)", "(+ 1 (if a b c))");
}

#[test]
fn blocks_name_values() {
    shows("{ let x = 1 let y = x * 2 x + y }", "{x=1 y=(* x 2) (+ x y)}");
    shows("{ let x = 1; (x, x) }", "{x=1 <x x>}");
    shows("{ 1 }", "{1}");
    shows("{ let a = 3 x2 }", "{a=3 x2}");
    shows("{ let a = 3 mm2 + a }", "{a=3 (+ mm2 a)}");
}

#[test]
fn repetition_takes_a_product_or_a_block() {
    shows("sum(i in 0..n) i * 2 + 1", "(+ (sum i 0..n (* i 2)) 1)");
    shows("2 * sum(i in 0..4) sum(j in 0..i) -a ^ j", "(* 2 (sum i 0..4 (sum j 0..i (neg (^ a j)))))");
    shows("max(i in 0..2 * k) { i } * 2", "(* (max i 0..(* 2 k) {i}) 2)");
    shows("max(a, b)", "max(a, b)");
    shows("min(in_ + 1)", "min((+ in_ 1))");
    shows("sum", "sum");
    shows("product(x)", "product(x)");
}

#[test]
fn literals() {
    shows("1_000.5", "1000.5");
    shows("1e-6", "0.000001");
    shows("1024 x 768", "1024x768");
    shows("1024x768", "1024x768");
    shows("#f08", "#ff0088ff");
    shows("#11223344", "#11223344");
    shows(r#""a\n\t\"\\\u{fc}\u{1F600}ß""#, "\"a\\n\\t\\\"\\\\ü😀ß\"");
    shows("[680 nm, 550 nm,]", "[680'nm 550'nm]");
    shows("[]", "[]");
    shows("true == false", "(== true false)");
    shows("λ_1 + größe", "(+ λ_1 größe)");
    shows("truely + iffy + inside", "(+ (+ truely iffy) inside)");
}

#[test]
fn properties_rows_and_ranges_need_no_separators() {
    let text = "param a = 4 /m in -1 /m .. 40 /m\ntable t { -3 m: 1 -2 m: -4 0 km: 1 }\ntransfer u { 30: #000, 0 /m 90: #fff, 20 /m }
medium b { k_a = a -1 k_s = (1, 2) (3) }";
    let (module, _, rendered) = read(text);
    assert!(rendered.contains("E0111"), "{rendered}");
    let shown: Vec<_> = module.items.iter().map(show::item).collect();
    assert_eq!(
        shown,
        [
            "param a (/ 4 m) (/ (neg 1) m)..(/ 40 m)",
            "table t [(neg 3'm): 1] [(neg 2'm): (neg 4)] [0'km: 1]",
            "transfer u [30: #000000ff (/ 0 m)] [90: #ffffffff (/ 20 m)]",
            "medium b [k_a (- a 1)]",
        ]
    );
}

#[test]
fn functions_and_types() {
    let module = read_clean(
        "fn f(q: vec3<length>, n: number = 4) -> 1/length^2 * light = q\nfn g() -> spectrum<(1/length)^-1> = 1\nuse std::noise::{fbm}",
    );
    let shown: Vec<_> = module.items.iter().map(show::item).collect();
    assert_eq!(
        shown,
        [
            "fn f(q: vec3<length>, n: number = 4) -> (* (/ 1 (^ length 2)) light) = q",
            "fn g() -> spectrum<(^ (/ 1 length) -1)> = 1",
            "use std noise: fbm",
        ]
    );
}

#[test]
fn only_a_bare_divided_number_draws_the_warning() {
    let warns = |text: &str| read(&format!("const a = {text}")).1.iter().any(|d| d.code == "W0101");
    for text in ["1/2 deg", "-1 / 2 deg", "x * 1/2 deg", "1 / 2 m^2 * x"] {
        assert!(warns(text), "{text}");
    }
    for text in [
        "p / 0.4 m",
        "-p.y / 8 km",
        "680 nm / 2 nm",
        "1/(2 deg)",
        "(1/2) deg",
        "1 / 2",
        "2 /m",
        "(1) / 2 m",
        "1 + x / 2 m",
        "1 deg/2",
    ] {
        assert!(!warns(text), "{text}");
    }
}
