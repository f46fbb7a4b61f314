//! The deformation network: from a Gaussian's encoded position and a receiver's, how the Gaussian appears to that receiver.

use super::WrfGsPlusConfig;
use crate::mlp::{Activation, FrequencyEncoding, LayerInput, Network};

/// The network: the encoded receiver goes through a layer of 256 to 90 features; with these, the encoded position goes through 8 layers of 256
/// with a skip to four heads.
#[derive(Clone, Debug)]
pub struct WrfGsPlusModel {
    /// All layers. Inputs are the encoded position (0) and the encoded receiver (1).
    pub network: Network,
    /// Head of the displacement, metres; 3.
    pub position: LayerInput,
    /// Head of what is added to the standard deviations, metres; 3.
    pub scale: LayerInput,
    /// Head of what is added to the unit quaternion; 4.
    pub rotation: LayerInput,
    /// Head of what is added to the degree-0 coefficients; C_rf.
    pub signal: LayerInput,
    /// Encoding of a Gaussian's position.
    pub of_position: FrequencyEncoding,
    /// Encoding of a receiver's position.
    pub of_receiver: FrequencyEncoding,
}

impl WrfGsPlusModel {
    /// The network of a configuration.
    pub fn new(config: &WrfGsPlusConfig) -> Self {
        let of_position = FrequencyEncoding { frequencies: config.position_frequencies };
        let of_receiver = FrequencyEncoding { frequencies: config.receiver_frequencies };
        let mut network = Network::new(&[of_position.width(), of_receiver.width()]);
        let hidden = network.add(&[LayerInput::Input(1)], config.receiver_width, Activation::Relu);
        let receiver = network.add(&[hidden], config.receiver_features, Activation::Identity);
        let read = network.trunk(&[LayerInput::Input(0), receiver], config.layers, config.width, config.skip);
        let mut head = |outputs| network.add(&read, outputs, Activation::Identity);
        let (position, scale, rotation, signal) = (head(3), head(3), head(4), head(config.radio_target.channels()));
        Self { network, position, scale, rotation, signal, of_position, of_receiver }
    }

    /// The heads, in the order of [`Offsets`](super::Offsets).
    pub fn heads(&self) -> [LayerInput; 4] {
        [self.position, self.scale, self.rotation, self.signal]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_network_has_its_layers() {
        let model = WrfGsPlusModel::new(&WrfGsPlusConfig::default());
        let widths: Vec<[usize; 2]> = model.network.layers().iter().map(|l| [l.inputs, l.outputs]).collect();
        let trunk = [[153, 256], [256, 256], [256, 256], [256, 256], [256, 256], [409, 256], [256, 256], [256, 256]];
        let heads = [[256, 3], [256, 3], [256, 4], [256, 3]];
        assert_eq!(widths, [&[[39, 256], [256, 90]][..], &trunk, &heads].concat());
        let parameters: usize = widths.iter().map(|[i, o]| (i + 1) * o).sum();
        assert_eq!(model.network.parameters(), parameters);
    }
}
