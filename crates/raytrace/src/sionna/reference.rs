//! Reference files as they are on disk, and as a scene with exact corners.

use crate::radio::Antenna;
use corf_scene::config::{AntennaPattern, Orientation, Polarization};
use corf_scene::model::{
    LightMaterial, Material, Object, Permittivity, RadioMaterial, Scattering, ScatteringPattern, Scene, Triangle,
};
use corf_scene::{Error, Result};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// A reference file of either schema.
pub enum Reference {
    /// `corf-sionna-ref/1`.
    Specular(SpecularReference),
    /// `corf-sionna-diffuse-ref/1`.
    Diffuse(DiffuseReference),
}

/// Diffuse power and Bartlett maps (`corf-sionna-diffuse-ref/1`).
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct DiffuseReference {
    /// Scene name.
    pub scene: String,
    /// Carrier, Hz.
    pub frequency_hz: f64,
    /// The array of the maps.
    pub array: ReferenceArray,
    /// Materials by name; the scattering pattern is the case's.
    pub materials: BTreeMap<String, ReferenceMaterial>,
    /// Objects.
    pub objects: Vec<ReferenceObject>,
    /// Transmitter, metres.
    pub tx: [f64; 3],
    /// Receivers, metres.
    pub rx: Vec<[f64; 3]>,
    /// One per scattering pattern.
    pub cases: Vec<DiffuseCase>,
}

/// The grid of a Bartlett map.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ReferenceArray {
    /// Azimuths in the array frame, degrees.
    pub az_deg: Vec<f64>,
    /// Elevations, degrees.
    pub el_deg: Vec<f64>,
    /// Heading of the array at each receiver, radians.
    pub rx_yaw_rad: Vec<f64>,
}

/// One scattering pattern.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct DiffuseCase {
    /// Name.
    pub name: String,
    /// Pattern of every material.
    pub pattern: String,
    /// Exponent of the lobe around the specular direction.
    #[serde(default)]
    pub alpha_r: Option<u32>,
    /// Exponent of the lobe back towards the source.
    #[serde(default)]
    pub alpha_i: Option<u32>,
    /// Weight of the lobe around the specular direction beside the other.
    #[serde(default, alias = "lambda_")]
    pub lambda: Option<f64>,
    /// The library's arguments.
    pub args: ReferenceArgs,
    /// Results per receiver.
    pub rx_results: Vec<DiffuseResult>,
}

/// Diffuse power received at one receiver.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct DiffuseResult {
    /// Index into the receivers.
    pub rx_index: usize,
    /// Power by interaction types.
    pub power_by_type: BTreeMap<String, Estimate>,
    /// Power of DS paths: that of SD paths with the ends exchanged.
    #[serde(rename = "DS_by_reciprocity", default)]
    pub ds_by_reciprocity: Option<Estimate>,
    /// Power of D paths by object.
    #[serde(rename = "D_power_by_object")]
    pub power_by_object: BTreeMap<String, ObjectPower>,
    /// Map in dB, azimuth by elevation.
    pub bartlett_noncoherent_db: Vec<Vec<f64>>,
    /// Standard deviation of one seed's map, median over its directions, dB.
    #[serde(default)]
    pub bartlett_std_db_single_seed_median: f64,
}

/// A Monte Carlo mean and its standard error.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Estimate {
    /// Mean over seeds.
    pub mean: f64,
    /// Standard error of the mean.
    pub sem: f64,
}

/// One object's diffuse power.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct ObjectPower {
    /// The library's.
    pub sionna: Estimate,
    /// Power by float64 quadrature.
    pub quadrature_f64: f64,
}

/// A triangle's corners as the file gives them, metres.
type Corners = [[f64; 3]; 3];

/// A material of the file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ReferenceMaterial {
    /// Real relative permittivity.
    pub eps_r: f64,
    /// Loss: η = ε_r − j·ε_im.
    pub eps_im: f64,
    /// Slab thickness, metres.
    pub thickness: f64,
    /// Scattering coefficient.
    #[serde(rename = "S")]
    pub scattering_coefficient: f64,
    /// Cross-polarisation.
    #[serde(rename = "Kx")]
    pub xpd: f64,
    /// `lambertian`, `directive` or `backscattering`.
    pub pattern: String,
    /// Exponent of the lobe around the specular direction.
    #[serde(default)]
    pub alpha_r: Option<u32>,
    /// Exponent of the lobe back towards the source.
    #[serde(default)]
    pub alpha_i: Option<u32>,
    /// Weight of the lobe around the specular direction beside the other.
    #[serde(default, alias = "lambda_")]
    pub lambda: Option<f64>,
}

