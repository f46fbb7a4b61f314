//! A reconstruction that can be looked at while it works: threads of their own speak to browsers and make what they ask for.
//! It neither waits for them nor ends with them.

use super::growth::{Drawing, Growth};
use super::routes::Desk;
use super::server::{Port, Server};
use super::subject::{Subject, Work};
use crate::methods::interface::{Advance, Method};
use crate::methods::registry;
use crate::note;
use crate::split::Split;
use anyhow::{Context, Result};
use corf::Field;
use corf_scene::dataset::Dataset;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Longest wait at the end for a page that is looking, which may have been closed, and for what it is sent.
const LONGEST_WAIT: Duration = Duration::from_secs(4);

/// The page of a reconstruction at work. The server ends with it.
pub struct Watching {
    growth: Arc<Growth>,
    server: Server,
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
        let (url, dataset) = (port.url(), dataset.clone());
        let (server, jobs) = port.open()?;
        // It ends with the server, which sends the jobs; one that is at work then is not waited for.
        let answer = move || {
            let mut subject = Subject::at_work(dataset, work);
            let mut desk = Desk::new(&mut subject);
            jobs.into_iter().for_each(|job| job.answer(&mut desk));
        };
        std::thread::Builder::new().name("view".to_owned()).spawn(answer).context("the viewer gets no thread")?;
        note!("{url} shows the field while it grows: open it in a browser on this machine");
        Ok(Self { growth, server })
    }

    /// Takes note of progress; the field is read only where a page has asked for it.
    pub fn report(&self, advance: &Advance<'_>) {
        self.growth.report(advance);
    }

    /// Shows a page that is looking what the reconstruction ended with, and ends the server: within five seconds, whatever its clients do.
    pub fn finish(self, field: impl FnOnce() -> Option<Field>) {
        let until = Instant::now() + LONGEST_WAIT;
        self.growth.finish(until, field);
        self.server.end(until);
    }
}

/// How a method's Gaussians are drawn: the rasteriser's settings, and whether their RF colours are spectra.
fn drawing(method: &dyn Method) -> Result<(corf::RasterConfig, bool)> {
    let raster = registry::raster_of(method.id(), &method.config())?.with_context(|| {
        format!(
            "{} has no Gaussians that could be shown while they grow\n  help: leave --view out, and look at the run with `corf view` once it has ended",
            method.id()
        )
    })?;
    Ok((raster, registry::has_radio_colours(method.id())))
}
