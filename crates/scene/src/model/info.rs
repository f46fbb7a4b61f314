//! Contents of a scene in numbers, and findings of its validation.

use crate::finding::{Finding, Severity};
use crate::model::{LightMaterial, Scene};
use crate::words::{counted, verb};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// A scene in numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneInfo {
    /// Name.
    pub name: String,
    /// Named objects.
    pub objects: usize,
    /// Triangles.
    pub triangles: usize,
    /// Vertices.
    pub vertices: usize,
    /// Textures and their texels in all.
    pub textures: usize,
    /// Texels of all textures.
    pub texels: usize,
    /// Smallest and largest corner, metres; absent without vertices.
    pub bounds_m: Option<[[f32; 3]; 2]>,
    /// Surface of all triangles, m² (one side).
    pub area_m2: f64,
    /// Surface that emits light, m².
    pub emissive_area_m2: f64,
    /// Triangles that emit light.
    pub emissive_triangles: usize,
    /// Point, spot and directional lights.
    pub punctual_lights: usize,
    /// Per material, in the scene's order.
    pub materials: Vec<MaterialInfo>,
}

/// One material in numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MaterialInfo {
    /// Name.
    pub name: String,
    /// Triangles.
    pub triangles: usize,
    /// Surface, m².
    pub area_m2: f64,
    /// Identifier of its radio properties, if it has any.
    pub radio: Option<String>,
    /// Whether it emits light.
    pub emissive: bool,
}

fn emits(m: &LightMaterial) -> bool {
    m.emissive.iter().any(|e| *e > 0.0)
}

/// Twice the area of triangle `i` as a vector along its normal, m².
fn double_area(scene: &Scene, i: usize) -> DVec3 {
    let [a, b, c] = scene.corners_f64(i);
    (b - a).cross(c - a)
}

impl SceneInfo {
    /// Counts and measures a scene whose indices are in range (an imported one's are).
    pub fn of(scene: &Scene) -> Self {
        let mut materials: Vec<MaterialInfo> = scene
            .materials
            .iter()
            .map(|m| MaterialInfo {
                name: m.name.clone(),
                triangles: 0,
                area_m2: 0.0,
                radio: m.radio.as_ref().map(|r| r.id.clone()),
                emissive: emits(&m.light),
            })
            .collect();
        for (i, t) in scene.triangles.iter().enumerate() {
            let m = &mut materials[t.material as usize];
            m.triangles += 1;
            m.area_m2 += 0.5 * double_area(scene, i).length();
        }
        let emissive = || materials.iter().filter(|m| m.emissive);
        Self {
            name: scene.name.clone(),
            objects: scene.objects.len(),
            triangles: scene.triangles.len(),
            vertices: scene.positions.len(),
            textures: scene.textures.len(),
            texels: scene.textures.iter().map(|t| t.texels.pixels().len()).sum(),
            bounds_m: scene.bounds().map(|b| [b.min.to_array(), b.max.to_array()]),
            area_m2: materials.iter().map(|m| m.area_m2).sum(),
            emissive_area_m2: emissive().map(|m| m.area_m2).sum(),
            emissive_triangles: emissive().map(|m| m.triangles).sum(),
            punctual_lights: scene.lights.len(),
            materials,
        }
    }

    /// Names of the materials in use that have no radio properties.
    pub fn materials_without_radio(&self) -> Vec<&str> {
        self.materials.iter().filter(|m| m.triangles > 0 && m.radio.is_none()).map(|m| m.name.as_str()).collect()
    }
}

impl std::fmt::Display for SceneInfo {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "{}", self.name)?;
        writeln!(
            f,
            "  {}, {}, {}, {:.1} m² of surface",
            counted(self.objects, "object"),
            counted(self.triangles, "triangle"),
            counted(self.vertices, "vertex"),
            self.area_m2
        )?;
        if let Some([min, max]) = self.bounds_m {
            let size: Vec<String> = min.iter().zip(max).map(|(a, b)| format!("{:.2}", b - a)).collect();
            writeln!(
                f,
                "  {} m, from ({:.2}, {:.2}, {:.2}) to ({:.2}, {:.2}, {:.2})",
                size.join(" × "),
                min[0],
                min[1],
                min[2],
                max[0],
                max[1],
                max[2]
            )?;
        }
        writeln!(f, "  {}, {:.1} million texels", counted(self.textures, "texture"), self.texels as f64 / 1e6)?;
        writeln!(
            f,
            "  {} ({:.2} m²), {}",
            counted(self.emissive_triangles, "emissive triangle"),
            self.emissive_area_m2,
            counted(self.punctual_lights, "punctual light")
        )?;
        let width = self.materials.iter().map(|m| m.name.chars().count()).max().unwrap_or(0).max(8);
        writeln!(f, "  {:width$} {:>9} {:>10}  radio", "material", "triangles", "area m²")?;
        for m in &self.materials {
            let emits = if m.emissive { "  emits light" } else { "" };
            let radio = m.radio.as_deref().unwrap_or("none");
            writeln!(f, "  {:width$} {:>9} {:>10.2}  {radio}{emits}", m.name, m.triangles, m.area_m2)?;
        }
        let missing = self.materials_without_radio();
        if !missing.is_empty() {
            writeln!(
                f,
                "  without radio properties, to be mapped under [radio_materials] of a scene file: {}",
                missing.join(", ")
            )?;
        }
        Ok(())
    }
}

