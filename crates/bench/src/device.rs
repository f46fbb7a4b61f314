//! `--device`: which device a command runs on.

use anyhow::Result;
use corf::{CpuDevice, Device, Gaussians, OptimizerConfig, RasterConfig};
use corf_raytrace::sensor::LightDevice;
use std::fmt;
use std::str::FromStr;

/// Choice of `--device`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// A GPU if this build has the GPU device and the machine has one, otherwise the processor.
    #[default]
    Auto,
    /// The processor.
    Cpu,
    /// A GPU, or any adapter that Vulkan, Metal or DirectX 12 offers; an error if there is none. `gpu:N` names the N-th, counted from 0.
    Gpu(usize),
}

impl FromStr for DeviceChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (kind, number) = text.split_once(':').unwrap_or((text, "0"));
        match (kind, number.parse()) {
            ("auto", _) if text == kind => Ok(Self::Auto),
            ("cpu", _) if text == kind => Ok(Self::Cpu),
            ("gpu", Ok(number)) => Ok(Self::Gpu(number)),
            _ => Err("expected auto, cpu, gpu or gpu:N, where N counts the machine's adapters from 0".to_owned()),
        }
    }
}

impl fmt::Display for DeviceChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => write!(f, "auto"),
            Self::Cpu => write!(f, "cpu"),
            Self::Gpu(number) => write!(f, "gpu:{number}"),
        }
    }
}

/// A device that was found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// The processor.
    #[default]
    Cpu,
    /// An adapter, by its name.
    #[cfg(feature = "gpu")]
    Gpu {
        /// The adapter's name.
        adapter: String,
        /// The number that [`DeviceChoice::Gpu`] gives it.
        number: usize,
        /// Whether a reconstruction's kernels are timed on it.
        timed: bool,
    },
}

impl DeviceChoice {
    /// The number of the adapter that is asked for.
    pub fn adapter(self) -> usize {
        if let Self::Gpu(number) = self { number } else { 0 }
    }

    /// Looks for the device and says on standard error what `auto` found.
    ///
    /// # Errors
    /// `gpu` where there is none, or in a build without it.
    #[cfg(feature = "gpu")]
    pub fn resolve(self) -> Result<Backend> {
        use crate::note;
        use corf_gpu::{AdapterOptions, adapter_name, adapter_names};
        let look = |number, software| adapter_name(&AdapterOptions { number, software, ..AdapterOptions::default() });
        match self {
            Self::Cpu => Ok(Backend::Cpu),
            Self::Auto => match look(0, false) {
                Some(adapter) => {
                    note!("device: {adapter}");
                    Ok(Backend::Gpu { adapter, number: 0, timed: false })
                }
                None => {
                    note!("device: no GPU was found, the processor does it");
                    Ok(Backend::Cpu)
                }
            },
            Self::Gpu(number) => {
                let there = adapter_names();
                let Some((adapter, in_software)) = there.get(number).cloned() else { anyhow::bail!(no_adapter(self, &there)) };
                if in_software {
                    note!(
                        "device: {adapter} is an adapter in software: it computes on the processor, where --device cpu is faster"
                    );
                }
                Ok(Backend::Gpu { adapter, number, timed: false })
            }
        }
    }

    /// Looks for the device.
    ///
    /// # Errors
    /// `gpu`, in a build without it.
    #[cfg(not(feature = "gpu"))]
    pub fn resolve(self) -> Result<Backend> {
        anyhow::ensure!(
            !matches!(self, Self::Gpu(_)),
            "--device {self}: this program was built without the GPU device\n  help: build it with `--features gpu`, or choose --device cpu"
        );
        Ok(Backend::Cpu)
    }
}

/// That there is no adapter of the number that `choice` names, and which there are: their names, and whether each is in software.
#[cfg(feature = "gpu")]
fn no_adapter(choice: DeviceChoice, there: &[(String, bool)]) -> String {
    let named = |(number, (name, in_software)): (usize, &(String, bool))| {
        format!("gpu:{number} {name}{}", if *in_software { " (in software)" } else { "" })
    };
    let names: Vec<String> = there.iter().enumerate().map(named).collect();
    match names.as_slice() {
        [] => format!("--device {choice}: no adapter was found\n  help: install a Vulkan driver, or choose --device cpu"),
        [one] => format!("--device {choice}: there is no such adapter\n  help: there is {one}; choose it or --device cpu"),
        _ => format!(
            "--device {choice}: there is no such adapter\n  help: there are {}; choose one or --device cpu",
            names.join(", ")
        ),
    }
}

/// Number of this machine's GPUs, adapters in software left out; 0 in a build without the GPU device.
pub fn gpu_count() -> usize {
    #[cfg(feature = "gpu")]
    {
        use corf_gpu::{AdapterOptions, adapter_name};
        let is_there = |number: &usize| adapter_name(&AdapterOptions { number: *number, ..AdapterOptions::default() }).is_some();
        (0..).take_while(is_there).count()
    }
    #[cfg(not(feature = "gpu"))]
    0
}

