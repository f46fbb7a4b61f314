//! The kernels of a training step behind its forward pass: losses, the blend backwards, the update.

use super::{
    GpuDevice,
    dense::DenseUpdate,
    frame::{ARGS_APPEARANCE, ARGS_BUCKETS, ARGS_GEOMETRY, Mark, Memory},
    params::{self, Params},
    pyramid::Pyramid,
    shaders::{Fixed, Gradients},
};
use crate::{Error, Result, device::ViewId};
use corf_gpu::{Bound, Context, Kernel};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// The kernels of a step beyond the forward pass.
pub(crate) struct Training {
    similarity: Kernel,
    gradient: Kernel,
    /// Of pixels that do not count: the image before the loss, its gradient behind.
    left_out: [Kernel; 2],
    /// Kernels for each shape of tiles: the modalities apart, both at once.
    backward: Vec<[Kernel; 2]>,
    /// Appearance, geometry.
    update: [Kernel; 2],
    write_gradients: [Kernel; 2],
    /// For dense steps; made when there is one.
    pub(super) dense: Option<DenseUpdate>,
    /// Gradients of geometry that are noted as well; made when there is such a step.
    pub(super) noted: Option<Kernel>,
}

impl Training {
    pub fn new(context: &Context, shapes: &[Fixed]) -> Result<Self> {
        let fixed = &shapes[0];
        let backward = |fixed: &Fixed| -> Result<[Kernel; 2]> {
            let kernels = [("blend backwards", fixed.backward(false)), ("blend both backwards", fixed.backward(true))];
            Ok(Kernel::all(context, kernels)?)
        };
        let backward = shapes.par_iter().map(backward).collect::<Result<_>>()?;
        let [similarity, gradient, take_target, clear_gradient, appearance, geometry, of_appearance, of_geometry] = Kernel::all(
            context,
            [
                ("similarity", fixed.similarity()),
                ("loss gradient", fixed.gradient()),
                ("targets of masked pixels", fixed.take_target()),
                ("gradients of masked pixels", fixed.clear_gradient()),
                ("update appearance", fixed.update_appearance(Gradients::Sparse)),
                ("update geometry", fixed.update_geometry(Gradients::Sparse)),
                ("gradients of appearance", fixed.update_appearance(Gradients::Written)),
                ("gradients of geometry", fixed.update_geometry(Gradients::Written)),
            ],
        )?;
        let (update, write_gradients) = ([appearance, geometry], [of_appearance, of_geometry]);
        let left_out = [take_target, clear_gradient];
        Ok(Self { similarity, gradient, left_out, backward, update, write_gradients, dense: None, noted: None })
    }
}

