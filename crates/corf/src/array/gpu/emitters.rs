//! A field's emitters on a GPU: sources, then points.

use super::super::ArrayField;
use crate::Result;
use corf_gpu::Context;

/// Buffers of emitters.
pub(super) struct Emitters {
    /// Position and variance of the size, m².
    pub positions: wgpu::Buffer,
    /// Log gains.
    pub gains: wgpu::Buffer,
    /// Corrections of the log gain, anchor after anchor.
    pub seen_from: wgpu::Buffer,
    /// Emitters, and anchors.
    pub count: usize,
    pub anchors: usize,
}

impl Emitters {
    pub fn new(context: &Context, field: &ArrayField) -> Result<Self> {
        let (count, anchors) = (field.sources.len() + field.points.len(), field.anchors.positions_m.len());
        let made = Self {
            positions: context.storage("emitters", 16 * count as u64)?,
            gains: context.storage("log gains", 4 * count as u64)?,
            seen_from: context.storage("corrections of log gains", 4 * (anchors * count) as u64)?,
            count,
            anchors,
        };
        let extent2 = (field.extent_m * field.extent_m) as f32;
        let positions: Vec<[f32; 4]> = [(&field.sources, 0.0), (&field.points, extent2)]
            .into_iter()
            .flat_map(|(cloud, extent2)| cloud.position.iter().map(move |[x, y, z]| [*x, *y, *z, extent2]))
            .collect();
        context.fill(&made.positions, 0, &positions);
        for (first, cloud) in [(0, &field.sources), (field.sources.len(), &field.points)] {
            context.fill(&made.gains, 4 * first as u64, &cloud.gain);
            for (k, row) in cloud.seen_from.iter().enumerate() {
                context.fill(&made.seen_from, 4 * (k * count + first) as u64, row);
            }
        }
        context.check("holding a radio field")?;
        Ok(made)
    }
}
