//! Text from files and configurations as a part of other notations: whatever it says, it stays text there.

/// Control characters, line ends among them, as blanks.
fn one_line(text: &str) -> impl Iterator<Item = char> + '_ {
    text.chars().map(|c| if c.is_control() { ' ' } else { c })
}

/// Text on one line without escapes, for writers that escape it themselves.
pub fn plain(text: &str) -> String {
    one_line(text).collect()
}

/// Replaces characters by what they are written as.
fn replaced(text: &str, by: impl Fn(char) -> Option<&'static str>) -> String {
    let mut out = String::with_capacity(text.len());
    for c in one_line(text) {
        match by(c) {
            Some(written) => out.push_str(written),
            None => out.push(c),
        }
    }
    out
}

/// Escapes text for LaTeX, also behind a `\\`, which would take a bracket or a star for its argument.
pub fn latex(text: &str) -> String {
    replaced(text, |c| {
        Some(match c {
            '\\' => r"\textbackslash{}",
            '#' => r"\#",
            '$' => r"\$",
            '%' => r"\%",
            '&' => r"\&",
            '_' => r"\_",
            '{' => r"\{",
            '}' => r"\}",
            '~' => r"\textasciitilde{}",
            '^' => r"\textasciicircum{}",
            '<' => r"\textless{}",
            '>' => r"\textgreater{}",
            '|' => r"\textbar{}",
            '[' => "{[}",
            ']' => "{]}",
            '*' => "{*}",
            _ => return None,
        })
    })
}

/// Quotes text as a CSV cell; text that a spreadsheet would take for a formula is marked as text by an apostrophe in front.
pub fn csv(text: &str) -> String {
    let formula = text.trim_start().starts_with(['=', '+', '-', '@']) || text.starts_with(['\t', '\r', '\n']);
    format!("\"{}{}\"", if formula { "'" } else { "" }, replaced(text, |c| (c == '"').then_some("\"\"")))
}

/// Escapes text for Markdown, in tables too.
pub fn markdown(text: &str) -> String {
    replaced(text, |c| {
        Some(match c {
            '\\' => r"\\",
            '|' => r"\|",
            '`' => r"\`",
            '*' => r"\*",
            '_' => r"\_",
            '[' => r"\[",
            ']' => r"\]",
            '~' => r"\~",
            '$' => r"\$",
            '<' => "&lt;",
            '>' => "&gt;",
            '&' => "&amp;",
            _ => return None,
        })
    })
}

/// A paragraph that may be Markdown, without HTML.
pub fn without_html(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

/// Escapes text for HTML, in attributes too.
pub fn html(text: &str) -> String {
    replaced(text, |c| {
        Some(match c {
            '&' => "&amp;",
            '<' => "&lt;",
            '>' => "&gt;",
            '"' => "&quot;",
            '\'' => "&#39;",
            _ => return None,
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const NASTY: &str = "\\ # $ % & _ { } ~ ^ | ` <b> \"q\" 'p'\n\x1b[2J";

    #[test]
    fn latex_has_no_character_left_that_it_obeys() {
        let text = latex(NASTY);
        assert!(text.starts_with(
            r"\textbackslash{} \# \$ \% \& \_ \{ \} \textasciitilde{} \textasciicircum{} \textbar{} ` \textless{}b"
        ));
        assert!(!text.contains(['\n', '\x1b']));
        assert_eq!(latex("[1] *x"), "{[}1{]} {*}x");
    }

    #[test]
    fn csv_cells_are_quoted_and_no_formulas() {
        assert_eq!(csv("a,\"b\"\nc"), "\"a,\"\"b\"\" c\"");
        for formula in ["=1+1", "+1", "-1", "@x", " =1", "\t=1"] {
            assert!(csv(formula).starts_with("\"'"), "{formula}");
        }
        assert_eq!(csv("w/o joint"), "\"w/o joint\"");
    }

    #[test]
    fn markdown_and_html_stay_text() {
        let text = markdown(NASTY);
        assert!(text.contains(r"\|") && text.contains(r"\`") && text.contains("&lt;b&gt;"), "{text}");
        assert!(!text.contains(['\n', '<']) && !text.replace(r"\|", "").contains('|'), "{text}");
        assert_eq!(html("<a href=\"x\" title='y'>&\x1b"), "&lt;a href=&quot;x&quot; title=&#39;y&#39;&gt;&amp; ");
        assert_eq!(without_html("a *word* <script>"), "a *word* &lt;script>");
    }
}
