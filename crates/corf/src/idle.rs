//! Keys of a configuration that mean nothing beside the rest of it: who gives one is told so, instead of getting what it would have been without.

/// A key, or a table of keys, without effect in a configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IdleKey {
    /// Its name with the tables it stands in: `depth.png_scale`.
    pub key: String,
    /// Why it has none, as a main clause: `it counts with sampling = "uniform" alone`.
    pub why: &'static str,
    /// What to do.
    pub help: &'static str,
}

impl IdleKey {
    /// Of these keys those whose condition does not hold; each comes with the reason.
    pub fn all<'k>(keys: impl IntoIterator<Item = (&'k str, bool, &'static str)>) -> Vec<Self> {
        let idle = keys.into_iter().filter(|(_, counts, _)| !counts);
        idle.map(|(key, _, why)| Self { key: key.to_owned(), why, help: "leave it out" }).collect()
    }

    /// The same key where its configuration is a table of another.
    pub fn within(self, table: &str) -> Self {
        Self { key: format!("{table}.{}", self.key), ..self }
    }

    /// Whether a given key is this one, or one of the table that this is.
    pub fn is(&self, given: &str) -> bool {
        given.strip_prefix(self.key.as_str()).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_stands_for_its_keys_and_for_no_others() {
        let key = IdleKey::all([("density", false, "why"), ("rays", true, "why")]).remove(0).within("light");
        assert!(key.is("light.density") && key.is("light.density.every"));
        assert!(!key.is("light.density_of") && !key.is("density") && !key.is("light"));
    }
}
