//! A reconstruction that can be looked at while it works: its server has a thread of its own.

use super::growth::{Drawing, Growth};
use super::server::Port;
use super::subject::{Subject, Work};
use crate::method::{Advance, Method};
use crate::methods::open::raster_of_method;
use crate::note;
use crate::split::Split;
use anyhow::{Context, Result};
use corf::Field;
use corf_scene::dataset::Dataset;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// The page of a reconstruction at work. The server ends with it.
pub struct Watching {
    growth: Arc<Growth>,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Watching {
    /// Refuses a method of which there is nothing to see while it works.
    ///
    /// # Errors
    /// A method without Gaussians that a rasteriser could draw.
    pub fn check(method: &dyn Method) -> Result<()> {
        drawing(method).map(|_| ())
    }

    /// Serves the page of `method`, which is about to reconstruct from what `split` trains with.
    ///
    /// # Errors
    /// Those of [`Self::check`]; the system gives no thread.
    pub fn start(port: Port, method: &dyn Method, seed: u64, dataset: &Dataset, split: &Split) -> Result<Self> {
        let (raster, radio) = drawing(method)?;
        let drawing = Drawing { raster, radio, modalities: dataset.modalities() };
        let growth = Arc::new(Growth::new(drawing, method.unit(), split.train.len()));
        let work = Work { method: method.id().to_owned(), seed, split: split.clone(), growth: growth.clone() };
        let over = Arc::new(AtomicBool::new(false));
        let (url, ends, dataset) = (port.url(), over.clone(), dataset.clone());
        let serve = move || {
            let mut subject = Subject::at_work(dataset, work);
            while !ends.load(Ordering::SeqCst) {
                if let Err(error) = port.answer_one(&mut subject) {
                    note!("nobody can look any more: {error:#}");
                    break;
                }
            }
        };
        let thread = std::thread::Builder::new().name("view".to_owned()).spawn(serve).context("the viewer gets no thread")?;
        note!("{url} shows the field while it grows: open it in a browser on this machine");
        Ok(Self { growth, over, thread: Some(thread) })
    }

    /// Takes note of progress; the field is read only where a page has asked for it.
    pub fn tell(&self, advance: &Advance<'_>) {
        self.growth.tell(advance);
    }

    /// Shows a page that is looking what the reconstruction ended with, and ends the server.
    pub fn finish(self, field: impl FnOnce() -> Option<Field>) {
        self.growth.finish(field);
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        self.over.store(true, Ordering::SeqCst);
        // An answer that has begun is given.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// How a method's Gaussians are drawn: the rasteriser's settings, and whether their RF colours are spectra.
fn drawing(method: &dyn Method) -> Result<(corf::RasterConfig, bool)> {
    let raster = raster_of_method(method.id(), &method.config())?.with_context(|| {
        format!(
            "{} has no Gaussians that could be shown while they grow\n  help: leave --view out, and look at the run with `corf view` once it has ended",
            method.id()
        )
    })?;
    Ok((raster, super::scene::has_rf_colours(method.id())))
}
