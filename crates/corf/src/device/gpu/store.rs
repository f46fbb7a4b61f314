//! Gaussians and their optimiser state in device memory: rows of words, one a Gaussian, as the CPU device keeps them.

use super::{
    context::Context,
    kernel::Kernel,
    shaders::{self, HarmonicsShape},
};
use crate::{Appearance, Gaussians, Result};
use rayon::prelude::*;

/// Position (3), quaternion (4), ln scale (3), opacity logits (optical, RF).
pub(super) const CORE: usize = 12;

/// One array of the store.
pub(crate) struct Rows {
    label: &'static str,
    pub buffer: wgpu::Buffer,
    /// Words per Gaussian.
    words: usize,
}

/// Value and Adam's moments.
pub(crate) struct Trained {
    pub value: Rows,
    pub moment1: Rows,
    pub moment2: Rows,
}

/// All Gaussians.
pub(crate) struct Store {
    pub core: Trained,
    /// What is left of the position rate.
    pub position_rate: Rows,
    /// Optical, RF.
    pub sh: [Trained; 2],
    pub harmonics: [HarmonicsShape; 2],
    len: usize,
    capacity: usize,
    gather: Kernel,
    /// Where rows are gathered before they are copied back.
    spare: Option<wgpu::Buffer>,
}

impl Rows {
    fn new(context: &Context, label: &'static str, words: usize, capacity: usize) -> Result<Self> {
        Ok(Self { label, buffer: context.storage(label, (4 * words * capacity) as u64)?, words })
    }

    fn bytes(&self, rows: usize) -> u64 {
        (4 * self.words * rows) as u64
    }
}

impl Trained {
    fn new(context: &Context, label: &'static str, words: usize, capacity: usize) -> Result<Self> {
        let rows = || Rows::new(context, label, words, capacity);
        Ok(Self { value: rows()?, moment1: rows()?, moment2: rows()? })
    }
}

/// `[coefficient][channel]` to `[channel][coefficient]`, padded.
pub(super) fn transposed(a: &Appearance, shape: HarmonicsShape) -> Vec<f32> {
    let (k, c) = (shape.coefficients(), shape.channels);
    let mut out = vec![0.0; a.opacity_logit.len() * shape.words()];
    for (row, one) in out.chunks_exact_mut(shape.words()).zip(a.sh.chunks_exact(k * c)) {
        for (n, value) in row[..k * c].iter_mut().enumerate() {
            *value = one[(n % k) * c + n / k];
        }
    }
    out
}

/// Channels and degree.
fn held(h: HarmonicsShape) -> (usize, usize) {
    (h.channels, h.degree)
}

impl Store {
    /// No Gaussians yet, with the channels and degrees of `like`.
    pub fn new(context: &Context, like: &Gaussians) -> Result<Self> {
        like.check_colours()?;
        let harmonics = [HarmonicsShape::of(&like.optical), HarmonicsShape::of(&like.rf)];
        let capacity = 1;
        Ok(Self {
            core: Trained::new(context, "geometry", CORE, capacity)?,
            position_rate: Rows::new(context, "position rates", 1, capacity)?,
            sh: [
                Trained::new(context, "optical harmonics", harmonics[0].words(), capacity)?,
                Trained::new(context, "RF harmonics", harmonics[1].words(), capacity)?,
            ],
            harmonics,
            len: 0,
            capacity,
            gather: Kernel::new(context, "gather", &shaders::gather())?,
            spare: None,
        })
    }

    pub fn len(&self) -> usize {
        self.len
    }

    fn rows(&self) -> [&Rows; 10] {
        let ([a, b], c) = (&self.sh, &self.core);
        [
            &c.value,
            &c.moment1,
            &c.moment2,
            &self.position_rate,
            &a.value,
            &a.moment1,
            &a.moment2,
            &b.value,
            &b.moment1,
            &b.moment2,
        ]
    }

