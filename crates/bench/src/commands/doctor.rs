//! `corf doctor`: what this program and this machine can do, and why they cannot do the rest.

use super::{Verdict, show};
use crate::metrics::lpips::{LpipsImages, LpipsNetworks, NO_WEIGHTS};
use crate::record::provenance::Provenance;
use crate::render::video;
use crate::scenes::oidn::{LIBRARY_VARIABLE, Oidn};
use anyhow::Result;
use clap::Args;
use corf_scene::bounds;
use corf_scene::words::counted;
use serde::Serialize;
use std::path::PathBuf;

/// `corf doctor`.
#[derive(Args)]
pub struct Doctor {
    /// Folder with the networks of LPIPS, as `corf evaluate --lpips` takes it: whether they can be read.
    #[arg(long, value_name = "DIR")]
    lpips: Option<PathBuf>,
}

/// Something optional: there, or the reason why not.
#[derive(Serialize)]
struct Found {
    found: bool,
    what: String,
}

impl Found {
    fn of<E: std::fmt::Display>(found: Result<String, E>) -> Self {
        match found {
            Ok(what) => Self { found: true, what },
            // Without the help that belongs to a command which needs it.
            Err(why) => Self { found: false, what: why.to_string().lines().map(str::trim).collect::<Vec<_>>().join("; ") },
        }
    }
}

/// The answer of `corf doctor`.
#[derive(Serialize)]
struct Report {
    program: Provenance,
    /// Features that the program was built with.
    features: Vec<&'static str>,
    system: String,
    memory_available_bytes: f64,
    /// Working folder and the space on its disk; none where the system does not tell.
    folder: PathBuf,
    disk_available_bytes: Option<u64>,
    gpu: Found,
    adapters: Vec<serde_json::Value>,
    lpips: Found,
    oidn: Found,
    ffmpeg: Found,
}

impl Doctor {
    /// Runs the command. What is missing is an answer, not an error.
    ///
    /// # Errors
    /// When standard output cannot be written.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let (gpu, adapters) = gpu();
        let folder = std::env::current_dir().unwrap_or_default();
        let report = Report {
            program: Provenance::here(),
            features: if cfg!(feature = "gpu") { vec!["gpu"] } else { Vec::new() },
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
            memory_available_bytes: bounds::available_bytes(),
            disk_available_bytes: disk_available_bytes(&folder),
            folder,
            gpu,
            adapters,
            lpips: self.lpips(),
            oidn: Found::of(Oidn::find(LIBRARY_VARIABLE).map(|o| o.name())),
            ffmpeg: Found::of(video::version()),
        };
        show(json, &report, &report.text())?;
        Ok(Verdict::Done)
    }

    fn lpips(&self) -> Found {
        let Some(folder) = &self.lpips else { return Found { found: false, what: NO_WEIGHTS.to_owned() } };
        Found::of(LpipsNetworks::read(folder, LpipsImages::Both).map(|networks| {
            let names: Vec<String> = networks.sha256().into_keys().collect();
            format!("{} in {}", names.join(", "), folder.display())
        }))
    }
}

impl Report {
    fn text(&self) -> String {
        let p = &self.program;
        let gigabytes = |bytes: f64| format!("{:.1} GB", bytes / 1e9);
        let dirty = if p.dirty { ", with changes" } else { "" };
        let features = if self.features.is_empty() { "none".to_owned() } else { self.features.join(", ") };
        let mut lines = vec![
            ("program", format!("corf {} (commit {}{dirty}), features: {features}", p.version, p.commit)),
            ("processor", format!("{}, {}, {}", p.processor, counted(p.threads, "thread"), self.system)),
            ("memory", format!("{} available", gigabytes(self.memory_available_bytes))),
            (
                "disk",
                match self.disk_available_bytes {
                    Some(bytes) => format!("{} available in {}", gigabytes(bytes as f64), self.folder.display()),
                    None => format!("unknown space in {}", self.folder.display()),
                },
            ),
        ];
        let answer = |found: &Found| if found.found { found.what.clone() } else { format!("no: {}", found.what) };
        lines.push(("GPU", answer(&self.gpu)));
        for (i, adapter) in self.adapters.iter().enumerate() {
            let line = |key: &str| adapter[key].as_str().unwrap_or_default().to_owned();
            let usable = if adapter["usable"] == true { "" } else { ", NOT usable: " };
            lines.push(("", format!("gpu:{i} {}{usable}{}", line("summary"), line("why"))));
        }
        lines.push(("LPIPS", answer(&self.lpips)));
        lines.push(("OIDN", answer(&self.oidn)));
        lines.push(("ffmpeg", answer(&self.ffmpeg)));
        lines.iter().map(|(name, text)| format!("{name:<10} {text}")).collect::<Vec<_>>().join("\n")
    }
}

