//! `scenes/*.toml`: which mesh, which carrier, where the transmitter stands, what the receiver is, how the platform moves.

use super::{ReceiverConfig, TransmitterConfig, read_toml};
use crate::contained::Reach;
use crate::import::{ImportOptions, UpAxis};
use crate::radio_spec::RadioSpec;
use crate::trajectory::TrajectoryConfig;
use crate::words::nearest;
use crate::{Error, Finding, Result, Scene, bounds};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A scene file: geometry and everything about it that is not geometry.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneConfig {
    /// The mesh.
    pub scene: SceneFile,
    /// The carrier.
    #[serde(default)]
    pub radio: RadioConfig,
    /// The fixed transmitter.
    pub transmitter: TransmitterConfig,
    /// More of them by name, `[transmitters.east]`; a dataset is of one, which its own key `transmitter` picks.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub transmitters: BTreeMap<String, TransmitterConfig>,
    /// The platform's receiver array.
    #[serde(default)]
    pub receiver: ReceiverConfig,
    /// Radio properties by exact name of a material in the mesh file; an entry replaces what the mesh file says.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub radio_materials: BTreeMap<String, RadioSpec>,
    /// The platform's way; a scene used for single paths needs none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trajectory: Option<TrajectoryConfig>,
    /// Path that the file was read from (its folder resolves `scene.file`).
    #[serde(skip)]
    pub source: PathBuf,
}

/// `[scene]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Mesh file (.glb, .gltf, .obj), relative to the TOML file.
    pub file: PathBuf,
    /// The file's up axis. Without it a glTF is taken as `y` up, as its standard says, and an OBJ as `z` up; `z` reads glTF files that
    /// were exported without turning.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<UpAxis>,
    /// Point of the mesh, metres along the world's axes, that becomes the origin: it is taken off every vertex in double precision, for models in
    /// coordinates of a map. All other positions (transmitters, the way, receivers of commands) are in the moved frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset_m: Option<[f64; 3]>,
    /// Whether the mesh file may name files (textures, buffers, material libraries) outside of its own folder.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub allow_outside: bool,
}

/// `[radio]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RadioConfig {
    /// Carrier frequency, Hz. A scene file without `[radio]` is at 60 GHz.
    pub frequency_hz: f64,
}

impl Default for RadioConfig {
    fn default() -> Self {
        Self { frequency_hz: 60e9 }
    }
}

