//! What is read back from the store beside the Gaussians themselves, and how it comes there again.

use super::{
    context::Context,
    store::{CORE, Store, transposed},
};
use crate::{
    Gaussians, Result,
    device::{DeviceState, Outline},
};

impl Store {
    /// What decides whether a Gaussian is pruned: 48 bytes of each.
    pub fn outlines(&self, context: &Context) -> Result<Vec<Outline>> {
        let core = context.read::<f32>("reading outlines back", &[(&self.core.value.buffer, self.len() * CORE)])?;
        let outline = |row: &[f32]| Outline {
            position: [row[0], row[1], row[2]],
            largest_log_scale: row[7].max(row[8]).max(row[9]),
            opacity_logit: [row[10], row[11]],
        };
        Ok(core[0].chunks_exact(CORE).map(outline).collect())
    }

    /// The Gaussians with their optimiser.
    pub fn state(&self, context: &Context) -> Result<DeviceState> {
        let [optical, rf] = &self.sh;
        let first = [&self.core.moment1.buffer, &optical.moment1.buffer, &rf.moment1.buffer];
        let second = [&self.core.moment2.buffer, &optical.moment2.buffer, &rf.moment2.buffer];
        let mut rates = context.read::<f32>("reading rates back", &[(&self.position_rate.buffer, self.len())])?;
        Ok(DeviceState {
            gaussians: self.to_gaussians(context)?,
            moments: [self.read(context, first)?, self.read(context, second)?],
            position_rate: rates.pop().unwrap_or_default(),
        })
    }

    /// Holds a state; nothing may be held yet.
    pub fn restore(&mut self, context: &Context, state: &DeviceState) -> Result<()> {
        state.check(self.harmonics.map(|h| (h.channels, h.degree)), self.len())?;
        self.append(context, &state.gaussians)?;
        let put = |buffer: &wgpu::Buffer, numbers: &[f32]| context.queue.write_buffer(buffer, 0, bytemuck::cast_slice(numbers));
        let [optical, rf] = &self.sh;
        let homes = [[&self.core.moment1, &optical.moment1, &rf.moment1], [&self.core.moment2, &optical.moment2, &rf.moment2]];
        for ([core, optical, rf], moments) in homes.into_iter().zip(&state.moments) {
            put(&core.buffer, &cores(moments));
            put(&optical.buffer, &transposed(&moments.optical, self.harmonics[0]));
            put(&rf.buffer, &transposed(&moments.rf, self.harmonics[1]));
        }
        put(&self.position_rate.buffer, &state.position_rate);
        context.check("restoring Gaussians")
    }
}

/// Geometry and opacities, Gaussian by Gaussian.
pub(super) fn cores(g: &Gaussians) -> Vec<f32> {
    let mut out = Vec::with_capacity(g.len() * CORE);
    for i in 0..g.len() {
        out.extend(g.position[i]);
        out.extend(g.rotation[i]);
        out.extend(g.log_scale[i]);
        out.extend([g.optical.opacity_logit[i], g.rf.opacity_logit[i]]);
    }
    out
}
