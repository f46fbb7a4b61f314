//! `corf view`: a field, or a data set, in a browser.

use super::{Verdict, show};
use crate::device::DeviceChoice;
use crate::input::Verify;
use crate::note;
use crate::view::{self, Subject};
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;

/// `corf view`.
#[derive(Args)]
pub struct View {
    /// Run of `corf reconstruct`, comparison that keeps one run (`corf demo` does), or data set.
    folder: PathBuf,
    /// Port on 127.0.0.1 (default: one that is free).
    #[arg(long, default_value_t = 0, hide_default_value = true, conflicts_with = "export")]
    port: u16,
    /// Write one self-contained page instead of serving it; an existing file is replaced.
    #[arg(long, value_name = "FILE.html")]
    export: Option<PathBuf>,
    /// Data set folder of a run, if it has moved since.
    #[arg(long)]
    dataset: Option<PathBuf>,
    #[command(flatten)]
    verify: Verify,
    /// Device that renders predictions at keyframes: auto, cpu, gpu, or gpu:N for the N-th adapter. The view itself is drawn by the browser.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
}

impl View {
    /// Serves the page until Ctrl-C, or writes it.
    ///
    /// # Errors
    /// A folder that is neither run nor data set, one that is damaged or not finished, a port or a file that cannot be had, an interrupt while
    /// a page is made.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let mut subject = Subject::open(&self.folder, self.dataset.as_deref(), self.verify, self.device)?;
        if let Some(path) = &self.export {
            let bytes = view::export(&mut subject, path)?;
            let text = format!("{} ({:.1} MB): open it in a browser", path.display(), bytes as f64 / 1e6);
            show(json, &serde_json::json!({ "page": path, "bytes": bytes }), &text)?;
            return Ok(Verdict::Done);
        }
        let port = view::Port::hold(self.port, "--port")?;
        show(json, &serde_json::json!({ "url": port.url() }), &port.url())?;
        note!("open it in a browser on this machine; Ctrl-C ends it");
        view::serve(&mut subject, port)?;
        Ok(Verdict::Done)
    }
}