/// A room's diagonal outside of these is more likely a unit mistaken, metres.
const PLAUSIBLE_DIAGONAL_M: std::ops::RangeInclusive<f32> = 0.5..=2000.0;

/// Checks a scene for tracing light and, at `frequency_hz`, radio. An empty list means that all is well.
pub fn validate_scene(scene: &Scene, frequency_hz: f64) -> Vec<Finding> {
    let mut findings = Vec::new();
    let name = scene.name.as_str();
    if scene.triangles.is_empty() {
        return vec![Finding::error(name, "there is no triangle", "give a scene with triangle meshes")];
    }
    check_numbers(scene, &mut findings);
    if findings.iter().any(|f| f.severity == Severity::Error) {
        // Areas and edges of broken indices mean nothing.
        return findings;
    }
    check_triangles(scene, &mut findings);
    findings.extend(crate::radio_check::radio_findings(scene, frequency_hz));
    let info = SceneInfo::of(scene);
    if let Some(b) = scene.bounds() {
        let diagonal = (b.max - b.min).length();
        if !PLAUSIBLE_DIAGONAL_M.contains(&diagonal) {
            findings.push(Finding::new(
                Severity::Warning,
                name,
                format!("its diagonal is {diagonal} m"),
                "positions are metres; was it exported in millimetres or centimetres?",
            ));
        }
    }
    if info.emissive_triangles == 0 && info.punctual_lights == 0 {
        findings.push(Finding::new(
            Severity::Warning,
            name,
            "nothing emits light: images will be black",
            "add an emissive material or a light",
        ));
    }
    findings
}

/// Finite numbers, indices in range, unit normals.
fn check_numbers(scene: &Scene, findings: &mut Vec<Finding>) {
    let name = scene.name.as_str();
    let n = scene.positions.len();
    if scene.normals.len() != n || scene.uvs.len() != n {
        findings.push(Finding::error(
            name,
            format!(
                "{}, {}, {}",
                counted(n, "position"),
                counted(scene.normals.len(), "normal"),
                counted(scene.uvs.len(), "texture coordinate")
            ),
            "every vertex needs one of each",
        ));
        return;
    }
    let repair = "repair the model: every coordinate is a finite number";
    if let Some(i) = scene.positions.iter().position(|p| !p.is_finite()) {
        findings.push(Finding::error(format!("{name}: vertex {i}"), "its position is not finite", repair));
    }
    // Unit to float32's and 16-bit quantisation's accuracy.
    if let Some(i) = scene.normals.iter().position(|v| !v.is_finite() || (v.length() - 1.0).abs() > 1e-3) {
        findings.push(Finding::error(format!("{name}: vertex {i}"), "its normal is no unit vector", repair));
    }
    if let Some(i) = scene.uvs.iter().position(|uv| uv.iter().any(|v| !v.is_finite())) {
        findings.push(Finding::error(format!("{name}: vertex {i}"), "its texture coordinate is not finite", repair));
    }
    let bad = |t: &crate::model::Triangle| {
        t.vertices.iter().any(|v| *v as usize >= n)
            || t.material as usize >= scene.materials.len()
            || t.object as usize >= scene.objects.len()
    };
    if let Some(i) = scene.triangles.iter().position(bad) {
        findings.push(Finding::error(
            format!("{name}: triangle {i}"),
            "it uses a vertex, material or object that does not exist",
            "indices count from 0",
        ));
    }
    for m in &scene.materials {
        let o = &m.light;
        let textures = [o.base_color_texture, o.metallic_roughness_texture, o.normal_texture, o.emissive_texture];
        if textures.iter().flatten().any(|t| t.texture as usize >= scene.textures.len()) {
            findings.push(Finding::error(
                format!("{name}: material \"{}\"", m.name),
                "it uses a texture that does not exist",
                "indices count from 0",
            ));
        }
    }
}

