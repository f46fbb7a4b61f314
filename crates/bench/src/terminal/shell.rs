//! Text as words of a shell's line.

/// Text as one word of a shell script, in quotes.
pub fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// A word as it is typed: in quotes only where the shell would take it otherwise.
pub fn word(text: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "/._-+:@%".contains(c);
    if !text.is_empty() && text.chars().all(plain) { text.to_owned() } else { quoted(text) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_blanks_and_quotes_are_one_word_of_the_next_command() {
        assert_eq!(word("runs/a-1"), "runs/a-1");
        assert_eq!(word("my runs/it's"), "'my runs/it'\\''s'");
        assert_eq!(word(""), "''");
    }
}
