//! From receivers to observations: working memory for a batch of poses, and kernels bound to it.

use super::capon::{BoundInversion, Inversion};
use super::emitters::Emitters;
use super::job::{Job, Near, ReceiverRow, Receivers};
use super::pixels::Pixels;
use super::shape::{CHUNK, Shape};
use crate::Result;
use corf_gpu::{Bound, Context, Kernel, UNIFORM_STRIDE};

/// Compiled kernels of the forward pass.
pub(super) struct Kernels {
    pub shape: Shape,
    waves: Kernel,
    /// Parts of tables and their sums, of beams.
    tables: Option<[Kernel; 2]>,
    inversion: Option<Inversion>,
    observe: Kernel,
}

impl Kernels {
    pub fn new(context: &Context, shape: Shape) -> Result<Self> {
        let [waves, observe] = Kernel::all(context, [("waves", shape.waves()), ("observe waves", shape.observe())])?;
        let tables = match shape {
            Shape::Beam { .. } | Shape::Capon { .. } => {
                let sources = [("collect waves", shape.collect_waves()), ("sum tables of waves", shape.sum_waves())];
                Some(Kernel::all(context, sources)?)
            }
            Shape::Lobes => None,
        };
        Ok(Self { shape, waves, tables, inversion: Inversion::new(context, shape)?, observe })
    }
}

/// Bytes of working memory that a pose takes.
pub(super) fn bytes_a_pose(shape: Shape, emitters: usize, pixels: usize, anchors: usize) -> usize {
    let tables = 16 * shape.entries() * (1 + emitters.div_ceil(CHUNK));
    let matrices = 4 * (1 + shape.squared());
    32 * emitters + tables + matrices + 4 * pixels + size_of::<ReceiverRow>() + size_of::<Near>() * anchors
}

/// A batch of poses.
pub(super) struct Forward {
    shape: Shape,
    /// Constants of the dispatches, [`UNIFORM_STRIDE`] bytes apart.
    pub jobs: wgpu::Buffer,
    pub receivers: wgpu::Buffer,
    pub anchors: wgpu::Buffer,
    pub waves: wgpu::Buffer,
    pub lobes: wgpu::Buffer,
    pub parts: wgpu::Buffer,
    pub tables: wgpu::Buffer,
    /// Of Capon's beamformer: inverse covariances of waves of the power 1 in all, and the power of all waves.
    pub matrices: wgpu::Buffer,
    pub totals: wgpu::Buffer,
    pub observed: wgpu::Buffer,
    of_waves: Bound,
    of_tables: Option<[Bound; 2]>,
    of_matrices: Option<BoundInversion>,
    of_pixels: Bound,
    emitters: usize,
    groups: usize,
}

impl Forward {
    /// Room for `batch` poses at once, `held` receivers and jobs, and tables of at least `tables` lists of `directions`.
    pub fn new(context: &Context, kernels: &Kernels, emitters: &Emitters, pixels: &Pixels, room: Room) -> Result<Self> {
        let shape = kernels.shape;
        let Room { batch, held, tables, directions } = room;
        let (count, lists) = (emitters.count as u64, tables.max(batch) as u64);
        let entries = 16 * shape.entries() as u64;
        let parts = (batch * emitters.count.div_ceil(CHUNK)).max(tables * directions.div_ceil(CHUNK)) as u64;
        let lobes = if shape == Shape::Lobes { 16 * batch as u64 * count } else { 0 };
        let jobs = context.buffer("jobs of a radio field", UNIFORM_STRIDE * held as u64, wgpu::BufferUsages::UNIFORM)?;
        let receivers = context.storage("receivers", (size_of::<ReceiverRow>() * held) as u64)?;
        let anchors = context.storage("anchors of receivers", (size_of::<Near>() * held * emitters.anchors) as u64)?;
        let waves = context.storage("waves", 16 * batch as u64 * count)?;
        let lobes = context.storage("lobes", lobes)?;
        let parts = context.storage("parts of tables", entries * parts)?;
        let tables = context.storage("tables", entries * lists)?;
        let matrices = context.storage("inverse covariances", (4 * batch * shape.squared()) as u64)?;
        let totals = context.storage("powers of all waves", 4 * batch as u64)?;
        let observed = context.storage("observations", (4 * batch * pixels.count) as u64)?;
        let uniform = size_of::<Job>() as u64;
        let of_waves = kernels.waves.bind(
            context,
            uniform,
            &[&jobs, &emitters.positions, &emitters.gains, &emitters.seen_from, &receivers, &anchors, &waves, &lobes],
        )?;
        let of_tables = match &kernels.tables {
            Some([collect, sum]) => Some([
                collect.bind(context, uniform, &[&jobs, &waves, &parts])?,
                sum.bind(context, uniform, &[&jobs, &parts, &tables])?,
            ]),
            None => None,
        };
        let of_matrices = match &kernels.inversion {
            Some(inversion) => Some(inversion.bind(context, &jobs, [&tables, &matrices, &totals])?),
            None => None,
        };
        let of_pixels = match shape {
            Shape::Beam { .. } => kernels.observe.bind(context, uniform, &[&jobs, &pixels.looks, &tables, &observed])?,
            Shape::Capon { .. } => {
                kernels.observe.bind(context, uniform, &[&jobs, &pixels.looks, &tables, &observed, &totals])?
            }
            Shape::Lobes => {
                kernels.observe.bind(context, uniform, &[&jobs, &pixels.looks, &pixels.tiles, &waves, &lobes, &observed])?
            }
        };
        let (emitters, groups) = (emitters.count, pixels.groups);
        Ok(Self {
            shape,
            jobs,
            receivers,
            anchors,
            waves,
            lobes,
            parts,
            tables,
            matrices,
            totals,
            observed,
            of_waves,
            of_tables,
            of_matrices,
            of_pixels,
            emitters,
            groups,
        })
    }

    /// Sends receivers, and constants of the dispatches, one after the other.
    pub fn send(&self, context: &Context, receivers: &Receivers, jobs: &[Job]) {
        context.fill(&self.receivers, 0, &receivers.rows);
        context.fill(&self.anchors, 0, &receivers.anchors);
        for (k, job) in jobs.iter().enumerate() {
            context.fill(&self.jobs, UNIFORM_STRIDE * k as u64, &[*job]);
        }
    }

    /// Observations at the `receivers` receivers of a job; with emitters.
    pub fn run(&self, pass: &mut wgpu::ComputePass<'_>, job: usize, receivers: usize) {
        let at = (UNIFORM_STRIDE * job as u64) as u32;
        self.of_waves.run(pass, at, (receivers * self.emitters).div_ceil(64) as u32);
        if let Some([collect, sum]) = &self.of_tables {
            collect.run(pass, at, (receivers * self.emitters.div_ceil(CHUNK)) as u32);
            sum.run(pass, at, (receivers * self.shape.entries()).div_ceil(64) as u32);
        }
        if let Some(inversion) = &self.of_matrices {
            inversion.run(pass, at, self.shape, receivers);
        }
        self.of_pixels.run(pass, at, (receivers * self.groups) as u32);
    }
}

/// What a [`Forward`] has room for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Room {
    /// Poses at once.
    pub batch: usize,
    /// Receivers and jobs that are sent at once.
    pub held: usize,
    /// Tables that are collected from pixels, and their number.
    pub tables: usize,
    pub directions: usize,
}
