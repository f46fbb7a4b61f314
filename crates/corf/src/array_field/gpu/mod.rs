//! A radio field on a GPU: observations of batches of poses.
//!
//! A pose is a run of four kernels over all poses of a batch: the waves of its emitters, the table of what an array can know of them (in parts of 256
//! waves, which are then added up), and the spectrum at every pixel; or, where a sensor shows a lobe for each wave, the waves and then, tile by tile,
//! the lobes that reach it. Capon's beamformer has three more between table and spectrum: the covariance of the array's elements, its inverse (a
//! workgroup a pose), and the table of its forms. Sums run in a fixed order and without atomics: an adapter and driver give the same bytes each time,
//! whatever the batch. In f32, so that results differ from the processor's by rounding (docs/design/018).

mod backward;
mod capon;
mod emitters;
mod forward;
mod job;
mod observer;
mod pixels;
mod shape;
mod stepper;
#[cfg(test)]
mod tests;

use super::SensorSettings;
use shape::Shape;

pub use observer::GpuObserver;

/// Whether a GPU forms a sensor's observations and takes steps with them: it computes in f32, which Capon's spectra with little loading do not bear.
pub fn forms(sensor: &SensorSettings) -> bool {
    Shape::of(sensor).is_ok()
}
