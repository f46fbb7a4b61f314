//! Places of a network's parameters on a GPU: filled up so that every row, and every source's part of it, begins at a vector.

use super::super::network::Network;
use super::{LANES, vectors};

/// One layer's places, counted in vectors.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Place {
    /// First vector of the weights.
    pub weights: usize,
    /// From one output's weights to the next.
    pub stride: usize,
    /// First vector of each source's part within a row.
    pub columns: Vec<usize>,
    /// First vector of the biases.
    pub bias: usize,
}

/// Places of all layers, and the way to them from the order of [`Network`].
pub(super) struct Layout {
    pub layers: Vec<Place>,
    /// Place of each parameter, counted in numbers.
    map: Vec<u32>,
    len: usize,
}

impl Layout {
    pub fn new(network: &Network) -> Self {
        let (mut layers, mut map, mut len) = (vec![], vec![0; network.parameters()], 0);
        for layer in network.layers() {
            let (mut columns, mut stride) = (vec![], 0);
            for source in &layer.sources {
                columns.push(stride);
                stride += vectors(network.width(*source));
            }
            let outputs = LANES * vectors(layer.outputs);
            let place = Place { weights: len, stride, columns, bias: len + outputs * stride };
            let mut from = layer.weights().start;
            for row in 0..layer.outputs {
                for (source, column) in layer.sources.iter().zip(&place.columns) {
                    let first = LANES * (place.weights + row * stride + column);
                    for k in 0..network.width(*source) {
                        map[from] = (first + k) as u32;
                        from += 1;
                    }
                }
            }
            for (k, from) in layer.bias().enumerate() {
                map[from] = (LANES * place.bias + k) as u32;
            }
            len = place.bias + vectors(layer.outputs);
            layers.push(place);
        }
        Self { layers, map, len }
    }

    /// Vectors in all.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Numbers in the order of [`Network`] to those on the GPU.
    pub fn padded(&self, packed: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; LANES * self.len];
        self.map.iter().zip(packed).for_each(|(at, v)| out[*at as usize] = *v);
        out
    }

    /// Back again.
    pub fn packed(&self, padded: &[f32]) -> Vec<f32> {
        self.map.iter().map(|at| padded[*at as usize]).collect()
    }
}
