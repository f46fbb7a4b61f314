//! Real spherical harmonics to degree 3 as polynomials of a unit direction (x, y, z), in the order and with the signs that the
//! splatting literature uses, so that fields can be exchanged with other viewers.

/// Degree 1: sqrt(3 / 4π).
const C1: f32 = 0.488_602_5;
/// Degree 2, m = −2 … 2.
const C2: [f32; 5] = [1.092_548_4, -1.092_548_4, 0.315_391_57, -1.092_548_4, 0.546_274_2];
/// Degree 3, m = −3 … 3.
const C3: [f32; 7] = [-0.590_043_6, 2.890_611_4, -0.457_045_8, 0.373_176_34, -0.457_045_8, 1.445_305_7, -0.590_043_6];
const C0: f32 = crate::gaussians::SH_C0;

/// Most coefficients per channel, (3+1)².
pub(crate) const MAX_COEFFICIENTS: usize = 16;

/// The basis functions of `K` = (degree+1)² ∈ {1, 4, 9, 16} coefficients in direction `d`; the rest is zero.
#[inline(always)]
pub(crate) fn basis_of<const K: usize>([x, y, z]: [f32; 3]) -> [f32; MAX_COEFFICIENTS] {
    let mut out = [0.0; MAX_COEFFICIENTS];
    out[0] = C0;
    if K >= 4 {
        out[1] = -C1 * y;
        out[2] = C1 * z;
        out[3] = -C1 * x;
    }
    if K >= 9 {
        out[4] = C2[0] * x * y;
        out[5] = C2[1] * y * z;
        out[6] = C2[2] * (2.0 * z * z - x * x - y * y);
        out[7] = C2[3] * x * z;
        out[8] = C2[4] * (x * x - y * y);
    }
    if K >= 16 {
        out[9] = C3[0] * y * (3.0 * x * x - y * y);
        out[10] = C3[1] * x * y * z;
        out[11] = C3[2] * y * (4.0 * z * z - x * x - y * y);
        out[12] = C3[3] * z * (2.0 * z * z - 3.0 * x * x - 3.0 * y * y);
        out[13] = C3[4] * x * (4.0 * z * z - x * x - y * y);
        out[14] = C3[5] * z * (x * x - y * y);
        out[15] = C3[6] * x * (x * x - 3.0 * y * y);
    }
    out
}

/// Σ_k w_k ∂Y_k/∂d: the gradient with respect to the direction (before it is confined to the unit sphere) for coefficient weights `w`.
#[inline(always)]
pub(crate) fn direction_gradient<const K: usize>([x, y, z]: [f32; 3], w: &[f32; MAX_COEFFICIENTS]) -> [f32; 3] {
    let (mut gx, mut gy, mut gz) = (0.0, 0.0, 0.0);
    if K >= 4 {
        gy -= C1 * w[1];
        gz += C1 * w[2];
        gx -= C1 * w[3];
    }
    if K >= 9 {
        gx += C2[0] * y * w[4] - 2.0 * C2[2] * x * w[6] + C2[3] * z * w[7] + 2.0 * C2[4] * x * w[8];
        gy += C2[0] * x * w[4] + C2[1] * z * w[5] - 2.0 * C2[2] * y * w[6] - 2.0 * C2[4] * y * w[8];
        gz += C2[1] * y * w[5] + 4.0 * C2[2] * z * w[6] + C2[3] * x * w[7];
    }
    if K >= 16 {
        gx += C3[0] * 6.0 * x * y * w[9] + C3[1] * y * z * w[10] - C3[2] * 2.0 * x * y * w[11] - C3[3] * 6.0 * x * z * w[12]
            + C3[4] * (4.0 * z * z - 3.0 * x * x - y * y) * w[13]
            + C3[5] * 2.0 * x * z * w[14]
            + C3[6] * 3.0 * (x * x - y * y) * w[15];
        gy += C3[0] * 3.0 * (x * x - y * y) * w[9] + C3[1] * x * z * w[10] + C3[2] * (4.0 * z * z - x * x - 3.0 * y * y) * w[11]
            - C3[3] * 6.0 * y * z * w[12]
            - C3[4] * 2.0 * x * y * w[13]
            - C3[5] * 2.0 * y * z * w[14]
            - C3[6] * 6.0 * x * y * w[15];
        gz += C3[1] * x * y * w[10]
            + C3[2] * 8.0 * y * z * w[11]
            + C3[3] * (6.0 * z * z - 3.0 * x * x - 3.0 * y * y) * w[12]
            + C3[4] * 8.0 * x * z * w[13]
            + C3[5] * (x * x - y * y) * w[14];
    }
    [gx, gy, gz]
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    #[test]
    fn the_basis_is_orthonormal_on_the_sphere() {
        // Midpoint rule in azimuth and in cos(polar angle) with n² points: exact in azimuth, error of order n^-2 in the other.
        const N: usize = 400;
        const TOLERANCE: f64 = 2e-4;
        let mut gram = [[0.0_f64; 16]; 16];
        for i in 0..N {
            for j in 0..N {
                let z = (i as f64 + 0.5) / N as f64 * 2.0 - 1.0;
                let phi = (j as f64 + 0.5) / N as f64 * std::f64::consts::TAU;
                let r = (1.0 - z * z).sqrt();
                let y = basis_of::<16>([(r * phi.cos()) as f32, (r * phi.sin()) as f32, z as f32]);
                for a in 0..16 {
                    for b in 0..16 {
                        gram[a][b] += f64::from(y[a]) * f64::from(y[b]) * 4.0 * std::f64::consts::PI / (N * N) as f64;
                    }
                }
            }
        }
        for a in 0..16 {
            for b in 0..16 {
                let expected = if a == b { 1.0 } else { 0.0 };
                assert!((gram[a][b] - expected).abs() < TOLERANCE, "<Y{a}, Y{b}> = {}", gram[a][b]);
            }
        }
    }

    #[test]
    fn direction_gradients_are_those_of_the_polynomials() {
        // Central differences in f32 with a step of 1e-2: cubic polynomials leave an error of C3·h² < 3e-4.
        const TOLERANCE: f32 = 1e-3;
        let mut rng = Rng::keyed(1, 2, 3);
        for _ in 0..20 {
            let d = [0; 3].map(|_| rng.uniform() * 2.0 - 1.0);
            let w = [0; 16].map(|_| rng.uniform() * 2.0 - 1.0);
            let gradient = direction_gradient::<16>(d, &w);
            let value = |d| basis_of::<16>(d).iter().zip(w).map(|(y, w)| y * w).sum::<f32>();
            for axis in 0..3 {
                let h = 1e-2;
                let (mut a, mut b) = (d, d);
                a[axis] -= h;
                b[axis] += h;
                let numeric = (value(b) - value(a)) / (2.0 * h);
                assert!((numeric - gradient[axis]).abs() < TOLERANCE, "axis {axis}: {numeric} {}", gradient[axis]);
            }
        }
    }
}
