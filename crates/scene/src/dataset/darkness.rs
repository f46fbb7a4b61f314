//! Keyframes that show nothing: a camera in the dark, or one that looks past the scene.

use crate::Light;
use crate::finding::{Finding, Severity};

/// Images without a value above this, of 255, are black.
const BLACK: u8 = 3;

/// Emptiness of one keyframe's optical image and depth map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Sight {
    /// Whether its image, where there is one, is black.
    pub black: bool,
    /// Whether its depth, where there is one, is empty: no pixel shows a surface.
    pub empty: bool,
}

impl Sight {
    pub(super) fn of(light: &Light) -> Self {
        let is_surface = |d: &f32| d.is_finite() && *d > 0.0;
        Self {
            black: light.image.pixels().iter().flatten().all(|v| *v <= BLACK),
            empty: light.depth_m.as_ref().is_some_and(|depth| !depth.pixels().iter().any(is_surface)),
        }
    }
}

/// A warning where keyframes are black, and one where they see no surface; what to do about it depends on whether they were `imported`.
pub(super) fn findings(place: &str, sights: &[Sight], imported: bool) -> Vec<Finding> {
    let count = |is: fn(&Sight) -> bool| sights.iter().filter(|s| is(s)).count();
    let of_all = |n: usize| if n == sights.len() { format!("all {n}") } else { format!("{n} of {}", sights.len()) };
    let mut found = Vec::new();
    let mut warn = |n: usize, what: &str, help: &str| {
        if n > 0 {
            found.push(Finding::new(Severity::Warning, place, format!("{} {what}", of_all(n)), help));
        }
    };
    warn(
        count(|s| s.black),
        "images are black",
        if imported {
            "nothing is learnt from a black image: take it out of the capture, or give the folder of the pictures that are meant with --images"
        } else {
            "light the scene (an emissive material, a light), open what keeps the light from the platform, or raise optical.exposure_ev"
        },
    );
    warn(
        count(|s| s.empty),
        "depth images are empty: the camera sees no surface",
        if imported {
            "0 is no depth: give maps that hold some with --depth; or import without them and reconstruct with --set 'depth.prior=\"none\"'"
        } else {
            "move the trajectory into the scene; `corf scene validate` says whether it lies outside"
        },
    );
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Raster;

    #[test]
    fn what_shows_nothing_is_counted() {
        let black = Raster::filled(4, 3, [0u8, 2, 3]);
        let mut lit = black.clone();
        lit[(1, 1)][2] = 40;
        let nothing = Raster::filled(4, 3, 0f32);
        let mut wall = nothing.clone();
        wall[(2, 2)] = 3.5;
        let light = |image: &Raster<[u8; 3]>, depth_m| Sight::of(&Light { depth_m, ..Light::of_image(image.clone()) });
        let sights = [light(&black, Some(nothing)), light(&lit, Some(wall)), light(&lit, None)];
        let texts: Vec<String> = findings("d", &sights, false).iter().map(ToString::to_string).collect();
        assert_eq!(texts.len(), 2);
        assert!(texts[0].contains("1 of 3 images are black") && texts[1].contains("1 of 3 depth images are empty"), "{texts:?}");
        assert!(findings("d", &sights[1..], false).is_empty());
        assert!(findings("d", &sights[..1], false)[0].to_string().contains("all 1 images are black"));
        let of_capture: Vec<String> = findings("d", &sights, true).iter().map(ToString::to_string).collect();
        assert!(of_capture[0].contains("--images") && of_capture[1].contains("--depth"), "{of_capture:?}");
    }
}
