//! Numbers of a record are numbers: none that is infinite or none at all, and none so large that it can only be damage. They are
//! looked at as they are read; nothing is kept of them.

use anyhow::{Result, bail};
use serde::de::{DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::Value;
use std::cell::RefCell;
use std::fmt;

/// No metric, time or share is beyond this.
const LARGEST: f64 = 1e12;

/// Keys that may hold nothing.
const OPTIONAL: [&str; 4] = ["gaussians", "peak_memory_bytes", "peak_device_memory_bytes", "latency"];

/// Keys whose content is somebody else's: a method's own configuration.
const FOREIGN: [&str; 2] = ["config", "overrides"];

const HELP: &str = "the record is damaged, or what made it is not sound: make it again";

/// Checks the numbers of a record as JSON holds it, where a number that is not finite is null.
///
/// # Errors
/// The first that is none, or that is a time and negative, by its key.
pub fn check(value: &Value) -> Result<()> {
    look(value, true, usize::MAX).map(drop)
}

/// Checks JSON text before it is taken for anything: it holds no more than `most_values` values, for what is small as text may be
/// large in memory; and where it is a record's, its numbers are numbers. Returns how many values it holds. Text that is no JSON is
/// left to whoever reads it.
///
/// # Errors
/// More values, or those of [`check`].
pub fn check_text(text: &str, of_record: bool, most_values: usize) -> Result<usize> {
    look(&mut serde_json::Deserializer::from_str(text), of_record, most_values)
}

fn look<'de>(source: impl Deserializer<'de>, of_record: bool, most_values: usize) -> Result<usize> {
    let state = RefCell::new(State { left: most_values, fault: None });
    let look = Look { state: &state, path: "", key: "", checked: of_record };
    // An error without a fault is of JSON itself.
    let _ = look.deserialize(source);
    let State { left, fault } = state.into_inner();
    match fault {
        None => Ok(most_values - left),
        Some(Fault::Number(fault)) => bail!("{fault}\n  help: {HELP}"),
        Some(Fault::Size) => bail!(
            "it holds more than {most_values} numbers and texts\n  help: a file of its kind is smaller than that; it is damaged, or \
             of another kind"
        ),
    }
}

struct State {
    left: usize,
    fault: Option<Fault>,
}

enum Fault {
    Number(String),
    Size,
}

/// A look at the value at a path.
#[derive(Clone, Copy)]
struct Look<'a> {
    state: &'a RefCell<State>,
    path: &'a str,
    key: &'a str,
    checked: bool,
}

impl Look<'_> {
    fn refuse<E: Error>(&self, fault: Fault) -> Result<(), E> {
        self.state.borrow_mut().fault = Some(fault);
        Err(E::custom("refused"))
    }

    /// Whether a number is of a time, none of which is negative.
    fn is_time(&self) -> bool {
        self.key == "seconds" || self.key.ends_with("_s")
    }
}

impl<'de> DeserializeSeed<'de> for Look<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, source: D) -> Result<(), D::Error> {
        let left = self.state.borrow().left.checked_sub(1);
        let Some(left) = left else { return self.refuse(Fault::Size) };
        self.state.borrow_mut().left = left;
        source.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Look<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("JSON")
    }

    fn visit_unit<E: Error>(self) -> Result<(), E> {
        if self.checked && !OPTIONAL.contains(&self.key) {
            return self.refuse(Fault::Number(format!(
                "{} is null, as numbers that are not finite are written, and a value belongs there",
                self.path
            )));
        }
        Ok(())
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<(), E> {
        if self.checked && (number.is_nan() || number.abs() > LARGEST) {
            return self.refuse(Fault::Number(format!("{} is {number:e}, which no such number can be", self.path)));
        }
        if self.checked && number < 0.0 && self.is_time() {
            return self.refuse(Fault::Number(format!("{} is {number}, and no time is negative", self.path)));
        }
        Ok(())
    }

    fn visit_i64<E: Error>(self, number: i64) -> Result<(), E> {
        if self.is_time() { self.visit_f64(number as f64) } else { Ok(()) }
    }

    fn visit_u64<E: Error>(self, number: u64) -> Result<(), E> {
        if self.is_time() { self.visit_f64(number as f64) } else { Ok(()) }
    }

    fn visit_bool<E: Error>(self, _: bool) -> Result<(), E> {
        Ok(())
    }

    fn visit_str<E: Error>(self, _: &str) -> Result<(), E> {
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        for i in 0_usize.. {
            let path = if self.checked { format!("{}[{i}]", self.path) } else { String::new() };
            if list.next_element_seed(Look { path: &path, ..self })?.is_none() {
                break;
            }
        }
        Ok(())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            let dot = if self.path.is_empty() { "" } else { "." };
            let path = if self.checked { format!("{}{dot}{key}", self.path) } else { String::new() };
            let checked = self.checked && !FOREIGN.contains(&key.as_str());
            map.next_value_seed(Look { path: &path, key: &key, checked, ..self })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_is_no_number_is_named() {
        let curve = json!([{"seconds": 0.0, "gaussians": null}]);
        let sound = json!({"config": {"x": null, "late_s": -1}, "means": {"a": -1.5}, "gaussians": null, "curve": curve});
        check(&sound).unwrap();
        assert_eq!(check_text(&sound.to_string(), true, 12).unwrap(), 11);
        for (value, said) in [
            (json!({"means": {"psnr": f64::NAN}}), "means.psnr is null, as numbers that are not finite are written"),
            (json!({"frames": [{"a": 1.0}, {"a": 1.7e308}]}), "frames[1].a is 1.7e308"),
            (json!({"curve": [[0.0, -1e13]]}), "curve[0][1] is -1"),
            (
                json!({"curve": [{"seconds": 1.0}, {"seconds": -1e-9}]}),
                "curve[1].seconds is -0.000000001, and no time is negative",
            ),
            (json!({"latency": {"total": {"p90_s": -2}}}), "latency.total.p90_s is -2, and no time is negative"),
        ] {
            for error in [check(&value).unwrap_err(), check_text(&value.to_string(), true, 100).unwrap_err()] {
                assert!(error.to_string().starts_with(said), "{error}");
            }
            check_text(&value.to_string(), false, 100).unwrap();
        }
    }

    #[test]
    fn text_holds_no_more_values_than_its_reader_allows() {
        let values = |n: usize| format!("{{\"config\": [{}]}}", vec!["0"; n].join(","));
        check_text(&values(98), true, 100).unwrap();
        for text in [values(99), "[".repeat(101) + &"]".repeat(101), format!("{{\"a\":{}", values(99))] {
            let error = check_text(&text, true, 100).unwrap_err().to_string();
            assert!(error.contains("more than 100"), "{error}");
        }
        // What is no JSON is left to its reader.
        check_text("{\"a\": 1,", true, 100).unwrap();
    }
}
