//! Directions of a hemisphere on a square grid, dense enough for a scattering lobe to be interpolated between them.

use corf_scene::model::ScatteringPattern;
use glam::Vec3;

/// Spacing of the nodes over the standard deviation of the narrowest lobe. Linear interpolation then misses the peak of a single lobe
/// by up to (0.52)²/8 = 3 % per axis, more where the octahedral grid is widest; [`Nodes::sharpen`] makes that right on average.
const SPACING: f64 = 0.52;

/// A grid of unit directions with z ≥ 0 (z along the surface's normal), octahedral: the square's edge is the horizon.
#[derive(Clone, Debug)]
pub struct Nodes {
    side: usize,
    /// x, y and z of the directions.
    directions: [Vec<f32>; 3],
}

/// Room for the lobes of one wave.
#[derive(Debug, Default)]
pub struct LobeBuffer {
    /// F·f_s at every node.
    pub values: Vec<f32>,
    other: Vec<f32>,
    base: Vec<f32>,
}

impl Nodes {
    /// Nodes for a lobe; a Lambertian one needs a single node, and its cosine is the reader's.
    pub fn new(pattern: ScatteringPattern) -> Self {
        let side = match pattern {
            ScatteringPattern::Lambertian => return Self { side: 1, directions: [vec![0.0], vec![0.0], vec![1.0]] },
            ScatteringPattern::Directive { alpha_r } => side(alpha_r),
            ScatteringPattern::Backscatter { alpha_r, alpha_i, .. } => side(alpha_r.max(alpha_i)),
        };
        let directions: Vec<Vec3> = (0..side * side)
            .map(|i| {
                let at = |k: usize| 2.0 * k as f32 / (side - 1) as f32 - 1.0;
                let (u, v) = (at(i % side), at(i / side));
                let (x, y) = (0.5 * (u + v), 0.5 * (u - v));
                Vec3::new(x, y, (1.0 - x.abs() - y.abs()).max(0.0)).normalize()
            })
            .collect();
        Self { side, directions: [0, 1, 2].map(|axis| directions.iter().map(|d| d[axis]).collect()) }
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.directions[0].len()
    }

    /// The nodes around a unit direction, with weights whose sum is 1; below the horizon its nearest point counts.
    #[inline]
    pub fn around(&self, direction: Vec3) -> ([usize; 4], [f32; 4]) {
        if self.side == 1 {
            return ([0; 4], [1.0, 0.0, 0.0, 0.0]);
        }
        let z = direction.z.max(0.0);
        let scale = 0.5 * (self.side - 1) as f32 / (direction.x.abs() + direction.y.abs() + z).max(f32::MIN_POSITIVE);
        let middle = 0.5 * (self.side - 1) as f32;
        let u = (middle + (direction.x + direction.y) * scale).clamp(0.0, 2.0 * middle);
        let v = (middle + (direction.x - direction.y) * scale).clamp(0.0, 2.0 * middle);
        let (i, j) = ((u as usize).min(self.side - 2), (v as usize).min(self.side - 2));
        let (s, t) = (u - i as f32, v - j as f32);
        let first = j * self.side + i;
        let weights = [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t];
        ([first, first + 1, first + self.side, first + self.side + 1], weights)
    }

    /// Takes away in advance what linear interpolation adds: on average over a cell it is off by a twelfth of the second difference along
    /// each axis, so that peaks come out too low. `rows` hold four numbers a node, the first two of them powers.
    pub fn sharpen(&self, rows: &mut [f32], before: &mut Vec<f32>) {
        const WIDTH: usize = 4;
        let side = self.side;
        if side < 3 {
            return;
        }
        before.clear();
        before.extend_from_slice(rows);
        for stride in [1, side] {
            // A node at an edge has no neighbour on one side.
            for node in (0..side * side).filter(|node| (1..side - 1).contains(&(node / stride % side))) {
                for c in 0..WIDTH {
                    let at = |node: usize| before[node * WIDTH + c];
                    rows[node * WIDTH + c] -= (at(node - stride) - 2.0 * at(node) + at(node + stride)) / 12.0;
                }
            }
        }
        let (rows, _) = rows.as_chunks_mut::<WIDTH>();
        for row in rows {
            (row[0], row[1]) = (row[0].max(0.0), row[1].max(0.0));
        }
    }

    /// F·f_s of a wave at every node, in their order: `specular` and `back` are its mirrored and its reversed direction, `normal` that
    /// of the very facet it meets, all in the grid's frame. Nodes behind the facet get nothing.
    #[inline(always)]
    pub fn lobe(&self, pattern: ScatteringPattern, normal: Vec3, specular: Vec3, back: Vec3, lobes: &mut LobeBuffer) {
        let LobeBuffer { values, other, base } = lobes;
        match pattern {
            ScatteringPattern::Lambertian => {
                values.clear();
                values.push(std::f32::consts::FRAC_1_PI);
            }
            ScatteringPattern::Directive { alpha_r } => self.power_lobe(specular, alpha_r, base, values),
            ScatteringPattern::Backscatter { alpha_r, alpha_i, lambda } => {
                self.power_lobe(specular, alpha_r, base, values);
                self.power_lobe(back, alpha_i, base, other);
                let lambda = lambda as f32;
                values.iter_mut().zip(other).for_each(|(v, o)| *v = lambda * *v + (1.0 - lambda) * *o);
            }
        }
        if self.side > 1 && normal.z < FLAT {
            let [x, y, z] = &self.directions;
            for (value, ((x, y), z)) in values.iter_mut().zip(x.iter().zip(y).zip(z)) {
                *value *= f32::from(u8::from(x * normal.x + y * normal.y + z * normal.z > 0.0));
            }
        }
    }

