//! The report of a comparison, read by a parser: every held-out keyframe of every row, the best marked, nothing asked of a network.

use crate::common::*;
use roxmltree::{Document, Node, ParsingOptions};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Labels with what a page and an attribute would take for theirs.
const LABELS: [&str; 2] = ["nearest, <b>'raw'</b>", "blend & \"x\""];

/// Ten keyframes whose light is quick and poor: what is in the pictures does not matter here.
fn quick_dataset() -> &'static Path {
    static DATASET: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, path) = DATASET.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let config = tiny_config(folder.path(), 10);
        let out = folder.path().join("dataset");
        corf_ok(&["dataset", "generate", text(&config), "--out", text(&out)]);
        (folder, out)
    });
    path
}

/// A comparison of the two lookups, two seeds.
fn comparison(folder: &Path) -> PathBuf {
    let (plan, out) = (folder.join("plan.toml"), folder.join("out"));
    let row = |label: &str, method: &str| format!("[[row]]\nlabel = {}\nmethod = \"{method}\"\n", serde_json::json!(label));
    let rows = row(LABELS[0], "nearest") + &row(LABELS[1], "inverse-distance");
    let head = format!("name = \"two <lookups>\"\ndataset = {:?}\nseeds = [1, 2]\n", quick_dataset());
    fs::write(&plan, head + &rows).unwrap();
    corf_ok(&["bench", "run", text(&plan), "--out", text(&out), "--device", "cpu"]);
    out
}

fn parsed(html: &str) -> Document<'_> {
    Document::parse_with_options(html, ParsingOptions { allow_dtd: true, ..ParsingOptions::default() }).unwrap()
}

fn all<'a, 'i>(node: Node<'a, 'i>, tag: &str) -> Vec<Node<'a, 'i>> {
    node.descendants().filter(|n| n.has_tag_name(tag)).collect()
}

fn class(node: &Node<'_, '_>) -> String {
    node.attribute("class").unwrap_or("").to_owned()
}

#[test]
fn every_held_out_keyframe_of_every_row_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let out = comparison(folder.path());
    let html = fs::read_to_string(out.join("report.html")).unwrap();
    let document = parsed(&html);
    let root = document.root();

    // Keyframes 0 and 8 of 10 are held out.
    let articles = all(root, "article");
    assert_eq!(articles.iter().map(|a| a.attribute("id").unwrap()).collect::<Vec<_>>(), ["keyframe-1", "keyframe-9"]);
    for article in &articles {
        let images = all(*article, "img");
        assert_eq!(images.iter().filter(|i| class(i) == "observed").count(), 2, "image and spectrum");
        for row in ["0", "1"] {
            let of = images.iter().filter(|i| i.attribute("data-row") == Some(row));
            let (predicted, errors): (Vec<&Node<'_, '_>>, Vec<&Node<'_, '_>>) = of.partition(|i| class(i) == "predicted");
            assert_eq!((predicted.len(), errors.len()), (2, 2), "image and spectrum, each with its error");
            // One row is seen at a time.
            assert!(predicted.iter().chain(&errors).all(|i| i.attribute("hidden").is_some() == (row != "0")));
        }
        let sliders = all(*article, "input");
        assert_eq!(sliders.len(), 2);
        assert!(sliders.iter().all(|s| s.attribute("type") == Some("range") && s.attribute("aria-label").unwrap().len() > 20));
        let psnr = all(*article, "span")
            .iter()
            .filter(|s| s.text().is_some_and(|t| t.starts_with("PSNR ") && t.ends_with(" dB")))
            .count();
        assert_eq!(psnr, 4, "two rows, two halves");
    }
    let options: Vec<&str> = all(root, "option").iter().map(|o| o.text().unwrap()).collect();
    assert_eq!(options, LABELS);

    // Figures along the way, in the page and beside it.
    let along = root.descendants().find(|n| class(n) == "along").unwrap();
    assert_eq!(all(along, "svg").len(), 3);
    for figure in ["beam.svg", "rate.svg", "outage.svg"] {
        let svg = fs::read_to_string(out.join(figure)).unwrap();
        let names: Vec<String> = all(parsed(&svg).root(), "text").iter().map(|t| t.text().unwrap().trim().to_owned()).collect();
        assert!(LABELS.iter().all(|label| names.iter().any(|name| name == label)), "{figure}: {names:?}");
        assert!(names.iter().any(|name| name == "distance travelled, m"), "{figure}: {names:?}");
    }

    // Of two seeds nothing is the best.
    let cells: Vec<Vec<Node<'_, '_>>> = all(all(root, "tbody")[0], "tr").iter().map(|line| all(*line, "td")).collect();
    assert!(cells.len() == 2 && cells.iter().flatten().all(|cell| class(cell) != "best"));

    // Nothing is asked of a network, and text stays text.
    assert!(
        all(root, "img")
            .iter()
            .all(|i| i.attribute("src").unwrap().starts_with("data:image/") && i.attribute("alt").unwrap().len() > 8)
    );
    for node in root.descendants().filter(Node::is_element) {
        assert!(!["link", "iframe", "object", "embed", "form"].contains(&node.tag_name().name()), "{:?}", node.tag_name());
        for name in ["src", "href", "action", "data", "srcset"] {
            assert!(node.attribute(name).is_none_or(|value| value.starts_with("data:image/")), "{name} of {:?}", node.tag_name());
        }
        for attribute in node.attributes() {
            assert!(!attribute.value().contains("url(") && !attribute.name().starts_with("on"), "{}", attribute.name());
        }
    }
    let outside = html.replace("http://www.w3.org/", "");
    assert!(
        !outside.contains("://") && !outside.contains("url(") && !outside.contains("@import"),
        "names of XML are no addresses, others are"
    );
    assert!(html.contains("default-src 'none'") && html.contains("&lt;b&gt;"));
    assert!(all(root, "title")[0].text().unwrap().contains("two <lookups>"));
    assert!(html.len() < 2_000_000, "{}", html.len());
}

