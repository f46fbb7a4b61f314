//! Keyframes as training targets: each level averages 2×2 blocks of the one before, odd remainders dropped.

use super::geometry::Grid;
use crate::simd::Isa;
use crate::{
    Error, Result,
    device::{
        Planes, TrainingView,
        mask::{mask_levels, usable_depths},
    },
    loss::fused::{DepthTarget, Target},
};
use corf_scene::{Pinhole, Rigid3};
use rayon::prelude::*;

/// One level of one modality.
pub(crate) struct Level {
    pub camera: Pinhole,
    pub target: Target,
}

/// One uploaded keyframe.
pub(crate) struct Pyramid {
    pub world_from_camera: Rigid3,
    /// Per level: optical, RF.
    pub levels: Vec<[Level; 2]>,
    /// Levels of the RF image; those beyond are its last one again.
    pub radio_levels: usize,
    /// Per level, if the keyframe has inverse depths.
    pub depth: Option<Vec<DepthTarget>>,
}

/// A keyframe's images level by level, checked and averaged.
pub(crate) struct Levels {
    /// Per level: optical, RF.
    pub images: Vec<[(Pinhole, Planes); 2]>,
    /// Per level, if the keyframe has inverse depths.
    pub depth: Option<Vec<DepthTarget>>,
}

/// Levels of an RF image's pyramid where so many are asked for: each has pixels. Steps may look at fewer of them than of the optical image's.
pub(crate) fn radio_levels(view: &TrainingView, levels: u32) -> usize {
    let has_pixels = |level: &u32| [view.radio_camera.width, view.radio_camera.height].iter().all(|size| size >> level > 0);
    (0..levels.max(1)).take_while(has_pixels).count()
}

/// Refuses a step that looks at a level that is not there.
pub(crate) fn check_levels(asked: [u32; 2], there: [usize; 2]) -> std::result::Result<(), String> {
    let missing = asked.into_iter().zip(there).zip(["optical", "RF"]).find(|((level, there), _)| *level as usize >= *there);
    missing.map_or(Ok(()), |((level, there), name)| Err(format!("level {level} of the {name} image's pyramid of {there}")))
}

/// Refuses a training view that is no target, or has too few pixels for so many levels; of RF the first is enough.
pub(crate) fn check_view(view: &TrainingView, levels: u32) -> Result<()> {
    let images = [(&view.light_camera, &view.light, "optical", levels), (&view.radio_camera, &view.radio, "rf", 1)];
    for (camera, image, name, levels) in images {
        check(camera, image, name)?;
        for level in 0..levels {
            let camera = camera.downsampled(level);
            if camera.width == 0 || camera.height == 0 {
                let what = format!("level {level} of the pyramid has {}x{} pixels", camera.width, camera.height);
                return Err(Error::invalid(format!("training view, {name}"), what, "use fewer pyramid levels or larger images"));
            }
        }
    }
    let size = (view.light_camera.width, view.light_camera.height);
    if let Some(mask) = view.mask.as_ref().filter(|m| (m.width(), m.height()) != size) {
        let what = format!("{}x{} pixels against an image of {}x{}", mask.width(), mask.height(), size.0, size.1);
        return Err(Error::invalid("training view, mask", what, "give it in the optical image's size"));
    }
    match &view.inverse_depth {
        Some(d) if [&d.value, &d.confidence].iter().any(|r| (r.width(), r.height()) != size) => {
            let what = format!("{}x{} pixels against an image of {}x{}", d.value.width(), d.value.height(), size.0, size.1);
            let help = "give it and its confidence in the optical image's size";
            Err(Error::invalid("training view, inverse_depth", what, help))
        }
        _ => Ok(()),
    }
}

