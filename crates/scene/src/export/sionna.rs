//! A scene for Sionna RT: `scene.xml` (Mitsuba 3), one PLY for every object and material, and `radio.json` with what a scene file cannot
//! say there.
//!
//! Geometry stays as it is traced here: float32 positions in the world frame, z up, metres, triangles in the scene's order. Vertices that
//! differ in their normal or texture coordinate alone are shared, since edges are found by shared vertices. Materials are written with
//! their numbers, never with an ITU name: Sionna RT looks those up by itself.

use super::ply;
use crate::config::SceneConfig;
use crate::itu;
use crate::model::{Permittivity, RadioMaterial, world_from_array};
use crate::radio_spec::{PatternName, RadioSpec};
use crate::words::{counted, verb};
use crate::{Error, Result, Scene, io, trajectory};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Version of `radio.json`.
pub const SCHEMA: &str = "corf-sionna-scene/1";

/// `radio.json`: what Sionna RT has to be told from Python, and whose shape is whose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RadioFile {
    /// [`SCHEMA`].
    pub schema: String,
    /// The scene's name.
    pub scene: String,
    /// Carrier, Hz.
    pub frequency_hz: f64,
    /// The transmitter.
    pub transmitter: AntennaEntry,
    /// The receiver's element; its positions are `poses`.
    pub receiver: AntennaEntry,
    /// Materials by `bsdf` id.
    pub materials: BTreeMap<String, MaterialEntry>,
    /// Shapes in the order of `scene.xml`.
    pub shapes: Vec<ShapeEntry>,
    /// Evenly spaced poses of the scene's trajectory.
    pub poses: Vec<PoseEntry>,
}

/// One end of the link.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AntennaEntry {
    /// World position, metres; the receiver's are the poses'.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub position_m: Option<[f64; 3]>,
    /// `(α, β, γ)`, radians: `world_from_array = R_z(α)·R_y(β)·R_x(γ)`; the receiver's is that of every pose.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orientation_rad: Option<[f64; 3]>,
    /// `iso`, `dipole`, `tr38901`.
    pub pattern: String,
    /// `V`, `H`, `VH`, `cross`.
    pub polarization: String,
    /// Elements along array z and along array y: what Sionna RT's `PlanarArray` takes as `num_rows` and `num_cols`.
    pub rows: usize,
    /// See `rows`.
    pub cols: usize,
    /// Between columns, between rows, wavelengths: `horizontal_spacing`, `vertical_spacing`.
    pub spacing_wavelengths: [f64; 2],
    /// Beam direction of a transmit array of several elements (conjugate steering weights of unit power): azimuth and elevation in the
    /// array's frame, degrees. Sionna RT's paths are those of the elements: combine them with these weights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beam_deg: Option<[f64; 2]>,
}

/// A material at the carrier.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MaterialEntry {
    /// The material's name in the mesh file.
    pub name: String,
    /// The radio material's identifier.
    pub radio_id: String,
    /// Real relative permittivity.
    pub relative_permittivity: f64,
    /// Conductivity, S/m.
    pub conductivity_s_per_m: f64,
    /// Slab thickness, metres.
    pub thickness_m: f64,
    /// S in `[0, 1]`.
    pub scattering_coefficient: f64,
    /// K_x in `[0, 1]`.
    pub xpd_coefficient: f64,
    /// The lobe, which `scene.xml` cannot hold.
    pub scattering_pattern: PatternName,
    /// Exponent of the lobe around the specular direction.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alpha_r: Option<u32>,
    /// Exponent of the lobe back towards the source.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alpha_i: Option<u32>,
    /// Weight of the lobe around the specular direction beside the other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lambda: Option<f64>,
}

/// A shape of `scene.xml`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShapeEntry {
    /// Its id, which is also Sionna RT's name of the object.
    pub id: String,
    /// Its PLY file, relative to the folder.
    pub file: String,
    /// The object's name in the mesh file.
    pub object: String,
    /// Key into [`RadioFile::materials`].
    pub material: String,
    /// Number of triangles.
    pub triangles: usize,
}

/// A pose of the platform's array.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseEntry {
    /// World position, metres.
    pub position_m: [f64; 3],
    /// Rows of `rotation_world_from_array` (boresight +x, zenith +z).
    pub world_from_array: [[f64; 3]; 3],
}

