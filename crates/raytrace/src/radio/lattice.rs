//! The Fibonacci lattice: directions spread evenly over the sphere.

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;

/// Steps of the R2 sequence: 1/g and 1/g² of the plastic number g, the root of x³ = x + 1.
pub const R2: DVec2 = DVec2::new(0.754_877_666_246_692_7, 0.569_840_290_998_053_3);

/// Direction `i` of `count`, each standing for 4π/count steradians.
pub fn fibonacci(i: usize, count: usize) -> DVec3 {
    // The golden section of a turn: (3 − √5)/2.
    const TURNS: f64 = 0.381_966_011_250_105_15;
    let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
    let radius = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = ((TURNS * i as f64).fract() * std::f64::consts::TAU).sin_cos();
    DVec3::new(radius * cos, radius * sin, z)
}

/// Side of the octahedral map along whose Z-curve [`Directions`] run: 0.2° a bin.
const CURVE_SIDE: usize = 512;

/// A lattice as tasks look along it: directions near each other follow one another, so that what they meet is still at hand.
pub struct Directions {
    world_from_lattice: DMat3,
    /// Numbers in the lattice, those of near directions together.
    along: Vec<u32>,
}

impl Directions {
    /// Of `count` directions over the whole sphere, turned.
    pub fn new(count: usize, world_from_lattice: DMat3) -> Self {
        let mut along: Vec<u32> = (0..count as u32).collect();
        along.par_sort_by_cached_key(|&number| (z_curve(world_from_lattice * fibonacci(number as usize, count)), number));
        Self { world_from_lattice, along }
    }

    /// How many.
    pub fn count(&self) -> usize {
        self.along.len()
    }

    /// Their numbers, those of near ones together.
    pub fn along(&self) -> &[u32] {
        &self.along
    }

    /// The unit direction of a number, in the world.
    pub fn of(&self, number: usize) -> DVec3 {
        self.world_from_lattice * fibonacci(number, self.along.len())
    }
}

/// Place of a direction on a Z-shaped curve that fills the octahedral map.
fn z_curve(d: DVec3) -> u32 {
    let bin = octahedral(d, CURVE_SIDE);
    let spread = |v: usize| (0..CURVE_SIDE.trailing_zeros()).fold(0, |code, bit| code | ((v as u32 >> bit) & 1) << (2 * bit));
    spread(bin % CURVE_SIDE) | spread(bin / CURVE_SIDE) << 1
}

/// The bin of a unit direction on the octahedral map of the sphere, of side × side bins, row by row.
pub fn octahedral(d: DVec3, side: usize) -> usize {
    let scale = 1.0 / (d.x.abs() + d.y.abs() + d.z.abs()).max(f64::MIN_POSITIVE);
    let (x, y) = (d.x * scale, d.y * scale);
    // The lower half is folded out over the square's corners.
    let (x, y) = if d.z >= 0.0 { (x, y) } else { ((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)) };
    let cell = |t: f64| (((t + 1.0) * 0.5 * side as f64) as usize).min(side - 1);
    cell(y) * side + cell(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_directions_follow_one_another_and_none_is_lost() {
        let count = 10_000;
        let directions = Directions::new(count, DMat3::from_rotation_x(0.7));
        let mut numbers = directions.along().to_vec();
        let steps: f64 =
            numbers.windows(2).map(|pair| directions.of(pair[0] as usize).angle_between(directions.of(pair[1] as usize))).sum();
        // They are 2° apart; in the lattice's own order one is 137° of azimuth from the next.
        assert!((steps / count as f64).to_degrees() < 5.0, "{}", (steps / count as f64).to_degrees());
        numbers.sort_unstable();
        assert!(numbers.into_iter().eq(0..count as u32));
    }
}
