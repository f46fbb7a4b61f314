//! NeRF² on the processor.
//!
//! Rays are worked on in blocks of a fixed number; blocks run on all threads, and their gradients are added up in their order, so that the bytes
//! do not depend on the number of threads.

use super::rendering::{RayOutputs, Sum};
use super::trainer::{Nerf2Trainer, check_rays};
use super::{Batch, Nerf2Config, Nerf2Model, PixelRay};
use crate::mlp::{Adam, Tape, Trained};
use corf::numeric::Real;
use corf::{Error, Result};
use rayon::prelude::*;

/// Points of a block, about: its activations take a few megabytes.
const POINTS_A_BLOCK: usize = 1024;

/// Trains and evaluates with all threads of the processor, in `f32`; or in `f64`, for its gradients to be tested.
pub struct Nerf2CpuTrainer<T = f32> {
    model: Nerf2Model,
    config: Nerf2Config,
    transmitter: [T; 3],
    adam: Adam,
    trained: Trained<T>,
    loss: f64,
}

/// Inputs and values of the network over a block of rays.
struct Block<T> {
    inputs: [Vec<T>; 2],
    tape: Tape<T>,
    distances: Vec<T>,
}

impl<T: Real> Nerf2CpuTrainer<T> {
    /// A network with these parameters; `transmitter_m` is in the world frame.
    ///
    /// # Errors
    /// A configuration out of range, or parameters of another network.
    pub fn new(config: &Nerf2Config, transmitter_m: [f32; 3], parameters: Vec<T>) -> Result<Self> {
        config.validate()?;
        let model = Nerf2Model::new(config);
        if parameters.len() != model.network.parameters() {
            let what = format!("{} parameters where the network has {}", parameters.len(), model.network.parameters());
            return Err(Error::invalid("network", what, "take those of a network of the same shape"));
        }
        Ok(Self {
            transmitter: transmitter_m.map(|v| T::of(f64::from(v))),
            adam: Adam::with_decay(config.weight_decay),
            trained: Trained::new(parameters),
            config: *config,
            model,
            loss: 0.0,
        })
    }

    fn rays_a_block(&self) -> usize {
        (POINTS_A_BLOCK / self.config.samples).max(1)
    }

    /// End of the last sample's segment, if it counts.
    fn end(&self) -> Option<T> {
        self.config.last_sample.then(|| T::of(f64::from(self.config.far_m)))
    }

    /// Runs the network over a block's points.
    fn forward(&self, rays: &[PixelRay], distances: &[f32]) -> Block<T> {
        let samples = self.config.samples;
        let width = self.model.encoding.width();
        let mut inputs = [vec![T::ZERO; distances.len() * width], Vec::with_capacity(distances.len() * 2 * width)];
        let distances: Vec<T> = distances.iter().map(|r| T::of(f64::from(*r))).collect();
        for (k, ray) in rays.iter().enumerate() {
            let [origin, direction] = [ray.origin_m, ray.direction].map(|v| v.map(|c| T::of(f64::from(c))));
            let transmitter = ray.transmitter_m.map_or(self.transmitter, |t| t.map(|c| T::of(f64::from(c))));
            let outside = self.model.outside(direction, transmitter);
            for (at, r) in (k * samples..).zip(&distances[k * samples..(k + 1) * samples]) {
                let point = [0, 1, 2].map(|axis| origin[axis] + direction[axis] * *r);
                self.model.encoding.encode(point, &mut inputs[0][at * width..]);
                inputs[1].extend_from_slice(&outside);
            }
        }
        let tape = self.model.network.forward(&self.trained.parameters, &[&inputs[0], &inputs[1]], distances.len());
        Block { inputs, tape, distances }
    }

