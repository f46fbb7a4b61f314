//! Radio materials guessed by the names of a mesh's materials.

use corf_scene::Scene;

/// Radio properties that a name suggests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guess {
    /// Words one of which the name holds, whole or in the plural; of one that ends in `*`, words that begin so.
    words: &'static [&'static str],
    /// Lines of its entry.
    pub entry: Entry,
    /// Slab thickness, metres.
    pub thickness_m: f64,
    /// Share of the reflected field that is scattered.
    pub scattering: f64,
}

/// Permittivity of a guess.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Entry {
    /// A name of ITU-R P.2040-3, Table 3, that holds at 60 GHz.
    Itu(&'static str),
    /// Relative permittivity and conductivity at 60 GHz, S/m, of what the table has no row for: of the order of published measurements.
    Constant(f64, f64),
}

const fn guess(words: &'static [&'static str], entry: Entry, thickness_m: f64, scattering: f64) -> Guess {
    Guess { words, entry, thickness_m, scattering }
}

/// Guesses, the most telling words first: a "glass door" is glass, a "wooden floor" wood, a "carpet tile" a carpet.
const GUESSES: [Guess; 13] = [
    guess(&["glass", "glazing", "glas", "window", "pane", "mirror", "screen", "monitor"], Entry::Itu("glass"), 0.008, 0.0),
    guess(
        &["metal", "metallic", "steel", "iron", "alumin*", "brass", "chrome", "copper", "radiator", "metall", "stahl"],
        Entry::Itu("metal"),
        0.002,
        0.05,
    ),
    guess(
        &["cloth", "tablecloth", "fabric", "textile", "carpet", "rug", "curtain", "sofa", "cushion", "leather", "felt", "wool"],
        Entry::Constant(1.5, 0.04),
        0.006,
        0.5,
    ),
    guess(&["concrete", "cement", "beton", "brick", "clay", "masonry", "screed"], Entry::Itu("concrete"), 0.1, 0.3),
    guess(&["marble", "granite", "stone", "tile", "ceramic", "porcelain", "terrazzo"], Entry::Itu("marble"), 0.02, 0.1),
    guess(&["chipboard", "mdf", "particle", "laminate", "melamine"], Entry::Itu("chipboard"), 0.019, 0.2),
    guess(&["parquet", "floorboard", "plank"], Entry::Itu("floorboard"), 0.02, 0.2),
    guess(
        &[
            "wood", "wooden", "oak", "walnut", "timber", "pine", "birch", "holz", "bois", "door", "table", "desk", "shelf",
            "cabinet",
        ],
        Entry::Itu("wood"),
        0.03,
        0.3,
    ),
    guess(&["ceiling", "acoustic"], Entry::Itu("ceiling_board"), 0.02, 0.2),
    guess(&["plaster*", "gypsum", "drywall", "putz", "wall", "paint"], Entry::Itu("plasterboard"), 0.013, 0.3),
    guess(&["plastic", "pvc", "acryl*", "rubber", "vinyl", "polymer", "polycarbonate"], Entry::Constant(2.6, 0.06), 0.003, 0.1),
    guess(&["lamp", "bulb"], Entry::Itu("glass"), 0.003, 0.0),
    guess(&["floor", "ground", "boden"], Entry::Itu("concrete"), 0.2, 0.3),
];

/// What stands for a material whose name says nothing.
pub const UNKNOWN: Guess = guess(&[], Entry::Itu("plasterboard"), 0.013, 0.3);

impl Guess {
    /// What a material's name suggests, and the word that does.
    pub fn by_name(name: &str) -> Option<(Self, &'static str)> {
        let said = words_of(name);
        let holds = |word: &str| match word.strip_suffix('*') {
            Some(stem) => said.iter().any(|given| given.starts_with(stem)),
            None => said.iter().any(|given| given == word || given.strip_suffix('s') == Some(word)),
        };
        let of = |guess: Guess| guess.words.iter().find(|word| holds(word)).map(|word| (guess, word.trim_end_matches('*')));
        GUESSES.into_iter().find_map(of)
    }

