//! The shape of a network: which layer reads what, and where its parameters lie.

use crate::stage;
use corf::numeric::Real;
use corf_scene::Rng;
use std::ops::Range;

/// Slope of [`Activation::LeakyRelu`] below zero (the usual default).
pub(crate) const LEAK: f64 = 0.01;

/// Function applied to every output of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// y = z.
    Identity,
    /// y = max(z, 0).
    Relu,
    /// y = z, and 0.01·z below zero.
    LeakyRelu,
    /// y = 1 / (1 + e⁻ᶻ).
    Sigmoid,
}

impl Activation {
    /// y of z.
    pub fn apply<T: Real>(self, z: T) -> T {
        match self {
            Self::Identity => z,
            Self::Relu if z > T::ZERO => z,
            Self::Relu => T::ZERO,
            Self::LeakyRelu if z > T::ZERO => z,
            Self::LeakyRelu => T::of(LEAK) * z,
            Self::Sigmoid => T::ONE / (T::ONE + (-z).exp()),
        }
    }

    /// dy/dz, written in y: every one of these functions lets it be read off its value.
    pub fn slope<T: Real>(self, y: T) -> T {
        match self {
            Self::Identity => T::ONE,
            Self::Relu if y > T::ZERO => T::ONE,
            Self::Relu => T::ZERO,
            Self::LeakyRelu if y > T::ZERO => T::ONE,
            Self::LeakyRelu => T::of(LEAK),
            Self::Sigmoid => y * (T::ONE - y),
        }
    }
}

/// Something a layer reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LayerInput {
    /// One of the network's inputs, by its number.
    Input(usize),
    /// The outputs of an earlier layer, by its number.
    Layer(usize),
}

/// A fully connected layer: y = activation(W·x + b), where x is what its sources give, one behind the other.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseLayer {
    /// Sources of x, in order.
    pub sources: Vec<LayerInput>,
    /// Length of x.
    pub inputs: usize,
    /// Length of y.
    pub outputs: usize,
    /// The activation function.
    pub activation: Activation,
    /// Number of the first weight in the network's parameters: W by rows, then b.
    first: usize,
}

impl DenseLayer {
    /// Place of W in the network's parameters, one row of `inputs` numbers for each output.
    pub fn weights(&self) -> Range<usize> {
        self.first..self.first + self.inputs * self.outputs
    }

    /// Place of b in the network's parameters.
    pub fn bias(&self) -> Range<usize> {
        let weights = self.weights();
        weights.end..weights.end + self.outputs
    }
}

/// A network of fully connected layers without loops: skips, branches and several heads are layers that read what others read too.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    inputs: Vec<usize>,
    layers: Vec<DenseLayer>,
}

impl Network {
    /// A network that reads vectors of these lengths, without layers yet.
    pub fn new(inputs: &[usize]) -> Self {
        Self { inputs: inputs.to_vec(), layers: vec![] }
    }

    /// Adds a layer and says how others name it.
    ///
    /// # Panics
    /// A source that does not exist yet, or a layer without inputs or outputs.
    pub fn add(&mut self, sources: &[LayerInput], outputs: usize, activation: Activation) -> LayerInput {
        let inputs = sources.iter().map(|s| self.width(*s)).sum();
        assert!(inputs > 0 && outputs > 0, "a layer of {inputs} inputs and {outputs} outputs");
        let first = self.parameters();
        self.layers.push(DenseLayer { sources: sources.to_vec(), inputs, outputs, activation, first });
        LayerInput::Layer(self.layers.len() - 1)
    }

    /// Adds `layers` hidden layers of `width`, rectified, that begin with what `read` gives; behind layer `skip`, counted from 0, that is put in
    /// again. Returns what is read behind the last one.
    ///
    /// # Panics
    /// As [`Self::add`]; no layers.
    pub fn trunk(&mut self, read: &[LayerInput], layers: usize, width: usize, skip: usize) -> Vec<LayerInput> {
        let mut next = read.to_vec();
        for layer in 0..layers {
            let x = self.add(&next, width, Activation::Relu);
            next = if layer == skip { [read, &[x]].concat() } else { vec![x] };
        }
        next
    }

    /// Lengths of the inputs.
    pub fn inputs(&self) -> &[usize] {
        &self.inputs
    }

    /// The layers, in an order in which each reads only what comes before it.
    pub fn layers(&self) -> &[DenseLayer] {
        &self.layers
    }

    /// Whether no other layer reads this one, by its number: its outputs are the network's.
    pub fn is_head(&self, layer: usize) -> bool {
        !self.layers.iter().any(|other| other.sources.contains(&LayerInput::Layer(layer)))
    }

    /// Length of what a source gives.
    ///
    /// # Panics
    /// A source that does not exist.
    pub fn width(&self, source: LayerInput) -> usize {
        match source {
            LayerInput::Input(i) => self.inputs[i],
            LayerInput::Layer(l) => self.layers[l].outputs,
        }
    }

    /// Number of parameters.
    pub fn parameters(&self) -> usize {
        self.layers.last().map_or(0, |l| l.bias().end)
    }

    /// Floating-point operations of a forward and a backward pass over one row, two for each multiplication by a weight.
    pub fn operations(&self) -> f64 {
        let products = |l: &DenseLayer| {
            let on = l.sources.iter().filter(|s| matches!(s, LayerInput::Layer(_))).map(|s| self.width(*s)).sum::<usize>();
            (l.outputs * (2 * l.inputs + on)) as f64
        };
        2.0 * self.layers.iter().map(products).sum::<f64>()
    }

    /// Parameters to begin with, drawn as PyTorch's `Linear` does: weights and biases uniform within ±1/√inputs.
    pub fn initial<T: Real>(&self, seed: u64) -> Vec<T> {
        let mut parameters = Vec::with_capacity(self.parameters());
        for (l, layer) in self.layers.iter().enumerate() {
            let mut rng = Rng::keyed(seed, stage::NETWORK, l as u64);
            let bound = 1.0 / (layer.inputs as f64).sqrt();
            let count = layer.bias().end - layer.weights().start;
            parameters.extend((0..count).map(|_| T::of(bound * (2.0 * rng.uniform_f64() - 1.0))));
        }
        parameters
    }
}
