//! Mitsuba's XML, indented.

use std::fmt::Write as _;

/// A document that grows from top to bottom.
pub(super) struct Xml {
    text: String,
    open: Vec<&'static str>,
}

impl Xml {
    pub(super) fn new() -> Self {
        Self { text: String::from("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n"), open: Vec::new() }
    }

    fn indent(&mut self) {
        self.text.push_str(&"  ".repeat(self.open.len()));
    }

    fn tag(&mut self, name: &str, attributes: &[(&str, &str)], end: &str) {
        self.indent();
        self.text.push('<');
        self.text.push_str(name);
        for (key, value) in attributes {
            // Writing to a String cannot fail.
            let _ = write!(self.text, " {key}=\"{}\"", escaped(value));
        }
        self.text.push_str(end);
        self.text.push('\n');
    }

    /// A remark, of words without two hyphens in a row.
    pub(super) fn comment(&mut self, words: &str) {
        self.indent();
        let _ = writeln!(self.text, "<!-- {words} -->");
    }

    /// Begins an element.
    pub(super) fn open(&mut self, name: &'static str, attributes: &[(&str, &str)]) {
        self.tag(name, attributes, ">");
        self.open.push(name);
    }

    /// Ends the last one begun.
    pub(super) fn close(&mut self) {
        if let Some(name) = self.open.pop() {
            self.indent();
            let _ = writeln!(self.text, "</{name}>");
        }
    }

    /// An element without content.
    pub(super) fn empty(&mut self, name: &str, attributes: &[(&str, &str)]) {
        self.tag(name, attributes, "/>");
    }

    /// A property.
    pub(super) fn value(&mut self, kind: &str, name: &str, value: &str) {
        self.empty(kind, &[("name", name), ("value", value)]);
    }

    /// A number.
    pub(super) fn float(&mut self, name: &str, value: impl std::fmt::Display) {
        self.value("float", name, &value.to_string());
    }

    /// A linear colour.
    pub(super) fn rgb(&mut self, name: &str, [r, g, b]: [f32; 3]) {
        self.value("rgb", name, &format!("{r} {g} {b}"));
    }

    /// A transform by a matrix, by rows.
    pub(super) fn matrix(&mut self, name: &str, rows: &[[f64; 4]; 4]) {
        self.open("transform", &[("name", name)]);
        let words: Vec<String> = rows.iter().flatten().map(f64::to_string).collect();
        self.empty("matrix", &[("value", &words.join(" "))]);
        self.close();
    }

    /// The whole document.
    pub(super) fn into_text(self) -> String {
        self.text
    }
}

/// A value between quotation marks. Mitsuba replaces words that begin with a dollar sign, which no value here has.
fn escaped(value: &str) -> String {
    value.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