/// Use of the gradients of some steps.
#[derive(Clone, Copy)]
pub(super) enum Destination<'a> {
    /// Steps of sparse Adam.
    Sparse,
    /// Steps of dense Adam.
    Dense,
    /// They are written to buffers: geometry, optical and RF harmonics.
    Written([&'a wgpu::Buffer; 3]),
    /// The same, and gradients on the screen are summed if the step asks for it.
    Noted([&'a wgpu::Buffer; 3]),
}

/// The kernels of a batch of steps with their memory.
pub(super) struct BoundTraining {
    /// Kernels for each shape of tiles: the modalities apart, both at once.
    backward: Vec<[Bound; 2]>,
    /// Appearance, geometry.
    update: [Bound; 2],
    /// Of dense steps: light, RF.
    pub momentum: Option<[Bound; 2]>,
}

/// The loss kernels with a keyframe, where it is at present.
pub(super) struct BoundLoss {
    placing: u64,
    similarity: Bound,
    gradient: Bound,
    /// Of a keyframe with a mask.
    left_out: Option<[Bound; 2]>,
}

impl BoundTraining {
    /// Records what comes behind a step's forward pass, up to the update; `mark` is called between the kernels.
    pub fn record(
        &self,
        pass: &mut wgpu::ComputePass<'_>,
        step: &Planned,
        loss: Option<&BoundLoss>,
        offset: u32,
        m: &Memory,
        mark: Mark<'_>,
    ) {
        let p = &step.params;
        if let Some(BoundLoss { similarity, gradient, left_out, .. }) = loss {
            let left_out = left_out.as_ref().filter(|_| p.mask_groups() > 0);
            if let Some([take_target, _]) = left_out {
                take_target.run(pass, offset, p.mask_groups());
            }
            similarity.run(pass, offset, 3 * p.blocks_total);
            mark(pass);
            gradient.run(pass, offset, 3 * p.blocks_total);
            if let Some([_, clear_gradient]) = left_out {
                clear_gradient.run(pass, offset, p.mask_groups());
            }
        }
        mark(pass);
        self.backward[p.shape as usize][p.fused as usize].run_indirect(pass, offset, &m.args, ARGS_BUCKETS);
        mark(pass);
        self.update[0].run_indirect(pass, offset, &m.args, ARGS_APPEARANCE);
        mark(pass);
        self.update[1].run_indirect(pass, offset, &m.args, ARGS_GEOMETRY);
    }
}

/// One step's constants and place among the uniforms.
pub(super) struct Planned {
    pub params: Params,
    pub view: ViewId,
}

impl GpuDevice {
    /// Binds the kernels behind a forward pass from `values`.
    pub(super) fn bind_training(
        &self,
        uniform: &wgpu::Buffer,
        [core, of_light, of_radio]: [&wgpu::Buffer; 3],
        destination: Destination<'_>,
    ) -> Result<BoundTraining> {
        let (m, s, t, context) = (&self.memory, &self.store, &self.training, &self.context);
        let bind = |kernel: &Kernel, buffers: &[&wgpu::Buffer]| kernel.bind(context, params::SIZE, buffers);
        let (image, gradient) = (&m.image.buffer, &m.gradient.buffer);
        let (lists, entries, splats) = (&m.lists.buffer, &m.entries.buffer, &m.splats.buffer);
        let (heads, tails) = (&m.checkpoint_heads.buffer, &m.checkpoint_tails.buffer);
        let (tiles, visited, records) =
            (&m.bucket_tiles.buffer, &m.visited.buffer, [&m.record_heads.buffer, &m.record_tails.buffer]);
        let backward =
            [uniform, &m.state, lists, tiles, entries, splats, image, gradient, heads, tails, visited, records[0], records[1]];
        let of_shape = |[single, double]: &[Kernel; 2]| Ok([bind(single, &backward)?, bind(double, &backward)?]);
        let dense = t.dense.as_ref().filter(|_| matches!(destination, Destination::Dense));
        let ([appearance, geometry], core_gradient) = match destination {
            Destination::Written([core, ..]) => (t.write_gradients.each_ref(), core),
            Destination::Noted([core, ..]) => {
                let noted = t.noted.as_ref().unwrap_or(&t.write_gradients[1]);
                ([&t.write_gradients[0], noted], core)
            }
            Destination::Sparse | Destination::Dense => {
                (dense.map_or(&t.update, |d| &d.update).each_ref(), &s.core.moment1.buffer)
            }
        };
        let (numbers, sums, directions) = (&m.gaussian_of.buffer, &m.ellipse_sums.buffer, &m.directions.buffer);
        let (light, radio) = ([of_light, &s.sh[0].moments.buffer], [of_radio, &s.sh[1].moments.buffer]);
        let read = [uniform, &m.state, numbers, &m.drawn.buffer, records[0], records[1], splats, core];
        let mut appearance_buffers = [&read[..], &light[..], &radio[..], &[sums, directions]].concat();
        if let Destination::Written([_, light, radio]) | Destination::Noted([_, light, radio]) = destination {
            appearance_buffers.extend([light, radio]);
        }
        let (second, rates, marks) = (&s.core.moment2.buffer, &s.position_rate.buffer, &self.marks.buffer);
        let mut geometry_buffers = vec![uniform, &m.state, numbers, sums, directions, core, core_gradient, second, rates];
        if matches!(destination, Destination::Dense | Destination::Noted(_)) {
            geometry_buffers.push(marks);
        }
        let momentum = |kernel: &Kernel, [value, moments]: [&wgpu::Buffer; 2]| {
            bind(kernel, &[uniform, &m.state, marks, rates, core, &s.core.moment1.buffer, second, value, moments])
        };
        let momentum =
            dense.map(|d| Ok::<_, Error>([momentum(&d.momentum[0], light)?, momentum(&d.momentum[1], radio)?])).transpose()?;
        Ok(BoundTraining {
            momentum,
            backward: t.backward.iter().map(of_shape).collect::<Result<_>>()?,
            update: [bind(appearance, &appearance_buffers)?, bind(geometry, &geometry_buffers)?],
        })
    }

    /// Binds the loss kernels to the keyframes of some steps; what is bound to a keyframe that has moved is bound again.
    pub(super) fn bind_losses(
        &self,
        uniform: &wgpu::Buffer,
        steps: &[Planned],
        bound: &mut BTreeMap<usize, BoundLoss>,
    ) -> Result<()> {
        let (m, t) = (&self.memory, &self.training);
        let (image, derivatives, gradient) = (&m.image.buffer, &m.derivatives.buffer, &m.gradient.buffer);
        let losses = &m.block_losses.buffer;
        bound.retain(|view, loss| self.keyframe_cache.place(*view).is_some_and(|(_, placing)| placing == loss.placing));
        for view in steps.iter().map(|s| s.view.0) {
            if let (false, Some((target, placing))) = (bound.contains_key(&view), self.keyframe_cache.place(view)) {
                let bind = |kernel: &Kernel, buffers: &[&wgpu::Buffer]| kernel.bind(&self.context, params::SIZE, buffers);
                let similarity = bind(&t.similarity, &[uniform, image, target, derivatives, losses])?;
                let has_mask = self.keyframe_cache.get(view).is_some_and(Pyramid::has_mask);
                let [take_target, clear_gradient] = &t.left_out;
                let left_out = || {
                    let take_target = bind(take_target, &[uniform, target, image])?;
                    Ok::<_, Error>([take_target, bind(clear_gradient, &[uniform, target, gradient])?])
                };
                let left_out = has_mask.then(left_out).transpose()?;
                let gradient = bind(&t.gradient, &[uniform, image, target, derivatives, gradient, losses])?;
                bound.insert(view, BoundLoss { placing, similarity, gradient, left_out });
            }
        }
        Ok(())
    }
}
