//! Quadratic forms of steering vectors, vᴴQv, as short Fourier sums.

use crate::radio::{Complex, PlanarArray};
use glam::DVec3;
use rayon::prelude::*;

/// u ↦ v(u)ᴴ Q v(u) for a Hermitian Q and the steering vectors v_m(u) = exp(j2π p_m·u) of a planar array.
///
/// On a uniform grid of elements the phase of every term Q_mn depends on the lag p_n − p_m alone. With the phase steps y and z between
/// columns and rows, and lags of opposite sign taken together, Q condenses into a real bilinear form of [`harmonics`]:
/// Σ (cos l_y·y, sin l_y·y) T_{l_y l_z} (cos l_z·z, sin l_z·z)ᵀ over l_y ∈ [0, C), l_z ∈ [0, R). Nothing is approximated, and the cost of a
/// direction does not depend on what Q was made of.
#[derive(Clone, Debug)]
pub(super) struct LagForm {
    array: PlanarArray,
    /// T: of every l_y a row for the cosine and one for the sine, each of R cosines of l_z and then R sines.
    table: Vec<f64>,
}

/// Plane waves a task condenses; fixed, so that sums come out the same for any thread count.
const WAVES_PER_TASK: usize = 2048;
/// Plane waves that are added to a sum while it is at hand.
const WAVES_AT_ONCE: usize = 4;
/// Numbers that a direction's harmonics may take without allocating: 32 rows.
const INLINE_HARMONICS: usize = 64;

impl LagForm {
    /// Q = Σ p·v(u)v(u)ᴴ over plane waves from the unit directions u of the array frame with the powers p.
    ///
    /// vᴴQv = Σ p·K_C(y − y′)·K_R(z − z′) with the Fejér kernel K_n(x) = Σ_{|l| < n} (n − |l|) cos(l·x).
    pub fn of_waves(array: PlanarArray, waves: &[(DVec3, f64)]) -> Self {
        let partial: Vec<Vec<f64>> = waves.par_chunks(WAVES_PER_TASK).map(|chunk| products(array, chunk)).collect();
        let mut this = Self::dark(array);
        for sums in &partial {
            this.table.iter_mut().zip(sums).for_each(|(entry, sum)| *entry += sum);
        }
        let weight = |l: usize, n: usize| (n - l) as f64 * both_signs(l);
        let (columns, rows) = (array.columns, array.rows);
        for (i, row) in this.table.chunks_exact_mut(2 * rows).enumerate() {
            row.iter_mut().enumerate().for_each(|(j, entry)| *entry *= weight(i / 2, columns) * weight(j % rows, rows));
        }
        this
    }

    /// Q itself, N×N by rows, in the array's order of elements.
    pub fn of_matrix(array: PlanarArray, q: &[Complex]) -> Self {
        let (rows, n) = (array.rows, array.elements());
        let mut this = Self::dark(array);
        for i in 0..n {
            let (column, row) = (i / rows, i % rows);
            for j in column * rows..n {
                let (other_column, other_row) = (j / rows, j % rows);
                // Rows run downwards.
                let (ly, lz) = (other_column - column, row.abs_diff(other_row));
                let sign = if row < other_row { -1.0 } else { 1.0 };
                // The real part of q·e^{+j(l_y·y ± l_z·z)}; what is left of this column is the conjugate.
                let Complex { re, im } = q[i * n + j] * both_signs(ly);
                let (cosine, sine) = this.table[4 * ly * rows..4 * (ly + 1) * rows].split_at_mut(2 * rows);
                cosine[lz] += re;
                cosine[rows + lz] -= im * sign;
                sine[lz] -= im;
                sine[rows + lz] -= re * sign;
            }
        }
        this
    }

    fn dark(array: PlanarArray) -> Self {
        Self { array, table: vec![0.0; 4 * array.elements()] }
    }

    /// The value at a unit direction of the array frame; real, because Q is Hermitian.
    pub fn value(&self, direction: DVec3) -> f64 {
        let [y, z] = self.array.phase_steps(direction);
        let (mut inline, mut spilled) = ([0.0; INLINE_HARMONICS], Vec::new());
        let of_z = match inline.get_mut(..2 * self.array.rows) {
            Some(inline) => inline,
            None => {
                spilled.resize(2 * self.array.rows, 0.0);
                &mut spilled[..]
            }
        };
        harmonics(z, 1.0, of_z);
        let step = Complex::new(y.cos(), y.sin());
        let (mut sum, mut of_y) = (0.0, Complex::real(1.0));
        for rows in self.table.chunks_exact(2 * of_z.len()) {
            let (cosine, sine) = rows.split_at(of_z.len());
            sum += of_y.re * dot(cosine, of_z) + of_y.im * dot(sine, of_z);
            of_y = of_y * step;
        }
        sum
    }
}

/// Multiplicity of a lag: 2 for a positive one, which stands for both signs, and 1 for zero.
fn both_signs(lag: usize) -> f64 {
    if lag > 0 { 2.0 } else { 1.0 }
}