    fn rows_mut(&mut self) -> [&mut Rows; 10] {
        let [a, b] = &mut self.sh;
        let c = &mut self.core;
        [
            &mut c.value,
            &mut c.moment1,
            &mut c.moment2,
            &mut self.position_rate,
            &mut a.value,
            &mut a.moment1,
            &mut a.moment2,
            &mut b.value,
            &mut b.moment1,
            &mut b.moment2,
        ]
    }

    /// Room for `n` Gaussians. Nothing changes on an error.
    fn reserve(&mut self, context: &Context, n: usize) -> Result<()> {
        if n <= self.capacity {
            return Ok(());
        }
        // Half as much again, so that keyframe after keyframe does not copy each time.
        let capacity = n.max(self.capacity + self.capacity / 2);
        let len = self.len;
        let mut fresh = vec![];
        for rows in self.rows() {
            fresh.push(Rows::new(context, rows.label, rows.words, capacity)?);
        }
        let mut encoder = context.encoder();
        for (rows, new) in self.rows_mut().into_iter().zip(fresh) {
            if len > 0 {
                encoder.copy_buffer_to_buffer(&rows.buffer, 0, &new.buffer, 0, new.bytes(len));
            }
            *rows = new;
        }
        context.submit(encoder);
        self.capacity = capacity;
        context.check("growing")
    }

    pub fn append(&mut self, context: &Context, new: &Gaussians) -> Result<()> {
        let n = new.len();
        new.check_appendable(self.harmonics.map(held))?;
        if n == 0 {
            return Ok(());
        }
        self.reserve(context, self.len + n)?;
        let mut core = Vec::with_capacity(n * CORE);
        for i in 0..n {
            core.extend(new.position[i]);
            core.extend(new.rotation[i]);
            core.extend(new.log_scale[i]);
            core.extend([new.optical.opacity_logit[i], new.rf.opacity_logit[i]]);
        }
        let sh = [transposed(&new.optical, self.harmonics[0]), transposed(&new.rf, self.harmonics[1])];
        let first = self.len;
        let c = &self.core;
        context.fill(&c.value.buffer, c.value.bytes(first), &core);
        context.fill(&self.position_rate.buffer, self.position_rate.bytes(first), &vec![1.0; n]);
        for (trained, values) in self.sh.iter().zip(&sh) {
            context.fill(&trained.value.buffer, trained.value.bytes(first), values);
        }
        let mut encoder = context.encoder();
        for trained in [c, &self.sh[0], &self.sh[1]] {
            for moment in [&trained.moment1, &trained.moment2] {
                encoder.clear_buffer(&moment.buffer, moment.bytes(first), Some(moment.bytes(n)));
            }
        }
        context.submit(encoder);
        self.len += n;
        context.check("adding Gaussians")
    }

