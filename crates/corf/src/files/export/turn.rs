//! A field in another frame: means, rotations and spherical harmonics turned together.

use crate::files::ply::SingleModality;
use crate::gaussians::harmonics::{self, MAX_COEFFICIENTS};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

/// A file's frame, by the direction that is up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame {
    /// The world's: z up.
    World,
    /// x right, y down, z forward, as viewers take the files of the reference implementation.
    YDown,
    /// x right, y up, z backward (RUB).
    YUp,
}

impl Frame {
    /// Rotation from the world to this frame. World x stays x.
    pub fn file_from_world(self) -> DMat3 {
        match self {
            Self::World => DMat3::IDENTITY,
            Self::YDown => DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
            Self::YUp => DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y),
        }
    }

    /// The upward axis.
    pub fn up(self) -> [i8; 3] {
        match self {
            Self::World => [0, 0, 1],
            Self::YDown => [0, -1, 0],
            Self::YUp => [0, 1, 0],
        }
    }
}

/// The field in the frame that `rotation` leads to. A colour towards a turned direction is that towards the direction before.
pub fn turned(field: &SingleModality, frame: Frame) -> SingleModality {
    if frame == Frame::World {
        return field.clone();
    }
    let rotation = frame.file_from_world();
    let quaternion = DQuat::from_mat3(&rotation);
    let mut out = field.clone();
    for p in &mut out.position {
        *p = (rotation * DVec3::from_array(p.map(f64::from))).as_vec3().to_array();
    }
    for q in &mut out.rotation {
        let [w, x, y, z] = q.map(f64::from);
        let [x, y, z, w] = (quaternion * DQuat::from_xyzw(x, y, z, w)).to_array();
        *q = [w, x, y, z].map(|v| v as f32);
    }
    let degree = field.appearance.sh_degree;
    let bands: Vec<Vec<f64>> = (0..=degree).map(|band| band_rotation(band, rotation)).collect();
    let (channels, stride) = (field.appearance.channels, field.appearance.stride());
    out.appearance.sh.par_chunks_exact_mut(stride).zip(field.appearance.sh.par_chunks_exact(stride)).for_each(|(to, from)| {
        for (band, matrix) in bands.iter().enumerate() {
            let (first, size) = (band * band, 2 * band + 1);
            for (row, c) in (0..size).flat_map(|row| (0..channels).map(move |c| (row, c))) {
                let sum: f64 = (0..size).map(|k| matrix[row * size + k] * f64::from(from[(first + k) * channels + c])).sum();
                to[(first + row) * channels + c] = sum as f32;
            }
        }
    });
    out
}

/// Directions by which a band's rotation is found. Spread evenly, they make its equations orthogonal but for some per cent.
const DIRECTIONS: usize = 256;

/// The matrix M, by rows, of the 2·band + 1 coefficients of one band: `Σ_j (M c)_j Y_j(R d) = Σ_k c_k Y_k(d)` for every direction d. Rotations mix the
/// functions of one band only, so this is exact; it is solved by least squares over many directions.
fn band_rotation(band: usize, rotation: DMat3) -> Vec<f64> {
    let (first, size) = (band * band, 2 * band + 1);
    let at =
        |d: DVec3| -> [f64; MAX_COEFFICIENTS] { harmonics::basis_of::<MAX_COEFFICIENTS>(d.as_vec3().to_array()).map(f64::from) };
    // Normal equations [BᵀB | BᵀA].
    let width = 2 * size;
    let mut system = vec![0.0; size * width];
    for d in (0..DIRECTIONS).map(spread) {
        let (turned, before) = (at(rotation * d), at(d));
        for (j, k) in (0..size).flat_map(|j| (0..size).map(move |k| (j, k))) {
            system[j * width + k] += turned[first + j] * turned[first + k];
            system[j * width + size + k] += turned[first + j] * before[first + k];
        }
    }
    // Gauss and Jordan; the matrix is nearly diagonal, so that pivots need not be sought.
    for pivot in 0..size {
        let scale = system[pivot * width + pivot].recip();
        system[pivot * width..(pivot + 1) * width].iter_mut().for_each(|v| *v *= scale);
        let row: Vec<f64> = system[pivot * width..(pivot + 1) * width].to_vec();
        for other in (0..size).filter(|r| *r != pivot) {
            let factor = system[other * width + pivot];
            for (v, p) in system[other * width..(other + 1) * width].iter_mut().zip(&row) {
                *v -= factor * p;
            }
        }
    }
    (0..size).flat_map(|j| system[j * width + size..(j + 1) * width].to_vec()).collect()
}

/// Direction `i` of a Fibonacci lattice on the sphere.
fn spread(i: usize) -> DVec3 {
    let z = 1.0 - (2.0 * i as f64 + 1.0) / DIRECTIONS as f64;
    let (sin, cos) = (i as f64 * std::f64::consts::PI * (3.0 - 5.0_f64.sqrt())).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * cos, r * sin, z)
}
