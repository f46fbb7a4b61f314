//! Radio images of many poses: the next are drawn while those before them are read back.

use super::{
    GpuDevice,
    capacity::BufferCapacity,
    frame::{Extent, FAILED, Leaves, STATE_WORDS},
    params::{Params, Uniforms},
    train::STEPS_PER_SUBMISSION,
};
use crate::{
    Result,
    device::{Planes, View, check_camera},
};
use corf_gpu::{Reading, Scratch};
use corf_scene::{Pinhole, Rigid3};
use rayon::prelude::*;

/// Bytes of images that are read back together: memory that they come through is kept up to twice as much.
const BATCH_BYTES: usize = 16 << 20;
/// Images drawn together by an adapter in software, which takes its time: whoever waits hears of them soon.
const SOFTWARE_BATCH: usize = 2;

impl GpuDevice {
    pub(super) fn stream_radio(
        &mut self,
        camera: &Pinhole,
        poses: &[Rigid3],
        background: [f32; 3],
        take: &mut dyn FnMut(Vec<Planes>) -> Result<()>,
    ) -> Result<()> {
        check_camera(camera)?;
        let frame =
            |pose: &Rigid3| self.frame([None, Some((View { camera: *camera, world_from_camera: *pose }, background))], false);
        let mut frames: Vec<Params> = poses.iter().filter_map(frame).collect();
        let mut images = Scratch::new(&self.context, "radio images")?;
        let mut waiting: Option<(&mut [Params], Reading<u32>)> = None;
        for batch in frames.chunks_mut(self.radio_batch(camera)) {
            let reading = self.begin_radio(batch, self.first_room(batch), &mut images)?;
            if let Some((before, reading)) = waiting.replace((batch, reading)) {
                take(self.finish_radio(before, reading, camera, &mut images)?)?;
            }
        }
        match waiting {
            Some((last, reading)) => take(self.finish_radio(last, reading, camera, &mut images)?),
            None => Ok(()),
        }
    }

    /// Images of a batch.
    fn radio_batch(&self, camera: &Pinhole) -> usize {
        let most = if self.context.is_software() { SOFTWARE_BATCH } else { STEPS_PER_SUBMISSION };
        (BATCH_BYTES / (4 * self.radio_numbers(camera))).clamp(1, most)
    }

    /// Numbers of an image.
    fn radio_numbers(&self, camera: &Pinhole) -> usize {
        camera.width * camera.height * self.store.harmonics[1].channels
    }

    fn first_room(&self, frames: &[Params]) -> BufferCapacity {
        BufferCapacity::guess(self.store.len(), self.least_room, self.most_room(frames))
    }

    fn most_room(&self, frames: &[Params]) -> BufferCapacity {
        self.extent(frames).most(&self.context, &self.shapes[0])
    }

    fn extent(&self, frames: &[Params]) -> Extent {
        let mut extent = Extent { gaussians: self.store.len(), ..Extent::default() };
        frames.iter().for_each(|p| extent.include(p, &self.shapes));
        extent
    }

    /// Has a batch drawn into `images`, one behind the other, and copied from there.
    fn begin_radio(&mut self, frames: &mut [Params], room: BufferCapacity, images: &mut Scratch) -> Result<Reading<u32>> {
        let n = self.store.len();
        let extent = self.extent(frames);
        self.memory.reserve(&self.context, &self.shapes[0], &extent, room)?;
        // All planes of the colour, and none of what lies behind them.
        let numbers = extent.pixels * self.store.harmonics[1].channels;
        images.reserve(&self.context, frames.len() * numbers, 4)?;
        let m = &self.memory;
        frames.iter_mut().for_each(|p| p.set_room(m.room));
        let uniforms = Uniforms::new(&self.context, frames.iter())?;
        m.reset(&self.context, n);
        let bound = self.forward.bind(&self.context, &uniforms.buffer, self.values(), m, Leaves::Images)?;
        let mut encoder = self.context.encoder();
        let bytes = 4 * numbers as u64;
        for (k, p) in frames.iter().enumerate() {
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                bound.record(&mut pass, p, uniforms.offset(k), n, m, &mut |_| {});
            }
            encoder.copy_buffer_to_buffer(&m.image.buffer, 0, &images.buffer, k as u64 * bytes, bytes);
        }
        self.context.submit(encoder);
        let sources = [(&m.state, STATE_WORDS), (&images.buffer, frames.len() * numbers)];
        Ok(self.context.begin_reading("rendering spectra", &sources)?)
    }

    /// Waits for a batch, which is drawn again with more room where there was too little.
    fn finish_radio(
        &mut self,
        frames: &mut [Params],
        mut reading: Reading<u32>,
        camera: &Pinhole,
        images: &mut Scratch,
    ) -> Result<Vec<Planes>> {
        loop {
            let read = reading.finish(&self.context)?;
            if read[0][FAILED] == 0 {
                let channels = self.store.harmonics[1].channels;
                let image = |planes: &[u32]| interleaved(camera, channels, planes);
                return Ok(read[1].par_chunks_exact(self.radio_numbers(camera)).map(image).collect());
            }
            let room = BufferCapacity::asked(&read[0], self.most_room(frames));
            reading = self.begin_radio(frames, room, images)?;
        }
    }
}

/// An image whose planes lie one behind the other, as bits.
fn interleaved(camera: &Pinhole, channels: usize, planes: &[u32]) -> Planes {
    let (width, height) = (camera.width, camera.height);
    let mut pixels = vec![0.0; planes.len()];
    for (channel, plane) in planes.chunks_exact(width * height).enumerate() {
        let values = pixels[channel..].iter_mut().step_by(channels);
        values.zip(plane).for_each(|(value, bits)| *value = f32::from_bits(*bits));
    }
    Planes { width, height, channels, pixels }
}
