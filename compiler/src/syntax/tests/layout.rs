//! The one format.

use super::{SNIPPETS, read_clean, show};
use crate::syntax::format;

#[track_caller]
fn formatted(text: &str) -> String {
    let once = format(text).unwrap_or_else(|d| panic!("{text}\n{d:?}"));
    let twice = format(&once).unwrap_or_else(|d| panic!("{once}\n{d:?}"));
    assert_eq!(once, twice, "formatting again changes something");
    once
}

#[test]
fn formatting_is_stable_and_keeps_the_meaning() {
    for (name, text) in SNIPPETS {
        let once = formatted(text);
        assert_eq!(show::module(&read_clean(text)), show::module(&read_clean(&once)), "{name}");
        let significant = |t: &str| t.split_whitespace().collect::<String>();
        assert_eq!(significant(text), significant(&once), "{name}: nothing but space changes");
        assert!(once.ends_with('\n') && !once.contains(" \n") && !once.contains("\n\n\n"), "{name}");
    }
}

#[test]
fn blocks_stay_on_their_line_if_they_fit() {
    assert_eq!(formatted("medium  a{k_a=2 /m k_e =3lx/m}"), "medium a { k_a = 2 /m  k_e = 3 lx / m }\n");
    assert_eq!(formatted("camera{}\nfog {\n}"), "camera {}\nfog {}\n");
    let long = format!("medium a {{ k_a = {} }}", ["b"; 40].join("+"));
    assert_eq!(formatted(&long), format!("medium a {{\n    k_a = {}\n}}\n", ["b"; 40].join(" + ")));
}

#[test]
fn blocks_on_several_lines_have_a_property_a_line() {
    let text = "medium a {\n\n\n k_a=1 /m   k_s = 2 /m\n\n\n\n k_e = 0\n\n}\n\n\n\nfog {}";
    assert_eq!(formatted(text), "medium a {\n    k_a = 1 /m\n    k_s = 2 /m\n\n    k_e = 0\n}\n\nfog {}\n");
}

#[test]
fn rows_of_tables_stand_in_lines_as_they_were_written_and_fit() {
    let text = "table t {0:1   2:3 // why\n4:5  6:7\n\n8:9\n10: 11 /* twelve */ 12: 13 14: {\nlet x = 1 x} 15: 16}";
    let expected = "table t {
    0: 1  2: 3  // why
    4: 5  6: 7

    8: 9
    10: 11 /* twelve */
    12: 13
    14: {
        let x = 1
        x
    }  15: 16
}
";
    assert_eq!(formatted(text), expected);
    let rows: Vec<String> = (10..40).map(|i| format!("{i}: #ffffff, 2 /m")).collect();
    let wide = formatted(&format!("transfer t {{{}}}", rows.join(" ")));
    let lines: Vec<&str> = wide.lines().collect();
    // Five of 17 columns each, with two spaces between them and four before, reach column 97.
    assert_eq!(lines[1], format!("    {}", rows[..5].join("  ")));
    assert_eq!(lines.len(), 2 + 6);
    assert!(lines.iter().all(|l| l.chars().count() <= 100));
}

#[test]
fn operators_are_set_as_one_reads_them() {
    let text = "const a=-b*-2 m ^ - 1+!c^2/( d,e ) m-f( g : 1 ,[h ,i]) . x\nparam p=1 in 0..10\nconst s=sum( i in 0 .. 3 )i+max(j in 0..k+1) {j}";
    let expected = "const a = -b * -2 m^-1 + !c^2 / (d, e) m - f(g: 1, [h, i]).x
param p = 1 in 0 .. 10
const s = sum(i in 0..3) i + max(j in 0 .. k + 1) { j }
";
    assert_eq!(formatted(text), expected);
    let text =
        "fn f ( q:vec3 < length >,n : number=4 )->1 / length ^ 2={let x=1;let y=2 x*y}\nuse std :: noise::{ a ,b }";
    let expected = "fn f(q: vec3<length>, n: number = 4) -> 1/length^2 = { let x = 1;  let y = 2  x * y }\nuse std::noise::{a, b}\n";
    assert_eq!(formatted(text), expected);
    assert_eq!(formatted("image{size=1024x768}"), "image { size = 1024 x 768 }\n");
}

#[test]
fn line_breaks_inside_values_stay() {
    let text = "medium a {\nk_a = b +\nc * f(\nx: 1,\n y: 2 +\n3\n)\nk_s = {\nlet z = 1\nz\n} }";
    let expected = "medium a {
    k_a = b +
        c * f(
            x: 1,
            y: 2 +
                3
        )
    k_s = {
        let z = 1
        z
    }
}
";
    assert_eq!(formatted(text), expected);
}

#[test]
fn comments_stay_where_they_are() {
    let text = "//! top\n\n\n// one\n/// docs\nmedium a { // after the brace\n// own line\nk_a = 1 /m// trailing\n/* before */ k_s = 2 /* inside */ /m
k_e = 0 // last\n\n// at the end\n}\n/* two\n lines */ fog { /* empty */ }\n// end";
    let expected = "//! top

// one
/// docs
medium a {  // after the brace
    // own line
    k_a = 1 /m  // trailing
    /* before */ k_s = 2 /* inside */ /m
    k_e = 0  // last

    // at the end
}
/* two
 lines */ fog { /* empty */ }
// end
";
    assert_eq!(formatted(text), expected);
}

#[test]
fn a_text_with_errors_is_not_formatted() {
    assert!(format("medium a { k_a = }").is_err_and(|d| d.has_errors()));
    assert_eq!(format("").as_deref(), Ok(""));
}
