//! Paths of a dataset's files, relative to its folder.

/// The file stem of keyframe `index`: counted from 1, five digits.
pub fn stem(index: usize) -> String {
    format!("{:05}", index + 1)
}

pub(super) const DATASET_JSON: &str = "dataset.json";
pub(super) const TRAJECTORY_JSON: &str = "trajectory.json";
/// Header of a dataset in the making; gone once `dataset.json` is there.
pub(super) const PARTIAL_JSON: &str = "dataset.partial.json";
/// Folder of the RF images made by the recipe of published sets.
pub(super) const TUTORIAL_ROOT: &str = "rf-tutorial";
/// One record a finished keyframe; gone once `dataset.json` is there.
pub(super) const PROGRESS_DIR: &str = "progress";

pub(super) const LINEAR: &str = "linear";
pub(super) const ALBEDO: &str = "albedo";
pub(super) const NORMALS: &str = "normals";

pub(super) fn image(index: usize) -> String {
    format!("optical/images/{}.png", stem(index))
}
/// A float image of three channels: [`LINEAR`], [`ALBEDO`] or [`NORMALS`].
pub(super) fn float_image(name: &str, index: usize) -> String {
    format!("optical/{name}/{}.exr", stem(index))
}
pub(super) fn depth(index: usize) -> String {
    format!("optical/depth/{}.exr", stem(index))
}
pub(super) fn surface(index: usize) -> String {
    format!("optical/surfaces/{}.exr", stem(index))
}
/// Which pixels of the image count. Not called as the image is, as the file below.
pub(super) fn mask(index: usize) -> String {
    format!("optical/masks/{}_mask.png", stem(index))
}
/// Not called as the image is: readers that match images by their last letters would take it for one.
pub(super) fn depth_png(index: usize) -> String {
    format!("optical/depth_mm/{}_depth.png", stem(index))
}
pub(super) fn spectrum(index: usize) -> String {
    format!("rf/spectra/{}.exr", stem(index))
}
pub(super) fn radio_image(index: usize) -> String {
    format!("rf/images/{}.png", stem(index))
}
pub(super) fn db(index: usize) -> String {
    format!("rf/db/{}.exr", stem(index))
}
pub(super) fn sphere(index: usize) -> String {
    format!("rf/sphere/{}.exr", stem(index))
}
pub(super) fn paths(index: usize) -> String {
    format!("rf/paths/{}.jsonl.gz", stem(index))
}
pub(super) fn progress(index: usize) -> String {
    format!("{PROGRESS_DIR}/{}.json", stem(index))
}
