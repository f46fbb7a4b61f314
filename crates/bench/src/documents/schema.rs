//! The keys of configuration files as Markdown tables, from the types that read them.

use schemars::{JsonSchema, schema_for};
use serde_json::Value;
use std::fmt::Write;

/// Every key of `T` and of the tables within it: type, default, meaning.
pub fn tables<T: JsonSchema>(title: &str) -> String {
    let schema = schema_for!(T).to_value();
    let mut out = String::new();
    describe(title, &schema, &mut out);
    let definitions = schema.get("$defs").and_then(Value::as_object);
    for (name, definition) in definitions.into_iter().flatten() {
        describe(name, definition, &mut out);
    }
    out
}

fn describe(name: &str, schema: &Value, out: &mut String) {
    let meaning = text(schema);
    let _ = writeln!(out, "### {name}\n");
    if !meaning.is_empty() {
        let _ = writeln!(out, "{meaning}\n");
    }
    if let Some(properties) = schema["properties"].as_object() {
        let required: Vec<&str> = schema["required"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        let _ = writeln!(out, "| key | type | default | meaning |\n|---|---|---|---|");
        for (key, property) in properties {
            let default = match &property["default"] {
                Value::Null if required.contains(&key.as_str()) => "**required**".to_owned(),
                Value::Null | Value::Object(_) => "–".to_owned(),
                value => format!("`{value}`"),
            };
            let _ = writeln!(out, "| `{key}` | {} | {default} | {} |", kind(property), text(property));
        }
        out.push('\n');
    }
    for variant in schema["oneOf"].as_array().into_iter().flatten() {
        if let Some(value) = variant["const"].as_str() {
            let _ = writeln!(out, "- `\"{value}\"`: {}", text(variant));
        }
    }
    for value in schema["enum"].as_array().into_iter().flatten() {
        let _ = writeln!(out, "- `{value}`");
    }
    out.push('\n');
}

/// A description in one line of a table.
pub(crate) fn text(schema: &Value) -> String {
    let words: Vec<&str> = schema["description"].as_str().unwrap_or_default().split_whitespace().collect();
    words.join(" ").replace('|', "\\|")
}

/// The type of a key, in words.
pub(crate) fn kind(schema: &Value) -> String {
    let named = |reference: &str| reference.rsplit('/').next().unwrap_or(reference).to_owned();
    if let Some(reference) = schema["$ref"].as_str() {
        return named(reference);
    }
    let alternatives = schema["anyOf"].as_array().or_else(|| schema["allOf"].as_array());
    if let Some(reference) = alternatives.into_iter().flatten().find_map(|a| a["$ref"].as_str()) {
        return named(reference);
    }
    let simple = match &schema["type"] {
        Value::String(one) => one.as_str(),
        Value::Array(several) => several.iter().filter_map(Value::as_str).find(|t| *t != "null").unwrap_or("value"),
        _ => "value",
    };
    match simple {
        "array" => match schema["maxItems"].as_u64() {
            Some(count) => format!("{count} × {}", kind(&schema["items"])),
            None => format!("list of {}", kind(&schema["items"])),
        },
        "object" => match &schema["additionalProperties"] {
            Value::Object(_) => format!("table of {}", kind(&schema["additionalProperties"])),
            _ => "table".to_owned(),
        },
        "boolean" => "true or false".to_owned(),
        other => other.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::config::{DatasetConfig, SceneConfig};

    #[test]
    fn keys_have_their_types_defaults_and_meanings() {
        let scene = tables::<SceneConfig>("Scene file");
        assert!(scene.contains("| `thickness_m` | number |"), "{scene}");
        let dataset = tables::<DatasetConfig>("Data-set file");
        assert!(
            dataset.contains("| `keyframes` | integer | **required** | Number of keyframes along the trajectory. |"),
            "{dataset}"
        );
        assert!(dataset.contains("| `way` | 2 × number | `[0.0,1.0]` |"), "{dataset}");
        assert!(dataset.contains("- `\"bartlett\"`:"), "{dataset}");
        // No key is without a meaning.
        for line in scene.lines().chain(dataset.lines()) {
            assert!(!line.starts_with("| `") || !line.ends_with("|  |"), "{line}");
        }
    }
}
