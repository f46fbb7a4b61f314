//! The page: its parts put into one HTML text, with the data in it (exported) or without (served).

use super::points;
use super::scene::{self, SceneDocument};
use super::splats;
use super::subject::Subject;
use crate::files::ending::check_file;
use crate::files::escape::html as escape;
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use anyhow::{Context, Result, ensure};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use corf_scene::io::write_atomic;
use serde::Serialize;
use std::path::Path;

const PAGE: &str = include_str!("assets/page.html");
const STYLE: &str = include_str!("assets/style.css");
/// The scripts, in the order in which they need each other.
const SCRIPTS: [&str; 11] = [
    include_str!("assets/math.js"),
    include_str!("assets/source.js"),
    include_str!("assets/sorter.js"),
    include_str!("assets/shaders.js"),
    include_str!("assets/renderer.js"),
    include_str!("assets/controls.js"),
    include_str!("assets/overlay.js"),
    include_str!("assets/spectrum.js"),
    include_str!("assets/panel.js"),
    include_str!("assets/growth.js"),
    include_str!("assets/main.js"),
];

/// Most characters of one element: browsers hold half a gigabyte in a string.
const MOST_CHARACTERS: usize = 500_000_000;

/// What a page may ask for: its own pictures and its own worker.
const POLICY: &str =
    "default-src 'none'; base-uri 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; worker-src blob:";

/// What a page that is served may ask for beside: the routes of its server.
pub(super) const SERVED_POLICY: &str = "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; style-src 'unsafe-inline'; \
     script-src 'unsafe-inline'; worker-src blob:; connect-src 'self'";

/// Puts values into a template's `{{NAME}}`s, once: what a value holds stays as it is.
fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut out = String::with_capacity(template.len() + values.iter().map(|v| v.1.len()).sum::<usize>());
    let mut rest = template;
    while let Some((before, (name, after))) = rest.split_once("{{").and_then(|(b, r)| Some((b, r.split_once("}}")?))) {
        out += before;
        out += values.iter().find(|v| v.0 == name).map_or("", |v| v.1);
        rest = after;
    }
    out + rest
}

fn page(scene: &SceneDocument, policy: &str, data: &str) -> String {
    let title = escape(&format!("{} – corf view", scene.title));
    let values = [
        ("TITLE", title.as_str()),
        ("POLICY", policy),
        ("STYLE", STYLE),
        ("UNIT", scene.unit),
        ("SCRIPT", &SCRIPTS.join("\n")),
        ("DATA", data),
    ];
    fill(PAGE, &values)
}

/// A page that asks the server it comes from for its data.
pub(super) fn served(scene: &SceneDocument) -> String {
    page(scene, SERVED_POLICY, "")
}

/// A page of one paragraph.
pub(super) fn notice(text: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>corf view</title></head>\n<body><p>{}</p></body></html>\n",
        escape(text)
    )
}

/// JSON that ends no element it stands in.
fn json_element(name: &str, value: &impl Serialize) -> Result<String> {
    let text = serde_json::to_string(value)?.replace('<', "\\u003c");
    Ok(format!("<script type=\"application/json\" id=\"data-{name}\">{text}</script>\n"))
}

fn bytes_element(name: &str, bytes: &[u8]) -> Result<String> {
    ensure!(
        bytes.len() / 3 * 4 < MOST_CHARACTERS,
        "{name} takes {} MB, more than a browser reads from one page\n  help: leave --export out: the page that is served has no such limit",
        bytes.len() / 1_000_000
    );
    Ok(format!("<script type=\"text/plain\" id=\"data-{name}\">{}</script>\n", STANDARD.encode(bytes)))
}

/// The field's bytes of a subject; empty where it has no Gaussians.
pub(super) fn field_bytes(subject: &Subject) -> Vec<u8> {
    let Some(run) = &subject.run else { return Vec::new() };
    match (&run.field, scene::field_layout(run)) {
        (Some((field, _)), Some(layout)) => splats::bytes(field, &layout),
        _ => Vec::new(),
    }
}

/// A page that holds all of its data.
fn exported(subject: &mut Subject) -> Result<String> {
    let scene = SceneDocument::of(subject)?;
    let mut data = json_element("scene", &scene)?;
    match &subject.run {
        Some(_) => data += &bytes_element("field", &field_bytes(subject))?,
        None => {
            for modality in ["optical", "rf"] {
                data += &bytes_element(&format!("points-{modality}"), &points::read(&subject.dataset, modality)?)?;
            }
        }
    }
    let count = subject.dataset.len();
    let mut progress = Progress::start("keyframes of the page", count, "keyframes");
    for index in 0..count {
        interrupt::check()?;
        data += &json_element(&format!("keyframe-{}", index + 1), &subject.keyframe(index)?)?;
        progress.set(index + 1, count);
    }
    progress.finish();
    Ok(page(&scene, POLICY, &data))
}

/// Writes one self-contained page, whole or not at all; returns its size in bytes.
///
/// # Errors
/// A place that cannot be written, which is found before anything is rendered; whatever keeps a keyframe from being read or rendered.
pub fn export(subject: &mut Subject, path: &Path) -> Result<usize> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    check_file("--export", path)?;
    ensure!(!path.is_dir(), "{} is a folder\n  help: name a file with --export, for example view.html", path.display());
    ensure!(folder.is_dir(), "{} is no folder, so no file can be written there\n  help: make it first", folder.display());
    tempfile::tempfile_in(folder)
        .with_context(|| format!("cannot write into {}\n  help: choose a writable place with --export", folder.display()))?;
    let html = exported(subject)?;
    write_atomic(path, html.as_bytes())?;
    Ok(html.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_template_is_filled_once() {
        let filled = fill("<a>{{TITLE}}</a>{{DATA}}{{ }}", &[("TITLE", "{{DATA}}"), ("DATA", "d")]);
        assert_eq!(filled, "<a>{{DATA}}</a>d");
        assert_eq!(fill("no end {{DATA", &[("DATA", "d")]), "no end {{DATA");
    }

    #[test]
    fn data_ends_no_element() {
        let element = json_element("scene", &"</script><b>").unwrap();
        assert_eq!(element.matches("</script>").count(), 1);
        assert!(element.contains("\\u003c/script>\\u003cb>"));
    }

    #[test]
    fn the_page_names_every_part_and_asks_nothing_of_a_network() {
        for name in ["TITLE", "POLICY", "STYLE", "UNIT", "SCRIPT", "DATA"] {
            assert!(PAGE.contains(&format!("{{{{{name}}}}}")), "{name}");
        }
        assert_eq!(SERVED_POLICY.replace("; form-action 'none'", ""), format!("{POLICY}; connect-src 'self'"));
        let all = [PAGE, STYLE, &SCRIPTS.join("\n")].concat();
        assert!(!all.contains("http://") && !all.contains("https://") && !all.contains("@import") && !all.contains("url("));
        assert!(!SCRIPTS.join("\n").contains("</script"), "a script must not end its element");
    }
}