    /// The lines of its entry under `[radio_materials]`.
    pub fn lines(&self) -> String {
        let Self { thickness_m, scattering, .. } = self;
        let slab = format!("thickness_m = {thickness_m}\nscattering_coefficient = {scattering}\n");
        match self.entry {
            Entry::Itu(name) => format!("itu = \"{name}\"\n{slab}"),
            Entry::Constant(permittivity, conductivity) => {
                format!("relative_permittivity = {permittivity}\nconductivity_s_per_m = {conductivity}\n{slab}")
            }
        }
    }
}

/// The words of a name, in small letters: parted at everything but letters, and before a capital behind a small letter.
fn words_of(name: &str) -> Vec<String> {
    let mut parted = String::new();
    let mut small = false;
    for letter in name.chars() {
        if !letter.is_alphabetic() || (small && letter.is_uppercase()) {
            parted.push(' ');
        }
        small = letter.is_lowercase();
        parted.extend(letter.is_alphabetic().then_some(letter));
    }
    parted.to_lowercase().split_whitespace().map(str::to_owned).collect()
}

/// The entries of all materials, in the mesh's order, and the names of those that nothing is known of.
pub fn entries(scene: &Scene) -> (String, Vec<String>) {
    let mut used = vec![false; scene.materials.len()];
    scene.triangles.iter().for_each(|t| used[t.material as usize] = true);
    let (mut text, mut unknown) = (String::new(), Vec::new());
    for (material, used) in scene.materials.iter().zip(used) {
        let key = toml::Value::String(material.name.clone());
        let idle = if used { "" } else { "; no triangle uses it" };
        if let Some(radio) = &material.radio {
            text += &format!(
                "# {key}: the mesh file itself says what it is ({}){idle}. An entry of this name here would replace that.\n\n",
                radio.id
            );
            continue;
        }
        let (guess, why) = match Guess::by_name(&material.name) {
            Some((guess, word)) => (guess, format!("# GUESSED by \"{word}\" in its name{idle}: check material and thickness.\n")),
            None => {
                unknown.push(material.name.clone());
                let why = format!(
                    "# TO BE FILLED IN{idle}: its name says nothing. This is a board of plaster, so that the scene can be traced.\n"
                );
                (UNKNOWN, why)
            }
        };
        text += &format!("{why}[radio_materials.{key}]\n{}\n", guess.lines());
    }
    (text, unknown)
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::itu;

    #[test]
    fn names_suggest_materials_that_are_known_at_60_ghz() {
        for (name, entry) in [
            ("Window_Glass.001", Some(Entry::Itu("glass"))),
            ("Concrete wall", Some(Entry::Itu("concrete"))),
            ("MAT_oak", Some(Entry::Itu("wood"))),
            ("glass door", Some(Entry::Itu("glass"))),
            ("WallPlasterboard", Some(Entry::Itu("plasterboard"))),
            ("floorTiles02", Some(Entry::Itu("marble"))),
            ("brushed_aluminium", Some(Entry::Itu("metal"))),
            ("ceiling_panel", Some(Entry::Itu("ceiling_board"))),
            ("textile", Some(Entry::Constant(1.5, 0.04))),
            ("tablecloth", Some(Entry::Constant(1.5, 0.04))),
            ("Carpet tile", Some(Entry::Constant(1.5, 0.04))),
            // Words that only sound like others inside of them.
            ("environment", None),
            ("Untitled", None),
            ("light_grey", None),
            ("polygon", None),
            ("Material.003", None),
        ] {
            assert_eq!(Guess::by_name(name).map(|(guess, _)| guess.entry), entry, "{name}");
        }
        for guess in GUESSES.iter().chain([&UNKNOWN]) {
            if let Entry::Itu(name) = guess.entry {
                itu::properties(name, 60e9).unwrap();
            }
            assert!(guess.thickness_m > 0.0 && (0.0..=1.0).contains(&guess.scattering));
        }
    }
}
