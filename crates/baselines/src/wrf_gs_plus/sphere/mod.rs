//! WRF-GS+ of an array that stands still while the transmitter moves, as it was published: Gaussians are drawn over azimuth and elevation of the
//! array instead of through a pinhole, and what the network reads is the transmitter's place. On the processor.
//!
//! [`Lens`] projects, [`draw`](raster::draw) blends and differentiates, `loss` compares levels; [`FixedArrayTrainer`] puts them in the place of the
//! device's rasteriser, and the device keeps Gaussians, optimiser and density control.

mod lens;
mod loss;
mod raster;
#[cfg(test)]
mod tests;
mod trainer;

pub use lens::Lens;
pub use trainer::FixedArrayTrainer;
