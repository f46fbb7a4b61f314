//! A radio field that knows its array.

pub mod anchors;
pub mod beam;
pub mod births;
pub mod cloud;
pub mod config;
pub mod field;
pub mod lobes;
pub mod peaks;
pub mod sensor;
pub mod trainer;
pub mod wave;

pub use config::ArrayConfig;
pub use field::ArrayField;
pub use sensor::{ArraySensor, SensorSettings};
pub use trainer::ArrayTrainer;

#[cfg(test)]
mod tests;
