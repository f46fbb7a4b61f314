//! Masks of images over a pyramid's levels.

use super::TrainingView;
use corf_scene::Raster;

/// A training view's mask level by level: a block counts if all its four pixels do, odd remainders dropped. `None` where all pixels count.
pub(super) fn mask_levels(view: &TrainingView, levels: u32) -> Option<Vec<Raster<bool>>> {
    let mask = view.mask.as_ref().filter(|m| m.pixels().contains(&false))?;
    let mut out = vec![mask.clone()];
    while let Some(last) = out.last().filter(|_| out.len() < levels.max(1) as usize) {
        let all = |x: usize, y: usize| [(0, 0), (1, 0), (0, 1), (1, 1)].iter().all(|(u, v)| last[(2 * x + u, 2 * y + v)]);
        out.push(Raster::from_fn(last.width() / 2, last.height() / 2, all));
    }
    Some(out)
}

/// Inverse depths with their confidences, row-major; where a pixel does not count, or has no finite value and positive confidence, both are 0.
pub(super) fn usable_depths(view: &TrainingView) -> Option<Vec<[f32; 2]>> {
    let depth = view.inverse_depth.as_ref()?;
    let usable = |(i, (value, confidence)): (usize, (&f32, &f32))| {
        let counts = view.mask.as_ref().is_none_or(|m| m.pixels()[i]);
        let known = value.is_finite() && confidence.is_finite() && *confidence > 0.0;
        if counts && known { [*value, *confidence] } else { [0.0; 2] }
    };
    Some(depth.value.pixels().iter().zip(depth.confidence.pixels()).enumerate().map(usable).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::Planes;
    use corf_scene::{Pinhole, Rigid3};

    fn view(mask: Option<Raster<bool>>) -> TrainingView {
        let camera = Pinhole::from_horizontal_fov(5, 4, 90.0);
        let planes = || Planes { width: 5, height: 4, channels: 3, pixels: vec![0.5; 60] };
        let (light_camera, radio_camera, world_from_camera) = (camera, camera, Rigid3::IDENTITY);
        TrainingView {
            world_from_camera,
            light_camera,
            light: planes(),
            radio_camera,
            radio: planes(),
            inverse_depth: None,
            mask,
        }
    }

    #[test]
    fn a_block_counts_if_its_four_pixels_do() {
        // The last column has no block.
        let mask = Raster::from_fn(5, 4, |x, y| (x, y) != (3, 0) && x != 4);
        let levels = mask_levels(&view(Some(mask.clone())), 3).unwrap_or_default();
        assert_eq!(levels[0], mask);
        assert_eq!(levels[1].pixels(), [true, false, true, true]);
        assert_eq!((levels[2].pixels(), levels.len()), (&[false][..], 3));
    }

    #[test]
    fn a_mask_that_leaves_nothing_out_is_none() {
        assert!(mask_levels(&view(Some(Raster::filled(5, 4, true))), 2).is_none());
        assert!(mask_levels(&view(None), 2).is_none());
    }
}
