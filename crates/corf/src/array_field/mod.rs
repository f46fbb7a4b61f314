//! A radio field that knows its array: emitters whose waves are observed through the receiver's own beam pattern.
//!
//! A spectrum is not a photograph. An array sees through its beam pattern, side lobes included, and what is strongest stands nowhere on a surface:
//! mirror images of the transmitter, metres behind a wall. [`ArrayField`] is therefore a set of points that send: points on the surfaces that light
//! knows, and virtual sources anywhere. [`ArraySensor`] forms the observation of their waves, and [`ArrayTrainer`] learns them online.
//!
//! An emitter's power depends on where it is seen from: its log gain is interpolated between [`anchors`] at places of the receiver. Training takes
//! residuals in decibels off in proportion to the part that an emitter has in each pixel (a multiplicative update in the manner of Richardson and
//! Lucy).

pub mod anchors;
mod beam;
mod births;
mod capon;
pub mod cloud;
mod config;
mod field;
#[cfg(feature = "gpu")]
pub mod gpu;
mod lobes;
mod observer;
mod peaks;
mod peel;
mod refine;
mod sensor;
mod stepper;
mod symmetric;
#[cfg(test)]
mod tests;
mod trainer;
mod wave;
mod work;

pub use config::{ArrayConfig, Surface};
pub use field::ArrayField;
pub use observer::{CpuObserver, Observer};
pub use peel::Peeled;
pub use sensor::{ArraySensor, SensorSettings};
pub use trainer::{ArrayTrainer, Image, Observed};
pub use wave::Wave;
pub use work::Work;
