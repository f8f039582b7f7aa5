//! The text part of a NRRD file as named fields, and the forms their values take.

use super::super::broken;
use compiler::loader::LoadError;
use std::collections::HashMap;

/// Fields by name, in lower case and without spaces: the format allows `space origin` and `spaceorigin` alike.
pub(super) struct Fields(HashMap<String, String>);

impl Fields {
    /// Also returns where the byte after the empty line is that ends the header; a detached header needs none.
    pub(super) fn parse(text: &[u8]) -> Result<(Self, Option<u64>), LoadError> {
        let mut fields = HashMap::new();
        let mut at = 0;
        for number in 1.. {
            let Some(rest) = text.get(at..).filter(|rest| !rest.is_empty()) else {
                break;
            };
            let end = rest.iter().position(|b| *b == b'\n');
            let line = &rest[..end.unwrap_or(rest.len())];
            at += end.map_or(rest.len(), |end| end + 1);
            let line = String::from_utf8_lossy(line.strip_suffix(b"\r").unwrap_or(line));
            if number == 1 {
                check_magic(&line)?;
            } else if line.is_empty() {
                return Ok((Self(fields), Some(at as u64)));
            } else if !line.starts_with('#') {
                add(&mut fields, &line, number)?;
            }
        }
        Ok((Self(fields), None))
    }

    pub(super) fn get(&self, name: &str) -> Option<&str> {
        self.0.get(name).map(String::as_str)
    }

    pub(super) fn required(&self, name: &str) -> Result<&str, LoadError> {
        self.get(name).ok_or_else(|| broken(format!("has no field `{name}` in its header")))
    }

    pub(super) fn integer(&self, name: &str) -> Result<Option<i64>, LoadError> {
        self.get(name).map(|text| text.trim().parse().map_err(|_| malformed(name, text))).transpose()
    }

    /// Numbers between spaces.
    pub(super) fn numbers<T: std::str::FromStr>(&self, name: &str) -> Result<Option<Vec<T>>, LoadError> {
        let Some(text) = self.get(name) else { return Ok(None) };
        let numbers: Result<Vec<T>, _> = text.split_whitespace().map(str::parse).collect();
        numbers.map(Some).map_err(|_| malformed(name, text))
    }

    /// Words, or quoted strings with `\"` inside.
    pub(super) fn words(&self, name: &str) -> Result<Option<Vec<String>>, LoadError> {
        let Some(text) = self.get(name) else { return Ok(None) };
        let mut words = vec![];
        let mut rest = text.trim_start();
        while !rest.is_empty() {
            let (word, after) = if let Some(quoted) = rest.strip_prefix('"') {
                let (mut word, mut escaped, mut end) = (String::new(), false, None);
                for (at, c) in quoted.char_indices() {
                    if c == '"' && !escaped {
                        end = Some(at + 1);
                        break;
                    }
                    escaped = c == '\\' && !escaped;
                    if !escaped {
                        word.push(c);
                    }
                }
                (word, &quoted[end.ok_or_else(|| malformed(name, text))?..])
            } else {
                let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
                (rest[..end].to_string(), &rest[end..])
            };
            words.push(word);
            rest = after.trim_start();
        }
        Ok(Some(words))
    }

    /// Vectors `(1,0,0)` between spaces, `none` for an axis that has none.
    pub(super) fn vectors(&self, name: &str) -> Result<Option<Vec<Option<Vec<f64>>>>, LoadError> {
        let Some(text) = self.get(name) else { return Ok(None) };
        let mut vectors = vec![];
        let mut rest = text.trim_start();
        while !rest.is_empty() {
            if let Some(inside) = rest.strip_prefix('(') {
                let end = inside.find(')').ok_or_else(|| malformed(name, text))?;
                let numbers: Result<Vec<f64>, _> = inside[..end].split(',').map(|n| n.trim().parse()).collect();
                vectors.push(Some(numbers.map_err(|_| malformed(name, text))?));
                rest = inside[end + 1..].trim_start();
            } else if let Some(after) = rest.strip_prefix("none") {
                vectors.push(None);
                rest = after.trim_start();
            } else {
                return Err(malformed(name, text));
            }
        }
        Ok(Some(vectors))
    }
}

/// `E0603` for a field whose value has another form than it should.
fn malformed(name: &str, text: &str) -> LoadError {
    let shown: String = text.chars().take(60).collect();
    broken(format!("has `{shown}` for the field `{name}`, which cannot be read"))
}

fn check_magic(line: &str) -> Result<(), LoadError> {
    let version = line.strip_prefix("NRRD").and_then(|v| v.trim_end().parse::<u32>().ok());
    match version {
        Some(1..=5) => Ok(()),
        Some(n) => Err(broken(format!("is of NRRD version {n}; 1 to 5 are known"))),
        None => Err(broken("does not start with a line like `NRRD0005`")),
    }
}

fn add(fields: &mut HashMap<String, String>, line: &str, number: usize) -> Result<(), LoadError> {
    let Some((name, value)) = line.split_once(':') else {
        let shown: String = line.chars().take(40).collect();
        return Err(broken(format!("has no field in line {number} of its header: `{shown}`")));
    };
    // `key:=value` is for programs that agree on the key.
    if value.starts_with('=') {
        return Ok(());
    }
    let mut plain: String = name.to_lowercase();
    plain.retain(|c| !c.is_whitespace());
    if plain == "centerings" {
        plain = "centers".into();
    }
    match fields.insert(plain, value.trim().to_string()) {
        None => Ok(()),
        Some(_) => Err(broken(format!("has the field `{}` twice, again in line {number}", name.trim()))),
    }
}
