//! `corf view`: a field, or a data set, in a browser.

use super::{Verdict, show};
use crate::device::DeviceChoice;
use crate::files::separation::{Reads, is_same, keep_apart};
use crate::metrics::input::Verify;
use crate::note;
use crate::run::KeptModel;
use crate::viewer::{self, Subject};
use anyhow::Result;
use clap::Args;
use std::path::{Path, PathBuf};

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
            self.check_apart(path, subject.dataset_folder())?;
            let bytes = viewer::export(&mut subject, path)?;
            let text = format!("{} ({:.1} MB): open it in a browser", path.display(), bytes as f64 / 1e6);
            show(json, &serde_json::json!({ "page": path, "bytes": bytes }), &text)?;
            return Ok(Verdict::Done);
        }
        let port = viewer::Port::hold(self.port, "--port")?;
        show(json, &serde_json::json!({ "url": port.url() }), &port.url())?;
        note!("open it in a browser on this machine; Ctrl-C ends it");
        viewer::serve(&mut subject, port)?;
        Ok(Verdict::Done)
    }

    /// Refuses a page in the run or the data set that is looked at; a comparison has a place for one.
    fn check_apart(&self, page: &Path, dataset: &Path) -> Result<()> {
        if page.is_dir() {
            // Said by whoever writes it.
            return Ok(());
        }
        let beside = |own: &Path| match (page.parent(), own.parent()) {
            (Some(a), Some(b)) => is_same(if a.as_os_str().is_empty() { Path::new(".") } else { a }, b),
            _ => false,
        };
        let is_own = |model: KeptModel| model.page.file_name() == page.file_name() && !page.is_symlink() && beside(&model.page);
        let folder = Reads::Folder(&self.folder);
        let run = (!KeptModel::all(&self.folder).into_iter().any(is_own)).then_some(folder);
        let reads: Vec<Reads<'_>> = run.into_iter().chain([Reads::Folder(dataset)]).collect();
        keep_apart("--export", page, &reads)
    }
}
