//! Keyframes as training targets in device memory: per level and modality one plane a channel, then inverse depths with their confidences and
//! the optical image's mask, one bit a pixel, each where there is one.
//!
//! An image that came from bytes stays bytes: level 0 holds them, four to a word, and levels 1 to 4 the sums of their 4^level bytes, two to a
//! word. Both are exact. Other images, and deeper levels, are floats. An inverse depth and its confidence are two half-precision floats of
//! one word: within 5e-4 of themselves, far below any prior's error.

use super::params::Params;
use crate::{
    Antialias, Result,
    device::{
        Planes, TrainingView,
        cpu::{
            geometry::{Grid, Pose},
            pyramid::{check_view, radio_levels},
        },
        mask::{mask_levels, usable_depths},
    },
    simd::{Isa, Kernel, Lanes},
};
use corf_scene::Raster;
use half::{f16, slice::HalfFloatSliceExt};

/// Deepest level whose sums of bytes fit into 16 bits.
const DEEPEST_SUMS: u32 = 4;
/// Largest number that a half-precision float holds.
const LARGEST_HALF: f32 = 65504.0;

/// Place and form of an image in a keyframe's words.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Target {
    /// First word.
    at: u32,
    /// Numbers of a word, as a power of two: 4 bytes, 2 sums of bytes, 1 float.
    shift: u32,
    /// Value of a byte's, or a sum's, unit.
    unit: f32,
}

/// One level of a keyframe: the images to render, and where their targets are.
struct Level {
    grids: [Grid; 2],
    targets: [Target; 2],
    depth_at: Option<u32>,
    mask_at: Option<u32>,
}

/// A keyframe's pose, and the layout of its words.
pub(crate) struct Pyramid {
    pub pose: Pose,
    levels: Vec<Level>,
    /// Levels of the RF image; those beyond are its last one again.
    radio_levels: usize,
}

/// A keyframe laid out for device memory; made on any thread.
pub(crate) struct Packed {
    pub pyramid: Pyramid,
    pub words: Vec<u32>,
}

/// Numbers of an image, one plane a channel.
enum Numbers {
    Bytes(Vec<u8>),
    Sums(Vec<u16>),
    Floats(Vec<f32>),
}

/// One level of an image.
struct Image {
    level: u32,
    width: usize,
    height: usize,
    channels: usize,
    numbers: Numbers,
}

/// The bytes of an image of bytes over 255, one plane a channel; `None` of another image.
struct Bytes<'a>(&'a Planes);

impl Kernel for Bytes<'_> {
    type Output = Option<Vec<u8>>;

    // Plain loops over slices, which the compiler widens to the instruction set.
    #[inline(always)]
    fn run<L: Lanes>(self) -> Self::Output {
        /// Pixels at a time: their bytes stay in the first cache until they lie in their planes.
        const PIXELS: usize = 256;
        let (pixels, n) = (self.0.width * self.0.height, self.0.channels);
        let mut out = vec![0; n * pixels];
        let mut bytes = vec![0_u8; n * PIXELS];
        for (k, values) in self.0.pixels.chunks(n * PIXELS).enumerate() {
            let bytes = &mut bytes[..values.len()];
            let mut are_bytes = true;
            for (b, v) in bytes.iter_mut().zip(values) {
                *b = byte(*v);
                are_bytes &= f32::from(*b) / 255.0 == *v;
            }
            if !are_bytes {
                return None;
            }
            for (c, plane) in out.chunks_exact_mut(pixels.max(1)).enumerate() {
                let plane = &mut plane[k * PIXELS..][..values.len() / n];
                plane.iter_mut().zip(bytes.iter().skip(c).step_by(n)).for_each(|(to, from)| *to = *from);
            }
        }
        Some(out)
    }
}

/// `[pixel][channel]` as one plane a channel.
fn planar(image: &Planes) -> Vec<f32> {
    let (pixels, n) = (image.width * image.height, image.channels);
    let mut out = vec![0.0; n * pixels];
    for (c, plane) in out.chunks_exact_mut(pixels.max(1)).enumerate() {
        for (value, pixel) in plane.iter_mut().zip(image.pixels.chunks_exact(n)) {
            *value = pixel[c];
        }
    }
    out
}

/// The byte whose value is nearest.
fn byte(value: f32) -> u8 {
    (value * 255.0 + 0.5) as u8
}

