//! The network of NeRF² and what it reads.

use super::Nerf2Config;
use crate::mlp::{Activation, FrequencyEncoding, LayerInput, Network};
use corf::numeric::Real;

/// The network: from an encoded position, 8 layers of 256 with a skip to how a point attenuates (2 numbers) and to 256 features; from these,
/// the encoded direction and transmitter, layers of 256 and 128 to what the point sends (2 numbers).
#[derive(Clone, Debug)]
pub struct Nerf2Model {
    /// All layers.
    pub network: Network,
    /// Head of the attenuation: amplitude and phase per metre, before their activations.
    pub attenuation: LayerInput,
    /// Head of the signal: amplitude and phase, before their activations.
    pub signal: LayerInput,
    /// Encoding of position, direction and transmitter alike.
    pub encoding: FrequencyEncoding,
}

impl Nerf2Model {
    /// The network of a configuration.
    pub fn new(config: &Nerf2Config) -> Self {
        let encoding = FrequencyEncoding { frequencies: config.frequencies };
        let (position, outside) = (LayerInput::Input(0), LayerInput::Input(1));
        let mut network = Network::new(&[encoding.width(), 2 * encoding.width()]);
        let read = network.trunk(&[position], config.layers, config.width, config.skip);
        let attenuation = network.add(&read, 2, Activation::Identity);
        let features = network.add(&read, config.width, Activation::Identity);
        let first = network.add(&[features, outside], config.width, Activation::Relu);
        let second = network.add(&[first], config.width / 2, Activation::Relu);
        let signal = network.add(&[second], 2, Activation::Identity);
        Self { network, attenuation, signal, encoding }
    }

    /// Encoded direction and transmitter: what all points of a ray share.
    pub fn outside<T: Real>(&self, direction: [T; 3], transmitter: [T; 3]) -> Vec<T> {
        let width = self.encoding.width();
        let mut out = vec![T::ZERO; 2 * width];
        self.encoding.encode(direction, &mut out[..width]);
        self.encoding.encode(transmitter, &mut out[width..]);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_network_has_690_564_parameters() {
        let model = Nerf2Model::new(&Nerf2Config::default());
        assert_eq!(model.network.parameters(), 690_564);
        assert_eq!(model.encoding.width(), 63);
        let widths: Vec<usize> = model.network.layers().iter().map(|l| l.inputs).collect();
        assert_eq!(widths, [63, 256, 256, 256, 256, 319, 256, 256, 256, 256, 382, 256, 128]);
    }
}
