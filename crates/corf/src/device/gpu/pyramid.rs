//! Keyframes as training targets in device memory: per level and modality one plane a channel, then inverse depths and confidences.

use super::{context::Context, params::Params};
use crate::{
    Antialias, Result,
    device::{
        Planes, TrainingView,
        cpu::{
            geometry::{Grid, Pose},
            pyramid::{check_view, usable},
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

/// A keyframe laid out for device memory; made on any thread.
pub(crate) struct Packed {
    pose: Pose,
    words: Vec<f32>,
    levels: Vec<Level>,
}

/// Adds `[pixel][channel]` as one plane a channel.
fn planar(image: &Planes, out: &mut Vec<f32>) {
    let (pixels, n, at) = (image.width * image.height, image.channels, out.len());
    out.resize(at + n * pixels, 0.0);
    for (c, plane) in out[at..].chunks_exact_mut(pixels.max(1)).enumerate() {
        for (value, pixel) in plane.iter_mut().zip(image.pixels.chunks_exact(n)) {
            *value = pixel[c];
        }
    }
}

/// Adds the next level of a plane at `at`: the means of its 2×2 blocks.
fn halve(words: &mut Vec<f32>, at: usize, width: usize, height: usize) {
    for y in 0..height / 2 {
        let row = |y: usize| at + y * width..at + y * width + width / 2 * 2;
        let end = words.len();
        words.resize(end + width / 2, 0.0);
        let (before, out) = words.split_at_mut(end);
        let (above, below) = (before[row(2 * y)].as_chunks::<2>().0, before[row(2 * y + 1)].as_chunks::<2>().0);
        for ((value, a), b) in out.iter_mut().zip(above).zip(below) {
            *value = 0.25 * ((a[0] + a[1]) + (b[0] + b[1]));
        }
    }
}

/// Adds the next level of inverse depths at `at` and the confidences behind them, by which they are weighted.
fn halve_depth(words: &mut Vec<f32>, at: usize, width: usize, height: usize) {
    let (cells, end) = ((width / 2) * (height / 2), words.len());
    words.resize(end + 2 * cells, 0.0);
    let (before, out) = words.split_at_mut(end);
    let (value, confidence) = before[at..at + 2 * width * height].split_at(width * height);
    let (values, confidences) = out.split_at_mut(cells);
    for y in 0..height / 2 {
        for x in 0..width / 2 {
            let i = 2 * y * width + 2 * x;
            let (mut sum, mut weight) = (0.0, 0.0);
            for j in [i, i + 1, i + width, i + width + 1] {
                sum += confidence[j] * value[j];
                weight += confidence[j];
            }
            let cell = y * (width / 2) + x;
            values[cell] = if weight > 0.0 { sum / weight } else { 0.0 };
            confidences[cell] = 0.25 * weight;
        }
    }
}

impl Packed {
    pub fn new(view: &TrainingView, levels: u32, antialias: Antialias) -> Result<Self> {
        let levels = levels.max(1);
        check_view(view, levels)?;
        let mut cameras = [view.optical_camera, view.rf_camera];
        let images = [&view.optical, &view.rf];
        let size = images.map(|i| i.pixels.len()).iter().sum::<usize>()
            + if view.inverse_depth.is_some() { 2 * view.optical.width * view.optical.height } else { 0 };
        // A level has a quarter of the one before.
        let mut words = Vec::with_capacity(size + size / 3);
        let mut out: Vec<Level> = vec![];
        for level in 0..levels {
            let before = out.last().map(|l| (cameras, l.target_at, l.depth_at));
            if level > 0 {
                cameras = cameras.map(|c| c.downsampled(1));
            }
            let mut target_at = [0; 2];
            for (g, image) in images.iter().enumerate() {
                target_at[g] = words.len() as u32;
                match before {
                    None => planar(image, &mut words),
                    Some((cameras, at, _)) => {
                        let (width, height) = (cameras[g].width, cameras[g].height);
                        for c in 0..image.channels {
                            halve(&mut words, at[g] as usize + c * width * height, width, height);
                        }
                    }
                }
            }
            let depth_at = view.inverse_depth.as_ref().map(|d| {
                let here = words.len() as u32;
                match before.and_then(|(cameras, _, at)| Some((cameras[0], at?))) {
                    None => {
                        let pairs = || d.value.pixels().iter().zip(d.confidence.pixels()).map(|(v, c)| usable(*v, *c));
                        words.extend(pairs().map(|p| p.0));
                        words.extend(pairs().map(|p| p.1));
                    }
                    Some((camera, at)) => halve_depth(&mut words, at as usize, camera.width, camera.height),
                }
                here
            });
            out.push(Level { grids: cameras.map(|c| Grid::new(&c, antialias)), target_at, depth_at });
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

    pub fn grids(&self, levels: [usize; 2]) -> [Grid; 2] {
        [0, 1].map(|g| self.levels[levels[g]].grids[g])
    }

    /// Fills in where the targets of the images' levels lie and how they weigh.
    pub fn target(&self, levels: [usize; 2], weights: [f32; 2], channels: [usize; 2], depth_weight: f32, p: &mut Params) {
        for g in 0..2 {
            let grid = &mut p.grids[g];
            let pixels = (grid.size[0] * grid.size[1]) as f32;
            grid.target_at = self.levels[levels[g]].target_at[g];
            grid.channels = channels[g] as u32;
            grid.scale = weights[g] / (pixels * channels[g] as f32).max(1.0);
        }
        if let (Some(at), true) = (self.levels[levels[0]].depth_at, depth_weight > 0.0 && p.grids[0].size[0] > 0) {
            p.grids[0].depth_at = at;
            // η multiplies the depth term inside L_opt (paper Eq. (19)).
            p.grids[0].depth_scale = depth_weight / (p.grids[0].size[0] * p.grids[0].size[1]) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::device::{InverseDepth, cpu::pyramid::levels_of};
    use corf_scene::{Pinhole, Raster, Rigid3, Rng};

    #[test]
    fn what_is_packed_is_what_the_processor_trains_on() {
        let mut rng = Rng::keyed(6, 0, 0);
        let (optical_camera, rf_camera) =
            (Pinhole::from_horizontal_fov(37, 22, 80.0), Pinhole::from_horizontal_fov(18, 13, 80.0));
        let mut planes = |c: &Pinhole, channels: usize| Planes {
            width: c.width,
            height: c.height,
            channels,
            pixels: (0..c.width * c.height * channels).map(|_| rng.uniform()).collect(),
        };
        let (optical, rf) = (planes(&optical_camera, 3), planes(&rf_camera, 1));
        let mut map = |unknown: f32| Raster::from_fn(37, 22, |_, _| if rng.uniform() < 0.2 { unknown } else { rng.uniform() });
        let inverse_depth = Some(InverseDepth { value: map(f32::NAN), confidence: map(0.0) });
        let view = TrainingView { world_from_camera: Rigid3::IDENTITY, optical_camera, optical, rf_camera, rf, inverse_depth };
        let packed = Packed::new(&view, 3, Antialias::On).unwrap();
        let truth = levels_of(&view, 3).unwrap();
        for (l, level) in packed.levels.iter().enumerate() {
            for (g, (camera, image)) in truth.images[l].iter().enumerate() {
                assert_eq!((level.grids[g].width, level.grids[g].height), (camera.width, camera.height));
                for (i, value) in image.pixels.iter().enumerate() {
                    let (pixel, channel) = (i / image.channels, i % image.channels);
                    let at = level.target_at[g] as usize + channel * camera.width * camera.height + pixel;
                    assert_eq!(packed.words[at], *value);
                }
            }
            let depth = &truth.depth.as_ref().unwrap()[l];
            let at = level.depth_at.unwrap() as usize;
            assert_eq!(packed.words[at..at + depth.value.len()], depth.value);
            assert_eq!(packed.words[at + depth.value.len()..][..depth.value.len()], depth.confidence);
        }
    }
}
