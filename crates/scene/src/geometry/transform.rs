//! Rigid transforms and similarities, always named `target_from_source`.

use crate::{Error, Result};
use glam::{DMat3, DMat4, DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// A rotation and a translation: `p_target = rotation · p_source + translation` (metres).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rigid3 {
    /// `rotation_target_from_source`, orthonormal, determinant +1.
    pub rotation: DMat3,
    /// The source frame's origin in the target frame, metres.
    pub translation: DVec3,
}

/// Greatest distance of a 3×3 block to the nearest rotation (root of the sum of squares over its elements) at which it is taken for that rotation:
/// nine numbers of three decimals, each half a unit of the third off, and a little for the sum.
const ROTATION_TOLERANCE: f64 = 1.51e-3;
/// Distance from which on whoever reads a capture should say that a rotation was rounded; six decimals and single precision stay below.
pub const ROUNDED: f64 = 1.6e-6;
/// Distance that is the rounding of double precision: such a rotation is kept to the bit.
const EXACT: f64 = 1e-12;
/// Lengths of quaternions that are taken for rotations; what lies outside is no quaternion but other numbers.
const QUATERNION_LENGTH: std::ops::RangeInclusive<f64> = 0.5..=2.0;
/// Distance from 1 of a quaternion's length that is no rounding of whoever wrote it: single precision and six decimals stay below.
const UNIT_LENGTH: f64 = 1e-5;
/// Share of the greatest fault of a matrix below which another of its faults goes without saying.
const MINOR: f64 = 0.1;
/// Newton's steps to the nearest rotation: the distance squares with each, so that these are more than enough.
const NEWTON_STEPS: usize = 8;

impl Rigid3 {
    /// The transform that changes nothing.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// `world_from_camera` of a camera at `eye` that looks at `target`, image up along `up` (OpenCV axes: x right, y down, z forward).
    pub fn looking_at(eye: DVec3, target: DVec3, up: DVec3) -> Self {
        let z = (target - eye).normalize();
        let x = z.cross(up).normalize();
        let y = z.cross(x);
        Self { rotation: DMat3::from_cols(x, y, z), translation: eye }
    }

    /// Maps a point.
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// Maps a direction or displacement.
    pub fn transform_vector(&self, vector: DVec3) -> DVec3 {
        self.rotation * vector
    }

    /// `source_from_target`.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// `self ∘ other`: `a_from_b.compose(b_from_c) = a_from_c`.
    pub fn compose(&self, other: &Self) -> Self {
        Self { rotation: self.rotation * other.rotation, translation: self.transform_point(other.translation) }
    }

    /// The 4×4 homogeneous matrix, by rows.
    pub fn to_rows(&self) -> [[f64; 4]; 4] {
        DMat4::from_cols(
            self.rotation.x_axis.extend(0.0),
            self.rotation.y_axis.extend(0.0),
            self.rotation.z_axis.extend(0.0),
            self.translation.extend(1.0),
        )
        .transpose()
        .to_cols_array_2d()
    }

    /// Reads a 4×4 homogeneous matrix given by rows; its rotation is the nearest one ([`Self::nearest`]).
    ///
    /// # Errors
    /// A number that is not finite, a last row other than `0 0 0 1`, or a 3×3 block that is no rotation; `place` says where it came from.
    pub fn from_rows(rows: &[[f64; 4]; 4], place: &str) -> Result<Self> {
        Self::nearest(rows, place).map(|(pose, _)| pose)
    }

    /// Reads a 4×4 homogeneous matrix given by rows, and how far its 3×3 block is off the rotation that was taken for it, the nearest one: the root
    /// of the sum of squares over its elements. A block that is exact in double precision is kept to the bit.
    ///
    /// # Errors
    /// A number that is not finite, a last row other than `0 0 0 1`, or a 3×3 block that is off by more than three decimals account for (it mirrors,
    /// scales, shears or flattens) or that has been rounded to fewer. `place` says where it came from.
    pub fn nearest(rows: &[[f64; 4]; 4], place: &str) -> Result<(Self, f64)> {
        if let Some((r, c)) = (0..16).map(|i| (i / 4, i % 4)).find(|&(r, c)| !rows[r][c].is_finite()) {
            return Err(Error::invalid(
                place,
                format!("row {r}, column {c} of the pose is {}", rows[r][c]),
                "every element must be a finite number; remove or repair this keyframe",
            ));
        }
        if rows[3] != [0.0, 0.0, 0.0, 1.0] {
            return Err(Error::invalid(place, "the last row of the pose is not 0 0 0 1", "give a rigid 4x4 matrix by rows"));
        }
        let block = DMat3::from_cols_array_2d(&[
            [rows[0][0], rows[1][0], rows[2][0]],
            [rows[0][1], rows[1][1], rows[2][1]],
            [rows[0][2], rows[1][2], rows[2][2]],
        ]);
        let (rotation, off) = nearest_rotation(block).ok_or_else(|| no_rotation(block, place))?;
        Ok((Self { rotation, translation: DVec3::new(rows[0][3], rows[1][3], rows[2][3]) }, off))
    }

