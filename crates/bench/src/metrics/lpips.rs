//! LPIPS of images and Jet spectra, where its weights are given.
//!
//! A key is `lpips_BACKBONE_IMAGE` for the input as LPIPS defines it, [−1, 1], and `lpips_BACKBONE_01_IMAGE` for the literature's, [0, 1].

use crate::device::Backend;
use crate::note;
use crate::terminal::interrupt;
use anyhow::{Result, bail};
use clap::{Args, ValueEnum};
#[cfg(feature = "gpu")]
use corf::image_networks::lpips::LpipsOnGpu;
use corf::image_networks::lpips::{Backbone, Lpips, LpipsInput};
use corf_scene::Raster;
use corf_scene::dataset::Dataset;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
#[cfg(feature = "gpu")]
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Advice to who wants LPIPS and has no weights.
pub const NO_WEIGHTS: &str = "no weights were given (tools/fetch_weights.py gets them, --lpips names their folder)";

/// Which LPIPS is computed: where its weights are, and of which images.
#[derive(Args, Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LpipsOption {
    /// Compute LPIPS as well, with the weights in this folder: lpips_vgg.safetensors, lpips_alex.safetensors or lpips_squeeze.safetensors, as
    /// tools/fetch_weights.py gets them.
    #[arg(long, value_name = "FOLDER")]
    #[serde(default, rename = "folder", skip_serializing_if = "Option::is_none")]
    lpips: Option<PathBuf>,
    /// Images that LPIPS is computed of: large ones take long on a processor (VGG-16 needs 0.9 TFLOP for 1600×900 pixels, and LPIPS four such passes).
    #[arg(long, value_enum, default_value_t, requires = "lpips")]
    #[serde(rename = "images")]
    lpips_images: LpipsImages,
}

/// Images that LPIPS is computed of.
#[derive(ValueEnum, Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LpipsImages {
    /// Images and Jet spectra.
    #[default]
    Both,
    /// Jet spectra alone.
    Spectra,
}

impl LpipsImages {
    fn include(self, name: &str) -> bool {
        self == Self::Both || name != LIGHT
    }
}

impl LpipsOption {
    /// Whether it is to be computed.
    pub fn is_asked_for(&self) -> bool {
        self.lpips.is_some()
    }

    /// The same with its folder as an absolute path.
    ///
    /// # Errors
    /// When there is no working directory.
    pub fn absolute(&self) -> Result<Self> {
        let lpips = self.lpips.as_deref().map(std::path::absolute).transpose()?;
        Ok(Self { lpips, lpips_images: self.lpips_images })
    }

    /// The networks whose weights are in the folder, to be run on a device; none without a folder.
    ///
    /// # Errors
    /// Those of [`LpipsNetworks::read`].
    pub fn networks(&self, backend: &Backend) -> Result<Arc<LpipsNetworks>> {
        let networks = self.lpips.as_deref().map(|folder| LpipsNetworks::read(folder, self.lpips_images)).transpose()?;
        Ok(Arc::new(LpipsNetworks { backend: backend.clone(), ..networks.unwrap_or_default() }))
    }

    /// [`Self::networks`], and says so if LPIPS is not computed.
    ///
    /// # Errors
    /// Those of [`LpipsNetworks::read`].
    pub fn read(&self, backend: &Backend) -> Result<Arc<LpipsNetworks>> {
        if !self.is_asked_for() {
            note!("LPIPS is not computed: {NO_WEIGHTS}");
        }
        self.networks(backend)
    }
}

/// Name of the image of light among [`Pair`]s …
pub const LIGHT: &str = "opt";
/// … and that of the Jet spectrum.
pub const SPECTRUM: &str = "rf_jet";

/// Two 8-bit images and the name that keys end with.
pub type Pair<'a> = (&'a str, &'a Raster<[u8; 3]>, &'a Raster<[u8; 3]>);

/// The networks that LPIPS is computed with; none where it is not.
#[derive(Debug, Default)]
pub struct LpipsNetworks {
    networks: Vec<Lpips>,
    images: LpipsImages,
    /// Where they are to run.
    backend: Backend,
    /// Where they have run.
    ran_on_gpu: AtomicBool,
    ran_on_processor: AtomicBool,
}

impl LpipsNetworks {
    /// Reads the weights that are in a folder.
    ///
    /// # Errors
    /// A folder without any, or weights that are not those of LPIPS v0.1.
    pub fn read(folder: &Path, images: LpipsImages) -> Result<Self> {
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
        Ok(Self { networks, images, ..Self::default() })
    }

