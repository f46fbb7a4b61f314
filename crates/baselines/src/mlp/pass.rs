//! A network's values and gradients over a block of rows, by one thread. Who wants more threads gives each its own rows and adds gradients up in
//! a fixed order.

use super::network::{LayerInput, Network};
use corf::numeric::Real;
use corf::numeric::{Matrix, multiply};

/// Outputs of every layer, kept for the backward pass.
#[derive(Clone, Debug)]
pub struct Tape<T> {
    rows: usize,
    /// One array a layer, `rows × outputs`.
    values: Vec<Vec<T>>,
}

impl<T> Tape<T> {
    /// Outputs of a layer, row by row.
    ///
    /// # Panics
    /// A source that is no layer of the network.
    pub fn of(&self, layer: LayerInput) -> &[T] {
        match layer {
            LayerInput::Layer(l) => &self.values[l],
            LayerInput::Input(_) => panic!("an input is no layer's output"),
        }
    }
}

impl Network {
    /// Values of all layers; `inputs` are `rows × width` each.
    ///
    /// # Panics
    /// Arrays of the wrong size.
    pub fn forward<T: Real>(&self, parameters: &[T], inputs: &[&[T]], rows: usize) -> Tape<T> {
        let mut tape = Tape { rows, values: Vec::with_capacity(self.layers().len()) };
        for layer in self.layers() {
            let (w, b) = (&parameters[layer.weights()], &parameters[layer.bias()]);
            let mut out = b.repeat(rows);
            let mut column = 0;
            for source in &layer.sources {
                let x = self.rows_of(*source, inputs, &tape);
                let weights = Matrix::by_rows(&w[column..], layer.outputs, x.columns, layer.inputs);
                multiply(x, weights.transposed(), T::ONE, &mut out, layer.outputs);
                column += x.columns;
            }
            out.iter_mut().for_each(|z| *z = layer.activation.apply(*z));
            tape.values.push(out);
        }
        tape
    }

    /// Adds the gradient in all parameters to `gradient`; `heads` name layers that the loss reads, and its gradient in their outputs.
    ///
    /// # Panics
    /// Arrays of the wrong size, or a head that is no layer.
    pub fn backward<T: Real>(
        &self,
        parameters: &[T],
        inputs: &[&[T]],
        tape: &Tape<T>,
        heads: impl IntoIterator<Item = (LayerInput, Vec<T>)>,
        gradient: &mut [T],
    ) {
        let rows = tape.rows;
        // In the outputs of every layer; empty where nothing has come yet.
        let mut reached: Vec<Vec<T>> = vec![vec![]; self.layers().len()];
        for (head, values) in heads {
            let LayerInput::Layer(l) = head else { panic!("a head is a layer") };
            assert_eq!(values.len(), rows * self.layers()[l].outputs, "a head's gradient");
            reached[l] = values;
        }
        for (l, layer) in self.layers().iter().enumerate().rev() {
            let mut dz = std::mem::take(&mut reached[l]);
            if dz.is_empty() {
                continue;
            }
            for (g, y) in dz.iter_mut().zip(&tape.values[l]) {
                *g = *g * layer.activation.slope(*y);
            }
            let bias = &mut gradient[layer.bias()];
            for row in dz.chunks_exact(layer.outputs) {
                bias.iter_mut().zip(row).for_each(|(sum, g)| *sum += *g);
            }
            let w = &parameters[layer.weights()];
            let dw = &mut gradient[layer.weights()];
            let dz = Matrix::by_rows(&dz, rows, layer.outputs, layer.outputs);
            let mut column = 0;
            for source in &layer.sources {
                let x = self.rows_of(*source, inputs, tape);
                multiply(dz.transposed(), x, T::ONE, &mut dw[column..], layer.inputs);
                if let LayerInput::Layer(from) = *source {
                    let fresh = reached[from].is_empty();
                    reached[from].resize(rows * x.columns, T::ZERO);
                    let weights = Matrix::by_rows(&w[column..], layer.outputs, x.columns, layer.inputs);
                    let keep = if fresh { T::ZERO } else { T::ONE };
                    multiply(dz, weights, keep, &mut reached[from], x.columns);
                }
                column += x.columns;
            }
        }
    }