    /// Reads a rotation as Hamilton's quaternion `[w, x, y, z]`, of whatever length near 1, and how far that length is off 1. The length tells that
    /// numbers were rounded, not how far the rotation turned by it: three decimals may turn it by a tenth of a degree.
    ///
    /// # Errors
    /// A number that is not finite, a length that no writer of rotations gives a quaternion, or numbers of one or two decimals that have lost their
    /// length by it, and as much of their direction; `place` says where it came from.
    pub fn from_quaternion(quaternion: [f64; 4], translation: DVec3, place: &str) -> Result<(Self, f64)> {
        let [w, x, y, z] = quaternion;
        let q = DQuat::from_xyzw(x, y, z, w);
        let length = q.length();
        if !QUATERNION_LENGTH.contains(&length) {
            return Err(Error::invalid(
                place,
                format!("its quaternion is {w} {x} {y} {z}, of length {length}"),
                "give w, x, y, z of a rotation, of length 1, or take this image out",
            ));
        }
        if let Some(decimals) = few_decimals(&quaternion).filter(|decimals| {
            let off = (length - 1.0).abs();
            // Four numbers, each half a unit of the last decimal off; what is further from 1 has another length and was not rounded to it.
            off > UNIT_LENGTH && off <= 10f64.powi(-decimals)
        }) {
            let what = format!(
                "its quaternion {w} {x} {y} {z} is rounded to {decimals} decimal{}",
                if decimals == 1 { "" } else { "s" }
            );
            return Err(Error::invalid(place, what, FEW_DECIMALS));
        }
        let pose = Self { rotation: DMat3::from_quat(q.normalize()), translation };
        Ok((Self::from_rows(&pose.to_rows(), place)?, (length - 1.0).abs()))
    }
}

const FEW_DECIMALS: &str = "as few turn a camera by a degree and more: write the numbers of rotations with at least 3 decimals";

/// How many decimals some numbers are rounded to, where these are one or two, or none.
fn few_decimals(numbers: &[f64]) -> Option<i32> {
    // Some were written by way of single precision.
    let are_of = |decimals: &i32| {
        let unit = 10f64.powi(*decimals);
        numbers.iter().all(|v| ((v * unit).round() / unit - v).abs() < 1e-7)
    };
    (1..=2).find(are_of)
}

/// The rotation that is nearest to a matrix, and how far it is off; none where that is farther than the tolerance.
fn nearest_rotation(block: DMat3) -> Option<(DMat3, f64)> {
    // The orthogonal factor of the polar decomposition is the nearest rotation (Higham 1986); beyond twice or half the size nothing is near.
    let plausible = [block.x_axis, block.y_axis, block.z_axis].iter().all(|c| (0.5..=2.0).contains(&c.length()));
    if !plausible || block.determinant() < 0.1 {
        return None;
    }
    let mut rotation = block;
    for _ in 0..NEWTON_STEPS {
        rotation = 0.5 * (rotation + rotation.inverse().transpose());
    }
    let off = (block - rotation).to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt();
    if off <= EXACT {
        return Some((block, off));
    }
    // A rotation of two decimals may by chance be near another one, which is not the one that was meant.
    let is_rounded = off > ROUNDED && few_decimals(&block.to_cols_array()).is_some();
    (off <= ROTATION_TOLERANCE && !is_rounded).then_some((rotation, off))
}