/// Summary of an export by [`write()`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SionnaSummary {
    /// The folder.
    pub folder: PathBuf,
    /// Number of shapes (PLY files).
    pub shapes: usize,
    /// Number of materials.
    pub materials: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Number of vertices after sharing.
    pub vertices: usize,
    /// Number of poses.
    pub poses: usize,
}

/// Writes a scene with `poses` evenly spaced poses of its trajectory (none: 0) into `folder`; the same input gives the same bytes.
///
/// # Errors
/// A material without radio properties at the carrier, poses of a scene without a trajectory, files that cannot be written.
pub fn write(scene: &Scene, config: &SceneConfig, poses: usize, folder: &Path) -> Result<SionnaSummary> {
    config.check_radio(scene)?;
    let parts = parts(scene);
    let (tx, rx) = (&config.transmitter, &config.receiver);
    let o = tx.orientation;
    let mut file = RadioFile {
        schema: SCHEMA.to_string(),
        scene: scene.name.clone(),
        frequency_hz: config.radio.frequency_hz,
        transmitter: AntennaEntry {
            position_m: Some(tx.position_m),
            orientation_rad: Some([o.yaw_deg, o.pitch_deg, o.roll_deg].map(f64::to_radians)),
            pattern: name_of(&tx.pattern)?,
            polarization: name_of(&tx.polarization)?,
            rows: tx.rows,
            cols: tx.cols,
            spacing_wavelengths: tx.spacing_wavelengths,
            beam_deg: (tx.rows * tx.cols > 1).then(|| tx.beam.unwrap_or_default()).map(|b| [b.azimuth_deg, b.elevation_deg]),
        },
        receiver: AntennaEntry {
            position_m: None,
            orientation_rad: None,
            pattern: name_of(&rx.pattern)?,
            polarization: name_of(&rx.polarization)?,
            rows: rx.rows,
            cols: rx.cols,
            spacing_wavelengths: rx.spacing_wavelengths,
            beam_deg: None,
        },
        materials: BTreeMap::new(),
        shapes: Vec::with_capacity(parts.len()),
        poses: self::poses(config, poses)?,
    };
    let mut vertices = 0;
    for (index, part) in parts.iter().enumerate() {
        let material = &scene.materials[part.material as usize];
        // `check_radio` has found radio properties on every material in use.
        let Some(radio) = &material.radio else { continue };
        let material_id = format!("m_{}_{}", part.material, slug(&material.name));
        if !file.materials.contains_key(&material_id) {
            file.materials.insert(material_id.clone(), material_entry(&material.name, radio, file.frequency_hz)?);
        }
        let object = &scene.objects[part.object as usize].name;
        let id = format!("o_{index}_{}", slug(object));
        let name = format!("meshes/{id}.ply");
        io::write_atomic(folder.join(&name), &ply::encode(&part.positions, &part.triangles))?;
        vertices += part.positions.len();
        file.shapes.push(ShapeEntry {
            id,
            file: name,
            object: object.clone(),
            material: material_id,
            triangles: part.triangles.len(),
        });
    }
    let json = serde_json::to_string_pretty(&file)
        .map_err(|e| Error::invalid("radio.json", format!("cannot be written: {e}"), "every number must be finite"))?;
    io::write_atomic(folder.join("radio.json"), format!("{json}\n").as_bytes())?;
    // Last: a folder with a scene.xml is complete.
    io::write_atomic(folder.join("scene.xml"), scene_xml(&file).as_bytes())?;
    Ok(SionnaSummary {
        folder: folder.to_path_buf(),
        shapes: file.shapes.len(),
        materials: file.materials.len(),
        triangles: file.shapes.iter().map(|s| s.triangles).sum(),
        vertices,
        poses: file.poses.len(),
    })
}

