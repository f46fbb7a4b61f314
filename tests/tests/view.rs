//! `corf view`: the page that is written, the server and what it refuses.

use crate::common::*;
use serde_json::Value;
use std::fs;
use std::net::TcpListener;
use std::path::Path;

/// A small run on the tiny data set.
fn run_in(folder: &Path) -> std::path::PathBuf {
    let run = folder.join("run");
    let few = ["--set", "iterations_per_keyframe=4", "--no-verify"];
    corf_ok(&[&["reconstruct", text(tiny_dataset()), "--out", text(&run), "--device", "cpu"], &few[..]].concat());
    run
}

/// The JSON of an exported page's element.
fn element(html: &str, name: &str) -> Value {
    let (_, rest) = html.split_once(&format!("id=\"data-{name}\">")).unwrap_or_else(|| panic!("no {name}"));
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

#[test]
fn a_page_is_one_file_that_holds_everything() {
    let folder = tempfile::tempdir().unwrap();
    let run = run_in(folder.path());
    let out = folder.path().join("out");
    fs::create_dir(&out).unwrap();
    let page = out.join("view.html");
    let arguments = ["view", text(&run), "--export", text(&page), "--device", "cpu", "--no-verify"];
    corf_ok(&arguments);
    assert_eq!(fs::read_dir(&out).unwrap().count(), 1, "one file and nothing beside it");
    let html = fs::read_to_string(&page).unwrap();
    assert!(!html.contains("http://") && !html.contains("https://") && !html.contains(" src=\"") && !html.contains("<link"));
    assert!(html.contains("default-src 'none'") && !html.contains("connect-src"), "the page may ask nothing of a network");
    let scene = element(&html, "scene");
    let info: Value = serde_json::from_slice(&fs::read(run.join("run.json")).unwrap()).unwrap();
    assert_eq!(scene["field"]["count"], info["gaussians"]);
    let roles: Vec<&str> = scene["keyframes"].as_array().unwrap().iter().map(|k| k["role"].as_str().unwrap()).collect();
    assert_eq!(roles, ["test", "train", "train", "train", "train", "train", "train", "train", "test", "train"]);
    for number in 1..=10 {
        let keyframe = element(&html, &format!("keyframe-{number}"));
        for (half, key) in [("image", "predicted"), ("image", "error"), ("spectrum", "observed"), ("spectrum", "predicted")] {
            assert!(keyframe[half][key].as_str().unwrap().len() > 100, "{number}: {half}, {key}");
        }
        assert!(!keyframe["spectrum"]["peaks_observed"].as_array().unwrap().is_empty());
    }
    // The numbers are those of `corf evaluate`.
    let metrics: Value = serde_json::from_str(&corf_ok(&["evaluate", text(&run), "--json", "--device", "cpu"])).unwrap();
    let keyframe = element(&html, "keyframe-9");
    let shown: f64 = keyframe["numbers"][0]["value"].as_str().unwrap().parse().unwrap();
    assert!((metrics["frames"][1]["psnr_opt"].as_f64().unwrap() - shown).abs() < 0.006, "{shown}");
    // Without a record it opens in the middle of what is held out, with one on what was predicted best there.
    assert_eq!(scene["opening"], 8);
    corf_ok(&arguments);
    let before = fs::read(&page).unwrap();
    let sum = |frame: &Value| frame["psnr_opt"].as_f64().unwrap() + frame["psnr_rf_scalar"].as_f64().unwrap();
    let best = metrics["frames"].as_array().unwrap().iter().max_by(|a, b| sum(a).total_cmp(&sum(b))).unwrap();
    assert_eq!(element(&fs::read_to_string(&page).unwrap(), "scene")["opening"], best["index"]);
    // The same again, over the old file.
    corf_ok(&arguments);
    assert!(fs::read(&page).unwrap() == before);
    let bytes = before.len();
    corf_ok(&["view", text(tiny_dataset()), "--export", text(&page), "--no-verify"]);
    let html = fs::read_to_string(&page).unwrap();
    assert!(html.len() != bytes && element(&html, "scene")["points"]["optical"].as_u64().unwrap() > 100);
    assert!(element(&html, "keyframe-1")["image"]["predicted"].is_null());
}

#[test]
fn a_report_links_to_a_page_of_the_model_that_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let (plan, out) = (folder.path().join("plan.toml"), folder.path().join("out"));
    let row =
        "[[row]]\nlabel = \"CORF-GS <1>\"\nmethod = \"corf-gs\"\nkeep_model = true\nconfig = { iterations_per_keyframe = 2 }\n";
    fs::write(&plan, format!("name = \"kept\"\ndataset = {:?}\nseeds = [1]\n{row}", tiny_dataset())).unwrap();
    let arguments = ["bench", "run", text(&plan), "--out", text(&out), "--device", "cpu", "--no-verify"];
    corf_ok(&arguments);
    let (page, report) = (out.join("viewer.html"), || fs::read_to_string(out.join("report.html")).unwrap());
    let link = "<a href=\"viewer.html\">Look around in the field of CORF-GS &lt;1&gt;</a>";
    assert!(report().contains(link));
    // It is the page that `corf view --export` writes of the model.
    let own = folder.path().join("own.html");
    corf_ok(&["view", text(&out), "--export", text(&own), "--device", "cpu"]);
    assert!(fs::read(&page).unwrap() == fs::read(&own).unwrap());
    // No link leads nowhere; and a page that has gone is written again.
    fs::remove_file(&page).unwrap();
    corf_ok(&["bench", "report", text(&out), "--no-verify"]);
    assert!(!report().contains("viewer.html"));
    corf_ok(&[&arguments[..], &["--resume"]].concat());
    assert!(page.exists() && report().contains(link));
}