    /// ((1 + cosψ)/2)^α at every node, ψ from the lobe's axis, by repeated squaring: all nodes take every step together.
    #[inline(always)]
    fn power_lobe(&self, axis: Vec3, alpha: u32, base: &mut Vec<f32>, values: &mut Vec<f32>) {
        let [x, y, z] = &self.directions;
        base.clear();
        base.extend(x.iter().zip(y).zip(z).map(|((x, y), z)| 0.5 * (1.0 + (x * axis.x + y * axis.y + z * axis.z)).max(0.0)));
        values.clear();
        values.resize(base.len(), 1.0);
        let mut left = alpha;
        while left > 0 {
            if left & 1 == 1 {
                values.iter_mut().zip(&*base).for_each(|(v, b)| *v *= b);
            }
            left >>= 1;
            if left > 0 {
                base.iter_mut().for_each(|b| *b *= *b);
            }
        }
    }
}

/// Facets tilted by less than this (cosine) have the grid's own horizon.
const FLAT: f32 = 0.9999;

/// Nodes along a side: an odd number, so that the normal is one of them.
fn side(alpha: u32) -> usize {
    // ((1 + cosψ)/2)^α is one half at ψ_h, as a Gaussian is at 1.177 standard deviations.
    let half = (2.0 * 0.5f64.powf(1.0 / f64::from(alpha)) - 1.0).acos();
    let spacing = SPACING * half / 1.177;
    2 * (std::f64::consts::FRAC_PI_2 / spacing).ceil().max(2.0) as usize + 1
}

/// F·f_s towards a unit direction over what a table of [`Nodes`] holds of it: cosθ_s for the Lambertian lobe, 1 otherwise.
#[inline]
pub fn readout(pattern: ScatteringPattern, cos_scatter: f64) -> f64 {
    match pattern {
        ScatteringPattern::Lambertian => cos_scatter,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::{field::scattering, lattice};
    use glam::DVec3;

    #[test]
    fn sharpened_lobes_keep_their_peak_on_average() {
        // Over directions within half a standard deviation of the peak; without sharpening the mean is off by some 4 %.
        let tolerance = 0.012;
        for alpha_r in [5, 10, 40] {
            let pattern = ScatteringPattern::Directive { alpha_r };
            let nodes = Nodes::new(pattern);
            let (mut lobes, mut before) = (LobeBuffer::default(), Vec::new());
            let (mut found, mut expected) = (0.0, 0.0);
            for i in 0..200 {
                // Mirrored directions all over the inner hemisphere.
                let specular = lattice::fibonacci(i, 400);
                if specular.z < 0.4 {
                    continue;
                }
                nodes.lobe(pattern, Vec3::Z, specular.as_vec3(), Vec3::Z, &mut lobes);
                let mut rows: Vec<f32> = lobes.values.iter().flat_map(|v| [*v; 4]).collect();
                nodes.sharpen(&mut rows, &mut before);
                let near = 1.0 - 0.5 * (0.5 * 1.2 / f64::from(alpha_r).sqrt()).powi(2);
                for d in (0..20_000).map(|i| lattice::fibonacci(i, 20_000)).filter(|d| d.dot(specular) > near) {
                    let (at, weights) = nodes.around(d.as_vec3());
                    found += f64::from(at.iter().zip(weights).map(|(&i, w)| w * rows[4 * i]).sum::<f32>());
                    expected += scattering::lobe(pattern, d.z, d.dot(specular), 0.0);
                }
            }
            assert!((found / expected - 1.0).abs() < tolerance, "{alpha_r}: {}", found / expected);
        }
    }

    #[test]
    fn lobes_are_interpolated_within_their_stated_error() {
        // Of the lobe's peak; see SPACING.
        let tolerance = 0.07;
        for pattern in [
            ScatteringPattern::Lambertian,
            ScatteringPattern::Directive { alpha_r: 1 },
            ScatteringPattern::Directive { alpha_r: 5 },
            ScatteringPattern::Directive { alpha_r: 10 },
            ScatteringPattern::Directive { alpha_r: 50 },
            ScatteringPattern::Backscatter { alpha_r: 4, alpha_i: 9, lambda: 0.6 },
        ] {
            let nodes = Nodes::new(pattern);
            let mut lobes = LobeBuffer::default();
            for incidence in [0.0f64, 0.7, 1.4] {
                let k = DVec3::new(incidence.sin() * 0.8, incidence.sin() * 0.6, -incidence.cos());
                let (specular, back) = (DVec3::new(k.x, k.y, -k.z), -k);
                nodes.lobe(pattern, Vec3::Z, specular.as_vec3(), back.as_vec3(), &mut lobes);
                for d in (0..4000).map(|i| lattice::fibonacci(i, 4000)).filter(|d| d.z > 0.0) {
                    let (at, weights) = nodes.around(d.as_vec3());
                    let found: f32 = at.iter().zip(weights).map(|(&i, w)| w * lobes.values[i]).sum();
                    let found = f64::from(found) * readout(pattern, d.z);
                    let expected = scattering::lobe(pattern, d.z, d.dot(specular), d.dot(back));
                    assert!((found - expected).abs() < tolerance, "{pattern:?} {incidence} {d}: {found} {expected}");
                }
            }
        }
    }
}