/// Planes of half the size, each number made of a 2×2 block; odd remainders dropped.
fn halve<T: Copy, U>(planes: &[T], width: usize, height: usize, of: impl Fn([T; 4]) -> U) -> Vec<U> {
    let mut out = Vec::with_capacity(planes.len() / 4);
    for plane in planes.chunks_exact((width * height).max(1)) {
        for pair in plane.chunks_exact(2 * width) {
            let (above, below) = pair.split_at(width);
            let blocks = above.as_chunks::<2>().0.iter().zip(below.as_chunks::<2>().0);
            out.extend(blocks.map(|(a, b)| of([a[0], a[1], b[0], b[1]])));
        }
    }
    out
}

impl Image {
    /// An image as bytes, if every value is a byte's; otherwise as floats.
    fn new(image: &Planes) -> Self {
        let numbers = match Isa::detect().dispatch(Bytes(image)) {
            Some(bytes) => Numbers::Bytes(bytes),
            None => Numbers::Floats(planar(image)),
        };
        Self { level: 0, width: image.width, height: image.height, channels: image.channels, numbers }
    }

    /// Value of the unit of this level's bytes or sums.
    fn unit(&self) -> f32 {
        (1.0 / (255.0 * 4_f64.powi(self.level as i32))) as f32
    }

    /// The next level.
    fn halved(&self) -> Self {
        let (level, w, h) = (self.level + 1, self.width, self.height);
        let mut next = Self { level, width: w / 2, height: h / 2, channels: self.channels, numbers: Numbers::Floats(vec![]) };
        let unit = next.unit();
        next.numbers = match &self.numbers {
            Numbers::Bytes(bytes) => Numbers::Sums(halve(bytes, w, h, |block| block.map(u16::from).iter().sum())),
            Numbers::Sums(sums) if level <= DEEPEST_SUMS => Numbers::Sums(halve(sums, w, h, |block| block.iter().sum())),
            Numbers::Sums(sums) => {
                Numbers::Floats(halve(sums, w, h, |block| block.map(u32::from).iter().sum::<u32>() as f32 * unit))
            }
            Numbers::Floats(values) => Numbers::Floats(halve(values, w, h, |[a, b, c, d]| 0.25 * ((a + b) + (c + d)))),
        };
        next
    }

    /// Adds the numbers to a keyframe's words.
    fn put(&self, words: &mut Vec<u32>) -> Target {
        let at = words.len() as u32;
        let unit = self.unit();
        match &self.numbers {
            Numbers::Bytes(bytes) => {
                let (whole, rest) = bytes.as_chunks::<4>();
                words.extend(whole.iter().map(|b| u32::from_le_bytes(*b)));
                if !rest.is_empty() {
                    words.push(rest.iter().rev().fold(0, |word, b| word << 8 | u32::from(*b)));
                }
                Target { at, shift: 2, unit }
            }
            Numbers::Sums(sums) => {
                words.extend(sums.chunks(2).map(|s| u32::from(s[0]) | s.get(1).map_or(0, |s| u32::from(*s) << 16)));
                Target { at, shift: 1, unit }
            }
            Numbers::Floats(values) => {
                words.extend(values.iter().map(|v| v.to_bits()));
                Target { at, shift: 0, unit: 1.0 }
            }
        }
    }
}

/// One level of inverse depths with their confidences.
struct Depths {
    width: usize,
    height: usize,
    pairs: Vec<[f32; 2]>,
}

impl Depths {
    fn new(view: &TrainingView) -> Option<Self> {
        Some(Self { width: view.light.width, height: view.light.height, pairs: usable_depths(view)? })
    }

    /// The next level: means weighted by confidences, and the means of those.
    fn halved(&self) -> Self {
        let mean = |block: [[f32; 2]; 4]| {
            let (mut sum, mut weight) = (0.0, 0.0);
            for [value, confidence] in block {
                sum += confidence * value;
                weight += confidence;
            }
            [if weight > 0.0 { sum / weight } else { 0.0 }, 0.25 * weight]
        };
        Self { width: self.width / 2, height: self.height / 2, pairs: halve(&self.pairs, self.width, self.height, mean) }
    }