/// An object of the file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ReferenceObject {
    /// Name.
    pub name: String,
    /// Key into the materials.
    pub material: String,
    /// Triangles.
    pub triangles: Vec<Corners>,
}

/// Specular and transmitted paths (`corf-sionna-ref/1`).
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SpecularReference {
    /// Scene name.
    pub scene: String,
    /// Carrier, Hz.
    pub frequency_hz: f64,
    /// The element at both ends; an isotropic V one, where the file names none.
    #[serde(default)]
    pub antennas: ReferenceAntennas,
    /// Materials by name.
    pub materials: BTreeMap<String, ReferenceMaterial>,
    /// Objects.
    pub objects: Vec<ReferenceObject>,
    /// Transmitter, metres.
    pub tx: [f64; 3],
    /// Receivers, metres.
    pub rx: Vec<[f64; 3]>,
    /// Configurations traced in the scene.
    pub configs: Vec<ReferenceConfig>,
}

/// The element at both ends.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct ReferenceAntennas {
    /// `iso`, `dipole` or `tr38901`.
    pub pattern: AntennaPattern,
    /// `V` or `H`: a path has one coefficient.
    pub polarization: Polarization,
    /// Yaw, pitch and roll (z, y, x), radians.
    pub orientation: [f64; 3],
}

impl ReferenceAntennas {
    /// The element in the world.
    pub fn antenna(&self) -> Antenna {
        let [yaw_deg, pitch_deg, roll_deg] = self.orientation.map(f64::to_degrees);
        let world_from_antenna = Orientation { yaw_deg, pitch_deg, roll_deg }.world_from_array();
        Antenna { pattern: self.pattern, polarization: self.polarization, world_from_antenna, beam: None }
    }
}

/// One configuration of the library.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ReferenceConfig {
    /// Name.
    pub name: String,
    /// The library's arguments.
    pub args: ReferenceArgs,
    /// Results per receiver.
    pub rx_results: Vec<ReferencePaths>,
}

/// The library's arguments that matter to the physics.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ReferenceArgs {
    /// Interactions per path.
    pub max_depth: usize,
    /// Straight transmission.
    pub refraction: bool,
    /// Runs of which the file gives the mean; of paths there is one.
    #[serde(default = "one")]
    pub seeds: usize,
    /// Line of sight.
    #[serde(default = "yes")]
    pub los: bool,
    /// Specular reflection.
    #[serde(default = "yes")]
    pub specular_reflection: bool,
    /// Diffuse reflection.
    #[serde(default)]
    pub diffuse_reflection: bool,
    /// Diffraction.
    #[serde(default)]
    pub diffraction: bool,
    /// Diffraction at open edges as well; the library's default is no.
    #[serde(default)]
    pub edge_diffraction: bool,
    /// Diffraction into the region that the edge does not shadow as well; the library's default is yes.
    #[serde(default = "yes")]
    pub diffraction_lit_region: bool,
}

fn one() -> usize {
    1
}

fn yes() -> bool {
    true
}

/// The paths of one receiver.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ReferencePaths {
    /// Index into the receivers.
    pub rx_index: usize,
    /// 10·log10 Σ|a|² over `paths`, dB.
    #[serde(default)]
    pub total_power_db: Option<f64>,
    /// Paths the library found.
    pub paths: Vec<ReferencePath>,
    /// Valid paths the library drops: a segment under 1 cm.
    #[serde(default)]
    pub not_found_by_sionna: Vec<ReferencePath>,
}

