//! The word that was meant by a misspelt or shortened one: one rule for keys, choices, columns, methods and names of scenes' parts.

/// Letters from which on the beginning of a word stands for it.
const LEAST_OF_A_BEGINNING: usize = 3;

/// The candidate nearest to `given` in edit distance, if it is near enough to be a misspelling; what `given` is the beginning of is one edit away.
/// Of several as near the first. Letters' case does not count.
pub fn nearest<'a>(given: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let given = given.to_lowercase();
    let is_long = given.chars().count() >= LEAST_OF_A_BEGINNING;
    let distance = |candidate: &str| {
        let candidate = candidate.to_lowercase();
        if is_long && candidate.starts_with(&given) { (candidate != given).into() } else { edit_distance(&given, &candidate) }
    };
    candidates
        .into_iter()
        .map(|candidate| (distance(candidate), candidate))
        .min_by_key(|(distance, _)| *distance)
        .filter(|(distance, candidate)| *distance <= 1 + given.len().max(candidate.len()) / 3)
        .map(|(_, candidate)| candidate)
}

/// Levenshtein distance over characters.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let substituted = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = substituted.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edit_distance_of_textbook_words() {
        assert_eq!(edit_distance("kitten", "sitting"), 3);
        assert_eq!(edit_distance("", "abc"), 3);
        assert_eq!(edit_distance("same", "same"), 0);
    }

    #[test]
    fn a_misspelling_is_known_and_another_word_is_none() {
        assert_eq!(nearest("keyframe", ["keyframes", "seed"]), Some("keyframes"));
        assert_eq!(nearest("Conkrete", ["plaster", "concrete"]), Some("concrete"));
        assert_eq!(nearest("zzzzzz", ["keyframes", "seed"]), None);
        assert_eq!(nearest("", ["keyframes"]), None);
    }

    #[test]
    fn a_beginning_stands_for_the_first_word_that_has_it() {
        let columns = ["psnr_opt", "ssim_opt", "psnr_rf_jet", "psp_similarity"];
        assert_eq!(nearest("psnr", columns), Some("psnr_opt"));
        assert_eq!(nearest("psnr_rf", columns), Some("psnr_rf_jet"));
        // Two letters say nothing, and what is the word itself is nearer than what begins with it.
        assert_eq!(nearest("ps", columns), None);
        assert_eq!(nearest("seeds", ["seeds_of_all", "seeds"]), Some("seeds"));
    }
}