#[test]
fn a_report_is_the_same_each_time_and_says_what_was_not_kept() {
    let folder = tempfile::tempdir().unwrap();
    let out = comparison(folder.path());
    let read = || fs::read_to_string(out.join("report.html")).unwrap();
    let first = read();
    corf_ok(&["bench", "report", text(&out), "--threads", "1"]);
    assert!(read() == first, "the same records and predictions give the same bytes");

    // As earlier versions kept it: some keyframes, images as PNG.
    let kept = out.join("predictions/blend-x");
    let jpeg = image::open(kept.join("00001-optical.jpg")).unwrap();
    jpeg.save(kept.join("00001-optical.png")).unwrap();
    for name in ["00001-optical.jpg", "00009-optical.jpg", "00009-spectrum.png"] {
        fs::remove_file(kept.join(name)).unwrap();
    }
    corf_ok(&["bench", "report", text(&out)]);
    let html = read();
    let document = parsed(&html);
    let predicted = |article: &Node<'_, '_>| {
        all(*article, "img").iter().filter(|i| class(i) == "predicted" && i.attribute("data-row") == Some("1")).count()
    };
    let articles = all(document.root(), "article");
    assert_eq!(articles.iter().map(predicted).collect::<Vec<_>>(), [2, 0]);
    assert_eq!(html.matches("no prediction kept").count(), 2);
}

#[test]
fn the_papers_tables_stand_beside_what_was_run() {
    let folder = tempfile::tempdir().unwrap();
    let (out, paper) = (comparison(folder.path()), folder.path().join("paper"));
    corf_ok(&["bench", "paper", text(&out), "--out", text(&paper)]);
    let read = |name: &str| fs::read_to_string(paper.join(name)).unwrap();
    assert!(read("paper.md").contains("| NeRF² | – | not run | 12.17 |") && read("paper.tex").contains("not run & $18.52$"));
    assert!(Document::parse(&read("paper.svg")).is_ok());
    corf_refuses(&["bench", "paper", text(&paper.join("none"))], &["plan.toml"]);
    let written = corf_ok(&["bench", "paper", "results/2026-11-27-lobby147", "--out", text(&paper)]);
    assert_eq!(written.lines().count(), 4);
    // Published records: the row of the paper's main result, and an ablation, by the numbers of the published table.
    let csv = read("paper.csv");
    let ours = |start: &str| -> f64 {
        let line = csv.lines().find(|l| l.starts_with(start)).unwrap_or_else(|| panic!("{start}: {csv}"));
        line.split(',').nth(6).unwrap().parse().unwrap()
    };
    assert!((ours("I,\"CORF-GS\",corf-gs,\"CORF-GS\",psnr_rf,done,") - 25.71).abs() < 0.005);
    assert!(
        (ours("IV,\"w/o joint (frozen geometry)\",corf-gs-frozen,\"w/o joint (frozen geometry)\",psnr_opt,done,") - 30.12).abs()
            < 0.005
    );
}
