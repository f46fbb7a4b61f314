//! Interface of what deforms, renders and trains the Gaussians, on either device.

use crate::mlp::{Adam, Trained};
use corf::Result;
use corf::device::{DenseStep, Device, Planes, StepReport, TrainingView, View, ViewId};

/// Adam of the network, as published.
pub(crate) const NETWORK_ADAM: Adam = Adam { beta1: 0.9, beta2: 0.999, epsilon: 1e-15, weight_decay: 0.0 };

/// One step: dense Adam of the Gaussians in RF, Adam of the network, both from one view.
#[derive(Clone, Copy, Debug)]
pub struct DeformedStep {
    /// The step of the Gaussians.
    pub dense: DenseStep,
    /// Position of what moves from view to view, metres in the world frame: the receiver, or of an array that stands still the transmitter.
    pub receiver_m: [f32; 3],
    /// Rate of the network.
    pub network_rate: f64,
}

/// Trains Gaussians that a network deforms for each receiver.
pub trait WrfGsPlusTrainer: Send {
    /// The device that holds the Gaussians without deformation, and the views.
    fn device(&mut self) -> &mut dyn Device;

    /// Keeps a training view.
    ///
    /// # Errors
    /// The device's.
    fn upload(&mut self, view: &TrainingView) -> Result<ViewId> {
        self.device().upload(view, 1)
    }

    /// Takes steps in order and reports the last.
    ///
    /// # Errors
    /// The device's.
    fn train(&mut self, steps: &[DeformedStep]) -> Result<StepReport>;

    /// Renders RF as the receiver at the view's place finds it; of an array that stands still, as it finds a transmitter there.
    ///
    /// # Errors
    /// The device's.
    fn render(&mut self, view: &View, background: [f32; 3]) -> Result<Planes>;

    /// Parameters of the network and its optimiser.
    ///
    /// # Errors
    /// The device's.
    fn network(&mut self) -> Result<Trained<f32>>;

    /// Goes on from a state of the network.
    ///
    /// # Errors
    /// A state of another network; the device's errors.
    fn restore_network(&mut self, state: &Trained<f32>) -> Result<()>;
}
