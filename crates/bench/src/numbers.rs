//! Numbers of a record are numbers: none that is infinite or none at all, and none so large that it can only be damage.

use anyhow::{Result, bail};
use serde_json::Value;

/// No metric, time or share is beyond this.
const LARGEST: f64 = 1e12;

/// Keys that may hold nothing.
const OPTIONAL: [&str; 3] = ["gaussians", "peak_memory_bytes", "latency"];

/// Keys whose content is somebody else's: a method's own configuration.
const FOREIGN: [&str; 2] = ["config", "overrides"];

/// Checks the numbers of a record as JSON holds it, where a number that is not finite is null.
///
/// # Errors
/// The first that is none, by its key.
pub fn check(value: &Value) -> Result<()> {
    match fault("", "", value) {
        None => Ok(()),
        Some(fault) => bail!("{fault}\n  help: the record is damaged, or what made it is not sound: make it again"),
    }
}

fn fault(path: &str, key: &str, value: &Value) -> Option<String> {
    match value {
        Value::Null if !OPTIONAL.contains(&key) => Some(format!("{path} is not a finite number")),
        Value::Number(n) if n.is_f64() && !n.as_f64().is_some_and(|v| v.abs() <= LARGEST) => {
            Some(format!("{path} is {:e}, which no such number can be", n.as_f64().unwrap_or(f64::NAN)))
        }
        Value::Array(list) => list.iter().enumerate().find_map(|(i, v)| fault(&format!("{path}[{i}]"), key, v)),
        Value::Object(map) => map.iter().filter(|(name, _)| !FOREIGN.contains(&name.as_str())).find_map(|(name, v)| {
            let dot = if path.is_empty() { "" } else { "." };
            fault(&format!("{path}{dot}{name}"), name, v)
        }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_is_no_number_is_named() {
        let sound = json!({"config": {"x": null}, "means": {"a": 1.5}, "gaussians": null, "curve": [{"seconds": 0.0, "gaussians": null}]});
        check(&sound).unwrap();
        let message = |value: Value| check(&value).unwrap_err().to_string();
        assert!(message(json!({"means": {"psnr": f64::NAN}})).starts_with("means.psnr is not a finite number"));
        assert!(message(json!({"frames": [{"a": 1.0}, {"a": 1.7e308}]})).starts_with("frames[1].a is 1.7e308"));
        assert!(message(json!({"curve": [[0.0, -1e13]]})).starts_with("curve[0][1] is -1"));
    }
}
