//! Gaussians and their optimiser state in device memory: rows of words, one a Gaussian.
//!
//! A step reads and writes the harmonics of visible Gaussians, here and there among all, with both moments. These lie together, because memory
//! is faster where more of one place is wanted; values lie apart, so that five million of them can be bound at once.

use super::shaders::{self, HarmonicsShape};
use crate::{Appearance, Gaussians, Result};
use corf_gpu::{Context, Kernel};
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

/// Value and Adam's moments, apart.
pub(crate) struct Trained {
    pub value: Rows,
    pub moment1: Rows,
    pub moment2: Rows,
}

/// Harmonics of one modality: values, and a row's first and second moments behind one another.
pub(crate) struct Harmonics {
    pub value: Rows,
    pub moments: Rows,
}

/// Most bytes of rows gathered at once.
const GATHERED: u64 = 64 << 20;

/// All Gaussians.
pub(crate) struct Store {
    pub core: Trained,
    /// Decay factor of each Gaussian's position learning rate.
    pub position_rate: Rows,
    /// Optical, RF.
    pub sh: [Harmonics; 2],
    pub harmonics: [HarmonicsShape; 2],
    len: usize,
    capacity: usize,
    gather: Kernel,
    /// Scratch buffer in which rows are gathered before they are copied back.
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

impl Harmonics {
    fn new(context: &Context, [values, moments]: [&'static str; 2], words: usize, capacity: usize) -> Result<Self> {
        Ok(Self {
            value: Rows::new(context, values, words, capacity)?,
            moments: Rows::new(context, moments, 2 * words, capacity)?,
        })
    }
}

/// Rows of first moments and of second ones, each row's behind one another.
pub(super) fn joined(first: &[f32], second: &[f32], words: usize) -> Vec<f32> {
    first.chunks_exact(words).zip(second.chunks_exact(words)).flat_map(|(a, b)| a.iter().chain(b)).copied().collect()
}

/// The first (0) or second (1) ones of such rows.
pub(super) fn parted(rows: &[f32], which: usize, words: usize) -> Vec<f32> {
    rows.chunks_exact(words).skip(which).step_by(2).flatten().copied().collect()
}

/// `[coefficient][channel]` to `[channel][coefficient]`, padded.
pub(super) fn transposed(a: &Appearance, shape: HarmonicsShape) -> Vec<f32> {
    let (k, c) = (shape.coefficients(), shape.channels);
    let mut out = vec![0.0; a.opacity_logit.len() * shape.words()];
    for (row, one) in out.chunks_exact_mut(shape.words()).zip(a.sh.chunks_exact(k * c)) {
        for (channel, coefficients) in row.chunks_exact_mut(k).take(c).enumerate() {
            coefficients.iter_mut().zip(one.iter().skip(channel).step_by(c)).for_each(|(to, from)| *to = *from);
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
        let harmonics = [HarmonicsShape::of(&like.light), HarmonicsShape::of(&like.radio)];
        let capacity = 1;
        Ok(Self {
            core: Trained::new(context, "geometry", CORE, capacity)?,
            position_rate: Rows::new(context, "position rates", 1, capacity)?,
            sh: [
                Harmonics::new(context, ["optical harmonics", "moments of optical harmonics"], harmonics[0].words(), capacity)?,
                Harmonics::new(context, ["RF harmonics", "moments of RF harmonics"], harmonics[1].words(), capacity)?,
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

    /// Geometry with opacities, optical and RF harmonics: what a frame is made from.
    pub fn values(&self) -> [&wgpu::Buffer; 3] {
        [&self.core.value.buffer, &self.sh[0].value.buffer, &self.sh[1].value.buffer]
    }

    fn rows(&self) -> [&Rows; 8] {
        let ([a, b], c) = (&self.sh, &self.core);
        [&c.value, &c.moment1, &c.moment2, &self.position_rate, &a.value, &a.moments, &b.value, &b.moments]
    }

    fn rows_mut(&mut self) -> [&mut Rows; 8] {
        let ([a, b], c) = (&mut self.sh, &mut self.core);
        [
            &mut c.value,
            &mut c.moment1,
            &mut c.moment2,
            &mut self.position_rate,
            &mut a.value,
            &mut a.moments,
            &mut b.value,
            &mut b.moments,
        ]
    }

    /// Room for `n` Gaussians. Nothing changes on an error.
    fn reserve(&mut self, context: &Context, n: usize) -> Result<()> {
        if n <= self.capacity {
            return Ok(());
        }
        // Half as much again, so that keyframe after keyframe does not copy each time; as much as is needed where there is no more.
        let largest = context.largest_buffer() / self.rows().iter().map(|rows| rows.bytes(1)).max().unwrap_or(1);
        let capacity = n.max((self.capacity + self.capacity / 2).min(usize::try_from(largest).unwrap_or(usize::MAX)));
        let fresh = |capacity: usize| -> Result<Vec<Rows>> {
            self.rows().iter().map(|rows| Rows::new(context, rows.label, rows.words, capacity)).collect()
        };
        // What went wrong before is not what is tried again.
        context.check("growing")?;
        let (capacity, fresh) = match fresh(capacity) {
            Ok(rows) => (capacity, rows),
            Err(error) if capacity == n => return Err(error),
            Err(_) => (n, fresh(n)?),
        };
        let len = self.len;
        let mut encoder = context.encoder();
        for (rows, new) in self.rows_mut().into_iter().zip(fresh) {
            if len > 0 {
                encoder.copy_buffer_to_buffer(&rows.buffer, 0, &new.buffer, 0, new.bytes(len));
            }
            *rows = new;
        }
        context.submit(encoder);
        self.capacity = capacity;
        Ok(context.check("growing")?)
    }

    pub fn append(&mut self, context: &Context, new: &Gaussians) -> Result<()> {
        let n = new.len();
        new.check_appendable(self.harmonics.map(held))?;
        if n == 0 {
            return Ok(());
        }
        let mut core = Vec::with_capacity(n * CORE);
        for i in 0..n {
            core.extend(new.position[i]);
            core.extend(new.rotation[i]);
            core.extend(new.log_scale[i]);
            core.extend([new.light.opacity_logit[i], new.radio.opacity_logit[i]]);
        }
        self.extend(context, &core, |store, first| {
            for ((sh, shape), a) in store.sh.iter().zip(store.harmonics).zip([&new.light, &new.radio]) {
                context.fill(&sh.value.buffer, sh.value.bytes(first), &transposed(a, shape));
            }
            Ok(())
        })
    }

    /// Adds Gaussians of this geometry and these opacities with fresh optimiser state; `harmonics` writes theirs, from the given row on.
    pub(super) fn extend(
        &mut self,
        context: &Context,
        core: &[f32],
        harmonics: impl FnOnce(&mut Self, usize) -> Result<()>,
    ) -> Result<()> {
        let (n, first) = (core.len() / CORE, self.len);
        self.reserve(context, first + n)?;
        harmonics(self, first)?;
        let c = &self.core;
        context.fill(&c.value.buffer, c.value.bytes(first), core);
        context.fill(&self.position_rate.buffer, self.position_rate.bytes(first), &vec![1.0_f32; n]);
        let mut encoder = context.encoder();
        for moment in [&c.moment1, &c.moment2, &self.sh[0].moments, &self.sh[1].moments] {
            encoder.clear_buffer(&moment.buffer, moment.bytes(first), Some(moment.bytes(n)));
        }
        context.submit(encoder);
        self.len += n;
        Ok(context.check("adding Gaussians")?)
    }

    /// Keeps the rows whose flag is true, in order.
    pub fn retain(&mut self, context: &Context, keep: &[bool]) -> Result<()> {
        let kept: Vec<u32> = (0..self.len as u32).filter(|i| keep[*i as usize]).collect();
        if kept.len() == self.len {
            return Ok(());
        }
        if !kept.is_empty() {
            self.spare = Some(self.gather_rows(context, &self.rows(), &kept, 0)?);
        }
        context.check("removing Gaussians")?;
        self.len = kept.len();
        Ok(())
    }

    /// Copies the harmonics of some Gaussians, in their order, to row `to` and those behind it, which none of them is in.
    pub(super) fn copy_harmonics(&mut self, context: &Context, sources: &[u32], to: usize) -> Result<()> {
        self.spare = Some(self.gather_rows(context, &[&self.sh[0].value, &self.sh[1].value], sources, to)?);
        Ok(())
    }

    /// Copies rows of some arrays, in the order in which they are named, to row `to` and those behind it; no row may be written before it has
    /// been copied itself. Returns the scratch buffer they were gathered in.
    fn gather_rows(&self, context: &Context, arrays: &[&Rows], names: &[u32], to: usize) -> Result<wgpu::Buffer> {
        // Rows, the first of them in the new order, how many.
        let mut pieces = vec![];
        for rows in arrays {
            let at_once = (GATHERED.min(context.largest_buffer()) as usize / (4 * rows.words)).max(1);
            pieces.extend((0..names.len()).step_by(at_once).map(|first| (rows, first, at_once.min(names.len() - first))));
        }
        let bytes = pieces.iter().map(|(rows, _, count)| rows.bytes(*count)).max().unwrap_or(0);
        let spare = match &self.spare {
            Some(spare) if spare.size() >= bytes => spare.clone(),
            _ => context.storage("rows being gathered", bytes)?,
        };
        let named = context.storage("rows kept", 4 * names.len() as u64)?;
        context.queue.write_buffer(&named, 0, bytemuck::cast_slice(names));
        let constants = context.buffer("row sizes", 256 * pieces.len() as u64, wgpu::BufferUsages::UNIFORM)?;
        let mut encoder = context.encoder();
        // A row comes from its own place or from behind it: those that follow are not overwritten before their turn.
        for (k, (rows, first, count)) in pieces.into_iter().enumerate() {
            let sizes = [count as u32, rows.words as u32, first as u32, 0];
            context.queue.write_buffer(&constants, 256 * k as u64, bytemuck::cast_slice(&sizes));
            let bound = self.gather.bind(context, 16, &[&constants, &named, &rows.buffer, &spare])?;
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                bound.run(&mut pass, 256 * k as u32, (count * rows.words).div_ceil(256) as u32);
            }
            encoder.copy_buffer_to_buffer(&spare, 0, &rows.buffer, rows.bytes(to + first), rows.bytes(count));
        }
        context.submit(encoder);
        Ok(spare)
    }

    /// Replaces the RF appearance and its optimiser state, whose channels and degree stay as they are.
    pub fn reset_radio(&mut self, context: &Context, radio: &Appearance) -> Result<()> {
        radio.check_complete("RF appearance", self.len, held(self.harmonics[1]))?;
        let sh = &self.sh[1];
        context.fill(&sh.value.buffer, 0, &transposed(radio, self.harmonics[1]));
        let mut encoder = context.encoder();
        encoder.clear_buffer(&sh.moments.buffer, 0, None);
        context.submit(encoder);
        let c = &self.core;
        let numbers = self.len * CORE;
        let sources = [(&c.value.buffer, numbers), (&c.moment1.buffer, numbers), (&c.moment2.buffer, numbers)];
        let mut read = context.read::<f32>("starting the second stage", &sources)?;
        for (n, (rows, values)) in [&c.value, &c.moment1, &c.moment2].into_iter().zip(&mut read).enumerate() {
            for (i, row) in values.chunks_exact_mut(CORE).enumerate() {
                row[CORE - 1] = if n == 0 { radio.opacity_logit[i] } else { 0.0 };
            }
            context.queue.write_buffer(&rows.buffer, 0, bytemuck::cast_slice(values));
        }
        Ok(context.check("starting the second stage")?)
    }

    /// The numbers of one of each (geometry, optical and RF harmonics: parameters or their gradients) in the public shape.
    pub fn read(&self, context: &Context, buffers: [&wgpu::Buffer; 3]) -> Result<Gaussians> {
        let words = [CORE, self.harmonics[0].words(), self.harmonics[1].words()];
        let sources: Vec<_> = buffers.into_iter().zip(words).map(|(b, w)| (b, self.len * w)).collect();
        let read = context.read::<f32>("reading Gaussians back", &sources)?;
        Ok(self.shaped(&read[0], [&read[1], &read[2]]))
    }

    /// Converts numbers that have been read (rows of geometry, optical and RF harmonics) to the public shape.
    pub(super) fn shaped(&self, core: &[f32], sh: [&[f32]; 2]) -> Gaussians {
        let core: Vec<&[f32]> = core.chunks_exact(CORE).collect();
        let appearance = |g: usize| {
            let shape = self.harmonics[g];
            let (k, c) = (shape.coefficients(), shape.channels);
            let mut out = vec![0.0; core.len() * k * c];
            let rows = sh[g].par_chunks_exact(shape.words());
            out.par_chunks_exact_mut(k * c).zip(rows).with_min_len(256).for_each(|(out, row)| {
                for (at, value) in out.iter_mut().enumerate() {
                    *value = row[(at % c) * k + at / c];
                }
            });
            let opacity_logit = core.iter().map(|row| row[10 + g]).collect();
            Appearance { channels: c, sh_degree: shape.degree, opacity_logit, sh: out }
        };
        Gaussians {
            position: core.iter().map(|r| [r[0], r[1], r[2]]).collect(),
            rotation: core.iter().map(|r| [r[3], r[4], r[5], r[6]]).collect(),
            log_scale: core.iter().map(|r| [r[7], r[8], r[9]]).collect(),
            light: appearance(0),
            radio: appearance(1),
        }
    }

    pub fn to_gaussians(&self, context: &Context) -> Result<Gaussians> {
        self.read(context, self.values())
    }
}
