//! Quality over time: a reconstruction at work, evaluated on the held-out keyframes now and then. Nothing of it comes back into the work.

use crate::device::Backend;
use crate::methods::field::FieldPredictor;
use crate::methods::interface::{Advance, Method, Predictor};
use crate::methods::registry;
use crate::metrics::input::Input;
use crate::record::HeldOutQuality;
use crate::run::evaluation::evaluate;
use crate::split::Split;
use anyhow::{Result, ensure};
use corf::RasterConfig;
use std::sync::Arc;

/// Evaluates a method's field after every so many units of its work.
pub struct QualityWatch<'a> {
    every: usize,
    /// Units at which the next evaluation is due.
    due: usize,
    input: Input,
    split: &'a Split,
    /// The rasteriser's settings of a field of Gaussians; none of methods that hand over predictors.
    raster: Option<RasterConfig>,
    backend: &'a Backend,
}

impl<'a> QualityWatch<'a> {
    /// Evaluates what `method` makes of `input` after every `every` units of its work (keyframes; steps of methods that work in steps).
    ///
    /// # Errors
    /// A method without a field that could be read while it works; a split that holds nothing out.
    pub fn new(every: usize, method: &dyn Method, input: &Input, split: &'a Split, backend: &'a Backend) -> Result<Self> {
        ensure!(every > 0, "evaluations every 0 {} are none\n  help: give 1 or more, or leave it out", method.unit());
        split.check_held_out()?;
        ensure!(
            is_possible(method)?,
            "{} has no field that could be evaluated while it works: it looks its predictions up\n  help: leave --evaluate-every out, or choose \
             a method that reconstructs, as corf-gs",
            method.id()
        );
        let raster = if method.predicts_at_work() { None } else { raster(method)? };
        // LPIPS takes longer than all the rest.
        let input = Input { networks: Arc::default(), ..input.clone() };
        Ok(Self { every, due: every, input, split, raster, backend })
    }

    /// The same where the method has such a field, and nothing where it has none: for comparisons, in which both stand side by side.
    ///
    /// # Errors
    /// Those of [`Self::new`], but for that.
    pub fn where_possible(
        every: Option<usize>,
        method: &dyn Method,
        input: &Input,
        split: &'a Split,
        backend: &'a Backend,
    ) -> Result<Option<Self>> {
        match every {
            Some(every) if is_possible(method)? => Self::new(every, method, input, split, backend).map(Some),
            _ => Ok(None),
        }
    }

    /// The quality of the field as it stands, where an evaluation is due and there is a field. At the end none is: the finished field is
    /// evaluated by itself.
    ///
    /// # Errors
    /// Unreadable keyframes, a device that gives up, an interrupt.
    pub(super) fn look(&mut self, advance: &Advance<'_>) -> Result<Option<HeldOutQuality>> {
        if advance.done < self.due || advance.done >= advance.total {
            return Ok(None);
        }
        let predictor: Option<Box<dyn Predictor>> = match self.raster {
            None => advance.predictor.map(|predictor| predictor.read()).transpose()?.flatten(),
            Some(raster) => {
                let field = advance.field.and_then(|field| field.read()).filter(|field| !field.gaussians.is_empty());
                field.map(|field| Box::new(FieldPredictor::new(field, raster, self.backend)) as Box<dyn Predictor>)
            }
        };
        let Some(mut predictor) = predictor else { return Ok(None) };
        self.due = (advance.done / self.every + 1) * self.every;
        self.of(predictor.as_mut()).map(Some)
    }

    /// The quality of a field.
    ///
    /// # Errors
    /// Those of [`Self::look`].
    pub(super) fn of(&self, predictor: &mut dyn Predictor) -> Result<HeldOutQuality> {
        let frames = evaluate(predictor, &self.input, self.split, |_, _| Ok(()))?;
        Ok(HeldOutQuality::of(&frames))
    }
}

/// Whether a method can be evaluated while it works.
fn is_possible(method: &dyn Method) -> Result<bool> {
    Ok(method.predicts_at_work() || raster(method)?.is_some())
}

/// The rasteriser's settings of a method whose Gaussians are its light and its radio; none of another.
fn raster(method: &dyn Method) -> Result<Option<RasterConfig>> {
    let raster = registry::raster_of(method.id(), &method.config())?;
    Ok(raster.filter(|_| registry::has_radio_colours(method.id())))
}