#[test]
fn what_cannot_be_viewed_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let run = run_in(folder.path());
    let missing = folder.path().join("missing");
    corf_refuses(&["view", text(&missing)], &["missing", "no folder", "help"]);
    corf_refuses(&["view", text(folder.path())], &["neither a run nor a data set", "run.json", "help"]);
    let dataset = text(tiny_dataset());
    corf_refuses(&["view", dataset, "--dataset", dataset], &["is a data set itself"]);
    corf_refuses(&["view", text(&run), "--export", text(&run)], &["is a folder", "--export"]);
    corf_refuses(&["view", text(&run), "--export", text(&missing.join("view.html"))], &["missing", "help"]);
    assert!(!missing.exists());
    corf_refuses(&["view", text(&run), "--export", "v.html", "--port", "80"], &["--port", "--export"]);
    // A comparison that keeps no model.
    let comparison = folder.path().join("comparison");
    fs::create_dir(&comparison).unwrap();
    fs::write(comparison.join("plan.toml"), "").unwrap();
    corf_refuses(&["view", text(&comparison)], &["no model", "keep_model"]);
    // A data set that has moved.
    let info = run.join("run.json");
    let moved = fs::read_to_string(&info).unwrap().replace(dataset, text(&missing));
    fs::write(&info, moved).unwrap();
    corf_refuses(&["view", text(&run)], &["missing", "--dataset"]);
    let page = folder.path().join("view.html");
    corf_ok(&["view", text(&run), "--dataset", dataset, "--export", text(&page), "--no-verify"]);
    // A field that is cut short, and a run that is not finished.
    let field = fs::read(run.join("coupled.ply")).unwrap();
    fs::write(run.join("coupled.ply"), &field[..field.len() - 9]).unwrap();
    fs::remove_file(&page).unwrap();
    corf_refuses(&["view", text(&run), "--dataset", dataset, "--export", text(&page)], &["coupled.ply", "truncated"]);
    assert!(!page.exists());
    fs::remove_file(&info).unwrap();
    corf_refuses(&["view", text(&run)], &["no finished run"]);
}

#[test]
fn the_server_answers_to_its_own_name_and_routes_alone() {
    let served = Served::start(text(tiny_dataset()), &[]);
    let own = served.page.host();
    let ask = |method: &str, target: &str, host: &str| served.page.try_ask(method, target, host).unwrap();
    let page = ask("GET", "/", &own);
    assert!(page.status == 200 && page.header("content-type").unwrap().contains("text/html"), "{}", page.head);
    assert!(String::from_utf8(page.body).unwrap().contains("connect-src 'self'"));
    let scene = ask("GET", "/data/scene", &format!("localhost:{}", served.page.port));
    assert!(scene.status == 200 && scene.header("content-type") == Some("application/json"), "{}", scene.head);
    let scene = scene.json();
    let points = ask("GET", "/data/points-optical", &own);
    assert_eq!((points.status, points.body.len() as u64), (200, 16 * scene["points"]["optical"].as_u64().unwrap()));
    let keyframe = ask("GET", "/data/keyframe-10", &own);
    assert!(keyframe.status == 200 && keyframe.json()["image"]["observed"].as_str().unwrap().starts_with("data:image/"));
    let head = ask("HEAD", "/data/scene", &own);
    assert_eq!((head.status, head.body.len()), (200, 0));
    for target in ["/dataset.json", "/data/../dataset.json", "/%2e%2e/dataset.json", "/data/keyframe-11", "/favicon.ico"] {
        assert_eq!(ask("GET", target, &own).status, 404, "{target}");
    }
    assert_eq!(ask("POST", "/data/scene", &own).status, 405);
    for host in ["evil.example", "evil.example:80", "127.0.0.1", "169.254.169.254"] {
        assert_eq!(ask("GET", "/", host).status, 403, "{host}");
    }
}

#[test]
fn a_port_in_use_is_named() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    corf_refuses(&["view", text(tiny_dataset()), "--no-verify", "--port", &port], &[&port, "another", "--port"]);
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_the_server_cleanly() {
    let mut served = Served::start(text(tiny_dataset()), &[]);
    let kill = std::process::Command::new("kill").args(["-INT", &served.child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    assert_eq!(served.child.wait().unwrap().code(), Some(0));
    assert!(served.page.connect().is_err(), "nobody listens any more");
}