    /// Rows of a source, as a matrix.
    fn rows_of<'a, T>(&self, source: LayerInput, inputs: &[&'a [T]], tape: &'a Tape<T>) -> Matrix<'a, T> {
        let width = self.width(source);
        let values = match source {
            LayerInput::Input(i) => inputs[i],
            LayerInput::Layer(l) => &tape.values[l],
        };
        assert_eq!(values.len(), tape.rows * width, "an input's size");
        Matrix::by_rows(values, tape.rows, width, width)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mlp::Activation;
    use corf_scene::Rng;

    /// Two inputs, a skip, a branch that two heads read, every activation.
    pub(super) fn network() -> (Network, [LayerInput; 2]) {
        let mut n = Network::new(&[3, 2]);
        let a = n.add(&[LayerInput::Input(0)], 5, Activation::LeakyRelu);
        let b = n.add(&[LayerInput::Input(0), a], 6, Activation::Relu);
        let c = n.add(&[b], 4, Activation::Sigmoid);
        let first = n.add(&[b, c], 2, Activation::Identity);
        let d = n.add(&[c, LayerInput::Input(1)], 3, Activation::Identity);
        let second = n.add(&[d], 1, Activation::Sigmoid);
        (n, [first, second])
    }

    #[test]
    fn gradients_are_those_of_finite_differences() {
        const ROWS: usize = 7;
        let (network, heads) = network();
        let mut rng = Rng::keyed(3, 0, 0);
        let inputs: Vec<Vec<f64>> = network.inputs().iter().map(|w| (0..w * ROWS).map(|_| rng.normal()).collect()).collect();
        let inputs: Vec<&[f64]> = inputs.iter().map(Vec::as_slice).collect();
        let mut parameters: Vec<f64> = network.initial(5);
        // loss = Σ over heads of Σ weight · value², so that its gradient is not constant.
        let weight = |i: usize| 0.3 + (i % 5) as f64;
        let loss = |p: &[f64]| {
            let tape = network.forward(p, &inputs, ROWS);
            heads.iter().flat_map(|h| tape.of(*h)).enumerate().map(|(i, v)| weight(i) * v * v).sum::<f64>()
        };
        let tape = network.forward(&parameters, &inputs, ROWS);
        let mut at = 0;
        let gradients = heads.map(|h| {
            let g = tape.of(h).iter().enumerate().map(|(i, v)| 2.0 * weight(at + i) * v).collect();
            at += tape.of(h).len();
            (h, g)
        });
        let mut gradient = vec![0.0; network.parameters()];
        network.backward(&parameters, &inputs, &tape, gradients, &mut gradient);
        // Central differences: their error is O(h²) plus rounding over h.
        const H: f64 = 1e-5;
        for i in 0..parameters.len() {
            let kept = parameters[i];
            parameters[i] = kept + H;
            let up = loss(&parameters);
            parameters[i] = kept - H;
            let down = loss(&parameters);
            parameters[i] = kept;
            let expected = (up - down) / (2.0 * H);
            assert!((gradient[i] - expected).abs() < 1e-7 * (1.0 + expected.abs()), "{i}: {} {expected}", gradient[i]);
        }
    }

    #[test]
    fn a_layer_is_what_it_says() {
        let mut n = Network::new(&[2]);
        let y = n.add(&[LayerInput::Input(0)], 2, Activation::Relu);
        assert_eq!(n.parameters(), 6);
        // W by rows, then b.
        let parameters = [1.0, 2.0, 3.0, -4.0, 0.5, 1.0];
        let tape = n.forward(&parameters, &[&[1.0, 1.0, 2.0, 0.0]], 2);
        assert_eq!(tape.of(y), [3.5, 0.0, 2.5, 7.0]);
    }

    #[test]
    fn initial_parameters_are_within_their_bound_and_follow_the_seed() {
        let (network, _) = network();
        let (a, b): (Vec<f32>, Vec<f32>) = (network.initial(1), network.initial(2));
        assert!(a != b && a == network.initial::<f32>(1));
        for layer in network.layers() {
            let bound = 1.0 / (layer.inputs as f32).sqrt();
            assert!(a[layer.weights().start..layer.bias().end].iter().all(|v| v.abs() <= bound));
        }
    }
}
