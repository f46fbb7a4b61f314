//! Rotations of few decimals: how many there are, and the worst of them.

use crate::Rigid3;
use crate::transform::ROUNDED;

/// What a reader learns of the rotations that it takes.
#[derive(Default)]
pub(super) struct Rounding {
    all: usize,
    rounded: usize,
    /// Greatest distance to the rotation that was taken, and the image it is of.
    worst: Option<(f64, String)>,
}

impl Rounding {
    /// Takes the pose of an image that [`Rigid3::nearest`] or [`Rigid3::from_quaternion`] gave.
    pub fn take(&mut self, (pose, off): (Rigid3, f64), name: &str) -> Rigid3 {
        self.all += 1;
        if off > ROUNDED {
            self.rounded += 1;
            if self.worst.as_ref().is_none_or(|(worst, _)| off > *worst) {
                self.worst = Some((off, name.to_owned()));
            }
        }
        pose
    }

    /// A word about those that were off; none where all are exact to six decimals.
    pub fn note(&self) -> Option<String> {
        let (off, name) = self.worst.as_ref()?;
        let (rounded, all) = (self.rounded, self.all);
        // A quaternion of any length says exactly one rotation; only rounding may turn a camera.
        let turn = if *off < MOST_ROUNDING {
            format!(", and rounding by as much turns a camera by {:.3} degrees and more", off.to_degrees())
        } else {
            String::new()
        };
        Some(format!(
            "rotations of {rounded} of {all} images are rounded or of another length than 1: that of {name} is {off:.1e} off a rotation; the nearest ones were \
             taken{turn}"
        ))
    }
}

/// Distance beyond which it is the length of a quaternion and no rounding.
const MOST_ROUNDING: f64 = 1e-2;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_is_named_and_exact_ones_need_no_word() {
        let mut rounding = Rounding::default();
        for (off, name) in [(0.0, "a"), (1e-7, "b")] {
            rounding.take((Rigid3::IDENTITY, off), name);
        }
        assert_eq!(rounding.note(), None);
        for (off, name) in [(1e-4, "c"), (1e-3, "d"), (2e-5, "e")] {
            rounding.take((Rigid3::IDENTITY, off), name);
        }
        let note = rounding.note().unwrap();
        assert!(
            note.contains("3 of 5 images") && note.contains("that of d is 1.0e-3") && note.contains("0.057 degrees"),
            "{note}"
        );
    }
}
