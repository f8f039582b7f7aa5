//! Names that every target takes as they are: ASCII, no keyword, no trailing underscore or digit, unique in the module.
//!
//! naga keeps one table of names for a whole module (only the members of structs have their own), and its writers rename
//! what they do not like. A name made here passes through the WGSL writer unchanged, so that the source map can find it.

use super::keywords::is_taken;
use rustc_hash::FxHashMap;

/// The names given out in one scope.
#[derive(Default)]
pub(super) struct Names {
    /// How often a base was asked for.
    asked: FxHashMap<String, u32>,
    /// What was given out, without a closing underscore: that is what naga compares.
    given: rustc_hash::FxHashSet<String>,
}

impl Names {
    /// A legal name that resembles the wanted one and was never given out before.
    pub(super) fn unique(&mut self, wanted: &str) -> String {
        let base = legal(wanted);
        let asked = self.asked.entry(base.clone()).or_insert(0);
        loop {
            let name = match *asked {
                0 => base.clone(),
                n => format!("{base}_{}", letters(n)),
            };
            *asked += 1;
            if !is_taken(&name) && self.given.insert(name.clone()) {
                return close(name);
            }
        }
    }
}

/// naga closes a name that ends in a digit with an underscore; done here, it has nothing to do.
fn close(mut name: String) -> String {
    if name.ends_with(|c: char| c.is_ascii_digit()) {
        name.push('_');
    }
    name
}

/// b, c, … z, ba, bb, …: suffixes without digits. The first use of a name is its "a".
fn letters(n: u32) -> String {
    let (mut n, mut text) = (n, String::new());
    while n > 0 {
        text.insert(0, char::from(b'a' + (n % 26) as u8));
        n /= 26;
    }
    text
}

/// The wanted name in letters that every target knows. Never empty, never a keyword, no closing underscore.
fn legal(wanted: &str) -> String {
    let mut name = String::new();
    let characters: Vec<char> = wanted.chars().collect();
    let mut i = 0;
    // Whether the last thing written was a spelt-out symbol, which must not run into the next letter.
    let mut spelt = false;
    while i < characters.len() {
        let c = characters[i];
        let run = characters[i..].iter().take_while(|c| greek(**c).is_some()).count();
        if run > 0 {
            // One or two Greek letters are symbols, `σ` or `Δρ`; more of them are a word.
            for c in &characters[i..i + run] {
                if let Some((symbol, letter)) = greek(*c) {
                    push(&mut name, if run <= 2 { symbol } else { letter }, run <= 2);
                }
            }
            (i, spelt) = (i + run, run <= 2);
            continue;
        }
        i += 1;
        let apart = std::mem::take(&mut spelt);
        if c.is_ascii_alphanumeric() {
            // `σ0` stays one name, `σt` is spelt `sigma_t`.
            if apart && c.is_ascii_alphabetic() {
                name.push('_');
            }
            name.push(c);
        } else if let Some(text) = latin(c) {
            // `τ₀` is `tau0`, as `σ0` is `sigma0`.
            push(&mut name, text, apart && !text.starts_with(|c: char| c.is_ascii_digit()));
        } else if matches!(c, '_' | ' ' | '-' | '.' | ':' | '\'') {
            name.push('_');
        } else {
            push(&mut name, &format!("u{:x}", u32::from(c)), true);
            spelt = true;
        }
    }
    // Targets keep double underscores for themselves; naga trims underscores at the end.
    let mut tidy = String::with_capacity(name.len());
    for c in name.chars().skip_while(|c| *c == '_') {
        if c != '_' || !tidy.ends_with('_') {
            tidy.push(c);
        }
    }
    tidy.truncate(tidy.trim_end_matches('_').len());
    // Digits cannot begin a name, and these prefixes are reserved in GLSL and by naga.
    let reserved = ["gl_", "webgl_", "naga", "Naga"];
    if !tidy.starts_with(|c: char| c.is_ascii_alphabetic()) || reserved.iter().any(|p| tidy.starts_with(p)) {
        tidy.insert_str(0, "v_");
        tidy.truncate(tidy.trim_end_matches('_').len());
    }
    // Targets stop at 1024 characters or less, and a reader long before.
    tidy.truncate(64);
    tidy.truncate(tidy.trim_end_matches('_').len());
    if is_taken(&tidy) {
        tidy.push_str("_v");
    }
    tidy
}

fn push(name: &mut String, text: &str, apart: bool) {
    if apart && !name.is_empty() && !name.ends_with('_') {
        name.push('_');
    }
    name.push_str(text);
}

