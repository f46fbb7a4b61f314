//! Keyframes as training targets in device memory: per level and modality one plane a channel, then inverse depths and confidences.

use super::{context::Context, params::Params};
use crate::{
    Antialias, Result,
    device::{
        Planes, TrainingView,
        cpu::{
            geometry::{Grid, Pose},
            pyramid::{Levels, levels_of},
        },
    },
};

/// One level of a keyframe: the images to render and where their targets begin, in words.
struct Level {
    grids: [Grid; 2],
    target_at: [u32; 2],
    depth_at: Option<u32>,
}

/// One uploaded keyframe.
pub(crate) struct Pyramid {
    pub pose: Pose,
    pub buffer: wgpu::Buffer,
    levels: Vec<Level>,
}

/// `[pixel][channel]` to one plane a channel.
fn planar(image: &Planes, out: &mut Vec<f32>) {
    for c in 0..image.channels {
        out.extend(image.pixels.iter().skip(c).step_by(image.channels));
    }
}

/// A keyframe laid out for device memory; made on any thread.
pub(crate) struct Packed {
    pose: Pose,
    words: Vec<f32>,
    levels: Vec<Level>,
}

impl Packed {
    pub fn new(view: &TrainingView, levels: u32, antialias: Antialias) -> Result<Self> {
        let Levels { images, depth } = levels_of(view, levels)?;
        let mut words = vec![];
        let mut out = vec![];
        for (l, level) in images.iter().enumerate() {
            let mut target_at = [0; 2];
            for (at, (_, image)) in target_at.iter_mut().zip(level) {
                *at = words.len() as u32;
                planar(image, &mut words);
            }
            let depth_at = depth.as_ref().map(|d| {
                let at = words.len() as u32;
                words.extend(&d[l].value);
                words.extend(&d[l].confidence);
                at
            });
            out.push(Level { grids: [0, 1].map(|g| Grid::new(&level[g].0, antialias)), target_at, depth_at });
        }
        Ok(Self { pose: Pose::new(&view.world_from_camera), words, levels: out })
    }

    pub fn upload(self, context: &Context) -> Result<Pyramid> {
        let buffer = context.storage("keyframe", 4 * self.words.len() as u64)?;
        context.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&self.words));
        context.check("uploading a keyframe")?;
        Ok(Pyramid { pose: self.pose, buffer, levels: self.levels })
    }
}

impl Pyramid {
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    pub fn grids(&self, level: usize) -> [Grid; 2] {
        self.levels[level].grids
    }

    /// Fills in where a level's targets lie and how they weigh.
    pub fn target(&self, level: usize, weights: [f32; 2], channels: [usize; 2], depth_weight: f32, p: &mut Params) {
        let level = &self.levels[level];
        for g in 0..2 {
            let grid = &mut p.grids[g];
            let pixels = (grid.size[0] * grid.size[1]) as f32;
            grid.target_at = level.target_at[g];
            grid.channels = channels[g] as u32;
            grid.scale = weights[g] / (pixels * channels[g] as f32).max(1.0);
        }
        if let (Some(at), true) = (level.depth_at, depth_weight > 0.0 && p.grids[0].size[0] > 0) {
            p.grids[0].depth_at = at;
            // η multiplies the depth term inside L_opt (paper Eq. (19)).
            p.grids[0].depth_scale = depth_weight / (p.grids[0].size[0] * p.grids[0].size[1]) as f32;
        }
    }
}
