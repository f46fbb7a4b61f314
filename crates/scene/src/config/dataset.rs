//! `scenes/lobby-mini.toml` and its like: how many keyframes, which images, which spectrum, which split.

use super::load::config_text;
use super::spectrum::{MAX_IMAGE_SIDE, check_fov};
use super::{SceneConfig, SpectrumConfig, TransmitterConfig, from_toml, read_toml};
use crate::trajectory::{TrajectoryPose, generate_between};
use crate::{Error, Pinhole, Result, bounds};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Configuration of `corf dataset generate`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DatasetConfig {
    /// Name of the dataset, e.g. `lobby-mini`.
    pub name: String,
    /// Scene file (TOML), relative to this file.
    pub scene: PathBuf,
    /// Name of the one of the scene's `[transmitters]` that is on. Default: its `[transmitter]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transmitter: Option<String>,
    /// Number of keyframes along the trajectory.
    pub keyframes: usize,
    /// The part of the scene's trajectory that is travelled, in loops. Default `[0.0, 1.0]`: once around.
    #[serde(default = "once_around")]
    pub way: [f64; 2],
    /// Seed of everything drawn at random. Default 0.
    #[serde(default)]
    pub seed: u64,
    /// The camera's images.
    #[serde(rename = "optical")]
    pub light: LightConfig,
    /// The RF images.
    #[serde(rename = "rf")]
    pub radio: SpectrumConfig,
    /// Training and test keyframes.
    #[serde(default)]
    pub split: SplitConfig,
    /// Path that the file was read from (its folder resolves `scene`).
    #[serde(skip)]
    pub source: PathBuf,
}

/// Largest effort of cached light.
const MAX_EFFORT: u32 = 64;

/// `[optical]`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LightConfig {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Full horizontal field of view, degrees. Default 90.
    #[serde(default = "ninety")]
    pub horizontal_fov_deg: f64,
    /// Method by which light is computed. Default `cached`.
    #[serde(default)]
    pub method: LightMethod,
    /// Camera paths a pixel; with `cached`, sixteen times as many where they disagree. Default 4 with `cached`, 256 with `path`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples_per_pixel: Option<u32>,
    /// Effort of cached light: the rays and walks of its lattices' points, and the camera paths, this many times. The error falls about
    /// as its root. Default 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effort: Option<u32>,
    /// Longest light path, in bounces; with `cached`, between diffuse surfaces. Default 64: paths end by themselves before.
    #[serde(default = "bounces")]
    pub max_bounces: u32,
    /// Exposure, EV (radiance × 2^EV); without it one exposure for the whole trajectory is metered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_ev: Option<f64>,
    /// Denoiser of images of the method `path`. Default: none, and they are unbiased.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub denoiser: Option<Denoiser>,
    /// Data sets of earlier versions say `true` where a filter went over their images; it can be read of, not asked for.
    #[serde(default, skip_serializing_if = "is_false")]
    #[schemars(skip)]
    pub denoise: bool,
    /// Also write linear radiance as EXR. Default false.
    #[serde(default)]
    pub write_linear: bool,
    /// Also write the reflectance of what is seen first, a denoiser's guide, as EXR. Default false.
    #[serde(default, skip_serializing_if = "is_false")]
    pub write_albedo: bool,
    /// Also write the normals of what is seen first, a denoiser's guide, as EXR. Default false.
    #[serde(default, skip_serializing_if = "is_false")]
    pub write_normals: bool,
    /// Also write depth in millimetres as 16-bit PNG. Default false.
    #[serde(default, skip_serializing_if = "is_false")]
    pub write_depth_png: bool,
}

impl LightConfig {
    /// [`LightConfig::samples_per_pixel`], or what the method takes by default.
    pub fn samples(&self) -> u32 {
        self.samples_per_pixel.unwrap_or(match self.method {
            LightMethod::Cached => 4,
            LightMethod::Path => 256,
        })
    }
}

