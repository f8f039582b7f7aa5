//! What people write when they mean something else: words of other languages, units spelt out, characters from a word
//! processor, and the nearest word of ours to a misspelt one.

use super::ast::{BlockKind, UNITS};

/// The words that start an item.
pub(super) const ITEM_WORDS: [&str; 17] = [
    "use", "const", "param", "fn", "table", "transfer", "grid", "medium", "light", "splats", "surface", "fog", "style",
    "text", "camera", "image", "render",
];

/// Words that others use for our items.
const ITEM_SYNONYMS: &[(&str, &[&str])] = &[
    ("medium", &["volume", "media", "material", "cloud", "participating_medium", "gas", "smoke", "object", "shader"]),
    ("fn", &["function", "func", "fun", "def", "field", "proc"]),
    ("const", &["let", "var", "val", "constant", "static", "define", "auto"]),
    ("param", &["parameter", "uniform", "slider", "control", "input", "property", "knob"]),
    ("use", &["import", "include", "require", "from", "open", "using"]),
    ("table", &["lut", "curve", "array", "map", "lookup", "profile"]),
    ("transfer", &["transfer_function", "tf", "colormap", "colourmap", "gradient", "palette", "ramp"]),
    ("grid", &["voxels", "dataset", "data", "texture", "volume_data", "scan", "field3d", "texture3d"]),
    ("light", &["sun", "lamp", "environment", "sky", "directional_light", "point_light", "spot", "lights"]),
    ("surface", &["mesh", "plane", "ground", "floor", "wall", "geometry"]),
    ("splats", &["splat", "gaussians", "gaussian", "pointcloud", "points"]),
    ("style", &["font", "textstyle"]),
    ("text", &["label", "string", "title", "caption"]),
    ("camera", &["view", "eye", "cam", "viewer", "viewpoint"]),
    ("image", &["picture", "output", "film", "screen", "canvas", "frame"]),
    ("render", &["renderer", "integrator", "settings", "options", "quality", "config"]),
    ("fog", &["haze", "mist", "atmosphere"]),
];

/// Words for shapes, which are values here and not items.
const SHAPES: &[&str] = &[
    "sphere",
    "box",
    "cube",
    "ellipsoid",
    "slab",
    "cylinder",
    "shell",
    "sdf",
    "ball",
    "torus",
    "cone",
    "union",
    "intersection",
];

/// Whether the word names a shape rather than an item.
pub(super) fn is_shape(word: &str) -> bool {
    SHAPES.contains(&word.to_lowercase().as_str())
}

/// The item word that was meant.
pub(super) fn item_word(word: &str) -> Option<&'static str> {
    let lower = word.to_lowercase();
    let same = ITEM_WORDS.into_iter().find(|w| *w == lower);
    let synonym = || ITEM_SYNONYMS.iter().find(|(_, others)| others.contains(&lower.as_str())).map(|(w, _)| *w);
    same.or_else(synonym).or_else(|| nearest(&lower, ITEM_WORDS))
}

/// The block that was meant by a word.
pub(super) fn block_word(word: &str) -> Option<BlockKind> {
    item_word(word).and_then(super::tree::block_kind)
}

/// The word at most a third of its letters away, and at least one.
fn nearest<'w>(word: &str, words: impl IntoIterator<Item = &'w str>) -> Option<&'w str> {
    let allowed = (word.chars().count() / 3).clamp(1, 3);
    if word.chars().count() < 3 {
        return None;
    }
    words
        .into_iter()
        .map(|w| (strsim::osa_distance(word, w), w))
        .filter(|(distance, _)| *distance <= allowed)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, w)| w)
}

/// Units written otherwise.
const UNIT_SYNONYMS: &[(&str, &[&str])] = &[
    ("m", &["meter", "meters", "metre", "metres", "mtr"]),
    ("km", &["kilometer", "kilometers", "kilometre", "kilometres", "kms"]),
    ("cm", &["centimeter", "centimeters", "centimetre", "centimetres", "cms"]),
    ("mm", &["millimeter", "millimeters", "millimetre", "millimetres", "mms"]),
    ("um", &["µm", "μm", "micrometer", "micrometers", "micrometre", "micrometres", "micron", "microns", "mum"]),
    ("nm", &["nanometer", "nanometers", "nanometre", "nanometres"]),
    ("s", &["sec", "secs", "second", "seconds"]),
    ("ms", &["msec", "millisecond", "milliseconds"]),
    ("deg", &["degree", "degrees", "degs", "grad", "grads"]),
    ("rad", &["radian", "radians", "rads"]),
    ("sr", &["steradian", "steradians"]),
    ("lx", &["lux", "luxes", "lumen", "lumens", "lm", "nit", "nits", "cd", "candela", "watt", "watts", "w"]),
    ("px", &["pixel", "pixels", "pxs", "pt", "pts"]),
];

