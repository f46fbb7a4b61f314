//! The network over many Gaussians on the processor, forward and backward.
//!
//! Gaussians are worked on in blocks of a fixed number; blocks run on all threads, and their gradients are added up in their order, so that the
//! bytes do not depend on the number of threads.

use super::rule::{Offsets, Rule, Shape};
use super::{WrfGsPlusConfig, WrfGsPlusModel};
use crate::mlp::{Tape, Trained};
use corf::numeric::Real;
use rayon::prelude::*;

/// Gaussians of a block: the activations of the published network take 5 MB.
const BLOCK: usize = 512;

/// A deformation network with its parameters, in `f32`; or in `f64`, for its gradients to be tested.
#[derive(Clone, Debug)]
pub struct Deformation<T> {
    /// The network.
    pub model: WrfGsPlusModel,
    /// What its predictions do.
    pub rule: Rule,
    /// Its parameters.
    pub trained: Trained<T>,
}

/// Inputs and values of the network over a block.
struct Block<T> {
    inputs: [Vec<T>; 2],
    tape: Tape<T>,
}

/// The first numbers of a row.
fn first<T: Real, const N: usize>(row: &[T]) -> [T; N] {
    std::array::from_fn(|k| row.get(k).copied().unwrap_or(T::ZERO))
}

impl<T: Real> Deformation<T> {
    /// A network of this configuration with these parameters.
    ///
    /// # Panics
    /// Another number of parameters than the network's.
    pub fn new(config: &WrfGsPlusConfig, parameters: Vec<T>) -> Self {
        let model = WrfGsPlusModel::new(config);
        assert_eq!(parameters.len(), model.network.parameters(), "parameters of this network");
        Self {
            model,
            rule: Rule { move_positions: config.move_positions, signal_is_magnitude: false },
            trained: Trained::new(parameters),
        }
    }

    fn forward(&self, block: &[Shape<T>], receiver: &[T]) -> Block<T> {
        let width = self.model.of_position.width();
        let mut positions = vec![T::ZERO; block.len() * width];
        for (row, base) in positions.chunks_exact_mut(width).zip(block) {
            self.model.of_position.encode(base.position, row);
        }
        let inputs = [positions, receiver.repeat(block.len())];
        let tape = self.model.network.forward(&self.trained.parameters, &[&inputs[0], &inputs[1]], block.len());
        Block { inputs, tape }
    }

    /// The encoded position of a receiver, metres in the world frame.
    fn receiver(&self, receiver_m: [T; 3]) -> Vec<T> {
        let mut out = vec![T::ZERO; self.model.of_receiver.width()];
        self.model.of_receiver.encode(receiver_m, &mut out);
        out
    }

    fn offsets(&self, tape: &Tape<T>, i: usize) -> Offsets<T> {
        let m = &self.model;
        fn row<T, const N: usize>(tape: &Tape<T>, head: crate::mlp::LayerInput, i: usize, width: usize) -> [T; N]
        where
            T: Real,
        {
            first(&tape.of(head)[i * width..(i + 1) * width])
        }
        let channels = m.network.width(m.signal);
        Offsets {
            position: row(tape, m.position, i, 3),
            scale: row(tape, m.scale, i, 3),
            rotation: row(tape, m.rotation, i, 4),
            signal: row(tape, m.signal, i, channels),
        }
    }

    /// The Gaussians as a receiver at `receiver_m` finds them, with what the network predicted of each.
    pub fn apply(&self, base: &[Shape<T>], receiver_m: [T; 3]) -> Vec<(Shape<T>, Offsets<T>)> {
        let receiver = self.receiver(receiver_m);
        let blocks = base.par_chunks(BLOCK).map(|block| {
            let tape = self.forward(block, &receiver).tape;
            let one = |(i, base): (usize, &Shape<T>)| {
                let offsets = self.offsets(&tape, i);
                (self.rule.apply(base, &offsets), offsets)
            };
            block.iter().enumerate().map(one).collect::<Vec<_>>()
        });
        blocks.flatten_iter().collect()
    }

    /// The gradient in all parameters from that in the offsets. What the network reads of a Gaussian's position has none, as published.
    pub fn gradient(&self, base: &[Shape<T>], receiver_m: [T; 3], offsets: &[Offsets<T>]) -> Vec<T> {
        let receiver = self.receiver(receiver_m);
        let channels = self.model.network.width(self.model.signal);
        let one = |(block, offsets): &(&[Shape<T>], &[Offsets<T>])| {
            let Block { inputs, tape } = self.forward(block, &receiver);
            let all = |read: fn(&Offsets<T>) -> &[T], width: usize| -> Vec<T> {
                offsets.iter().flat_map(|o| read(o)[..width].iter().copied()).collect()
            };
            let gradients =
                [all(|o| &o.position, 3), all(|o| &o.scale, 3), all(|o| &o.rotation, 4), all(|o| &o.signal, channels)];
            let heads = self.model.heads().into_iter().zip(gradients);
            let mut gradient = vec![T::ZERO; self.trained.parameters.len()];
            let read = [&inputs[0][..], &inputs[1]];
            self.model.network.backward(&self.trained.parameters, &read, &tape, heads, &mut gradient);
            gradient
        };
        let blocks: Vec<_> = base.chunks(BLOCK).zip(offsets.chunks(BLOCK)).collect();
        let mut sum = vec![T::ZERO; self.trained.parameters.len()];
        // A gradient for each thread at once; the order of the sum is that of the blocks.
        for wave in blocks.chunks(rayon::current_num_threads()) {
            let parts: Vec<_> = wave.par_iter().map(one).collect();
            for part in parts {
                sum.par_iter_mut().zip(part).with_min_len(1 << 14).for_each(|(sum, g)| *sum += g);
            }
        }
        sum
    }
}
