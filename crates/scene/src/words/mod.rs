//! Words of messages: things with their number, and the word that was meant by a misspelt one.

mod nearest;

pub use nearest::nearest;

/// So many things: "1 keyframe", "2 keyframes". `thing` is a noun, or ends in one.
pub fn counted(count: usize, thing: &str) -> String {
    if count == 1 { format!("1 {thing}") } else { format!("{count} {}", plural(thing)) }
}

/// The form of a verb that goes with so many things.
pub fn verb<'v>(count: usize, of_one: &'v str, of_several: &'v str) -> &'v str {
    if count == 1 { of_one } else { of_several }
}

/// A noun's plural.
fn plural(noun: &str) -> String {
    /// Endings of one thing and of several, those of whole Latin words first.
    const ENDINGS: [(&str, &str); 7] = [
        ("spectrum", "spectra"),
        ("vertex", "vertices"),
        ("body", "bodies"),
        ("entry", "entries"),
        ("ch", "ches"),
        ("x", "xes"),
        ("s", "ses"),
    ];
    let regular = || format!("{noun}s");
    let of = |(one, several): &(&str, &str)| noun.strip_suffix(one).map(|stem| format!("{stem}{several}"));
    ENDINGS.iter().find_map(of).unwrap_or_else(regular)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_have_the_form_that_their_number_asks_for() {
        for (count, thing, said) in [
            (0, "material", "0 materials"),
            (1, "material", "1 material"),
            (2, "emissive triangle", "2 emissive triangles"),
            (3, "vertex", "3 vertices"),
            (2, "spectrum", "2 spectra"),
            (1, "open body", "1 open body"),
            (2, "open body", "2 open bodies"),
            (2, "pass", "2 passes"),
            (2, "patch", "2 patches"),
            (2, "box", "2 boxes"),
            (2, "array", "2 arrays"),
        ] {
            assert_eq!(counted(count, thing), said);
        }
        assert_eq!([0, 1, 2].map(|n| verb(n, "has", "have")), ["have", "has", "have"]);
    }
}