    /// Adds them to a keyframe's words; returns their place.
    fn put(&self, words: &mut Vec<u32>) -> u32 {
        let at = words.len() as u32;
        /// Numbers at a time, for which the instruction set is asked about once.
        const AT_ONCE: usize = 256;
        let (mut floats, mut halves) = ([0.0; AT_ONCE], [f16::ZERO; AT_ONCE]);
        for some in self.pairs.as_flattened().chunks(AT_ONCE) {
            let (floats, halves) = (&mut floats[..some.len()], &mut halves[..some.len()]);
            floats.iter_mut().zip(some).for_each(|(to, from)| *to = from.clamp(-LARGEST_HALF, LARGEST_HALF));
            halves.convert_from_f32_slice(floats);
            let pairs = halves.as_chunks::<2>().0.iter();
            words.extend(pairs.map(|[value, confidence]| u32::from(value.to_bits()) | u32::from(confidence.to_bits()) << 16));
        }
        at
    }
}

/// Adds one level of a mask to a keyframe's words; returns its place.
fn put_mask(mask: &Raster<bool>, words: &mut Vec<u32>) -> u32 {
    let at = words.len() as u32;
    words.extend(mask.pixels().chunks(32).map(|some| some.iter().rev().fold(0, |word, counts| word << 1 | u32::from(*counts))));
    at
}

impl Packed {
    pub fn new(view: &TrainingView, levels: u32, antialias: Antialias) -> Result<Self> {
        let levels = levels.max(1);
        check_view(view, levels)?;
        let radio_levels = radio_levels(view, levels);
        let mut cameras = [view.light_camera, view.radio_camera];
        let mut images = [&view.light, &view.radio].map(Image::new);
        let mut of_radio = Target::default();
        let masks = mask_levels(view, levels);
        let mut depths = Depths::new(view);
        // About what they take: growing would copy them.
        let mut words = Vec::with_capacity(3 * view.light.width * view.light.height + 2 * view.radio.pixels.len());
        let mut out = vec![];
        for level in 0..levels {
            let has_radio = (level as usize) < radio_levels;
            if level > 0 {
                for g in [Some(0), has_radio.then_some(1)].into_iter().flatten() {
                    (cameras[g], images[g]) = (cameras[g].downsampled(1), images[g].halved());
                }
                depths = depths.map(|d| d.halved());
            }
            let of_light = images[0].put(&mut words);
            if has_radio {
                of_radio = images[1].put(&mut words);
            }
            let targets = [of_light, of_radio];
            let depth_at = depths.as_ref().map(|d| d.put(&mut words));
            let mask_at = masks.as_ref().map(|m| put_mask(&m[level as usize], &mut words));
            out.push(Level { grids: cameras.map(|c| Grid::new(&c, antialias)), targets, depth_at, mask_at });
        }
        Ok(Self { pyramid: Pyramid { pose: Pose::new(&view.world_from_camera), levels: out, radio_levels }, words })
    }
}

impl Pyramid {
    /// Levels of the optical image and of the RF image.
    pub fn levels(&self) -> [usize; 2] {
        [self.levels.len(), self.radio_levels]
    }

    /// Whether any pixel of the optical image does not count.
    pub fn has_mask(&self) -> bool {
        self.levels.iter().any(|l| l.mask_at.is_some())
    }

    pub fn grids(&self, levels: [usize; 2]) -> [Grid; 2] {
        [0, 1].map(|g| self.levels[levels[g]].grids[g])
    }

