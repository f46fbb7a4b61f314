//! `--device`: which device a command runs on.

use anyhow::Result;
use corf::{CpuDevice, Device, Gaussians, OptimizerConfig, RasterConfig};

/// What `--device` accepts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum DeviceChoice {
    /// A GPU if this build has the GPU device and the machine has one, otherwise the processor.
    #[default]
    Auto,
    /// The processor.
    Cpu,
    /// A GPU, or any adapter that Vulkan, Metal or DirectX 12 offers; an error if there is none.
    Gpu,
}

/// A device that was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Backend {
    /// The processor.
    Cpu,
    /// An adapter, by its name.
    #[cfg(feature = "gpu")]
    Gpu {
        /// The adapter's name.
        adapter: String,
    },
}

impl DeviceChoice {
    /// Looks for the device and says on standard error what `auto` found.
    ///
    /// # Errors
    /// `gpu` where there is none, or in a build without it.
    #[cfg(feature = "gpu")]
    pub fn resolve(self) -> Result<Backend> {
        use crate::note;
        use corf::device::gpu::{GpuOptions, adapter_name};
        let look = |software| adapter_name(&GpuOptions { software, ..GpuOptions::default() });
        match (self, look(false)) {
            (Self::Cpu, _) => Ok(Backend::Cpu),
            (Self::Auto, Some(adapter)) => {
                note!("device: {adapter}");
                Ok(Backend::Gpu { adapter })
            }
            (Self::Auto, None) => {
                note!("device: no GPU was found, the processor does it");
                Ok(Backend::Cpu)
            }
            (Self::Gpu, found) => found.or_else(|| look(true)).map(|adapter| Backend::Gpu { adapter }).ok_or_else(|| {
                anyhow::anyhow!("--device gpu: no adapter was found\n  help: install a Vulkan driver, or choose --device cpu")
            }),
        }
    }

    /// Looks for the device.
    ///
    /// # Errors
    /// `gpu`, in a build without it.
    #[cfg(not(feature = "gpu"))]
    pub fn resolve(self) -> Result<Backend> {
        anyhow::ensure!(
            self != Self::Gpu,
            "--device gpu: this program was built without the GPU device\n  help: build it with `--features gpu`, or choose --device cpu"
        );
        Ok(Backend::Cpu)
    }
}

impl Backend {
    /// For records.
    pub fn name(&self) -> String {
        match self {
            Self::Cpu => format!("cpu ({} threads)", rayon::current_num_threads()),
            #[cfg(feature = "gpu")]
            Self::Gpu { adapter } => format!("gpu ({adapter})"),
        }
    }

    /// A fresh device that holds `initial`.
    ///
    /// # Errors
    /// The device's.
    pub fn make(&self, optimizer: OptimizerConfig, raster: RasterConfig, initial: &Gaussians) -> Result<Box<dyn Device>> {
        match self {
            Self::Cpu => Ok(Box::new(CpuDevice::new(optimizer, raster, initial)?)),
            #[cfg(feature = "gpu")]
            Self::Gpu { .. } => {
                use corf::device::gpu::{GpuDevice, GpuOptions};
                let options = GpuOptions { software: true, tile: raster.tile_px, ..GpuOptions::default() };
                Ok(Box::new(GpuDevice::new(&options, optimizer, raster, initial)?))
            }
        }
    }
}