/// A Greek letter (or a sign used like one) as a symbol and within a word.
fn greek(c: char) -> Option<(&'static str, &'static str)> {
    Some(match c {
        'α' | 'ά' => ("alpha", "a"),
        'β' | 'ϐ' => ("beta", "v"),
        'γ' => ("gamma", "g"),
        'δ' => ("delta", "d"),
        'ε' | 'έ' | 'ϵ' => ("epsilon", "e"),
        'ζ' => ("zeta", "z"),
        'η' | 'ή' => ("eta", "i"),
        'θ' | 'ϑ' => ("theta", "th"),
        'ι' | 'ί' | 'ϊ' | 'ΐ' => ("iota", "i"),
        'κ' | 'ϰ' => ("kappa", "k"),
        'λ' => ("lambda", "l"),
        'μ' | 'µ' => ("mu", "m"),
        'ν' => ("nu", "n"),
        'ξ' => ("xi", "x"),
        'ο' | 'ό' => ("omicron", "o"),
        'π' | 'ϖ' => ("pi", "p"),
        'ρ' | 'ϱ' => ("rho", "r"),
        'σ' | 'ς' => ("sigma", "s"),
        'τ' => ("tau", "t"),
        'υ' | 'ύ' | 'ϋ' | 'ΰ' => ("upsilon", "y"),
        'φ' | 'ϕ' => ("phi", "f"),
        'χ' => ("chi", "ch"),
        'ψ' => ("psi", "ps"),
        'ω' | 'ώ' => ("omega", "o"),
        'Α' | 'Ά' => ("Alpha", "A"),
        'Β' => ("Beta", "V"),
        'Γ' => ("Gamma", "G"),
        'Δ' | '∆' => ("Delta", "D"),
        'Ε' | 'Έ' => ("Epsilon", "E"),
        'Ζ' => ("Zeta", "Z"),
        'Η' | 'Ή' => ("Eta", "I"),
        'Θ' => ("Theta", "Th"),
        'Ι' | 'Ί' | 'Ϊ' => ("Iota", "I"),
        'Κ' => ("Kappa", "K"),
        'Λ' => ("Lambda", "L"),
        'Μ' => ("Mu", "M"),
        'Ν' => ("Nu", "N"),
        'Ξ' => ("Xi", "X"),
        'Ο' | 'Ό' => ("Omicron", "O"),
        'Π' => ("Pi", "P"),
        'Ρ' => ("Rho", "R"),
        'Σ' => ("Sigma", "S"),
        'Τ' => ("Tau", "T"),
        'Υ' | 'Ύ' | 'Ϋ' => ("Upsilon", "Y"),
        'Φ' => ("Phi", "F"),
        'Χ' => ("Chi", "Ch"),
        'Ψ' => ("Psi", "Ps"),
        'Ω' | 'Ώ' => ("Omega", "O"),
        '∇' => ("nabla", "nabla"),
        '∂' => ("partial", "partial"),
        'ℓ' => ("ell", "l"),
        '∞' => ("infinity", "infinity"),
        _ => return None,
    })
}

