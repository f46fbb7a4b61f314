//! Licences of data.

/// A licence by the name that Hugging Face knows it by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Licence {
    /// Hugging Face's name, in small letters.
    pub id: &'static str,
    /// SPDX's.
    pub spdx: &'static str,
    /// In words.
    pub name: &'static str,
    /// Where its text is.
    pub url: &'static str,
}

/// Those that data are published under.
const KNOWN: [Licence; 9] = [
    known("cc0-1.0", "CC0-1.0", "Creative Commons Zero 1.0 Universal", "https://creativecommons.org/publicdomain/zero/1.0/"),
    known(
        "cc-by-4.0",
        "CC-BY-4.0",
        "Creative Commons Attribution 4.0 International",
        "https://creativecommons.org/licenses/by/4.0/",
    ),
    known(
        "cc-by-sa-4.0",
        "CC-BY-SA-4.0",
        "Creative Commons Attribution-ShareAlike 4.0 International",
        "https://creativecommons.org/licenses/by-sa/4.0/",
    ),
    known(
        "cc-by-nc-4.0",
        "CC-BY-NC-4.0",
        "Creative Commons Attribution-NonCommercial 4.0 International",
        "https://creativecommons.org/licenses/by-nc/4.0/",
    ),
    known(
        "cc-by-nc-sa-4.0",
        "CC-BY-NC-SA-4.0",
        "Creative Commons Attribution-NonCommercial-ShareAlike 4.0 International",
        "https://creativecommons.org/licenses/by-nc-sa/4.0/",
    ),
    known("odc-by", "ODC-By-1.0", "Open Data Commons Attribution License 1.0", "https://opendatacommons.org/licenses/by/1-0/"),
    known("odbl", "ODbL-1.0", "Open Data Commons Open Database License 1.0", "https://opendatacommons.org/licenses/odbl/1-0/"),
    known(
        "pddl",
        "PDDL-1.0",
        "Open Data Commons Public Domain Dedication and License 1.0",
        "https://opendatacommons.org/licenses/pddl/1-0/",
    ),
    known(
        "cdla-permissive-2.0",
        "CDLA-Permissive-2.0",
        "Community Data License Agreement Permissive 2.0",
        "https://cdla.dev/permissive-2-0/",
    ),
];

const fn known(id: &'static str, spdx: &'static str, name: &'static str, url: &'static str) -> Licence {
    Licence { id, spdx, name, url }
}

impl std::str::FromStr for Licence {
    type Err = String;

    /// By either name, in whatever letters.
    fn from_str(text: &str) -> Result<Self, String> {
        let found = KNOWN.into_iter().find(|l| l.id.eq_ignore_ascii_case(text) || l.spdx.eq_ignore_ascii_case(text));
        found.ok_or_else(|| format!("\"{text}\" is none of the licences of data: {}", KNOWN.map(|l| l.id).join(", ")))
    }
}

impl Licence {
    /// What the file LICENSE says.
    pub(super) fn text(&self) -> String {
        format!(
            "These data are published under the {} ({}).\nIts full text: {}\n\nThe program that wrote the files, corf, has a licence of its own, \
             which says nothing of the data.\n",
            self.name, self.spdx, self.url
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn licences_have_two_names() {
        for name in ["odbl", "ODbL-1.0", "ODBL"] {
            assert_eq!(name.parse::<Licence>().unwrap().spdx, "ODbL-1.0");
        }
        assert!("mit".parse::<Licence>().unwrap_err().contains("cc-by-4.0"));
    }
}