    /// Fills in where the targets of the images' levels lie and how they weigh.
    pub fn target(&self, levels: [usize; 2], weights: [f32; 2], channels: [usize; 2], depth_weight: f32, p: &mut Params) {
        for g in 0..2 {
            let grid = &mut p.grids[g];
            let pixels = (grid.size[0] * grid.size[1]) as f32;
            let target = &self.levels[levels[g]].targets[g];
            (grid.target_at, grid.target_shift, grid.target_unit) = (target.at, target.shift, target.unit);
            grid.channels = channels[g] as u32;
            grid.scale = weights[g] / (pixels * channels[g] as f32).max(1.0);
        }
        if let (Some(at), true) = (self.levels[levels[0]].mask_at, p.grids[0].size[0] > 0) {
            p.grids[0].mask_at = at;
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
    use corf_scene::{Pinhole, Rigid3, Rng};

    /// What the kernels read of an image's element (`shaders/loss.wgsl`).
    fn read(words: &[u32], target: Target, element: usize) -> f32 {
        let word = words[target.at as usize + (element >> target.shift)];
        let bits = 32 >> target.shift;
        match target.shift {
            0 => f32::from_bits(word),
            _ => ((word >> ((element << (5 - target.shift)) & 31)) & ((1 << bits) - 1)) as f32 * target.unit,
        }
    }

    #[test]
    fn what_is_packed_is_what_the_processor_trains_on() {
        let mut rng = Rng::keyed(6, 0, 0);
        let (light_camera, radio_camera) =
            (Pinhole::from_horizontal_fov(197, 102, 80.0), Pinhole::from_horizontal_fov(98, 93, 80.0));
        for (bytes, radio_channels) in [(true, 1), (false, 3)] {
            let mut planes = |c: &Pinhole, channels: usize, bytes: bool| Planes {
                width: c.width,
                height: c.height,
                channels,
                pixels: (0..c.width * c.height * channels)
                    .map(|_| rng.uniform())
                    .map(|v| if bytes { f32::from(byte(v)) / 255.0 } else { v })
                    .collect(),
            };
            let (light, radio) = (planes(&light_camera, 3, bytes), planes(&radio_camera, radio_channels, false));
            let mut map =
                |unknown: f32| Raster::from_fn(197, 102, |_, _| if rng.uniform() < 0.2 { unknown } else { rng.uniform() });
            let inverse_depth = Some(InverseDepth { value: map(f32::NAN), confidence: map(0.0) });
            let mask = Some(Raster::from_fn(197, 102, |x, y| (x * y) % 37 != 1));
            let view = TrainingView {
                world_from_camera: Rigid3::IDENTITY,
                light_camera,
                light,
                radio_camera,
                radio,
                inverse_depth,
                mask,
            };
            let Packed { pyramid, words } = Packed::new(&view, 6, Antialias::On).unwrap();
            let truth = levels_of(&view, 6).unwrap();
            for (l, level) in pyramid.levels.iter().enumerate() {
                let shift = [[2, 1, 1, 1, 1, 0][l] * u32::from(bytes), 0];
                for (g, (camera, image)) in truth.images[l].iter().enumerate() {
                    assert_eq!((level.grids[g].width, level.grids[g].height), (camera.width, camera.height));
                    assert_eq!(level.targets[g].shift, shift[g]);
                    for (i, value) in image.pixels.iter().enumerate() {
                        let (pixel, channel) = (i / image.channels, i % image.channels);
                        let found = read(&words, level.targets[g], channel * camera.width * camera.height + pixel);
                        // Floats are the processor's own; a product with a rounded unit is within an ulp or two of its sums.
                        let tolerance = if g == 0 && bytes { 2e-7 } else { 0.0 };
                        assert!((found - value).abs() <= tolerance, "level {l}: {found} against {value}");
                    }
                }
                for (i, counts) in mask_levels(&view, 6).unwrap()[l].pixels().iter().enumerate() {
                    let word = words[level.mask_at.unwrap() as usize + i / 32];
                    assert_eq!(word >> (i % 32) & 1 == 1, *counts, "level {l}");
                }
                let depth = &truth.depth.as_ref().unwrap()[l];
                for (i, (value, confidence)) in depth.value.iter().zip(&depth.confidence).enumerate() {
                    let word = words[level.depth_at.unwrap() as usize + i];
                    for (bits, truth) in [(word as u16, *value), ((word >> 16) as u16, *confidence)] {
                        let found = f16::from_bits(bits).to_f32();
                        assert!((found - truth).abs() <= 4.9e-4 * truth + 3e-8, "level {l}: {found} against {truth}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_keyframe_of_bytes_takes_less_than_half_the_memory_of_floats() {
        let camera = Pinhole::from_horizontal_fov(160, 90, 80.0);
        let planes = |value: f32| Planes { width: 160, height: 90, channels: 3, pixels: vec![value; 3 * 160 * 90] };
        let map = || Raster::filled(160, 90, 0.5);
        let words = |value: f32| {
            let view = TrainingView {
                world_from_camera: Rigid3::IDENTITY,
                light_camera: camera,
                light: planes(value),
                radio_camera: camera.downsampled(2),
                radio: Planes { width: 40, height: 22, channels: 1, pixels: vec![0.3; 40 * 22] },
                inverse_depth: Some(InverseDepth { value: map(), confidence: map() }),
                mask: None,
            };
            Packed::new(&view, 3, Antialias::On).unwrap().words.len()
        };
        // A pixel's three bytes, their sums in 16 bits at a quarter and a sixteenth of the pixels, a word of depth at all levels: ten bytes
        // instead of 21.
        let (bytes, floats) = (words(1.0), words(0.5));
        assert!(2 * bytes < floats, "{bytes} against {floats}");
    }
}