/// The triangles of one object and one material.
struct ConnectedPart {
    object: u32,
    material: u32,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

/// The scene cut by object and material, in this order, with vertices shared by position within each part.
fn parts(scene: &Scene) -> Vec<ConnectedPart> {
    let mut by_key: BTreeMap<(u32, u32), Vec<usize>> = BTreeMap::new();
    for (i, triangle) in scene.triangles.iter().enumerate() {
        by_key.entry((triangle.object, triangle.material)).or_default().push(i);
    }
    let cut = |((object, material), members): ((u32, u32), Vec<usize>)| {
        let mut index_of: HashMap<[u32; 3], u32> = HashMap::new();
        let mut part = ConnectedPart { object, material, positions: Vec::new(), triangles: Vec::with_capacity(members.len()) };
        for i in members {
            part.triangles.push(scene.corners(i).map(|corner| {
                // −0 and 0 are one position.
                let corner = corner + Vec3::ZERO;
                *index_of.entry(corner.to_array().map(f32::to_bits)).or_insert_with(|| {
                    part.positions.push(corner);
                    part.positions.len() as u32 - 1
                })
            }));
        }
        part
    };
    by_key.into_iter().map(cut).collect()
}

fn poses(config: &SceneConfig, count: usize) -> Result<Vec<PoseEntry>> {
    if count == 0 {
        return Ok(Vec::new());
    }
    let Some(way) = &config.trajectory else {
        return Err(Error::invalid(
            config.source.display().to_string(),
            format!("{} {} asked for, and there is no [trajectory]", counted(count, "pose"), verb(count, "was", "were")),
            "add one, or ask for no poses",
        ));
    };
    let entry = |pose: trajectory::TrajectoryPose| {
        let world_from_array = world_from_array(&pose.world_from_camera);
        let row = |i: usize| world_from_array.row(i).to_array();
        PoseEntry { position_m: pose.world_from_camera.translation.to_array(), world_from_array: [row(0), row(1), row(2)] }
    };
    Ok(trajectory::generate(way, count)?.into_iter().map(entry).collect())
}

/// The name a unit variant has in files.
fn name_of(value: &impl Serialize) -> Result<String> {
    match serde_json::to_value(value) {
        Ok(serde_json::Value::String(name)) => Ok(name),
        _ => Err(Error::invalid("antenna", "has no name in files", "use a named pattern and polarisation")),
    }
}

fn material_entry(name: &str, radio: &RadioMaterial, frequency_hz: f64) -> Result<MaterialEntry> {
    let (relative_permittivity, conductivity_s_per_m) = match &radio.permittivity {
        Permittivity::Itu(itu_name) => itu::properties(itu_name, frequency_hz)?,
        Permittivity::Constant { relative_permittivity, conductivity_s_per_m } => (*relative_permittivity, *conductivity_s_per_m),
    };
    let spec = RadioSpec::from(radio);
    Ok(MaterialEntry {
        name: name.to_string(),
        radio_id: radio.id.clone(),
        relative_permittivity,
        conductivity_s_per_m,
        thickness_m: radio.thickness_m,
        scattering_coefficient: radio.scattering.coefficient,
        xpd_coefficient: radio.scattering.xpd,
        scattering_pattern: spec.scattering_pattern,
        alpha_r: spec.alpha_r,
        alpha_i: spec.alpha_i,
        lambda: spec.lambda,
    })
}

/// Letters, digits and underscores: what an XML id, a file name and a Mitsuba reference all take.
fn slug(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}

fn scene_xml(file: &RadioFile) -> String {
    let mut xml = String::from("<scene version=\"2.1.0\">\n");
    // Writing to a String cannot fail.
    for (id, m) in &file.materials {
        let _ = writeln!(xml, "  <bsdf type=\"radio-material\" id=\"{id}\">");
        for (key, value) in [
            ("relative_permittivity", m.relative_permittivity),
            ("conductivity", m.conductivity_s_per_m),
            ("thickness", m.thickness_m),
            ("scattering_coefficient", m.scattering_coefficient),
            ("xpd_coefficient", m.xpd_coefficient),
        ] {
            let _ = writeln!(xml, "    <float name=\"{key}\" value=\"{value}\"/>");
        }
        xml.push_str("  </bsdf>\n");
    }
    for shape in &file.shapes {
        let _ = writeln!(
            xml,
            "  <shape type=\"ply\" id=\"{}\">\n    <string name=\"filename\" value=\"{}\"/>\n    <boolean name=\"face_normals\" \
             value=\"true\"/>\n    <ref id=\"{}\" name=\"bsdf\"/>\n  </shape>",
            shape.id, shape.file, shape.material
        );
    }
    xml.push_str("</scene>\n");
    xml
}

#[cfg(test)]
#[path = "sionna_tests.rs"]
mod tests;
