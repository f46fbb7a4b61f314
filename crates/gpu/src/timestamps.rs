//! When things happened on a device, by its own clock.

use crate::{Context, Reading};
use corf_scene::Result;

/// Timestamps that passes write.
pub struct Timestamps {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
}

impl Timestamps {
    /// Room for `count` of them on a device that takes some ([`Context::timestamps`]).
    ///
    /// # Errors
    /// There is no memory for them.
    pub fn new(context: &Context, count: u32) -> Result<Self> {
        let queries = context.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("timestamps"),
            ty: wgpu::QueryType::Timestamp,
            count,
        });
        let resolved = context.buffer("timestamps", u64::from(count) * 8, wgpu::BufferUsages::QUERY_RESOLVE)?;
        Ok(Self { queries, resolved })
    }

    /// Where passes write them.
    pub fn queries(&self) -> &wgpu::QuerySet {
        &self.queries
    }

    /// Has the first `count` ready for [`Self::read`] once the passes that are encoded so far have run.
    pub fn resolve(&self, encoder: &mut wgpu::CommandEncoder, count: u32) {
        encoder.resolve_query_set(&self.queries, 0..count, &self.resolved, 0);
    }

    /// The first `count`, in the device's own unit: [`Self::seconds`] has what lies between two.
    ///
    /// # Errors
    /// The device's.
    pub fn read(&self, context: &Context, count: u32) -> Result<Vec<u64>> {
        Ok(context.read::<u64>("timestamps", &[(&self.resolved, count as usize)])?.remove(0))
    }

    /// Has the first `count` on their way, without a wait.
    ///
    /// # Errors
    /// The device's.
    pub fn begin_reading(&self, context: &Context, count: u32) -> Result<Reading<u64>> {
        context.begin_reading("timestamps", &[(&self.resolved, count as usize)])
    }

    /// Seconds from one timestamp to another.
    pub fn seconds(context: &Context, from: u64, to: u64) -> f64 {
        to.saturating_sub(from) as f64 * f64::from(context.queue.get_timestamp_period()) * 1e-9
    }
}
