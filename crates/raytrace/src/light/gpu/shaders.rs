//! The WGSL of each kernel, put together from its parts.

use corf_gpu::GROUP_NUMBER;

/// A part by the name of its file.
macro_rules! part {
    ($name:literal) => {
        include_str!(concat!("shaders/", $name, ".wgsl"))
    };
}

/// What every kernel is made of: numbers, the scene, rays, surfaces, reflection, emitters.
const CORE: [&str; 11] = [
    GROUP_NUMBER,
    part!("numbers"),
    part!("integers"),
    part!("rng"),
    part!("sampler"),
    part!("scene"),
    part!("texture"),
    part!("surface"),
    part!("bsdf"),
    part!("bvh"),
    part!("emitter"),
];

/// Bindings of the scene: the settings and its buffers.
const SCENE_BINDINGS: usize = 12;

/// A storage buffer as a kernel declares it: its name, and its type.
type Binding<'a> = (&'a str, &'a str, bool);

const SUMS: Binding<'static> = ("sums", "array<Sums>", true);
const WORK: Binding<'static> = ("work", "array<atomic<u32>>", true);
const PICTURE: Binding<'static> = ("picture", "array<u32>", true);

fn declared(bindings: &[Binding<'_>]) -> String {
    let line = |(k, (name, ty, written)): (usize, &Binding<'_>)| {
        let access = if *written { "read_write" } else { "read" };
        format!("@group(0) @binding({}) var<storage, {access}> {name}: {ty};\n", SCENE_BINDINGS + k)
    };
    bindings.iter().enumerate().map(line).collect()
}

fn kernel(constants: &str, bindings: &[Binding<'_>], parts: &[&str]) -> String {
    let mut text = constants.to_owned();
    text += &CORE.join("\n");
    text += &declared(bindings);
    text += &parts.join("\n");
    text
}

/// Unbiased paths of pixels.
pub(super) fn render_paths(constants: &str) -> String {
    kernel(constants, &[SUMS, WORK], &[part!("film"), part!("tone"), part!("path"), part!("render")])
}

/// Depth and objects at pixels' centres.
pub(super) fn centre(constants: &str) -> String {
    kernel(constants, &[SUMS, WORK], &[part!("film"), part!("centre")])
}

/// Which pixels want more paths.
pub(super) fn select(constants: &str) -> String {
    kernel(constants, &[SUMS, WORK], &[part!("film"), part!("select")])
}

/// 8-bit images.
pub(super) fn develop(constants: &str) -> String {
    kernel(constants, &[SUMS, WORK, PICTURE], &[part!("film"), part!("tone"), part!("develop")])
}

/// A test's own function `item(i)`, which reads `asked` and writes `found`.
#[cfg(test)]
pub(super) fn probe(constants: &str, item: &str) -> String {
    let main = "
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let i = group_number(id) * 64u + thread;
    if (i < params.count) { item(i); }
}";
    let bindings = [("asked", "array<u32>", false), ("found", "array<u32>", true)];
    kernel(constants, &bindings, &[item, main])
}
