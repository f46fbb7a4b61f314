//! The WGSL of each kernel, put together from its parts.

use super::super::records::{Job, scene_declarations};
use super::params::{Params, Viewpoint};
use corf_gpu::GROUP_NUMBER;

/// A part by the name of its file.
macro_rules! part {
    ($name:literal) => {
        include_str!(concat!("shaders/", $name, ".wgsl"))
    };
}

/// What every kernel is made of behind the declarations of records: numbers, the scene, rays, surfaces, reflection, emitters.
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

/// Pages of cached light that a kernel binds.
pub(super) const PAGES: usize = 5;
/// State of the slot of a tile whose head is word 0 of the pages.
pub(super) const FILLED: u32 = 2;

/// Size of a page: 2 to the power of `bits` words of four.
#[derive(Clone, Copy, Debug)]
pub(super) struct PageSize {
    pub bits: u32,
}

/// The lattices as renderers bind them; what they write are the slots alone.
const LATTICES: [Binding<'static>; 3] =
    [("charts", "array<Chart>", false), ("lattices", "array<vec4<u32>>", false), ("slots", "array<atomic<u32>>", true)];
/// As what fills tiles binds them, with what a kernel works on behind them.
const TILES: [Binding<'static>; 6] = [
    ("charts", "array<Chart>", false),
    ("lattices", "array<vec4<u32>>", false),
    ("slots", "array<u32>", true),
    ("members", "array<u32>", false),
    ("jobs", "array<Job>", true),
    ("sites", "array<Site>", true),
];
const CANDIDATES: Binding<'static> = ("candidates", "array<Candidate>", true);
const LINKS: Binding<'static> = ("links", "array<vec4<u32>>", true);
const PAGE_NAMES: [&str; PAGES] = ["page_0", "page_1", "page_2", "page_3", "page_4"];

/// Bindings of the pages.
fn page_bindings(written: bool) -> [Binding<'static>; PAGES] {
    PAGE_NAMES.map(|name| (name, "array<vec4<u32>>", written))
}

/// Access to words of pages by one number, and to four points at once: which page it is, is asked once for all of them.
fn page_access(size: PageSize, written: bool) -> String {
    let cases = |statement: &dyn Fn(&str) -> String| -> String {
        let case = |(k, name): (usize, &&str)| {
            let label = if k + 1 == PAGES { "default".to_owned() } else { format!("case {k}u") };
            format!("        {label}: {{ {} }}\n", statement(name))
        };
        PAGE_NAMES.iter().enumerate().map(case).collect()
    };
    let (bits, mask) = (size.bits, (1u32 << size.bits) - 1);
    let mut text = format!(
        "fn word(at: u32) -> vec4<u32> {{\n    switch (at >> {bits}u) {{\n{}    }}\n}}\n",
        cases(&|name| format!("return {name}[at & {mask}u];"))
    );
    for name in PAGE_NAMES {
        text += &part!("page").replace("PAGE", name);
    }
    text += &format!(
        "fn blended(head: u32, numbers: vec4<u32>, shares: vec4<f32>) -> Blend {{\n    switch (head >> {bits}u) {{\n{}    }}\n}}\n",
        cases(&|name| format!("return blend_{name}(head & {mask}u, numbers, shares);"))
    );
    if written {
        text += &format!(
            "fn put(at: u32, value: vec4<u32>) {{\n    switch (at >> {bits}u) {{\n{}    }}\n}}\n",
            cases(&|name| format!("{name}[at & {mask}u] = value;"))
        );
    }
    text
}

/// Sites that stand for a point: of the coarse lattice and of the others.
pub(super) const COARSE_SITES: u32 = 18;
const LATTICE_SITES: u32 = 1;

/// A kernel over tiles.
fn tiles(constants: &str, size: PageSize, sites: u32, scratch: Binding<'_>, parts: &[&str]) -> String {
    let constants = format!("{constants}const SITES = {sites}u;\n");
    let bindings = [&TILES[..], &[scratch], &page_bindings(true)].concat();
    let access = page_access(size, true);
    kernel(&constants, &bindings, &[&[&Job::declaration(), part!("tiles"), part!("lattice"), &access], parts].concat())
}

/// Where tiles' points lie.
pub(super) fn sites(constants: &str, size: PageSize) -> String {
    tiles(constants, size, LATTICE_SITES, CANDIDATES, &[part!("sites"), part!("lattice_sites")])
}

/// Which emitters may light tiles.
pub(super) fn candidates(constants: &str, size: PageSize) -> String {
    tiles(constants, size, LATTICE_SITES, CANDIDATES, &[part!("patches"), part!("candidates")])
}

/// Direct light at tiles' points.
pub(super) fn direct(constants: &str, size: PageSize) -> String {
    tiles(constants, size, LATTICE_SITES, CANDIDATES, &[part!("patches"), part!("asked"), part!("reduce"), part!("direct")])
}

/// Indirect light at tiles' points.
pub(super) fn gather(constants: &str, size: PageSize) -> String {
    let parts = [part!("highlight"), part!("walk"), part!("reduce"), part!("gather")];
    tiles(constants, size, LATTICE_SITES, CANDIDATES, &parts)
}

/// Which cells of tiles are rough.
pub(super) fn rough(constants: &str, size: PageSize) -> String {
    tiles(constants, size, LATTICE_SITES, CANDIDATES, &[part!("rough")])
}

/// What stands for the surroundings of the coarse lattice's points.
pub(super) fn around(constants: &str, size: PageSize) -> String {
    tiles(constants, size, COARSE_SITES, CANDIDATES, &[part!("sites"), part!("around")])
}

/// Which emitters may light tiles of the coarse lattice.
pub(super) fn coarse_candidates(constants: &str, size: PageSize) -> String {
    tiles(constants, size, COARSE_SITES, CANDIDATES, &[part!("patches"), part!("candidates")])
}

/// Direct light at the coarse lattice's points.
pub(super) fn coarse_direct(constants: &str, size: PageSize) -> String {
    let parts = [part!("patches"), part!("asked"), part!("reduce"), part!("coarse_direct")];
    tiles(constants, size, COARSE_SITES, CANDIDATES, &parts)
}

/// Walks of the coarse lattice's points.
pub(super) fn links(constants: &str, size: PageSize) -> String {
    tiles(constants, size, COARSE_SITES, LINKS, &[part!("highlight"), part!("walk"), part!("reduce"), part!("links")])
}

/// Pixels from cached light.
pub(super) fn render_view(constants: &str, size: PageSize) -> String {
    let bindings = [&[SUMS, WORK][..], &LATTICES, &page_bindings(false)].concat();
    let access = page_access(size, false);
    let parts = [
        part!("film"),
        part!("tone"),
        &access,
        part!("lattice"),
        part!("asking"),
        part!("highlight"),
        part!("view"),
        part!("render"),
    ];
    kernel(constants, &bindings, &parts)
}

fn declared(bindings: &[Binding<'_>]) -> String {
    let line = |(k, (name, ty, written)): (usize, &Binding<'_>)| {
        let access = if *written { "read_write" } else { "read" };
        format!("@group(0) @binding({}) var<storage, {access}> {name}: {ty};\n", SCENE_BINDINGS + k)
    };
    bindings.iter().enumerate().map(line).collect()
}

fn kernel(constants: &str, bindings: &[Binding<'_>], parts: &[&str]) -> String {
    let mut text = constants.to_owned();
    text += &(scene_declarations() + &Viewpoint::declaration() + &Params::declaration());
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
