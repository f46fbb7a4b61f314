//! Every key of a configuration in one list, with what it means: from the schema of the type that reads it.

use crate::documents::schema::{kind, text};
use serde::Serialize;
use serde_json::Value;
use std::fmt::Write;

/// A key of a configuration.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Key {
    /// Its name with the tables it stands in: `depth.near_m`. `NAME` stands for a name of the user's, `[]` behind a list of tables.
    pub key: String,
    /// Its type, in words.
    pub kind: String,
    /// Its value where it is not given.
    pub default: Option<Value>,
    /// Whether it must be given, in a table that is.
    pub required: bool,
    /// What it means, with its unit.
    pub meaning: String,
    /// The words it takes, and what each means.
    pub choices: Vec<[String; 2]>,
}

/// Every key of a type's schema, tables within it included; `values` are the defaults where they are not those of the type.
pub fn keys(schema: &Value, values: &Value) -> Vec<Key> {
    let mut out = Vec::new();
    walk(schema, schema, "", values, &mut Vec::new(), &mut out);
    out
}

/// The keys as text for a terminal.
pub fn plain(keys: &[Key]) -> String {
    let mut out = String::new();
    for key in keys {
        let default = match &key.default {
            _ if key.required => ", required".to_owned(),
            None | Some(Value::Null) => String::new(),
            Some(value) => format!(", default {}", shown(value)),
        };
        let _ = writeln!(out, "{}  ({}{default})", key.key, key.kind);
        for line in wrapped(&key.meaning, 96) {
            let _ = writeln!(out, "    {line}");
        }
        for [word, meaning] in &key.choices {
            let mut lines = wrapped(meaning, 92).into_iter();
            let _ = writeln!(out, "    - {word}: {}", lines.next().unwrap_or_default());
            for line in lines {
                let _ = writeln!(out, "      {line}");
            }
        }
    }
    out.trim_end().to_owned()
}

/// A value as a user would write it: numbers of single precision with no more digits than they have.
fn shown(value: &Value) -> String {
    match value {
        Value::Array(list) => format!("[{}]", list.iter().map(shown).collect::<Vec<_>>().join(", ")),
        Value::Number(number) if number.is_f64() => match number.as_f64() {
            Some(v) if f64::from(v as f32) == v => (v as f32).to_string(),
            _ => number.to_string(),
        },
        other => other.to_string(),
    }
}

fn wrapped(text: &str, columns: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= columns => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// The definition behind a property: its own, the one it refers to, or that of which it is an optional value.
fn resolved<'s>(root: &'s Value, schema: &'s Value) -> &'s Value {
    let alternatives = || {
        let lists = [&schema["anyOf"], &schema["allOf"]].into_iter().filter_map(Value::as_array).flatten();
        lists.filter(|a| a["type"] != "null").collect::<Vec<_>>()
    };
    let reference = schema["$ref"].as_str();
    match (reference.and_then(|r| r.strip_prefix("#/$defs/")), alternatives().as_slice()) {
        (Some(name), _) => &root["$defs"][name],
        (None, [only]) => resolved(root, only),
        _ => schema,
    }
}

fn walk<'s>(root: &'s Value, table: &'s Value, prefix: &str, values: &Value, above: &mut Vec<&'s Value>, out: &mut Vec<Key>) {
    let required = |key: &str| table["required"].as_array().into_iter().flatten().any(|r| r == key);
    for (key, property) in table["properties"].as_object().into_iter().flatten() {
        let own = resolved(root, property);
        let name = format!("{prefix}{key}");
        let value = values.get(key).filter(|v| !v.is_null()).or_else(|| property.get("default")).unwrap_or(&Value::Null);
        // A type may hold itself.
        let known = above.iter().any(|a| std::ptr::eq(*a, own));
        let within =
            [(own, "."), (resolved(root, &own["items"]), "[]."), (resolved(root, &own["additionalProperties"]), ".NAME.")];
        let table_within = within.into_iter().find(|(t, _)| t["properties"].is_object()).filter(|_| !known);
        let mut meaning = text(property);
        if let Some((inner, between)) = table_within {
            let kind = match between {
                "." => "table".to_owned(),
                "[]." => "list of tables".to_owned(),
                _ => "tables by name".to_owned(),
            };
            if meaning.is_empty() {
                meaning = text(inner);
            }
            out.push(Key { key: name.clone(), kind, default: None, required: required(key), meaning, choices: Vec::new() });
            above.push(own);
            walk(root, inner, &format!("{name}{between}"), if between == "." { value } else { &Value::Null }, above, out);
            above.pop();
            continue;
        }
        let words = |list: &Value| -> Vec<[String; 2]> {
            let described = |v: &Value| Some([v["const"].as_str()?.to_owned(), text(v)]);
            list.as_array().into_iter().flatten().filter_map(described).collect()
        };
        let mut choices = words(&own["oneOf"]);
        choices
            .extend(own["enum"].as_array().into_iter().flatten().filter_map(|v| Some([v.as_str()?.to_owned(), String::new()])));
        let kind = if choices.is_empty() { kind(property) } else { "one of the words below".to_owned() };
        if meaning.is_empty() {
            meaning = text(own);
        }
        let default = Some(value.clone()).filter(|v| !v.is_null());
        out.push(Key { key: name, kind, default, required: required(key), meaning, choices });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use schemars::{JsonSchema, schema_for};
    use serde_json::json;

    /// An outer table.
    #[derive(Serialize, JsonSchema)]
    #[allow(dead_code)]
    struct Outer {
        /// A length, metres.
        length_m: f64,
        /// An inner table.
        #[schemars(default)]
        inner: Option<Inner>,
        /// Several of them.
        #[schemars(default)]
        many: Vec<Inner>,
    }

    #[derive(Serialize, JsonSchema)]
    #[allow(dead_code)]
    struct Inner {
        /// How it is done.
        #[schemars(default = "first")]
        how: How,
    }

    fn first() -> How {
        How::First
    }

    #[derive(Serialize, JsonSchema)]
    #[serde(rename_all = "kebab-case")]
    #[allow(dead_code)]
    enum How {
        /// At the start.
        First,
        /// At the end.
        Last,
    }

    #[test]
    fn keys_of_tables_within_tables_are_listed_with_their_words() {
        let schema = schema_for!(Outer).to_value();
        let list = keys(&schema, &json!({ "inner": { "how": "last" } }));
        let of = |key: &str| list.iter().find(|k| k.key == key).unwrap_or_else(|| panic!("{key} in {list:?}"));
        assert!(of("length_m").required && of("length_m").meaning == "A length, metres.");
        assert_eq!(of("inner").kind, "table");
        assert_eq!(
            (of("inner.how").default.clone(), of("many[].how").default.clone()),
            (Some(json!("last")), Some(json!("first")))
        );
        assert_eq!(of("inner.how").choices[1], ["last".to_owned(), "At the end.".to_owned()]);
        let text = plain(&list);
        assert!(text.contains("inner.how  (one of the words below, default \"last\")\n    How it is done."), "{text}");
        assert!(text.contains("    - first: At the start."), "{text}");
        assert_eq!(shown(&json!([0.1_f32, 0.1_f64, 3, "a"])), "[0.1, 0.1, 3, \"a\"]");
    }
}