/// Letters with accents, Cyrillic letters, and raised and lowered digits.
fn latin(c: char) -> Option<&'static str> {
    Some(match c {
        'á' | 'à' | 'â' | 'ã' | 'å' | 'ā' | 'ă' | 'ą' => "a",
        'ä' | 'æ' => "ae",
        'ç' | 'ć' | 'č' => "c",
        'ď' | 'ð' | 'đ' => "d",
        'é' | 'è' | 'ê' | 'ë' | 'ē' | 'ė' | 'ę' | 'ě' => "e",
        'ğ' => "g",
        'í' | 'ì' | 'î' | 'ï' | 'ī' | 'ı' => "i",
        'ł' | 'ĺ' | 'ľ' => "l",
        'ñ' | 'ń' | 'ň' => "n",
        'ó' | 'ò' | 'ô' | 'õ' | 'ō' => "o",
        'ö' | 'ø' | 'œ' | 'ő' => "oe",
        'ř' => "r",
        'ß' => "ss",
        'ś' | 'š' | 'ş' => "s",
        'ť' => "t",
        'ú' | 'ù' | 'û' | 'ū' | 'ů' => "u",
        'ü' | 'ű' => "ue",
        'ý' | 'ÿ' => "y",
        'ź' | 'ż' | 'ž' => "z",
        'Á' | 'À' | 'Â' | 'Ã' | 'Å' => "A",
        'Ä' | 'Æ' => "Ae",
        'Ç' | 'Ć' | 'Č' => "C",
        'É' | 'È' | 'Ê' | 'Ë' => "E",
        'Í' | 'Ì' | 'Î' | 'Ï' => "I",
        'Ł' => "L",
        'Ñ' => "N",
        'Ó' | 'Ò' | 'Ô' | 'Õ' => "O",
        'Ö' | 'Ø' | 'Œ' => "Oe",
        'Š' | 'Ś' => "S",
        'Ú' | 'Ù' | 'Û' => "U",
        'Ü' => "Ue",
        'Ž' | 'Ż' => "Z",
        'а' => "a",
        'б' => "b",
        'в' => "v",
        'г' | 'ґ' => "g",
        'д' => "d",
        'е' | 'э' | 'є' => "e",
        'ё' => "yo",
        'ж' => "zh",
        'з' => "z",
        'и' | 'і' => "i",
        'й' | 'ї' => "j",
        'к' => "k",
        'л' => "l",
        'м' => "m",
        'н' => "n",
        'о' => "o",
        'п' => "p",
        'р' => "r",
        'с' => "s",
        'т' => "t",
        'у' | 'ў' => "u",
        'ф' => "f",
        'х' => "kh",
        'ц' => "ts",
        'ч' => "ch",
        'ш' => "sh",
        'щ' => "shch",
        'ы' => "y",
        'ъ' | 'ь' => "",
        'ю' => "yu",
        'я' => "ya",
        'А' => "A",
        'Б' => "B",
        'В' => "V",
        'Г' | 'Ґ' => "G",
        'Д' => "D",
        'Е' | 'Э' | 'Є' => "E",
        'Ж' => "Zh",
        'З' => "Z",
        'И' | 'І' => "I",
        'К' => "K",
        'Л' => "L",
        'М' => "M",
        'Н' => "N",
        'О' => "O",
        'П' => "P",
        'Р' => "R",
        'С' => "S",
        'Т' => "T",
        'У' => "U",
        'Ф' => "F",
        'Х' => "Kh",
        'Ц' => "Ts",
        'Ч' => "Ch",
        'Ш' => "Sh",
        'Щ' => "Shch",
        'Ю' => "Yu",
        'Я' => "Ya",
        '₀' | '⁰' => "0",
        '₁' | '¹' => "1",
        '₂' | '²' => "2",
        '₃' | '³' => "3",
        '₄' | '⁴' => "4",
        '₅' | '⁵' => "5",
        '₆' | '⁶' => "6",
        '₇' | '⁷' => "7",
        '₈' | '⁸' => "8",
        '₉' | '⁹' => "9",
        '′' => "_prime",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn wanted_names_stay_recognisable() {
        for (wanted, name) in [
            ("density", "density"),
            ("σ", "sigma"),
            ("σ_t", "sigma_t"),
            ("σt", "sigma_t"),
            ("Δρ", "Delta_rho"),
            ("k_a", "k_a"),
            ("τ₀", "tau0"),
            ("πυκνότητα", "pyknotita"),
            ("плотность", "plotnost"),
            ("Größe", "Groesse"),
            ("密度", "u5bc6_u5ea6"),
            ("octave12", "octave12"),
            ("a__b", "a_b"),
            ("__x", "x"),
            ("x_", "x"),
            ("7th", "v_7th"),
            ("", "v"),
            ("_", "v"),
            ("gl_Position", "v_gl_Position"),
            ("loop", "loop_v"),
            ("sample", "sample_v"),
            ("half", "half_v"),
            ("abs", "abs_v"),
            ("Pass", "Pass_v"),
            ("main", "main_v"),
            ("vec3", "vec3_v"),
        ] {
            assert_eq!(legal(wanted), name, "{wanted}");
        }
    }

    #[test]
    fn collisions_get_letters() {
        let mut names = Names::default();
        let given: Vec<String> = ["σ", "sigma", "sigma_b", "σ", "x1", "x1", "x1_"].map(|n| names.unique(n)).into();
        assert_eq!(given, ["sigma", "sigma_b", "sigma_b_b", "sigma_c", "x1_", "x1_b", "x1_c"]);
        assert_eq!([1, 25, 26, 27, 26 * 26].map(letters), ["b", "z", "ba", "bb", "baa"]);
    }

    proptest! {
        #[test]
        fn naga_has_nothing_to_rename(wanted in prop::collection::vec("\\PC{0,12}|[a-z]{1,3}[_0-9]{0,3}|loop|x1|vec3|σ.", 1..40)) {
            let mut names = Names::default();
            let mut namer = naga::proc::Namer::default();
            namer.reset(
                &naga::Module::default(),
                &naga::keywords::wgsl::RESERVED_SET,
                &naga::keywords::wgsl::BUILTIN_IDENTIFIER_SET,
                naga::proc::CaseInsensitiveKeywordSet::empty(),
                &["__", "_naga"],
                &mut naga::FastHashMap::default(),
            );
            for wanted in &wanted {
                let name = names.unique(wanted);
                prop_assert_eq!(namer.call(&name), name);
            }
        }
    }
}