/// Degenerate and doubled triangles, open edges.
fn check_triangles(scene: &Scene, findings: &mut Vec<Finding>) {
    let name = scene.name.as_str();
    let degenerate = (0..scene.triangles.len()).filter(|i| double_area(scene, *i).length() == 0.0).count();
    if degenerate > 0 {
        findings.push(Finding::new(
            Severity::Warning,
            name,
            format!("{} {} no area", counted(degenerate, "triangle"), verb(degenerate, "has", "have")),
            "they are never hit; the importer drops them",
        ));
    }
    // Coincident sheets are noise to a light ray, whatever they are to a radio wave.
    for overlap in crate::overlaps::overlaps(scene) {
        let [object, other] = overlap.objects.map(|object| scene.objects[object as usize].name.as_str());
        let whose = if overlap.objects[0] == overlap.objects[1] {
            "others of the same object".into()
        } else {
            format!("those of \"{other}\"")
        };
        let slabs = if overlap.one_slab { "one slab, as they are of one object and material" } else { "two slabs" };
        findings.push(Finding::new(
            Severity::Warning,
            format!("{name}: object \"{object}\""),
            format!("{:.4} m² of its faces lie exactly on {whose}", overlap.area_m2),
            format!("remove the copies: radio passes {slabs} there, and light sees either at random"),
        ));
    }
    let key = |v: u32| scene.positions[v as usize].to_array().map(|x| (x + 0.0).to_bits());
    // An edge used once is a rim. Vertices are compared by place: seams of texture or normal are no rims.
    let mut edges: HashMap<(u32, [[u32; 3]; 2]), usize> = HashMap::new();
    for t in &scene.triangles {
        for k in 0..3 {
            let mut edge = [key(t.vertices[k]), key(t.vertices[(k + 1) % 3])];
            edge.sort_unstable();
            *edges.entry((t.object, edge)).or_default() += 1;
        }
    }
    let mut open: Vec<u32> = edges.iter().filter(|(_, n)| **n == 1).map(|((object, _), _)| *object).collect();
    open.sort_unstable();
    open.dedup();
    if !open.is_empty() {
        findings.push(Finding::new(
            Severity::Note,
            name,
            format!("{} of {} objects are open sheets", open.len(), scene.objects.len()),
            "a sheet is a slab of its material's thickness_m to a radio wave; a closed body is two of them",
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Material, Object, Permittivity, RadioMaterial, Triangle};
    use glam::Vec3;

    /// A closed unit-edge cube of 12 triangles, with radio properties and no light.
    fn cube(edge: f32) -> Scene {
        let positions: Vec<Vec3> =
            (0..8).map(|i| edge * Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32)).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangle = |vertices| Triangle { vertices, material: 0, object: 0 };
        let radio = RadioMaterial {
            id: "concrete".into(),
            permittivity: Permittivity::Itu("concrete".into()),
            thickness_m: 0.2,
            scattering: Default::default(),
        };
        Scene {
            name: "cube".into(),
            objects: vec![Object { name: "box".into() }],
            materials: vec![Material { name: "grey".into(), light: Default::default(), radio: Some(radio) }],
            normals: positions.iter().map(|p| (*p - 0.5 * edge).normalize()).collect(),
            uvs: vec![[0.0; 2]; 8],
            positions,
            triangles: quads.iter().flat_map(|q| [triangle([q[0], q[1], q[2]]), triangle([q[0], q[2], q[3]])]).collect(),
            ..Default::default()
        }
    }

    fn findings(scene: &Scene) -> Vec<String> {
        validate_scene(scene, 60e9).iter().map(|f| f.to_string()).collect()
    }

    #[test]
    fn a_cube_of_two_metres_has_24_square_metres() {
        let info = SceneInfo::of(&cube(2.0));
        assert!((info.area_m2 - 24.0).abs() < 1e-9);
        assert_eq!((info.triangles, info.emissive_triangles), (12, 0));
        assert_eq!(info.bounds_m, Some([[0.0; 3], [2.0; 3]]));
        let text = info.to_string();
        assert!(text.contains("2.00 × 2.00 × 2.00") && text.contains("concrete"), "{text}");
    }

    #[test]
    fn a_sound_scene_has_no_finding_and_each_fault_has_its_own() {
        let mut lit = cube(2.0);
        lit.materials[0].light.emissive = [1.0; 3];
        assert_eq!(findings(&lit), Vec::<String>::new());
        let with = |change: &dyn Fn(&mut Scene), expected: &str| {
            let mut s = lit.clone();
            change(&mut s);
            let found = findings(&s);
            assert!(found.len() == 1 && found[0].contains(expected), "{expected}: {found:?}");
        };
        with(&|s| s.materials[0].light.emissive = [0.0; 3], "black");
        with(&|s| s.materials[0].radio = None, "radio_materials.\"grey\"");
        with(&|s| s.materials[0].radio.as_mut().unwrap().thickness_m = 0.0, "thickness_m");
        with(&|s| s.materials[0].radio.as_mut().unwrap().permittivity = Permittivity::Itu("brick".into()), "not at 60 GHz");
        with(&|s| s.positions[3].y = f32::NAN, "vertex 3");
        with(&|s| s.normals[2] = Vec3::ZERO, "normal");
        with(&|s| s.triangles[4].vertices[1] = 99, "triangle 4");
        with(&|s| s.triangles.truncate(2), "open sheets");
        with(&|s| s.positions.iter_mut().for_each(|p| *p *= 1000.0), "millimetres");
        with(&|s| s.triangles.clear(), "no triangle");
        let mut holed = lit.clone();
        holed.triangles.truncate(11);
        assert!(findings(&holed).iter().any(|f| f.contains("\"box\": a body of 22.00 m² with a hole: 3 open edges")));
        let mut doubled = lit.clone();
        doubled.triangles.push(Triangle { vertices: [2, 3, 0], ..doubled.triangles[0] });
        let text = &findings(&doubled)[0];
        assert!(text.contains("lie exactly on others of the same object") && text.contains("one slab"), "{text}");
    }
}
