//! Rigid transforms, always named `target_from_source`.

use crate::{Error, Result};
use glam::{DMat3, DMat4, DVec3};
use serde::{Deserialize, Serialize};

/// A rotation and a translation: `p_target = rotation · p_source + translation` (metres).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rigid3 {
    /// `rotation_target_from_source`, orthonormal, determinant +1.
    pub rotation: DMat3,
    /// The source frame's origin in the target frame, metres.
    pub translation: DVec3,
}

/// Tolerance of `RᵀR` against the identity above which a matrix is refused as a rotation (float32 text files keep ~1e-6).
const ORTHONORMAL_TOLERANCE: f64 = 1e-4;

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

    /// Reads a 4×4 homogeneous matrix given by rows.
    ///
    /// # Errors
    /// A number that is not finite, a last row other than `0 0 0 1`, or a 3×3 block that is no rotation; `place` says where it came from.
    pub fn from_rows(rows: &[[f64; 4]; 4], place: &str) -> Result<Self> {
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
        let rotation = DMat3::from_cols_array_2d(&[
            [rows[0][0], rows[1][0], rows[2][0]],
            [rows[0][1], rows[1][1], rows[2][1]],
            [rows[0][2], rows[1][2], rows[2][2]],
        ]);
        let error =
            (rotation.transpose() * rotation - DMat3::IDENTITY).to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        if error > ORTHONORMAL_TOLERANCE || rotation.determinant() < 0.0 {
            return Err(Error::invalid(
                place,
                format!(
                    "the 3x3 block is not a rotation (R^T R is off the identity by {error:.1e}, determinant {:.3})",
                    rotation.determinant()
                ),
                "poses are rigid, without scale or mirror; OpenCV axes: x right, y down, z forward",
            ));
        }
        Ok(Self { rotation, translation: DVec3::new(rows[0][3], rows[1][3], rows[2][3]) })
    }
}