    /// The outputs and distances of a block's ray.
    fn ray<'a>(&self, block: &'a Block<T>, k: usize) -> (RayOutputs<'a, T>, &'a [T]) {
        let samples = k * self.config.samples..(k + 1) * self.config.samples;
        let both = 2 * samples.start..2 * samples.end;
        let (attenuation, signal) = (block.tape.of(self.model.attenuation), block.tape.of(self.model.signal));
        (RayOutputs { attenuation: &attenuation[both.clone()], signal: &signal[both] }, &block.distances[samples])
    }

    /// Squared error of a block's rays, summed, and its gradient in all parameters; `scale` goes before both.
    fn block_gradient(&self, rays: &[PixelRay], targets: &[f32], distances: &[f32], scale: T) -> (T, Vec<T>) {
        let block = self.forward(rays, distances);
        let mut heads = [vec![T::ZERO; 2 * distances.len()], vec![T::ZERO; 2 * distances.len()]];
        let (mut loss, samples, end) = (T::ZERO, self.config.samples, self.end());
        for (k, target) in targets.iter().enumerate() {
            let (outputs, distances) = self.ray(&block, k);
            let sum = Sum::new(outputs, distances, end);
            let error = sum.amplitude - T::of(f64::from(*target));
            loss += scale * error * error;
            let part = 2 * k * samples..2 * (k + 1) * samples;
            let [a, s] = &mut heads;
            sum.backward(outputs, distances, end, (scale + scale) * error, [&mut a[part.clone()], &mut s[part]]);
        }
        let mut gradient = vec![T::ZERO; self.trained.parameters.len()];
        let [attenuation, signal] = heads;
        self.model.network.backward(
            &self.trained.parameters,
            &[&block.inputs[0], &block.inputs[1]],
            &block.tape,
            [(self.model.attenuation, attenuation), (self.model.signal, signal)],
            &mut gradient,
        );
        (loss, gradient)
    }

    /// Mean squared error of a batch and its gradient in all parameters.
    ///
    /// # Errors
    /// A batch of another number of samples.
    pub fn gradient(&self, batch: &Batch) -> Result<(T, Vec<T>)> {
        let samples = self.config.samples;
        check_rays(batch.rays.len(), batch.distances.len(), samples)?;
        check_rays(batch.rays.len(), batch.targets.len(), 1)?;
        let at_once = self.rays_a_block();
        let scale = T::of(1.0 / batch.rays.len().max(1) as f64);
        let blocks: Vec<_> = batch
            .rays
            .chunks(at_once)
            .zip(batch.targets.chunks(at_once))
            .zip(batch.distances.chunks(at_once * samples))
            .collect();
        let (mut loss, mut gradient) = (T::ZERO, vec![T::ZERO; self.trained.parameters.len()]);
        // A gradient for each thread at once; the order of the sum is that of the blocks.
        for wave in blocks.chunks(rayon::current_num_threads()) {
            let parts: Vec<_> = wave.par_iter().map(|((r, t), d)| self.block_gradient(r, t, d, scale)).collect();
            for (part_loss, part) in parts {
                loss += part_loss;
                gradient.par_iter_mut().zip(part).with_min_len(1 << 14).for_each(|(sum, g)| *sum += g);
            }
        }
        Ok((loss, gradient))
    }
}

impl Nerf2Trainer for Nerf2CpuTrainer {
    fn step(&mut self, batch: &Batch, rate: f64) -> Result<()> {
        let (loss, gradient) = self.gradient(batch)?;
        self.loss = f64::from(loss);
        self.adam.step(&mut self.trained, &gradient, rate);
        Ok(())
    }

    fn loss(&mut self) -> Result<f64> {
        Ok(self.loss)
    }

    fn amplitudes(&mut self, rays: &[PixelRay], distances: &[f32]) -> Result<Vec<f32>> {
        let (samples, at_once, end) = (self.config.samples, self.rays_a_block(), self.end());
        check_rays(rays.len(), distances.len(), samples)?;
        let block = |(rays, distances): (&[PixelRay], &[f32])| {
            let block = self.forward(rays, distances);
            let amplitude = |k| {
                let (outputs, distances) = self.ray(&block, k);
                Sum::new(outputs, distances, end).amplitude
            };
            (0..rays.len()).map(amplitude).collect::<Vec<_>>()
        };
        let blocks = rays.par_chunks(at_once).zip(distances.par_chunks(at_once * samples)).map(block);
        Ok(blocks.collect::<Vec<_>>().concat())
    }

    fn state(&mut self) -> Result<Trained<f32>> {
        Ok(self.trained.clone())
    }

    fn restore(&mut self, state: &Trained<f32>) -> Result<()> {
        state.check(self.trained.parameters.len())?;
        self.trained = state.clone();
        Ok(())
    }
}
