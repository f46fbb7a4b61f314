//! Observations of a finished field.

use super::super::{ArrayField, Observer};
use super::emitters::Emitters;
use super::forward::{Forward, Kernels, Room, bytes_a_pose};
use super::job::{Job, Receivers};
use super::pixels::Pixels;
use super::shape::Shape;
use crate::Result;
use corf_gpu::{AdapterOptions, Context};
use corf_scene::{Raster, Rigid3};
use std::sync::Arc;

/// Most poses at once: enough that a GPU is full and few enough that nobody waits for the first.
const MOST_POSES: usize = 64;
/// Most memory that a batch takes, bytes.
const MOST_MEMORY: usize = 256 << 20;

/// Forms observations on a GPU, in f32. The same poses give the same bytes on the same adapter and driver.
pub struct GpuObserver {
    field: Arc<ArrayField>,
    forward: Forward,
    batch: usize,
    /// Last, for what is made of it to be dropped before.
    context: Context,
}

impl GpuObserver {
    /// Of a field.
    ///
    /// # Errors
    /// No adapter, or one without memory for the field.
    pub fn new(options: &AdapterOptions, field: Arc<ArrayField>) -> Result<Self> {
        Self::in_batches(Context::open(options)?, field, MOST_POSES)
    }

    /// [`Self::new`] with at most so many poses at once.
    pub(super) fn in_batches(context: Context, field: Arc<ArrayField>, most: usize) -> Result<Self> {
        let kernels = Kernels::new(&context, Shape::of(&field.sensor)?)?;
        let (emitters, pixels) = (Emitters::new(&context, &field)?, Pixels::new(&context, &field)?);
        let bytes = bytes_a_pose(kernels.shape, emitters.count, pixels.count, emitters.anchors);
        let bindable = usize::try_from(context.largest_buffer()).unwrap_or(usize::MAX);
        let batch = (bindable.min(MOST_MEMORY) / bytes).clamp(1, most);
        let room = Room { batch, held: batch, tables: 0, directions: 0 };
        let forward = Forward::new(&context, &kernels, &emitters, &pixels, room)?;
        context.check("holding a radio field")?;
        Ok(Self { field, forward, batch, context })
    }

    /// The adapter's name.
    pub fn adapter(&self) -> &str {
        &self.context.info.name
    }

    /// Poses that are observed at once.
    pub fn batch(&self) -> usize {
        self.batch
    }
}

impl Observer for GpuObserver {
    fn observe(&mut self, poses: &[Rigid3]) -> Result<Vec<Raster<f32>>> {
        let (width, height) = (self.field.camera.width, self.field.camera.height);
        if self.field.sources.is_empty() && self.field.points.is_empty() {
            return Ok(poses.iter().map(|_| Raster::filled(width, height, 0.0)).collect());
        }
        let mut out = Vec::with_capacity(poses.len());
        for poses in poses.chunks(self.batch) {
            let job = Job::new(&self.field, 0, poses.len());
            self.forward.send(&self.context, &Receivers::at(&self.field, poses), &[job]);
            let mut encoder = self.context.encoder();
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                self.forward.run(&mut pass, 0, poses.len());
            }
            self.context.submit(encoder);
            let sizes = [(&self.forward.observed, poses.len() * width * height)];
            for pixels in self.context.read::<f32>("observing a radio field", &sizes)?.concat().chunks_exact(width * height) {
                // Rounding can leave less than nothing.
                out.push(Raster::from_vec(width, height, pixels.iter().map(|p| p.max(0.0)).collect()));
            }
        }
        Ok(out)
    }
}