/// Checks a training view and builds its levels.
pub(crate) fn levels_of(view: &TrainingView, levels: u32) -> Result<Levels> {
    let levels = levels.max(1) as usize;
    check_view(view, levels as u32)?;
    let radio_levels = radio_levels(view, levels as u32);
    let mut images = vec![[(view.light_camera, view.light.clone()), (view.radio_camera, view.radio.clone())]];
    let mut depth: Option<Vec<DepthTarget>> = usable_depths(view).map(|pairs| {
        let (value, confidence) = pairs.into_iter().map(<(f32, f32)>::from).unzip();
        vec![DepthTarget { width: view.light.width, height: view.light.height, value, confidence }]
    });
    while let Some(last) = images.last().filter(|_| images.len() < levels) {
        let next = |g: usize| (last[g].0.downsampled(1), halve(&last[g].1));
        images.push([next(0), if images.len() < radio_levels { next(1) } else { last[1].clone() }]);
        if let Some(depths) = &mut depth
            && let Some(last) = depths.last()
        {
            depths.push(halve_depth(last));
        }
    }
    Ok(Levels { images, depth })
}

impl Pyramid {
    pub fn new(isa: Isa, view: &TrainingView, levels: u32) -> Result<Self> {
        let Levels { images, depth } = levels_of(view, levels)?;
        let masks = mask_levels(view, levels);
        let level = |(l, level): (usize, &[(Pinhole, Planes); 2])| {
            let mask = masks.as_ref().map(|m| m[l].pixels());
            [(0, mask), (1, None)].map(|(g, mask)| Level { camera: level[g].0, target: Target::new(isa, &level[g].1, mask) })
        };
        let levels_of_images = images.iter().enumerate().map(level).collect();
        let (world_from_camera, radio_levels) = (view.world_from_camera, radio_levels(view, levels));
        Ok(Self { world_from_camera, levels: levels_of_images, radio_levels, depth })
    }

    /// The images to render, each at its level.
    pub fn grids(&self, levels: [usize; 2], antialias: crate::Antialias) -> [Grid; 2] {
        [0, 1].map(|i| Grid::new(&self.levels[levels[i]][i].camera, antialias))
    }
}

fn check(camera: &Pinhole, image: &Planes, name: &str) -> Result<()> {
    let place = format!("training view, {name}");
    if (camera.width, camera.height) != (image.width, image.height)
        || image.pixels.len() != image.width * image.height * image.channels
    {
        let what = format!(
            "{} numbers for {}x{} pixels of {} channels, with a camera of {}x{}",
            image.pixels.len(),
            image.width,
            image.height,
            image.channels,
            camera.width,
            camera.height
        );
        return Err(Error::invalid(place, what, "give an image of the camera's size"));
    }
    if let Some(i) = image.pixels.iter().position(|v| !v.is_finite()) {
        let (x, y) = (i / image.channels % image.width, i / image.channels / image.width);
        return Err(Error::invalid(
            place,
            format!("pixel ({x}, {y}) is {}", image.pixels[i]),
            "every value must be a finite number",
        ));
    }
    Ok(())
}

fn halve(image: &Planes) -> Planes {
    let (width, height, n) = (image.width / 2, image.height / 2, image.channels);
    let mut pixels = vec![0.0; width * height * n];
    pixels.par_chunks_mut((width * n).max(1)).enumerate().for_each(|(y, row)| {
        for x in 0..width {
            for c in 0..n {
                let at = |dx: usize, dy: usize| image.pixels[((2 * y + dy) * image.width + 2 * x + dx) * n + c];
                row[x * n + c] = 0.25 * ((at(0, 0) + at(1, 0)) + (at(0, 1) + at(1, 1)));
            }
        }
    });
    Planes { width, height, channels: n, pixels }
}

/// Inverse depths weighted by their confidences; the confidence of a block is the mean of its four.
fn halve_depth(d: &DepthTarget) -> DepthTarget {
    let (width, height) = (d.width / 2, d.height / 2);
    let (mut value, mut confidence) = (Vec::with_capacity(width * height), Vec::with_capacity(width * height));
    for y in 0..height {
        for x in 0..width {
            let (mut sum, mut weight) = (0.0, 0.0);
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let i = (2 * y + dy) * d.width + 2 * x + dx;
                sum += d.confidence[i] * d.value[i];
                weight += d.confidence[i];
            }
            value.push(if weight > 0.0 { sum / weight } else { 0.0 });
            confidence.push(0.25 * weight);
        }
    }
    DepthTarget { width, height, value, confidence }
}