/// Method by which light is computed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum LightMethod {
    /// Irradiance of diffuse surfaces is computed once, in the world, for all keyframes; mirrors, highlights and glass are traced for
    /// each. Nearly free of noise; slightly biased, as `dataset.json` says.
    #[default]
    Cached,
    /// Every pixel by itself, by unbiased path tracing: the reference.
    Path,
}

/// Noise filters, which are programs of others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Denoiser {
    /// Intel Open Image Denoise, guided by albedo and normals.
    Oidn,
}

fn is_false(value: &bool) -> bool {
    !value
}

/// `[split]`: which keyframes are kept from training.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SplitConfig {
    /// A keyframe with index % `test_every` == 0 is a test one. Default 8.
    pub test_every: usize,
    /// `[start, length]` of a contiguous segment, the second split. Default: an eighth of the keyframes from the middle on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub held_out_segment: Option<[usize; 2]>,
}

impl Default for SplitConfig {
    fn default() -> Self {
        Self { test_every: 8, held_out_segment: None }
    }
}

impl SplitConfig {
    /// The contiguous held-out segment of `count` keyframes, as `start..end`.
    pub fn held_out(&self, count: usize) -> std::ops::Range<usize> {
        let [start, length] = self.held_out_segment.unwrap_or([count / 2, (count / 8).max(1)]);
        start.min(count)..start.saturating_add(length).min(count)
    }

    /// Test keyframes of the interleaved split.
    pub fn test(&self, count: usize) -> Vec<usize> {
        (0..count).step_by(self.test_every.max(1)).collect()
    }

    /// Training keyframes of the interleaved split.
    pub fn train(&self, count: usize) -> Vec<usize> {
        (0..count).filter(|i| i % self.test_every.max(1) != 0).collect()
    }
}

fn once_around() -> [f64; 2] {
    [0.0, 1.0]
}
fn ninety() -> f64 {
    90.0
}
fn bounces() -> u32 {
    64
}

