//! A scene for Mitsuba 3 as light sees it: `scene.xml` with Mitsuba's own plugins, one PLY for every object and material, textures.
//!
//! World frame, metres, radiance and texture coordinates are those of the scene (Mitsuba, too, has the first row of a bitmap at v = 0).
//! The scene's features map to Mitsuba's plugins as follows:
//!
//! | here | there |
//! |---|---|
//! | base colour, metallic, roughness, ior | `principled` (`base_color`, `metallic`, `roughness`, `eta`): the same GGX lobe, Schlick's term and F₀; its diffuse term is Disney's, not the coupled one traced here, and its lobe shadows viewer and light apart |
//! | normal map, normal scale | `normalmap`; on a surface's back Mitsuba mirrors the bumps |
//! | every surface is seen from both sides | `twosided` |
//! | alpha below the cutoff, alpha as coverage | `mask`; a cutoff is applied to a texture of four times the size |
//! | thin glass | `thindielectric`, tinted by the base colour; with a transmission below 1, `blendbsdf` with a `diffuse` base, which mirrors less than the pane traced here |
//! | emission | `area`, textured from OpenEXR; where seen from both sides, two sheets 0.1 mm apart with an emitter each |
//! | vertex colours | the PLY's `red`, `green`, `blue`, times the base colour; without those where there is a texture as well |
//! | point, spot, directional light | `point`, `spot`, `directional`; Mitsuba's spot falls off in the angle, not in its cosine squared, and no light has a range |
//! | sampler | `bitmap` with the wrap mode along u, bilinear or nearest |
//! | camera pose | `perspective`, whose camera frame is x left, y up, z forward |
//!
//! Colours with a factor are stored as 16-bit PNG, others as the 8 bits they are. What a scene needs and cannot have is listed in
//! [`MitsubaSummary::approximated`].

mod emission;
mod light;
mod material;
mod mesh;
mod sensor;
mod texture;
mod xml;

use crate::{Pinhole, Result, Rigid3, Scene, io};
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use texture::Textures;
use xml::Xml;

/// Sensors of the exported scene: one camera at several poses.
#[derive(Clone, Debug, PartialEq)]
pub struct Views {
    /// The camera of all views; square pixels, principal point in the middle.
    pub camera: Pinhole,
    /// `world_from_camera` of each, OpenCV axes.
    pub poses: Vec<Rigid3>,
}

/// Summary of an export by [`write()`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MitsubaSummary {
    /// The folder.
    pub folder: PathBuf,
    /// Number of shapes (PLY files).
    pub shapes: usize,
    /// Number of materials.
    pub materials: usize,
    /// Number of texture files.
    pub textures: usize,
    /// Number of emitters.
    pub emitters: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Number of sensors.
    pub sensors: usize,
    /// Features of the scene that the file format cannot express and that were approximated, in words.
    pub approximated: BTreeSet<String>,
}

/// Files by their path relative to the folder, held until all are made.
type Files = Vec<(String, Vec<u8>)>;

/// Writes a scene with one sensor per pose of `views` into `folder`; the same input gives the same bytes.
///
/// # Errors
/// A camera that Mitsuba has no sensor for, images that cannot be encoded, files that cannot be written.
pub fn write(scene: &Scene, views: Option<&Views>, folder: &Path) -> Result<MitsubaSummary> {
    let mut approximated = BTreeSet::new();
    let mut xml = Xml::new();
    xml.comment("Light, as corf's scene says it. World frame: z up, metres. Textures: first row at v = 0.");
    xml.open("scene", &[("version", "3.0.0")]);
    let used = mesh::used_materials(scene);
    // `path` does not look for lamps through panes and holes; `volpath` does, and finds the same light.
    let seen_through = used.iter().any(|m| material::is_seen_through(&scene.materials[*m as usize].light));
    xml.open("integrator", &[("type", if seen_through { "volpath" } else { "path" })]);
    xml.value("integer", "max_depth", "-1");
    xml.close();
    let sensors = views.map_or(Ok(0), |views| sensor::write(views, &mut xml).map(|()| views.poses.len()))?;
    let mut textures = Textures::new(scene);
    for &index in &used {
        material::write(scene, index, &mut textures, &mut xml, &mut approximated)?;
    }
    let mut files: Files = Vec::new();
    let meshes = mesh::write(scene, &mut textures, &mut files, &mut xml, &mut approximated)?;
    let lights = light::write(&scene.lights, scene.bounds(), &mut xml, &mut approximated);
    xml.close();
    files.extend(textures.into_files());
    let textures = files.len() - meshes.shapes;
    for (name, bytes) in &files {
        io::write_atomic(folder.join(name), bytes)?;
    }
    // Last: a folder with a scene.xml is complete.
    io::write_atomic(folder.join("scene.xml"), xml.into_text().as_bytes())?;
    Ok(MitsubaSummary {
        folder: folder.to_path_buf(),
        shapes: meshes.shapes,
        materials: used.len(),
        textures,
        emitters: meshes.emitters + lights,
        triangles: scene.triangles.len(),
        sensors,
        approximated,
    })
}

/// Letters, digits and underscores: what an XML id, a file name and a reference all take.
fn slug(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).take(60).collect()
}

#[cfg(test)]
mod tests;