/// The error that says in which way a matrix is no rotation.
fn no_rotation(block: DMat3, place: &str) -> Error {
    // Of size 1, so that no square leaves the range of numbers.
    let size = block.to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let axes = [block.x_axis, block.y_axis, block.z_axis].map(|axis| axis / size);
    let lengths = axes.map(DVec3::length);
    let cosine = |i: usize, j: usize| axes[i].dot(axes[j]) / (lengths[i] * lengths[j]);
    let angles = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| cosine(i, j).clamp(-1.0, 1.0).acos().to_degrees());
    let [ab, bc, ca] = angles;
    let volume = axes[0].cross(axes[1]).dot(axes[2]) / (lengths[0] * lengths[1] * lengths[2]);
    let lengths = lengths.map(|l| size * l);
    let [a, b, c] = lengths;
    // Of several faults the greatest is told.
    let skew = [(0, 1), (1, 2), (2, 0)].iter().fold(0.0_f64, |most, (i, j)| most.max(cosine(*i, *j).abs()));
    let stretch = lengths.iter().fold(0.0_f64, |most, l| most.max((l - 1.0).abs()));
    let square = skew < MINOR * stretch;
    let alike = lengths.iter().all(|l| (l - a).abs() < MINOR * stretch);
    let what = if !(volume.is_finite() && volume.abs() > 1e-6) {
        "it flattens space: its axes lie in one plane".to_owned()
    } else if volume < 0.0 {
        format!("it mirrors (its determinant is {:.3}): its axes are left-handed", block.determinant())
    } else if square && alike {
        format!("it scales by {a:.4}")
    } else if square {
        format!("it scales its axes by {a:.4}, {b:.4} and {c:.4}")
    } else {
        format!(
            "it shears: its axes, {a:.4}, {b:.4} and {c:.4} long, stand at {ab:.2}, {bc:.2} and {ca:.2} degrees to each other"
        )
    };
    let near = volume > 0.5 && lengths.iter().all(|l| (0.8..1.25).contains(l));
    let help = if near && few_decimals(&block.to_cols_array()).is_some() {
        FEW_DECIMALS
    } else if near {
        "poses are rigid: write their numbers with at least 3 decimals, and without scale"
    } else {
        "poses are rigid, without scale or mirror; OpenCV axes: x right, y down, z forward"
    };
    Error::invalid(place, format!("the 3x3 block is not a rotation: {what}"), help)
}

/// A similarity: `p_target = scale · rotation · p_source + translation`, all in double precision.
///
/// In files it is `{"rotation": 3x3 by rows, "scale": s, "translation_m": [x, y, z]}`, the target in metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "SimilarityFile", into = "SimilarityFile")]
pub struct Similarity3 {
    /// `rotation_target_from_source`, orthonormal, determinant +1.
    pub rotation: DMat3,
    /// Target units, which are metres, a source unit; positive.
    pub scale: f64,
    /// The source frame's origin in the target frame, metres.
    pub translation: DVec3,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SimilarityFile {
    rotation: [[f64; 3]; 3],
    scale: f64,
    translation_m: [f64; 3],
}

impl Similarity3 {
    /// The similarity that changes nothing.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, scale: 1.0, translation: DVec3::ZERO };

    /// The least rotation that brings the direction `up` of the source, where there is one, to +z, and a scale.
    pub fn with_up(up: Option<DVec3>, scale: f64) -> Self {
        let rotation = up.map_or(DMat3::IDENTITY, |up| DMat3::from_quat(DQuat::from_rotation_arc(up.normalize(), DVec3::Z)));
        Self { rotation, scale, translation: DVec3::ZERO }
    }

    /// Maps a point.
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.scale * (self.rotation * point) + self.translation
    }

    /// `target_from_camera` of a camera whose pose is `source_from_camera`: it is turned and moved, and stays rigid.
    pub fn pose(&self, source_from_camera: &Rigid3) -> Rigid3 {
        Rigid3 {
            rotation: self.rotation * source_from_camera.rotation,
            translation: self.transform_point(source_from_camera.translation),
        }
    }

    /// Whether it changes nothing.
    pub fn is_identity(&self) -> bool {
        *self == Self::IDENTITY
    }
}

impl From<Similarity3> for SimilarityFile {
    fn from(similarity: Similarity3) -> Self {
        let rotation = similarity.rotation.transpose().to_cols_array_2d();
        Self { rotation, scale: similarity.scale, translation_m: similarity.translation.to_array() }
    }
}

impl TryFrom<SimilarityFile> for Similarity3 {
    type Error = String;

