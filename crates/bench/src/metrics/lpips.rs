//! LPIPS of images and Jet spectra, where its weights are given.
//!
//! A key is `lpips_BACKBONE_IMAGE` for the input as LPIPS defines it, [−1, 1], and `lpips_BACKBONE_01_IMAGE` for the literature's, [0, 1].

use crate::note;
use anyhow::{Result, bail};
use clap::Args;
use corf::lpips::{Backbone, Input, Lpips};
use corf_scene::Raster;
use corf_scene::dataset::Dataset;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Advice to who wants LPIPS and has no weights.
pub const NO_WEIGHTS: &str = "no weights were given (tools/fetch_weights.py gets them, --lpips names their folder)";

/// Where weights of LPIPS are.
#[derive(Args, Clone, Debug)]
pub struct LpipsOption {
    /// Compute LPIPS as well, with the weights in this folder: lpips_vgg.safetensors, lpips_alex.safetensors or lpips_squeeze.safetensors, as
    /// tools/fetch_weights.py gets them.
    #[arg(long, value_name = "FOLDER")]
    lpips: Option<PathBuf>,
}

impl LpipsOption {
    /// The folder, as an absolute path.
    ///
    /// # Errors
    /// When there is no working directory.
    pub fn folder(&self) -> Result<Option<PathBuf>> {
        Ok(self.lpips.as_deref().map(std::path::absolute).transpose()?)
    }

    /// The networks whose weights are in the folder; none without a folder, which is said.
    ///
    /// # Errors
    /// Those of [`LpipsNetworks::read`].
    pub fn read(&self) -> Result<Arc<LpipsNetworks>> {
        if let Some(folder) = &self.lpips {
            return Ok(Arc::new(LpipsNetworks::read(folder)?));
        }
        note!("LPIPS is not computed: {NO_WEIGHTS}");
        Ok(Arc::default())
    }
}

/// Two 8-bit images and the name that keys end with.
pub type Pair<'a> = (&'a str, &'a Raster<[u8; 3]>, &'a Raster<[u8; 3]>);

/// The networks that LPIPS is computed with; none where it is not.
#[derive(Debug, Default)]
pub struct LpipsNetworks(Vec<Lpips>);

impl LpipsNetworks {
    /// Reads the weights that are in a folder.
    ///
    /// # Errors
    /// A folder without any, or weights that are not those of LPIPS v0.1.
    pub fn read(folder: &Path) -> Result<Self> {
        let file = |backbone: Backbone| folder.join(backbone.file());
        let there = Backbone::ALL.into_iter().filter(|b| file(*b).exists());
        let networks: Vec<Lpips> = there.map(|b| Lpips::read(&file(b), b)).collect::<corf::Result<_>>()?;
        if networks.is_empty() {
            let names = Backbone::ALL.map(Backbone::file).join(", ");
            bail!(
                "{} holds no weights of LPIPS\n  help: it needs one or more of {names}; tools/fetch_weights.py gets them",
                folder.display()
            );
        }
        Ok(Self(networks))
    }

    /// Checks that a dataset's images are large enough for every network.
    ///
    /// # Errors
    /// Images that are too small, and the size that is needed.
    pub fn check(&self, dataset: &Dataset) -> Result<()> {
        let has = dataset.modalities();
        let cameras = [(has.light, "images", dataset.optical_camera()), (has.radio, "spectra", dataset.rf_camera())];
        let cameras: Vec<_> = cameras.into_iter().filter(|c| c.0).map(|(_, what, camera)| (what, camera)).collect();
        for (network, (what, camera)) in self.0.iter().flat_map(|n| cameras.iter().map(move |c| (n, c))) {
            let (least, name) = (network.least_px(), network.backbone().name());
            if camera.width.min(camera.height) < least {
                bail!(
                    "LPIPS ({name}) needs {least}x{least} pixels at least, and the {what} of {} have {}x{}\n  help: leave --lpips out, or \
                     the file {} out of its folder",
                    dataset.header().name,
                    camera.width,
                    camera.height,
                    network.backbone().file()
                );
            }
        }
        Ok(())
    }

    /// SHA-256 of the weights, by backbone.
    pub fn sha256(&self) -> BTreeMap<String, String> {
        self.0.iter().map(|n| (n.backbone().name().to_owned(), n.sha256().to_owned())).collect()
    }

    /// Distances of pairs of images that have a name, by key.
    pub fn compare(&self, pairs: &[Pair<'_>]) -> BTreeMap<String, f64> {
        let mut found = BTreeMap::new();
        for (network, (name, a, b)) in self.0.iter().flat_map(|n| pairs.iter().map(move |p| (n, p))) {
            for (input, mark) in [(Input::Signed, ""), (Input::Unit, "_01")] {
                found.insert(format!("lpips_{}{mark}_{name}", network.backbone().name()), network.distance(a, b, input));
            }
        }
        found
    }
}