/// One path.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ReferencePath {
    /// Interaction letters, TX → RX.
    pub types: String,
    /// Objects, TX → RX.
    pub objects: Vec<String>,
    /// Vertices, metres.
    pub vertices: Vec<[f64; 3]>,
    /// Unfolded length, metres.
    pub length_m: f64,
    /// Delay, seconds.
    #[serde(default)]
    pub delay_s: Option<f64>,
    /// Coefficient in f64, `[re, im]`.
    pub a_f64: [f64; 2],
    /// Angle of arrival.
    #[serde(default)]
    pub aoa: Option<ReferenceAngles>,
    /// Angle of departure.
    #[serde(default)]
    pub aod: Option<ReferenceAngles>,
}

/// Zenith and azimuth, radians.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct ReferenceAngles {
    /// Zenith angle, from +z.
    pub theta: f64,
    /// Azimuth, from +x towards +y.
    pub phi: f64,
}

impl Reference {
    /// Reads a file.
    ///
    /// # Errors
    /// A file that cannot be read or whose schema is not known.
    pub fn load(path: &Path) -> Result<Self> {
        let text = corf_scene::io::read_text(path)?;
        let place = path.display().to_string();
        let help = "reference files are JSON of schema corf-sionna-ref/1 or corf-sionna-diffuse-ref/1";
        let unreadable = |e: serde_json::Error| Error::invalid(place.clone(), format!("not a reference file: {e}"), help);
        #[derive(Deserialize)]
        struct Schema {
            schema: String,
        }
        let schema: Schema = serde_json::from_str(&text).map_err(unreadable)?;
        match schema.schema.as_str() {
            "corf-sionna-ref/1" => {
                let reference: SpecularReference = serde_json::from_str(&text).map_err(unreadable)?;
                reference.validate(&place)?;
                Ok(Self::Specular(reference))
            }
            "corf-sionna-diffuse-ref/1" => {
                let reference: DiffuseReference = serde_json::from_str(&text).map_err(unreadable)?;
                reference.validate(&place)?;
                Ok(Self::Diffuse(reference))
            }
            other => Err(Error::invalid(place, format!("unknown schema `{other}`"), help)),
        }
    }
}

impl DiffuseReference {
    fn validate(&self, place: &str) -> Result<()> {
        let receivers = self.rx.len().min(self.array.rx_yaw_rad.len());
        for case in &self.cases {
            for result in &case.rx_results {
                let map = &result.bartlett_noncoherent_db;
                let fits = map.len() == self.array.az_deg.len() && map.iter().all(|row| row.len() == self.array.el_deg.len());
                if result.rx_index >= receivers || !fits {
                    return Err(Error::invalid(
                        format!("{place}: case `{}`, rx_index {}", case.name, result.rx_index),
                        "no such receiver, or a Bartlett map that does not fit az_deg by el_deg",
                        "rx_index counts from 0; the map has a row per azimuth and a column per elevation",
                    ));
                }
            }
        }
        Ok(())
    }

    /// The scene with a case's scattering pattern on every material.
    ///
    /// # Errors
    /// An object whose material is not listed, or an unknown scattering pattern.
    pub fn scene(&self, case: &DiffuseCase) -> Result<Scene> {
        let mut materials = self.materials.clone();
        for material in materials.values_mut() {
            material.pattern.clone_from(&case.pattern);
            material.alpha_r = case.alpha_r;
            material.alpha_i = case.alpha_i;
            material.lambda = case.lambda;
        }
        build_scene(&self.scene, self.frequency_hz, &materials, &self.objects)
    }
}

impl SpecularReference {
    pub(super) fn validate(&self, place: &str) -> Result<()> {
        if self.antennas.antenna().ports() != 1 {
            return Err(Error::invalid(
                format!("{place}: antennas"),
                format!("polarization {:?} has two ports, and a path of this schema one coefficient", self.antennas.polarization),
                "use V or H",
            ));
        }
        if self.configs.is_empty() {
            return Err(Error::invalid(
                place,
                "configs is empty",
                "give at least one configuration of the library to compare with",
            ));
        }
        for config in &self.configs {
            let fault = |what: &str, help: &str| Err(Error::invalid(format!("{place}: config `{}`", config.name), what, help));
            if config.args.diffuse_reflection {
                return fault(
                    "it was traced with diffuse reflection, which has no per-path float64 column",
                    "compare diffuse power with a corf-sionna-diffuse-ref/1 file",
                );
            }
            if config.rx_results.is_empty() {
                return fault("rx_results is empty", "give the paths of at least one receiver, or leave the configuration out");
            }
            for result in &config.rx_results {
                if result.rx_index >= self.rx.len() {
                    return Err(Error::invalid(
                        format!("{place}: config `{}`", config.name),
                        format!("rx_index {} of {} receivers", result.rx_index, self.rx.len()),
                        "rx_index counts from 0",
                    ));
                }
            }
        }
        Ok(())
    }