impl DatasetConfig {
    /// Reads and checks a dataset file.
    ///
    /// # Errors
    /// The file cannot be read, or a value in it cannot be used; the message names the key.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        Self::checked(read_toml(path)?, path)
    }

    /// Reads a dataset file, lets `change` set keys of its table, and checks what comes of it.
    ///
    /// # Errors
    /// As [`Self::load`]; what is wrong with a key that `change` set has no line to name.
    pub fn load_with(path: impl AsRef<Path>, change: impl FnOnce(&mut toml::Table)) -> Result<Self> {
        let path = path.as_ref();
        // What is wrong in the file itself is complained about with its line.
        let (text, place) = (config_text(path)?, path.display().to_string());
        let as_written: Self = from_toml(&text, &place)?;
        let mut table: toml::Table = from_toml(&text, &place)?;
        let before = table.clone();
        change(&mut table);
        if table == before {
            return Self::checked(as_written, path);
        }
        Self::checked(from_toml(&table.to_string(), &format!("{place} with --set"))?, path)
    }

    /// A configuration as `path` holds it, once its values are known to be of use.
    fn checked(mut config: Self, path: &Path) -> Result<Self> {
        config.source = path.to_path_buf();
        config.validate()?;
        Ok(config)
    }

    /// The poses of its keyframes, along the trajectory of its scene.
    ///
    /// # Errors
    /// The scene file has no `[trajectory]`.
    pub fn poses(&self, scene_config: &SceneConfig) -> Result<Vec<TrajectoryPose>> {
        let Some(trajectory) = &scene_config.trajectory else {
            return Err(Error::invalid(
                scene_config.source.display().to_string(),
                "there is no [trajectory] to place keyframes on",
                "add [trajectory] with waypoints_m = [[x, y], ...]",
            ));
        };
        generate_between(trajectory, self.keyframes, self.way)
    }

    /// The scene file's path, resolved against this file's folder.
    pub fn scene_path(&self) -> PathBuf {
        self.source.parent().unwrap_or(Path::new("")).join(&self.scene)
    }

    /// Reads the scene file this one refers to.
    ///
    /// # Errors
    /// As [`SceneConfig::load`].
    pub fn load_scene_config(&self) -> Result<SceneConfig> {
        SceneConfig::load(self.scene_path())
    }

    /// The scene's transmitter that this dataset is of.
    ///
    /// # Errors
    /// The scene has none of that name.
    pub fn transmitter_of<'a>(&self, scene: &'a SceneConfig) -> Result<&'a TransmitterConfig> {
        scene.transmitter_named(self.transmitter.as_deref(), &format!("{}: transmitter", self.source.display()))
    }

    /// The camera of the optical images.
    pub fn light_camera(&self) -> Pinhole {
        Pinhole::from_horizontal_fov(self.light.width, self.light.height, self.light.horizontal_fov_deg)
    }

    /// The camera of the RF images.
    pub fn radio_camera(&self) -> Pinhole {
        Pinhole::from_horizontal_fov(self.radio.width, self.radio.height, self.radio.horizontal_fov_deg)
    }

    /// The resolved configuration, defaults spelt out, as TOML.
    ///
    /// # Errors
    /// A number TOML cannot hold (a seed above 2⁶³ − 1).
    pub fn to_toml(&self) -> Result<String> {
        toml::to_string(self).map_err(|e| {
            Error::invalid(self.source.display().to_string(), format!("cannot be written as TOML: {e}"), "use a seed below 2^63")
        })
    }

    /// Checks every value.
    ///
    /// # Errors
    /// The first value out of range, by key.
    pub fn validate(&self) -> Result<()> {
        let fail =
            |key: &str, what: String, help: &str| Err(Error::invalid(format!("{}: {key}", self.source.display()), what, help));
        if self.name.is_empty() || self.name.contains(['/', '\\']) {
            return fail("name", format!("\"{}\" is no name", self.name), "give a short name, e.g. \"lobby-mini\"");
        }
        if self.keyframes == 0 {
            return fail("keyframes", "a dataset needs at least one keyframe".into(), "give a count, e.g. 40");
        }
        let place = |key: &str| format!("{}: {key}", self.source.display());
        bounds::count(&place("keyframes"), self.keyframes, bounds::MAX_KEYFRAMES, "keyframes")?;
        if self.seed > i64::MAX as u64 {
            return fail("seed", format!("{} is above 2^63 - 1", self.seed), "use a smaller seed");
        }
        for (table, w, h) in [("optical", self.light.width, self.light.height), ("rf", self.radio.width, self.radio.height)] {
            if !(1..=MAX_IMAGE_SIDE).contains(&w) || !(1..=MAX_IMAGE_SIDE).contains(&h) {
                return fail(table, format!("an image of {w}x{h} pixels"), "give 1 to 16384 pixels a side");
            }
        }
        check_fov(&place("optical.horizontal_fov_deg"), self.light.horizontal_fov_deg)?;
        if self.light.samples() == 0 || self.light.max_bounces == 0 {
            return fail("optical", "samples_per_pixel and max_bounces must be at least 1".into(), "e.g. 64 and 6");
        }
        let (samples, bounces) = (self.light.samples(), self.light.max_bounces);
        if samples > bounds::MAX_SAMPLES_PER_PIXEL || bounces > bounds::MAX_BOUNCES {
            let help = format!("give at most {} and {}", bounds::MAX_SAMPLES_PER_PIXEL, bounds::MAX_BOUNCES);
            return fail("optical", format!("{samples} samples_per_pixel and {bounces} max_bounces"), &help);
        }
        if let Some(effort) = self.light.effort {
            if !(1..=MAX_EFFORT).contains(&effort) {
                return fail("optical.effort", format!("is {effort}"), "give 1 to 64");
            }
            if self.light.method != LightMethod::Cached {
                let help = "leave it out and give samples_per_pixel, or set method = \"cached\"";
                return fail("optical.effort", "is that of cached light".into(), help);
            }
        }
        if self.light.denoise {
            return fail(
                "optical.denoise",
                "the filter that it asked for is gone".into(),
                "leave it out: method = \"cached\", the default, has little noise; with method = \"path\" there is denoiser = \"oidn\"",
            );
        }
        if self.light.denoiser.is_some() && self.light.method != LightMethod::Path {
            return fail(
                "optical.denoiser",
                "cached light has little noise, and of one surface the same in all keyframes; a filter would make it differ"
                    .into(),
                "leave it out, or set method = \"path\"",
            );
        }
        if let Some(exposure_ev) = self.light.exposure_ev {
            bounds::number(&place("optical.exposure_ev"), exposure_ev, &bounds::EXPOSURE_EV, "EV, or leave it out")?;
        }
        self.radio.validate(&self.source.display().to_string())?;
        if self.split.test_every < 2 && self.keyframes > 1 {
            return fail("split.test_every", "leaves nothing to train on".into(), "give 2 or more (8 is usual)");
        }
        if let Some([start, length]) = self.split.held_out_segment
            && (length == 0 || start.checked_add(length).is_none_or(|end| end > self.keyframes))
        {
            return fail(
                "split.held_out_segment",
                format!("[{start}, {length}] is not inside 0..{}", self.keyframes),
                "give [start, length] with length >= 1 and start + length <= keyframes",
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
name = "mini"
scene = "lobby.toml"
keyframes = 147
[optical]
width = 192
height = 108
[rf]
width = 96
height = 64
"#;

    #[test]
    fn the_resolved_configuration_spells_out_its_defaults() {
        let c: DatasetConfig = from_toml(TEXT, "d.toml").unwrap();
        c.validate().unwrap();
        let text = c.to_toml().unwrap();
        assert!(text.contains("lobe_width_deg = 1.0") && text.contains("test_every = 8"), "{text}");
        assert_eq!(from_toml::<DatasetConfig>(&text, "d.toml").unwrap(), c);
    }

    #[test]
    fn every_eighth_of_147_is_19_test_and_128_training_keyframes() {
        let split = SplitConfig::default();
        assert_eq!((split.test(147).len(), split.train(147).len()), (19, 128));
        assert_eq!(split.held_out(147), 73..91);
        assert_eq!(SplitConfig { held_out_segment: Some([140, 20]), ..split }.held_out(147), 140..147);
    }

    #[test]
    fn values_out_of_range_name_their_key() {
        for (from, to, key) in [
            ("keyframes = 147", "keyframes = 0", "keyframes"),
            ("width = 96", "width = 0", "rf"),
            ("height = 64", "height = 64\ndynamic_range_db = -3", "rf.dynamic_range_db"),
            ("height = 64", "height = 64\nbandwidth_hz = 1.0", "rf.bandwidth_hz: 1 Hz is under 1 MHz"),
            ("height = 64", "height = 64\nbandwidth_hz = inf", "rf.bandwidth_hz"),
            ("height = 64", "height = 64\nmvdr_loading = 0", "rf.mvdr_loading"),
            ("height = 64", "height = 64\nsphere = [0, 180]", "rf.sphere"),
            ("height = 64", "height = 64\nlobe_width_deg = 0.1", "rf.lobe_width_deg"),
            ("height = 108", "height = 108\nhorizontal_fov_deg = 180", "optical.horizontal_fov_deg"),
            ("[rf]", "[split]\nheld_out_segment = [140, 8]\n[rf]", "split.held_out_segment"),
        ] {
            let c: DatasetConfig = from_toml(&TEXT.replace(from, to), "d.toml").unwrap();
            let message = c.validate().unwrap_err().to_string();
            assert!(message.contains(key), "{message}");
        }
    }

    #[test]
    fn a_spectrum_or_a_transmitter_that_is_none_is_corrected() {
        let message =
            from_toml::<DatasetConfig>(&TEXT.replace("[rf]", "[rf]\nspectrum = \"mdvr\""), "d.toml").unwrap_err().to_string();
        assert!(message.contains("d.toml:9:") && message.contains("did you mean `mvdr`"), "{message}");
        let scene = "[scene]\nfile = \"r.glb\"\n[transmitter]\nposition_m = [0, 0, 2]\n[transmitters.east]\nposition_m = [3, 0, 2]\ncols = 4\n";
        let scene: SceneConfig = from_toml(scene, "s.toml").unwrap();
        scene.validate().unwrap();
        let of = |name: &str| from_toml::<DatasetConfig>(&format!("transmitter = \"{name}\"\n{TEXT}"), "d.toml").unwrap();
        assert_eq!(of("east").transmitter_of(&scene).unwrap().position_m, [3.0, 0.0, 2.0]);
        let message = of("eest").transmitter_of(&scene).unwrap_err().to_string();
        assert!(message.contains("did you mean \"east\""), "{message}");
    }

    #[test]
    fn keys_of_earlier_versions_are_read_and_written_as_they_were() {
        let radio = |keys: &str| from_toml::<SpectrumConfig>(&format!("width = 8\nheight = 6\n{keys}"), "d.toml");
        let own = SpectrumConfig { width: 8, height: 6, max_interactions: 2, ..SpectrumConfig::default() };
        for name in ["max_interactions", "max_reflections", "max_depth"] {
            assert_eq!(radio(&format!("{name} = 2")).unwrap(), own);
        }
        // A header's hash is that of its text, by which `--resume` knows what was begun, and records what they are of.
        let text = serde_json::to_string(&own).unwrap();
        let begin = "{\"width\":8,\"height\":6,\"horizontal_fov_deg\":90.0,\"max_reflections\":2,\"transmission\":true,\"diffraction\":false,\"diffuse\":true,";
        assert!(text.starts_with(begin) && text.ends_with(",\"write_db\":false,\"tutorial_compat\":false}"), "{text}");
        assert_eq!(serde_json::from_str::<SpectrumConfig>(&text).unwrap(), own);
        let old = radio("tutorial_compat = true").unwrap();
        assert!(old.validate("d.toml").unwrap_err().to_string().contains("rf.tutorial_compat"));
    }

    #[test]
    fn the_committed_configurations_load() {
        let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
        for (name, keyframes, light, radio) in [
            ("lobby-mini", 40, (192, 108), (96, 64)),
            ("lobby147", 147, (1600, 900), (300, 200)),
            ("office-mini", 40, (192, 108), (96, 64)),
            ("office480", 120, (480, 270), (300, 200)),
        ] {
            let c = DatasetConfig::load(scenes.join(format!("{name}.toml"))).unwrap();
            assert_eq!((c.name.as_str(), c.keyframes), (name, keyframes));
            assert_eq!((c.light_camera().width, c.light_camera().height), light);
            assert_eq!((c.radio_camera().width, c.radio_camera().height), radio);
        }
    }

    #[test]
    fn keys_are_changed_before_the_whole_is_checked() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("d.toml");
        std::fs::write(&path, TEXT).unwrap();
        let with = |change: &str| {
            DatasetConfig::load_with(&path, |table| {
                for (key, value) in change.parse::<toml::Table>().unwrap() {
                    table.insert(key, value);
                }
            })
        };
        assert_eq!(with("").unwrap(), DatasetConfig::load(&path).unwrap());
        let changed = with("seed = 9").unwrap();
        assert_eq!(changed, DatasetConfig { seed: 9, ..DatasetConfig::load(&path).unwrap() });
        for (change, said) in
            [("sead = 9", "did you mean `seed`?"), ("keyframes = 0", "keyframes"), ("seed = \"x\"", "with --set")]
        {
            let message = with(change).unwrap_err().to_string();
            assert!(message.contains(said), "{change}: {message}");
        }
    }
}