    fn try_from(file: SimilarityFile) -> std::result::Result<Self, String> {
        let [a, b, c] = file.rotation;
        let [x, y, z] = file.translation_m;
        let row = |[p, q, r]: [f64; 3], t| [p, q, r, t];
        let rows = [row(a, x), row(b, y), row(c, z), [0.0, 0.0, 0.0, 1.0]];
        let rigid = Rigid3::from_rows(&rows, "a similarity").map_err(|e| e.to_string())?;
        if !(file.scale.is_finite() && file.scale > 0.0) {
            return Err(format!("a similarity: its scale is {}", file.scale));
        }
        Ok(Self { rotation: rigid.rotation, scale: file.scale, translation: rigid.translation })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rotations in all directions.
    fn rotations() -> impl Iterator<Item = DMat3> {
        (0..200).map(|i| {
            let t = f64::from(i);
            let axis = DVec3::new((1.7 * t).sin(), (2.3 * t + 1.0).cos(), (0.9 * t).sin() + 0.1).normalize();
            DMat3::from_axis_angle(axis, 0.37 * t)
        })
    }

    fn rows(block: DMat3) -> [[f64; 4]; 4] {
        let [x, y, z] = [block.x_axis, block.y_axis, block.z_axis];
        [[x.x, y.x, z.x, 1.0], [x.y, y.y, z.y, 2.0], [x.z, y.z, z.z, 3.0], [0.0, 0.0, 0.0, 1.0]]
    }

    fn rounded(block: DMat3, decimals: i32) -> DMat3 {
        let unit = 10f64.powi(decimals);
        DMat3::from_cols_array(&block.to_cols_array().map(|v| (v * unit).round() / unit))
    }

    fn distance(a: DMat3, b: DMat3) -> f64 {
        (a - b).to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt()
    }

    #[test]
    fn rotations_of_few_decimals_become_the_nearest_rotation_and_exact_ones_stay() {
        let mut worst = 0.0_f64;
        for rotation in rotations() {
            let (kept, off) = Rigid3::nearest(&rows(rotation), "test").unwrap();
            assert!(kept.rotation == rotation && off < EXACT, "{off}");
            for decimals in 3..=8 {
                let (pose, off) = Rigid3::nearest(&rows(rounded(rotation, decimals)), "test").unwrap();
                assert!(distance(pose.rotation.transpose() * pose.rotation, DMat3::IDENTITY) < 1e-14);
                // The nearest one is no farther from what is written than the true one is, and thus no farther from the true one than twice that.
                let rounding = 1.5 * 10f64.powi(-decimals);
                assert!(off <= rounding && distance(pose.rotation, rotation) <= 2.0 * rounding, "{decimals}: {off}");
                assert_eq!(pose.translation, DVec3::new(1.0, 2.0, 3.0));
                assert!(decimals < 6 || off < ROUNDED, "six decimals need no word");
                if decimals == 3 {
                    worst = worst.max(off);
                }
            }
        }
        // The tolerance is no wider than it must be: some rotation of three decimals uses most of it.
        assert!(worst > 0.6 * ROTATION_TOLERANCE, "{worst}");
        for decimals in [1, 2] {
            // What is taken is a rotation as it stands, as quarter turns are.
            let taken: Vec<f64> = rotations()
                .filter_map(|r| Some(Rigid3::nearest(&rows(rounded(r, decimals)), "test").ok()?.1))
                .inspect(|off| assert!(*off < EXACT, "{decimals} decimals: {off}"))
                .collect();
            assert!((1..=20).contains(&taken.len()), "{decimals} decimals: {} of 200", taken.len());
        }
        // What has few decimals and is a rotation none the less is one.
        let exact = DMat3::from_cols(DVec3::new(0.6, 0.8, 0.0), DVec3::new(-0.8, 0.6, 0.0), DVec3::Z);
        assert_eq!(Rigid3::nearest(&rows(exact), "test").unwrap().0.rotation, exact);
    }

    #[test]
    fn what_is_no_rotation_is_refused_by_what_it_does() {
        let rotation = rotations().nth(7).unwrap();
        let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.3, 1.0, 0.0), DVec3::Z);
        for (block, words) in [
            (-1.0 * rotation, "mirrors"),
            (rotation * DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0)), "mirrors"),
            (2.5 * rotation, "scales by 2.5000"),
            (1.01 * rotation, "scales by 1.0100"),
            (rotation * DMat3::from_diagonal(DVec3::new(1.0, 1.0, 1.2)), "scales its axes by 1.0000, 1.0000 and 1.2000"),
            (rotation * shear, "shears"),
            (1.001 * rotation, "scales by 1.0010"),
            // Neither lengths nor angles alone.
            (rounded(rotation, 2), "shears"),
            (rotation * DMat3::from_diagonal(DVec3::new(1.0, 1.0, 0.0)), "flattens"),
            (DMat3::ZERO, "flattens"),
            (1e200 * rotation, "scales by 1"),
            (rounded(rotation, 1), "at least 3 decimals"),
        ] {
            let message = Rigid3::nearest(&rows(block), "a.json: pose 4").unwrap_err().to_string();
            assert!(message.contains(words) && message.contains("pose 4"), "{words}: {message}");
        }
        assert!(Rigid3::from_rows(&rows(f64::NAN * rotation), "test").unwrap_err().to_string().contains("row 0, column 0"));
    }

    #[test]
    fn a_quaternion_turns_the_same_whatever_its_length() {
        let q = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.1);
        for length in [0.6, 0.999, 1.0, 1.9] {
            let [x, y, z, w] = (q * length).to_array();
            let (pose, off) = Rigid3::from_quaternion([w, x, y, z], DVec3::X, "test").unwrap();
            assert!(distance(pose.rotation, DMat3::from_quat(q)) < 1e-14 && (off - (length - 1.0_f64).abs()).abs() < 1e-12);
        }
        for bad in [[0.0; 4], [f64::NAN, 0.0, 0.0, 1.0], [3.0, 4.0, 0.0, 0.0], [0.0, 0.1, 0.0, 0.0]] {
            let message = Rigid3::from_quaternion(bad, DVec3::X, "image 3").unwrap_err().to_string();
            assert!(message.contains("quaternion") && message.contains("image 3"), "{message}");
        }
        assert!(Rigid3::from_quaternion([1.0, 0.0, 0.0, 0.0], DVec3::NAN, "image 3").is_err());
    }

    #[test]
    fn a_quaternion_of_few_decimals_is_refused_where_it_can_be_known() {
        let written = |q: [f64; 4], decimals: i32| {
            let unit = 10f64.powi(decimals);
            q.map(|v| (v * unit).round() / unit)
        };
        let (mut refused, mut worst) = ([0; 2], 0.0_f64);
        for rotation in rotations().skip(1) {
            let [x, y, z, w] = DQuat::from_mat3(&rotation).to_array();
            for decimals in 1..=2 {
                let read = Rigid3::from_quaternion(written([w, x, y, z], decimals), DVec3::X, "image 3");
                match read {
                    Ok((_, off)) => assert!(off <= UNIT_LENGTH, "its length tells nothing: {off}"),
                    Err(error) => {
                        assert!(error.to_string().contains(&format!("rounded to {decimals} decimal")), "{error}");
                        refused[decimals as usize - 1] += 1;
                    }
                }
            }
            let (pose, _) = Rigid3::from_quaternion(written([w, x, y, z], 3), DVec3::X, "image 3").unwrap();
            let turn = DQuat::from_mat3(&(pose.rotation.transpose() * rotation)).to_axis_angle().1;
            worst = worst.max(turn.min(std::f64::consts::TAU - turn).to_degrees());
        }
        assert!(refused.iter().all(|n| *n >= 175), "{refused:?} of 199");
        assert!((0.05..0.12).contains(&worst), "three decimals turn by up to {worst} degrees");
        // A rotation that has few decimals, and one of another length.
        for (q, off) in [([0.6, 0.0, -0.8, 0.0], 0.0), ([1.0, 1.0, 0.0, 0.0], 2f64.sqrt() - 1.0), ([0.5; 4], 0.0)] {
            let (_, found) = Rigid3::from_quaternion(q, DVec3::X, "image 3").unwrap();
            assert!((found - off).abs() < 1e-12, "{q:?}: {found}");
        }
    }

    #[test]
    fn a_similarity_turns_scales_and_moves_and_is_read_as_it_was_written() {
        let up = DVec3::new(0.3, -2.0, 0.4);
        let similarity = Similarity3 { translation: DVec3::new(5.0, 6.0, 7.0), ..Similarity3::with_up(Some(up), 0.5) };
        assert!((similarity.transform_point(up.normalize()) - DVec3::new(5.0, 6.0, 7.5)).length() < 1e-15);
        let pose = Rigid3 { rotation: rotations().nth(3).unwrap(), translation: DVec3::new(1.0, -4.0, 2.0) };
        let moved = similarity.pose(&pose);
        // A point a unit ahead of the camera is half a metre ahead of it.
        let ahead = |p: &Rigid3, distance: f64| p.transform_point(distance * DVec3::Z);
        assert!((similarity.transform_point(ahead(&pose, 1.0)) - ahead(&moved, 0.5)).length() < 1e-14);
        let text = serde_json::to_string(&similarity).unwrap();
        assert_eq!(serde_json::from_str::<Similarity3>(&text).unwrap(), similarity);
        assert!(Similarity3::with_up(None, 1.0).is_identity() && !similarity.is_identity());
        for bad in
            [text.replace("0.5", "-0.5"), text.replace("scale", "factor"), text.replace("\"rotation\":[[", "\"rotation\":[[9")]
        {
            assert!(serde_json::from_str::<Similarity3>(&bad).is_err(), "{bad}");
        }
    }
}