/// `scale`·cos(l·x) for l = 0, 1, … in the first half, `scale`·sin(l·x) in the second.
fn harmonics(x: f64, scale: f64, into: &mut [f64]) {
    let step = Complex::new(x.cos(), x.sin());
    let mut term = Complex::real(scale);
    let (cosines, sines) = into.split_at_mut(into.len() / 2);
    for (cosine, sine) in cosines.iter_mut().zip(sines) {
        (*cosine, *sine) = (term.re, term.im);
        term = term * step;
    }
}

/// Σ a·b in four sums side by side, which vector units take together.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    let mut sums = [0.0; 4];
    for (a, b) in a.iter().zip(b) {
        (0..4).for_each(|i| sums[i] += a[i] * b[i]);
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

/// Σ p·h(y)h(z)ᵀ of waves' [`harmonics`], as [`LagForm::table`]. Every processor's version does the same operations and gives the same bits.
fn products(array: PlanarArray, waves: &[(DVec3, f64)]) -> Vec<f64> {
    #[cfg(target_arch = "x86_64")]
    if std::arch::is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2.
        return unsafe { products_avx2(array, waves) };
    }
    products_portable(array, waves)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn products_avx2(array: PlanarArray, waves: &[(DVec3, f64)]) -> Vec<f64> {
    products_portable(array, waves)
}

#[inline(always)]
fn products_portable(array: PlanarArray, waves: &[(DVec3, f64)]) -> Vec<f64> {
    let (columns, rows) = (array.columns, array.rows);
    let mut sums = vec![0.0; 4 * array.elements()];
    let mut of_y = [(); WAVES_AT_ONCE].map(|()| vec![0.0; 2 * columns]);
    let mut of_z = [(); WAVES_AT_ONCE].map(|()| vec![0.0; 2 * rows]);
    for few in waves.chunks(WAVES_AT_ONCE) {
        for i in 0..WAVES_AT_ONCE {
            // What is missing at the end has no power.
            let (u, power) = few.get(i).copied().unwrap_or_default();
            let [y, z] = array.phase_steps(u);
            harmonics(y, power, &mut of_y[i]);
            harmonics(z, 1.0, &mut of_z[i]);
        }
        let [a, b, c, d] = &of_z;
        for (i, row) in sums.chunks_exact_mut(2 * rows).enumerate() {
            // Cosine and sine of a lag stand next to each other in the table.
            let [p, q, r, s] = of_y.each_ref().map(|of_y| of_y[i % 2 * columns + i / 2]);
            for ((((sum, a), b), c), d) in row.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                *sum = *sum + p * a + q * b + r * c + s * d;
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    #[test]
    fn plane_waves_are_the_sum_of_their_beams() {
        let mut rng = Rng::keyed(6, 0, 0);
        // Elements enough for harmonics to be allocated, too.
        for (rows, columns) in [(8, 8), (3, 1), (1, 5), (40, 2)] {
            let array = PlanarArray { rows, columns, spacing_wavelengths: [0.5, 0.6] };
            let mut direction = || DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
            let waves: Vec<(DVec3, f64)> = (0..7).map(|i| (direction(), 0.1 + f64::from(i))).collect();
            let form = LagForm::of_waves(array, &waves);
            for u in [waves[3].0, direction(), direction()] {
                let beam = |from: &DVec3| {
                    let pairs = array.steering(u).into_iter().zip(array.steering(*from));
                    pairs.fold(Complex::ZERO, |sum, (v, w)| sum + Complex::new(v.re, -v.im) * w).norm_squared()
                };
                let expected: f64 = waves.iter().map(|(from, power)| power * beam(from)).sum();
                assert!((form.value(u) / expected - 1.0).abs() < 1e-11, "{rows}x{columns} {u}: {} {expected}", form.value(u));
            }
        }
    }

    #[test]
    fn any_hermitian_form_is_its_sum_over_lags() {
        let array = PlanarArray { rows: 3, columns: 4, spacing_wavelengths: [0.6, 0.45] };
        let n = array.elements();
        let mut rng = Rng::keyed(5, 0, 0);
        let mut q = vec![Complex::ZERO; n * n];
        for i in 0..n {
            q[i * n + i] = Complex::real(rng.normal());
            for j in 0..i {
                q[i * n + j] = Complex::new(rng.normal(), rng.normal());
                q[j * n + i] = Complex::new(q[i * n + j].re, -q[i * n + j].im);
            }
        }
        let form = LagForm::of_matrix(array, &q);
        for u in [DVec3::X, DVec3::new(0.3, -0.8, 0.5).normalize(), DVec3::new(-0.4, 0.1, -0.9).normalize()] {
            let v = array.steering(u);
            let mut sum = Complex::ZERO;
            for i in 0..n {
                for j in 0..n {
                    sum = sum + Complex::new(v[i].re, -v[i].im) * q[i * n + j] * v[j];
                }
            }
            assert!((form.value(u) - sum.re).abs() < 1e-11 && sum.im.abs() < 1e-11, "{u}: {} {sum:?}", form.value(u));
        }
    }
}
