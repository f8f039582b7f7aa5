//! "Did you mean …?"

use strsim::damerau_levenshtein;

/// The candidate that was probably meant, if one is close enough.
pub(crate) fn closest<'a>(written: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let lower = written.to_lowercase();
    let length = written.chars().count();
    // A third of the word may be wrong, one letter always, but never the whole word.
    let limit = (length / 3).max(1).min(length.saturating_sub(1).max(1));
    let mut best: Option<(usize, &'a str)> = None;
    for candidate in candidates {
        if candidate == written {
            continue;
        }
        let simplified = candidate.to_lowercase();
        let distance = if simplified == lower || simplified.replace('_', "") == lower.replace('_', "") {
            0
        } else {
            damerau_levenshtein(&simplified, &lower)
        };
        let near = distance <= limit && (length > 1 || distance == 0);
        if near && best.is_none_or(|(d, name)| (distance, candidate) < (d, name)) {
            best = Some((distance, candidate));
        }
    }
    best.map(|(_, name)| name)
}

/// The name under which this language knows what another one calls `written`.
pub(crate) fn synonym(written: &str) -> Option<&'static str> {
    const SYNONYMS: &[(&str, &str)] = &[
        ("lerp", "mix"),
        ("ln", "log"),
        ("power", "pow"),
        ("saturate", "clamp"),
        ("ceiling", "ceil"),
        ("frac", "fract"),
        ("fmod", "mod"),
        ("fabs", "abs"),
        ("hypot", "length"),
        ("norm", "length"),
        ("magnitude", "length"),
        ("dist", "distance"),
        ("float3", "vec3"),
        ("vec3f", "vec3"),
        ("float2", "vec2"),
        ("position", "p"),
        ("pos", "p"),
        ("wavelength", "lambda"),
        ("direction", "dir"),
        ("altitude", "h"),
        ("t", "time"),
        ("cosine", "cos_theta"),
        ("mu", "cos_theta"),
        ("hg", "henyey_greenstein"),
        ("ball", "sphere"),
        ("cube", "box"),
        ("cuboid", "box"),
        ("aabb", "box"),
        ("nabla", "gradient"),
        ("grad", "gradient"),
        ("perlin", "fbm"),
        ("noise", "fbm"),
        ("PI", "pi"),
        ("TAU", "tau"),
        ("colour", "color"),
        ("meter", "m"),
        ("meters", "m"),
        ("metre", "m"),
        ("metres", "m"),
        ("kilometer", "km"),
        ("kilometre", "km"),
        ("centimeter", "cm"),
        ("centimetre", "cm"),
        ("millimeter", "mm"),
        ("millimetre", "mm"),
        ("micron", "um"),
        ("nanometer", "nm"),
        ("nanometre", "nm"),
        ("sec", "s"),
        ("second", "s"),
        ("seconds", "s"),
        ("degree", "deg"),
        ("degrees", "deg"),
        ("radian", "rad"),
        ("radians", "rad"),
        ("lux", "lx"),
        ("pixel", "px"),
        ("pixels", "px"),
    ];
    SYNONYMS.iter().find(|(name, _)| *name == written).map(|(_, ours)| *ours)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn close_names_are_found_and_far_ones_are_not() {
        let names = ["sphere", "smoothstep", "exp", "k_a", "k_s"];
        assert_eq!(closest("spere", names), Some("sphere"));
        assert_eq!(closest("smooth_step", names), Some("smoothstep"));
        assert_eq!(closest("Exp", names), Some("exp"));
        assert_eq!(closest("ka", names), Some("k_a"));
        assert_eq!(closest("q", names), None);
        assert_eq!(closest("banana", names), None);
    }
}
