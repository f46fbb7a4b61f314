//! A scene file held against its scene, before anything is traced.

use super::{material_findings, placement_findings, refuse};
use crate::config::SceneConfig;
use crate::words::{counted, verb};
use crate::{Error, Result, Scene, Severity};

impl SceneConfig {
    /// Checks that every material a triangle uses has radio properties valid at the carrier; what no triangle uses does not matter.
    ///
    /// # Errors
    /// All materials without radio properties by name, or all whose properties cannot be used at this frequency.
    pub fn check_radio(&self, scene: &Scene) -> Result<()> {
        let missing = scene.materials_without_radio();
        if !missing.is_empty() {
            return Err(Error::invalid(
                self.source.display().to_string(),
                format!(
                    "{} of {} {} no radio properties: {}",
                    missing.len(),
                    counted(scene.materials.len(), "material"),
                    verb(missing.len(), "has", "have"),
                    missing.join(", ")
                ),
                format!(
                    "add [radio_materials.\"{}\"] (and so on) here, or extras.corf_radio to the material in the mesh file",
                    missing[0]
                ),
            ));
        }
        let mut errors = material_findings(scene, self.radio.frequency_hz);
        errors.retain(|f| f.severity == Severity::Error);
        if errors.len() < 2 {
            return refuse(errors);
        }
        let all: Vec<String> = errors.iter().map(|f| format!("{}: {}", f.place, f.what)).collect();
        let what = format!(
            "{} cannot be traced at {} GHz:\n    {}",
            counted(all.len(), "material"),
            self.radio.frequency_hz / 1e9,
            all.join("\n    ")
        );
        Err(Error::invalid(self.source.display().to_string(), what, errors[0].help.clone()))
    }

    /// Checks that no transmitter lies inside of a closed object, nor the platform's way, nor the one on the other.
    ///
    /// # Errors
    /// The first that does, with the object's name.
    pub fn check_placement(&self, scene: &Scene) -> Result<()> {
        refuse(placement_findings(self, scene))
    }
}