    /// The scene, its corners rounded to float32 as the library holds them.
    ///
    /// # Errors
    /// An object whose material is not listed, or an unknown scattering pattern.
    pub fn scene(&self) -> Result<Scene> {
        build_scene(&self.scene, self.frequency_hz, &self.materials, &self.objects)
    }
}

/// Builds a scene whose positions are the file's, rounded to float32.
pub(super) fn build_scene(
    name: &str,
    frequency_hz: f64,
    materials: &BTreeMap<String, ReferenceMaterial>,
    objects: &[ReferenceObject],
) -> Result<Scene> {
    let mut scene = Scene { name: name.to_string(), ..Scene::default() };
    let mut index = BTreeMap::new();
    for (id, material) in materials {
        let pattern = match (material.pattern.as_str(), material.alpha_r, material.alpha_i, material.lambda) {
            ("lambertian", ..) => ScatteringPattern::Lambertian,
            ("directive", Some(alpha_r), ..) => ScatteringPattern::Directive { alpha_r },
            ("backscattering" | "backscatter", Some(alpha_r), Some(alpha_i), Some(lambda)) => {
                ScatteringPattern::Backscatter { alpha_r, alpha_i, lambda }
            }
            (other, alpha_r, alpha_i, lambda) => {
                return Err(Error::invalid(
                    format!("material `{id}`"),
                    format!("scattering pattern `{other}` with alpha_r {alpha_r:?}, alpha_i {alpha_i:?}, lambda {lambda:?}"),
                    "use lambertian, directive with alpha_r, or backscattering with alpha_r, alpha_i and lambda",
                ));
            }
        };
        let omega_eps0 = std::f64::consts::TAU * frequency_hz * corf_scene::itu::VACUUM_PERMITTIVITY_F_PER_M;
        let radio = RadioMaterial {
            id: id.clone(),
            permittivity: Permittivity::Constant {
                relative_permittivity: material.eps_r,
                conductivity_s_per_m: material.eps_im * omega_eps0,
            },
            thickness_m: material.thickness,
            scattering: Scattering { coefficient: material.scattering_coefficient, xpd: material.xpd, pattern },
        };
        index.insert(id.clone(), scene.materials.len() as u32);
        scene.materials.push(Material { name: id.clone(), light: LightMaterial::default(), radio: Some(radio) });
    }
    for object in objects {
        let &material = index.get(&object.material).ok_or_else(|| {
            Error::invalid(
                format!("object `{}`", object.name),
                format!("material `{}` is not listed", object.material),
                "add it under materials",
            )
        })?;
        let number = scene.objects.len() as u32;
        scene.objects.push(Object { name: object.name.clone() });
        for triangle in &object.triangles {
            let exact = triangle.map(DVec3::from_array);
            if exact.iter().any(|p| !p.as_vec3().is_finite()) {
                return Err(Error::invalid(
                    format!("object `{}`", object.name),
                    format!("{triangle:?} has a corner beyond float32"),
                    "positions are metres",
                ));
            }
            let normal = (exact[1] - exact[0]).cross(exact[2] - exact[0]).normalize_or_zero().as_vec3();
            let first = scene.positions.len() as u32;
            scene.positions.extend(exact.iter().map(|p| p.as_vec3()));
            scene.normals.extend([normal; 3]);
            scene.uvs.extend([[0.0; 2]; 3]);
            scene.triangles.push(Triangle { vertices: [first, first + 1, first + 2], material, object: number });
        }
    }
    Ok(scene)
}

/// A position as the library holds it: the file's decimals rounded to float32, then exact.
pub(super) fn single(position: [f64; 3]) -> DVec3 {
    DVec3::from_array(position.map(|x| f64::from(x as f32)))
}