/// Whether a reconstruction finds a GPU, and every adapter there is.
#[cfg(feature = "gpu")]
fn gpu() -> (Found, Vec<serde_json::Value>) {
    use corf_gpu::adapter_reports;
    let reports = adapter_reports();
    let usable = reports.iter().find(|r| r.usable.is_ok() && !r.software);
    let found = match (usable, reports.is_empty()) {
        (Some(report), _) => Found { found: true, what: format!("{} is what --device auto takes", report.name) },
        (None, true) => {
            let what = "no adapter was found: Vulkan, Metal or DirectX 12 has no driver here (Linux: is libvulkan.so.1 installed, and does \
                        /usr/share/vulkan/icd.d or /etc/vulkan/icd.d name a driver?)";
            Found { found: false, what: what.to_owned() }
        }
        (None, false) => {
            let what = "no adapter is a usable GPU; --device auto takes the processor, and --device gpu:N an adapter in software";
            Found { found: false, what: what.to_owned() }
        }
    };
    let adapters = reports
        .iter()
        .map(|r| {
            let software = if r.software { ", in software" } else { "" };
            let subgroups = match r.subgroup {
                Some([least, most]) if least == most => format!("subgroups of {least}"),
                Some([least, most]) => format!("subgroups of {least} to {most}"),
                None => "no subgroups".to_owned(),
            };
            serde_json::json!({
                "name": r.name,
                "backend": r.backend,
                "driver": r.driver,
                "software": r.software,
                "subgroup_size": r.subgroup,
                "timestamps": r.timestamps,
                "largest_buffer_bytes": r.largest_buffer_bytes,
                "storage_buffers": r.storage_buffers,
                "usable": r.usable.is_ok(),
                "why": r.usable.as_ref().err(),
                "summary": format!(
                    "{} ({}{software}; driver {}; {subgroups}; buffers of up to {:.1} GB, {} bound at once)",
                    r.name, r.backend, r.driver, r.largest_buffer_bytes as f64 / 1e9, r.storage_buffers
                ),
            })
        })
        .collect();
    (found, adapters)
}

/// Whether a reconstruction finds a GPU: this build does not look.
#[cfg(not(feature = "gpu"))]
fn gpu() -> (Found, Vec<serde_json::Value>) {
    let what = "this program was built without the GPU device: build it with `--features gpu`";
    (Found { found: false, what: what.to_owned() }, Vec::new())
}

/// Space that a user may still take on a folder's disk.
#[cfg(unix)]
fn disk_available_bytes(folder: &std::path::Path) -> Option<u64> {
    use std::os::unix::ffi::OsStrExt;
    let path = std::ffi::CString::new(folder.as_os_str().as_bytes()).ok()?;
    let mut stat = std::mem::MaybeUninit::<libc::statvfs>::uninit();
    // SAFETY: `path` ends with a zero, `stat` is as large as the call writes, and is read only after it says that it has written.
    let stat = unsafe {
        if libc::statvfs(path.as_ptr(), stat.as_mut_ptr()) != 0 {
            return None;
        }
        stat.assume_init()
    };
    #[allow(clippy::useless_conversion, clippy::unnecessary_cast)]
    Some((stat.f_bavail as u64).saturating_mul(stat.f_frsize as u64))
}

#[cfg(not(unix))]
fn disk_available_bytes(_folder: &std::path::Path) -> Option<u64> {
    None
}
