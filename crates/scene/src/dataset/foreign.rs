//! Recognition of captures that others' programs made, so that a folder that is no data set is answered with the command that makes it one.

use std::path::Path;

/// Help for a folder without `dataset.json`: the command that imports it, where its layout is known.
pub(super) fn advice(dir: &Path) -> String {
    let Some(format) = recognise(dir) else {
        return "give the folder `corf dataset generate` or `corf dataset import` wrote".to_owned();
    };
    let rest = match format {
        "rf-3dgs" => " --rf-db MIN,MAX",
        _ => "",
    };
    format!(
        "this looks like a capture in the layout {format}: run `corf dataset import {} --from {format}{rest} --out FOLDER` first",
        dir.display()
    )
}

/// The layout of a folder, by the files that are in it; `None` where it is none that can be imported.
pub(super) fn recognise(dir: &Path) -> Option<&'static str> {
    let has = |name: &str| dir.join(name).exists();
    if has("gateway_info.yml") || has("tx_pos.csv") {
        return Some("nerf2");
    }
    let models = ["sparse/0", "sparse", "."];
    let is_model = |folder: &&str| {
        ["txt", "bin"].iter().any(|e| has(&format!("{folder}/images.{e}")) && has(&format!("{folder}/cameras.{e}")))
    };
    if models.iter().any(is_model) {
        return Some(if has("train_index.txt") && has("test_index.txt") { "rf-3dgs" } else { "colmap" });
    }
    if has("transforms.json") {
        return Some("nerfstudio");
    }
    (has("trajectory.json") && has("images")).then_some("corf-folder")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layouts_are_told_apart_and_other_folders_are_none() {
        let dir = tempfile::tempdir().unwrap();
        let put = |name: &str| {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        };
        assert_eq!(recognise(dir.path()), None);
        put("images/a.png");
        put("trajectory.json");
        assert_eq!(recognise(dir.path()), Some("corf-folder"));
        put("transforms.json");
        assert_eq!(recognise(dir.path()), Some("nerfstudio"));
        put("sparse/0/images.bin");
        put("sparse/0/cameras.txt");
        assert_eq!(recognise(dir.path()), Some("nerfstudio"), "half a model in either encoding is none");
        put("sparse/0/cameras.bin");
        assert_eq!(recognise(dir.path()), Some("colmap"));
        put("train_index.txt");
        put("test_index.txt");
        assert_eq!(recognise(dir.path()), Some("rf-3dgs"));
        assert!(advice(dir.path()).contains("--from rf-3dgs --rf-db"));
        put("tx_pos.csv");
        assert_eq!(recognise(dir.path()), Some("nerf2"));
    }
}