    /// Checks that a dataset's images are large enough for every network.
    ///
    /// # Errors
    /// Images that are too small, and the size that is needed.
    pub fn check(&self, dataset: &Dataset) -> Result<()> {
        let has = dataset.modalities();
        let cameras =
            [(has.light, LIGHT, "images", dataset.light_camera()), (has.radio, SPECTRUM, "spectra", dataset.radio_camera())];
        let compared = cameras.iter().filter(|(is_there, name, ..)| *is_there && self.images.include(name));
        for (network, (_, _, what, camera)) in self.networks.iter().flat_map(|n| compared.clone().map(move |c| (n, c))) {
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

    /// SHA-256 of the weights, by backbone and, if they are not all, the images that it sees.
    pub fn sha256(&self) -> BTreeMap<String, String> {
        let of = match self.images {
            LpipsImages::Both => "",
            LpipsImages::Spectra => " (spectra)",
        };
        self.networks.iter().map(|n| (format!("{}{of}", n.backbone().name()), n.sha256().to_owned())).collect()
    }

    /// The device that distances have been computed on so far: the GPU's name, `cpu`, or both; none before the first.
    pub fn device(&self) -> Option<String> {
        let gpu = self.ran_on_gpu.load(Ordering::Relaxed).then(|| self.backend.name());
        let processor = self.ran_on_processor.load(Ordering::Relaxed).then(|| "cpu".to_owned());
        let devices: Vec<String> = gpu.into_iter().chain(processor).collect();
        (!devices.is_empty()).then(|| devices.join(" and "))
    }

    /// The same networks on the GPU that is asked for, in their order; none where the processor runs them: no GPU is asked for, it is an adapter in
    /// software, or it cannot be used, which is said.
    #[cfg(feature = "gpu")]
    fn on_gpu(&self) -> Vec<LpipsOnGpu> {
        use corf_gpu::{AdapterOptions, Context};
        let Backend::Gpu { number, .. } = &self.backend else { return vec![] };
        let open = || {
            let context = Arc::new(Context::open(&AdapterOptions { number: *number, software: true, ..Default::default() })?);
            if context.is_software() {
                return Ok(vec![]);
            }
            self.networks.iter().map(|network| LpipsOnGpu::new(&context, network)).collect::<corf::Result<_>>()
        };
        open().unwrap_or_else(|error| {
            note!("LPIPS is computed on the processor: {error}");
            vec![]
        })
    }
}

/// Networks at work. A GPU is opened when something is first compared, and given back with the last clone.
#[derive(Clone, Debug, Default)]
pub struct LpipsComparer {
    networks: Arc<LpipsNetworks>,
    #[cfg(feature = "gpu")]
    on_gpu: Arc<OnceLock<Vec<LpipsOnGpu>>>,
}

impl LpipsComparer {
    /// Compares with these networks.
    pub fn new(networks: &Arc<LpipsNetworks>) -> Self {
        Self {
            networks: networks.clone(),
            #[cfg(feature = "gpu")]
            on_gpu: Arc::default(),
        }
    }

    /// Distances of pairs of images that have a name, by key.
    ///
    /// # Errors
    /// An interrupt, which is looked for before each of them.
    pub fn compare(&self, pairs: &[Pair<'_>]) -> Result<BTreeMap<String, f64>> {
        let mut found = BTreeMap::new();
        let LpipsNetworks { networks, images, .. } = &*self.networks;
        for (number, network) in networks.iter().enumerate() {
            for (name, a, b) in pairs.iter().filter(|(name, ..)| images.include(name)) {
                for (input, mark) in [(LpipsInput::Signed, ""), (LpipsInput::Unit, "_01")] {
                    interrupt::check()?;
                    let key = format!("lpips_{}{mark}_{name}", network.backbone().name());
                    found.insert(key, self.distance(number, a, b, input));
                }
            }
        }
        Ok(found)
    }

    fn distance(&self, number: usize, a: &Raster<[u8; 3]>, b: &Raster<[u8; 3]>, input: LpipsInput) -> f64 {
        #[cfg(feature = "gpu")]
        if let Some(network) = self.on_gpu.get_or_init(|| self.networks.on_gpu()).get(number) {
            match network.distance(a, b, input) {
                Ok(distance) => {
                    self.networks.ran_on_gpu.store(true, Ordering::Relaxed);
                    return distance;
                }
                Err(error) => note!("LPIPS of a pair of images is computed on the processor: {error}"),
            }
        }
        self.networks.ran_on_processor.store(true, Ordering::Relaxed);
        self.networks.networks[number].distance(a, b, input)
    }
}