/// The most bytes that buffers took on GPUs since [`reset_peak_memory`]; `None` where none was at work.
pub fn peak_memory_bytes() -> Option<u64> {
    #[cfg(feature = "gpu")]
    return corf_gpu::peak_memory_bytes();
    #[cfg(not(feature = "gpu"))]
    None
}

/// Forgets that peak, so that the next speaks of what follows.
pub fn reset_peak_memory() {
    #[cfg(feature = "gpu")]
    corf_gpu::reset_peak_memory();
}

/// Options of an adapter that a baseline's network runs on, in half precision if it is to.
#[cfg(feature = "gpu")]
pub fn network_options(number: usize, half: bool) -> corf_gpu::AdapterOptions {
    corf_gpu::AdapterOptions { number, software: true, half, ..Default::default() }
}

impl Backend {
    /// Whether a network that is to multiply in half precision does so here: a GPU with matrix units.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "the processor never does"))]
    pub fn multiplies_in_half(&self, wanted: bool) -> bool {
        match self {
            Self::Cpu => false,
            #[cfg(feature = "gpu")]
            Self::Gpu { number, .. } => corf_gpu::multiplies_in_half(&network_options(*number, wanted)),
        }
    }

    /// [`Self::name`], with the precision where a network multiplies in half.
    pub fn name_with_precision(&self, half: bool) -> String {
        let precision = if self.multiplies_in_half(half) { ", f16 products" } else { "" };
        format!("{}{precision}", self.name())
    }

    /// The device as light is traced on it.
    pub fn for_light(&self) -> LightDevice {
        match self {
            Self::Cpu => LightDevice::Processor,
            #[cfg(feature = "gpu")]
            Self::Gpu { number, .. } => {
                let options =
                    corf_gpu::AdapterOptions { number: *number, software: true, timestamps: true, ..Default::default() };
                LightDevice::Gpu(options)
            }
        }
    }

    /// The adapter's name; `None` where it is the processor.
    pub fn adapter(&self) -> Option<&str> {
        match self {
            Self::Cpu => None,
            #[cfg(feature = "gpu")]
            Self::Gpu { adapter, .. } => Some(adapter),
        }
    }

    /// The device's name for records.
    pub fn name(&self) -> String {
        match self {
            Self::Cpu => format!("cpu ({} threads)", rayon::current_num_threads()),
            #[cfg(feature = "gpu")]
            Self::Gpu { adapter, .. } => format!("gpu ({adapter})"),
        }
    }

    /// The same, to time the kernels of reconstructions, which costs them a little.
    ///
    /// # Errors
    /// The processor, which has no kernels.
    pub fn timing_kernels(self) -> Result<Self> {
        match self {
            Self::Cpu => anyhow::bail!(
                "--time-kernels: kernels are timed on a GPU, and the processor reconstructs\n  help: choose --device gpu, or leave it out"
            ),
            #[cfg(feature = "gpu")]
            Self::Gpu { adapter, number, .. } => Ok(Self::Gpu { adapter, number, timed: true }),
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
            Self::Gpu { number, timed, .. } => {
                use corf::device::gpu::{GpuDevice, GpuOptions};
                use corf_gpu::AdapterOptions;
                let options = GpuOptions {
                    adapter: AdapterOptions { number: *number, software: true, timestamps: *timed, ..AdapterOptions::default() },
                    tile: raster.tile_px,
                    keyframe_bytes: raster.keyframe_bytes(),
                    ..GpuOptions::default()
                };
                Ok(Box::new(GpuDevice::new(&options, optimizer, raster, initial)?))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_are_read_and_written_alike() {
        for (text, choice) in [
            ("auto", DeviceChoice::Auto),
            ("cpu", DeviceChoice::Cpu),
            ("gpu:0", DeviceChoice::Gpu(0)),
            ("gpu:3", DeviceChoice::Gpu(3)),
        ] {
            assert_eq!(text.parse(), Ok(choice));
            assert_eq!(choice.to_string(), text);
        }
        assert_eq!("gpu".parse(), Ok(DeviceChoice::Gpu(0)));
        for text in ["", "cuda", "cpu:1", "auto:0", "gpu:", "gpu:-1", "gpu:one", "gpu:0:1"] {
            assert!(text.parse::<DeviceChoice>().is_err(), "{text}");
        }
    }

    #[cfg(feature = "gpu")]
    #[test]
    fn an_adapter_that_is_not_there_is_answered_by_those_that_are() {
        let choice = DeviceChoice::Gpu(7);
        let text = no_adapter(choice, &[("One".to_owned(), false), ("llvmpipe".to_owned(), true)]);
        for part in ["--device gpu:7", "gpu:0 One", "gpu:1 llvmpipe (in software)", "--device cpu"] {
            assert!(text.contains(part), "{part} in {text}");
        }
        assert!(no_adapter(choice, &[]).contains("install a Vulkan driver"));
    }
}