/// Units that are not ours, with what to write.
const FOREIGN_UNITS: &[(&[&str], &str)] = &[
    (&["inch", "inches", "ft", "foot", "feet", "yd", "yard", "yards", "mile", "miles"], "convert to `m`"),
    (&["dm", "hm", "dam", "pm"], "convert to `m`, `cm`, `mm`, `um` or `nm`"),
    (&["us", "ns", "min", "mins", "minute", "minutes", "h", "hour", "hours"], "convert to `s` or `ms`"),
    (&["angstrom", "angstroms"], "convert to `nm`"),
    (&["percent"], "divide by 100"),
];

/// What to do about a word that stands where only a unit can: `Err` is advice in words.
pub(super) fn unit(word: &str) -> Option<Result<&'static str, &'static str>> {
    let lower = word.to_lowercase();
    if let Some(unit) = UNITS.into_iter().find(|u| *u == lower) {
        return Some(Ok(unit));
    }
    if let Some((unit, _)) = UNIT_SYNONYMS.iter().find(|(_, others)| others.contains(&lower.as_str())) {
        return Some(Ok(unit));
    }
    if let Some((_, advice)) = FOREIGN_UNITS.iter().find(|(others, _)| others.contains(&lower.as_str())) {
        return Some(Err(advice));
    }
    let spelt = UNIT_SYNONYMS.iter().flat_map(|(_, others)| others.iter().copied()).filter(|w| w.len() > 3);
    let spelt = nearest(&lower, spelt)?;
    UNIT_SYNONYMS.iter().find(|(_, others)| others.contains(&spelt)).map(|(unit, _)| Ok(*unit))
}

/// A character that is not of the language: what is wrong, and what to write.
pub(super) fn foreign_character(c: char) -> Option<(&'static str, &'static str)> {
    Some(match c {
        '“' | '”' | '„' | '«' | '»' | '‟' => {
            ("typographic quotation marks do not delimit text", "use the plain `\"`")
        }
        '\'' | '‘' | '’' | '`' => ("text stands in double quotation marks", "use `\"`"),
        '−' | '–' | '—' | '‐' | '‑' => ("this dash is not a minus sign", "use the plain `-`"),
        '×' | '·' | '∙' | '⋅' | '∗' => ("this sign is not the `*` of the language", "write `*`"),
        '÷' | '∕' | '⁄' => ("this sign is not the `/` of the language", "write `/`"),
        '°' => ("degrees are written with the unit `deg`", "write `deg`, as in `45 deg`"),
        '²' | '³' | '¹' | '⁴' | '⁵' | '⁶' | '⁷' | '⁸' | '⁹' | '⁰' | '⁻' => {
            ("powers are written with `^`", "write `^2`, `^-1` …")
        }
        '≤' => ("this sign is written with two characters", "write `<=`"),
        '≥' => ("this sign is written with two characters", "write `>=`"),
        '≠' => ("this sign is written with two characters", "write `!=`"),
        '√' => ("roots are calls", "write `sqrt(x)`"),
        '∞' => ("there is no infinity in the language", "leave the bound out, or choose a large finite one"),
        '…' => ("a range is written with two dots", "write `..`"),
        '%' => ("there is no `%` operator", "write `mod(a, b)` for a remainder, `0.5` for 50 %"),
        '&' => ("`and` is written with two characters", "write `&&`"),
        '|' => ("`or` is written with two characters", "write `||`"),
        '?' => ("there is no `?` operator", "write `if c then a else b`"),
        '~' => ("there is no `~` operator", "write `!` to negate a condition"),
        '@' | '$' => {
            ("this character starts nothing in the language", "leave it out; names are letters, digits and `_`")
        }
        '\\' => ("a backslash has a meaning in text in quotes only", "leave it out: lines need no continuation mark"),
        '\u{200B}' | '\u{200C}' | '\u{200D}' | '\u{2060}' | '\u{AD}' => {
            ("there is an invisible character here", "delete it")
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_others_lead_to_ours() {
        assert_eq!(item_word("volume"), Some("medium"));
        assert_eq!(item_word("mediun"), Some("medium"));
        assert_eq!(item_word("Camera"), Some("camera"));
        assert_eq!(item_word("function"), Some("fn"));
        assert_eq!(item_word("zebra"), None);
    }

    #[test]
    fn units_of_others_lead_to_ours() {
        assert_eq!(unit("meters"), Some(Ok("m")));
        assert_eq!(unit("M"), Some(Ok("m")));
        assert_eq!(unit("µm"), Some(Ok("um")));
        assert_eq!(unit("kilometrs"), Some(Ok("km")));
        assert!(matches!(unit("feet"), Some(Err(_))));
        assert_eq!(unit("bananas"), None);
    }

    #[test]
    fn every_synonym_leads_to_a_word_of_the_language() {
        assert!(ITEM_SYNONYMS.iter().all(|(word, _)| ITEM_WORDS.contains(word)));
        assert!(UNIT_SYNONYMS.iter().all(|(unit, _)| UNITS.contains(unit)));
        assert!(BlockKind::ALL.iter().all(|kind| ITEM_WORDS.contains(&kind.word())));
    }
}