    /// Keeps the rows whose flag is true, in order.
    pub fn retain(&mut self, context: &Context, keep: &[bool]) -> Result<()> {
        let kept: Vec<u32> = (0..self.len as u32).filter(|i| keep[*i as usize]).collect();
        if kept.len() == self.len {
            return Ok(());
        }
        self.len = kept.len();
        if kept.is_empty() {
            return Ok(());
        }
        let widest = CORE.max(self.harmonics[0].words()).max(self.harmonics[1].words());
        let bytes = (4 * kept.len() * widest) as u64;
        let spare = match self.spare.take() {
            Some(spare) if spare.size() >= bytes => spare,
            _ => context.storage("rows being gathered", bytes)?,
        };
        let names = context.storage("rows kept", 4 * kept.len() as u64)?;
        context.queue.write_buffer(&names, 0, bytemuck::cast_slice(&kept));
        let constants = context.buffer("row sizes", 16 * 256, wgpu::BufferUsages::UNIFORM)?;
        let mut encoder = context.encoder();
        for (k, rows) in self.rows().into_iter().enumerate() {
            let sizes = [kept.len() as u32, rows.words as u32, 0, 0];
            context.queue.write_buffer(&constants, 256 * k as u64, bytemuck::cast_slice(&sizes));
            let bound = self.gather.bind(context, 16, &[&constants, &names, &rows.buffer, &spare])?;
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                bound.run(&mut pass, 256 * k as u32, (kept.len() * rows.words).div_ceil(256) as u32);
            }
            encoder.copy_buffer_to_buffer(&spare, 0, &rows.buffer, 0, rows.bytes(kept.len()));
        }
        context.submit(encoder);
        self.spare = Some(spare);
        context.check("removing Gaussians")
    }

    /// Replaces the RF appearance and its optimiser state, whose channels and degree stay as they are.
    pub fn reset_rf(&mut self, context: &Context, rf: &Appearance) -> Result<()> {
        rf.check_complete("RF appearance", self.len, held(self.harmonics[1]))?;
        let sh = transposed(rf, self.harmonics[1]);
        let zeros = vec![0.0_f32; sh.len()];
        for (rows, values) in [&self.sh[1].value, &self.sh[1].moment1, &self.sh[1].moment2].into_iter().zip([&sh, &zeros, &zeros])
        {
            context.queue.write_buffer(&rows.buffer, 0, bytemuck::cast_slice(values));
        }
        let c = &self.core;
        let numbers = self.len * CORE;
        let sources = [(&c.value.buffer, numbers), (&c.moment1.buffer, numbers), (&c.moment2.buffer, numbers)];
        let mut read = context.read::<f32>("starting the second stage", &sources)?;
        for (n, (rows, values)) in [&c.value, &c.moment1, &c.moment2].into_iter().zip(&mut read).enumerate() {
            for (i, row) in values.chunks_exact_mut(CORE).enumerate() {
                row[CORE - 1] = if n == 0 { rf.opacity_logit[i] } else { 0.0 };
            }
            context.queue.write_buffer(&rows.buffer, 0, bytemuck::cast_slice(values));
        }
        context.check("starting the second stage")
    }

    /// The numbers of one of each (geometry, optical and RF harmonics: parameters or their gradients) in the public shape.
    pub fn read(&self, context: &Context, buffers: [&wgpu::Buffer; 3]) -> Result<Gaussians> {
        let n = self.len;
        let words = [CORE, self.harmonics[0].words(), self.harmonics[1].words()];
        let sources: Vec<_> = buffers.into_iter().zip(words).map(|(b, w)| (b, n * w)).collect();
        let read = context.read::<f32>("reading Gaussians back", &sources)?;
        let core: Vec<&[f32]> = read[0].chunks_exact(CORE).collect();
        let appearance = |g: usize| {
            let shape = self.harmonics[g];
            let (k, c) = (shape.coefficients(), shape.channels);
            let mut sh = vec![0.0; n * k * c];
            let rows = read[1 + g].par_chunks_exact(shape.words());
            sh.par_chunks_exact_mut(k * c).zip(rows).with_min_len(256).for_each(|(sh, row)| {
                for (at, value) in sh.iter_mut().enumerate() {
                    *value = row[(at % c) * k + at / c];
                }
            });
            let opacity_logit = core.iter().map(|row| row[10 + g]).collect();
            Appearance { channels: c, sh_degree: shape.degree, opacity_logit, sh }
        };
        Ok(Gaussians {
            position: core.iter().map(|r| [r[0], r[1], r[2]]).collect(),
            rotation: core.iter().map(|r| [r[3], r[4], r[5], r[6]]).collect(),
            log_scale: core.iter().map(|r| [r[7], r[8], r[9]]).collect(),
            optical: appearance(0),
            rf: appearance(1),
        })
    }

    pub fn to_gaussians(&self, context: &Context) -> Result<Gaussians> {
        self.read(context, [&self.core.value.buffer, &self.sh[0].value.buffer, &self.sh[1].value.buffer])
    }
}