impl SceneConfig {
    /// Reads and checks a scene file.
    ///
    /// # Errors
    /// The file cannot be read, or a value in it cannot be used; the message names the key.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let mut config: Self = read_toml(path)?;
        config.source = path.to_path_buf();
        config.read_patterns()?;
        config.validate()?;
        Ok(config)
    }

    /// Reads the antenna patterns that are in files, relative to this one.
    fn read_patterns(&mut self) -> Result<()> {
        let folder = self.source.parent().unwrap_or(Path::new("")).to_path_buf();
        let file = self.source.display().to_string();
        let named = self.transmitters.iter_mut().map(|(name, t)| (format!("transmitters.{name}"), &mut t.pattern));
        for (key, pattern) in std::iter::once(("transmitter".to_owned(), &mut self.transmitter.pattern)).chain(named) {
            *pattern = pattern.read(&folder, &format!("{file}: {key}.pattern"), None)?;
        }
        let receiver = &mut self.receiver;
        receiver.check_elements(&format!("{file}: receiver"))?;
        receiver.pattern = receiver.pattern.read(&folder, &format!("{file}: receiver.pattern"), Some(receiver.elements()))?;
        Ok(())
    }

    /// Checks every value against what the tracer can use.
    ///
    /// # Errors
    /// The first value out of range, by key.
    pub fn validate(&self) -> Result<()> {
        self.faults().into_iter().next().map_or(Ok(()), Err)
    }

    /// Every value that the tracer cannot use, one error each.
    pub fn faults(&self) -> Vec<Error> {
        let place = |key: &str| format!("{}: {key}", self.source.display());
        let f = self.radio.frequency_hz;
        let frequency = if !(f.is_finite() && f > 0.0) {
            Err(Error::invalid(place("radio.frequency_hz"), format!("{f} is no frequency"), "give hertz, e.g. 60e9"))
        } else if f < 1e6 {
            let help = format!("frequencies are in hertz: for {f} GHz write {f}e9");
            Err(Error::invalid(place("radio.frequency_hz"), format!("{f} Hz is under 1 MHz"), help))
        } else {
            bounds::number(&place("radio.frequency_hz"), f, &bounds::FREQUENCY_HZ, "hertz")
        };
        let mut checks = vec![frequency, self.transmitter.validate(&place("transmitter"))];
        let offset = |v: &f64| bounds::number(&place("scene.offset_m"), *v, &(-1e9..=1e9), "metres");
        checks.extend(self.scene.offset_m.iter().flatten().map(offset));
        checks.extend(self.transmitters.iter().map(|(name, t)| t.validate(&place(&format!("transmitters.{name}")))));
        checks.push(self.receiver.validate(&place("receiver")));
        checks.extend(self.trajectory.iter().map(|t| t.validate(&place("trajectory"))));
        let material = |(name, spec): (&String, &RadioSpec)| {
            spec.to_material(name, &place(&format!("radio_materials.\"{name}\""))).map(|_| ())
        };
        checks.extend(self.radio_materials.iter().map(material));
        checks.into_iter().filter_map(Result::err).collect()
    }

    /// The transmitter of this name in `[transmitters]`, or `[transmitter]` without one.
    ///
    /// # Errors
    /// A name that is not there; `place` says where it was asked for.
    pub fn transmitter_named(&self, name: Option<&str>, place: &str) -> Result<&TransmitterConfig> {
        let Some(name) = name else { return Ok(&self.transmitter) };
        self.transmitters.get(name).ok_or_else(|| {
            let help = match nearest(name, self.transmitters.keys().map(String::as_str)) {
                Some(near) => format!("did you mean \"{near}\"?"),
                None if self.transmitters.is_empty() => format!("add [transmitters.{name}] to the scene file, or remove the key"),
                None => format!("it has: {}", self.transmitters.keys().cloned().collect::<Vec<_>>().join(", ")),
            };
            Error::invalid(place, format!("{} has no transmitter \"{name}\"", self.source.display()), help)
        })
    }

    /// The mesh file's path, resolved against the TOML file's folder.
    pub fn mesh_path(&self) -> PathBuf {
        self.source.parent().unwrap_or(Path::new("")).join(&self.scene.file)
    }

    /// Reads the mesh and gives its materials the radio properties of `[radio_materials]`. With the scene comes what the mesh's import left
    /// out or changed: whoever uses the scene has to say so.
    ///
    /// # Errors
    /// The mesh cannot be read, or `[radio_materials]` names a material the mesh does not have.
    pub fn load_scene(&self) -> Result<(Scene, Vec<Finding>)> {
        let mesh = self.mesh_path();
        let (mut scene, report) = crate::import::load_with_report(&mesh, &self.import_options())?;
        self.apply_radio_materials(&mut scene)?;
        Ok((scene, report.findings(&mesh)))
    }

    /// Options of the mesh file's import, from `[scene]`.
    pub fn import_options(&self) -> ImportOptions {
        let reach = if self.scene.allow_outside { Reach::Anywhere } else { Reach::Folder };
        ImportOptions { up: self.scene.up, reach, offset_m: self.scene.offset_m }
    }

    /// Gives materials the radio properties of `[radio_materials]`, by exact name.
    ///
    /// # Errors
    /// A name no material of the scene has, or properties out of range.
    pub fn apply_radio_materials(&self, scene: &mut Scene) -> Result<()> {
        self.radio_materials.keys().try_for_each(|name| self.apply_radio_material(name, scene))
    }

    /// [`SceneConfig::apply_radio_materials`] of one entry.
    ///
    /// # Errors
    /// As there; a name that is not in `[radio_materials]` does nothing.
    pub fn apply_radio_material(&self, name: &str, scene: &mut Scene) -> Result<()> {
        let Some(spec) = self.radio_materials.get(name) else { return Ok(()) };
        let place = format!("{}: radio_materials.\"{name}\"", self.source.display());
        let radio = spec.to_material(name, &place)?;
        let mut found = false;
        for material in scene.materials.iter_mut().filter(|m| m.name == *name) {
            material.radio = Some(radio.clone());
            found = true;
        }
        if found {
            return Ok(());
        }
        let names: Vec<&str> = scene.materials.iter().map(|m| m.name.as_str()).collect();
        let help = nearest(name, names.iter().copied()).map_or_else(
            || format!("names are exact; the scene has: {}", names.join(", ")),
            |near| format!("did you mean \"{near}\"?"),
        );
        Err(Error::invalid(place, format!("{} has no material of this name", scene.name), help))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::from_toml;
    use crate::model::Material;

    const TEXT: &str = r#"
[scene]
file = "room.glb"
[transmitter]
position_m = [12.4, 5, 2.0]
orientation = { yaw_deg = 180 }
pattern = "tr38901"
[receiver]
rows = 4
[radio_materials."Wall"]
itu = "concrete"
thickness_m = 0.2
[trajectory]
waypoints_m = [[1, 1], [4, 1], [4, 3]]
"#;

    #[test]
    fn defaults_fill_what_is_left_out() {
        let c: SceneConfig = from_toml(TEXT, "t.toml").unwrap();
        c.validate().unwrap();
        assert_eq!(c.radio.frequency_hz, 60e9);
        assert_eq!((c.receiver.rows, c.receiver.cols, c.receiver.spacing_wavelengths), (4, 8, [0.5, 0.5]));
        assert_eq!(c.trajectory.as_ref().unwrap().height_m, 1.6);
        let again: SceneConfig = from_toml(&toml::to_string(&c).unwrap(), "t.toml").unwrap();
        assert_eq!(again, c);
    }

    #[test]
    fn a_misspelt_key_is_placed_and_corrected() {
        let bad = TEXT.replace("rows = 4", "row = 4");
        let message = from_toml::<SceneConfig>(&bad, "t.toml").unwrap_err().to_string();
        assert!(message.contains("t.toml:9:1") && message.contains("did you mean `rows`"), "{message}");
        let bad = TEXT.replace("tr38901", "tr38.901");
        let message = from_toml::<SceneConfig>(&bad, "t.toml").unwrap_err().to_string();
        assert!(message.contains("t.toml:7:") && message.contains("did you mean `tr38901`"), "{message}");
        let message = from_toml::<SceneConfig>("[scene]\nfile = 3\n", "t.toml").unwrap_err().to_string();
        assert!(message.contains("t.toml:2:8"), "{message}");
    }

    #[test]
    fn frequencies_in_gigahertz_are_caught() {
        let mut c: SceneConfig = from_toml(TEXT, "t.toml").unwrap();
        c.radio.frequency_hz = 60.0;
        assert!(c.validate().unwrap_err().to_string().contains("60e9"));
    }

    #[test]
    fn radio_materials_apply_by_exact_name() {
        let c: SceneConfig = from_toml(TEXT, "t.toml").unwrap();
        let material = |name: &str| Material { name: name.into(), light: Default::default(), radio: None };
        let mut scene = Scene { materials: vec![material("Wall"), material("Floor")], ..Default::default() };
        c.apply_radio_materials(&mut scene).unwrap();
        assert_eq!(scene.materials[0].radio.as_ref().unwrap().id, "concrete");
        assert!(scene.materials[1].radio.is_none());
        scene.materials[0].name = "Walls".into();
        assert!(c.apply_radio_materials(&mut scene).unwrap_err().to_string().contains("did you mean \"Walls\""));
    }
}
