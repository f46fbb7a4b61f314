//! The Fibonacci lattice: directions spread evenly over the sphere.

use corf_scene::Rng;
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

/// Stream of the places of directions in their cells.
const STAGE_JITTER: u64 = 0x6469_725f_6a69_7474;

/// A lattice as tasks look along it: directions near each other follow one another, so that what they meet is still at hand.
///
/// The cell of a direction is the parallelogram of the lattice's two shortest steps there, whose copies tile the sphere. Directions stand in the
/// middle of their cells, or anywhere in them by chance: the lattice's rows are straight, and one that runs along a strip of a face
/// meets it all the way or nowhere.
pub struct Directions {
    world_from_lattice: DMat3,
    /// Numbers in the lattice, those of near directions together.
    along: Vec<u32>,
    jitter: Option<Jitter>,
}

/// Directions that stand anywhere in their cells.
struct Jitter {
    seed: u64,
    /// Unit directions by number.
    directions: Vec<DVec3>,
}

impl Jitter {
    /// Random place of a direction in its cell, or in a part of one: two numbers in [−½, ½), as shares of the cell's sides.
    fn place(seed: u64, number: usize) -> [f64; 2] {
        let mut rng = Rng::keyed(seed, STAGE_JITTER, number as u64);
        [0; 2].map(|_| rng.uniform_f64() - 0.5)
    }
}

impl Directions {
    /// A lattice of `count` directions over the whole sphere, turned, in the middle of their cells.
    pub fn new(count: usize, world_from_lattice: DMat3) -> Self {
        let mut along: Vec<u32> = (0..count as u32).collect();
        along.par_sort_by_cached_key(|&number| (z_curve(world_from_lattice * fibonacci(number as usize, count)), number));
        Self { world_from_lattice, along, jitter: None }
    }

    /// The lattice with jitter: every direction at a random place in its cell, drawn by the seed and its number.
    pub fn jittered(self, seed: u64) -> Self {
        let directions = (0..self.count())
            .into_par_iter()
            .map(|number| shifted(self.middle(number), self.sides(number), Jitter::place(seed, number)))
            .map(DVec3::normalize)
            .collect();
        Self { jitter: Some(Jitter { seed, directions }), ..self }
    }

    /// Number of directions.
    pub fn count(&self) -> usize {
        self.along.len()
    }

    /// Numbers of the directions, ordered so that near ones are together.
    pub fn along(&self) -> &[u32] {
        &self.along
    }

    /// The unit direction of a number, in the world.
    pub fn of(&self, number: usize) -> DVec3 {
        match &self.jitter {
            Some(jitter) => jitter.directions[number],
            None => self.middle(number),
        }
    }

    /// The cell of a number, to be cut into `most` × `most` parts or fewer.
    pub fn cell(&self, number: usize, most: usize) -> DirectionCell {
        DirectionCell {
            middle: self.middle(number),
            sides: self.sides(number),
            first: self.count() + number * most * most,
            seed: self.jitter.as_ref().map(|jitter| jitter.seed),
        }
    }

    /// Direction in the middle of a number's cell, world frame, unit length.
    fn middle(&self, number: usize) -> DVec3 {
        self.world_from_lattice * fibonacci(number, self.count())
    }

    /// The sides of a number's cell, as differences of directions.
    fn sides(&self, number: usize) -> [DVec3; 2] {
        let count = self.count();
        neighbours(number, count).map(|step| {
            let (from, to) = if number + step < count { (number, number + step) } else { (number.saturating_sub(step), number) };
            self.middle(to) - self.middle(from)
        })
    }
}

/// The surroundings of a direction of a lattice.
pub struct DirectionCell {
    middle: DVec3,
    sides: [DVec3; 2],
    /// Number of its first part.
    first: usize,
    /// Seed of its parts' places, where they are jittered.
    seed: Option<u64>,
}

impl DirectionCell {
    /// One of the cell's side × side parts: a number that no direction and no other cell's part has, and its unit direction, in the world.
    pub fn part(&self, part: usize, side: usize) -> (usize, DVec3) {
        let number = self.first + part;
        let place = self.seed.map_or([0.0; 2], |seed| Jitter::place(seed, number));
        let at = |k: usize, place: f64| (k as f64 + 0.5 + place) / side as f64 - 0.5;
        let in_cell = [at(part % side, place[0]), at(part / side, place[1])];
        (number, shifted(self.middle, self.sides, in_cell).normalize())
    }
}

/// Moves a direction by shares of the two sides of its cell.
fn shifted(from: DVec3, [u, v]: [DVec3; 2], [x, y]: [f64; 2]) -> DVec3 {
    from + u * x + v * y
}

/// The index steps to a direction's nearest neighbours: two consecutive Fibonacci numbers, whose cell has the area 4π/count.
pub fn neighbours(index: usize, count: usize) -> [usize; 2] {
    let z = 1.0 - (2.0 * index as f64 + 1.0) / count as f64;
    let radius2 = (1.0 - z * z).max(f64::MIN_POSITIVE);
    let mut best = ([1, 2], f64::INFINITY);
    let (mut a, mut b) = (1usize, 2usize);
    // φ⁻¹ of a turn each: after F(k) steps the azimuth is off by φ^−k of a turn.
    let golden = 0.5 * (5.0f64.sqrt() - 1.0);
    let mut turn = golden * golden;
    let length2 = |step: usize, turn: f64| {
        (std::f64::consts::TAU * turn).powi(2) * radius2 + (2.0 * step as f64 / count as f64).powi(2) / radius2
    };
    while b < count {
        let both = length2(a, turn) + length2(b, turn * golden);
        if both < best.1 {
            best = ([a, b], both);
        }
        (a, b, turn) = (b, a + b, turn * golden);
    }
    best.0
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

    #[test]
    fn two_steps_span_the_cell_of_every_direction() {
        let count = 20_000;
        let cell_sr = 4.0 * std::f64::consts::PI / count as f64;
        for index in (1000..count - 1000).step_by(37) {
            let [a, b] = neighbours(index, count).map(|step| {
                let to = if index + step < count { index + step } else { index - step };
                fibonacci(to, count) - fibonacci(index, count)
            });
            let area = a.cross(b).length();
            // The sphere curves between the three: towards the poles, where few cells make a turn, by some per cent.
            assert!((area / cell_sr - 1.0).abs() < 0.05, "{index}: {}", area / cell_sr);
            assert!(a.length().max(b.length()) < 2.0 * cell_sr.sqrt(), "{index}: {a} {b}");
        }
    }

    #[test]
    fn directions_stand_anywhere_in_their_cells_and_cells_are_where_they_were() {
        let (count, turn) = (5_000, DMat3::from_rotation_y(1.1));
        let (regular, jittered) = (Directions::new(count, turn), Directions::new(count, turn).jittered(7));
        let side_rad = (4.0 * std::f64::consts::PI / count as f64).sqrt();
        let mut off = [0.0; 2];
        for number in 0..count {
            let angle = jittered.of(number).angle_between(regular.of(number));
            assert!(angle < 1.5 * side_rad, "{number}: {angle}");
            // The parts' mean is the cell's middle, and theirs that of the cell's parts.
            let mean: DVec3 = (0..16).map(|part| jittered.cell(number, 4).part(part, 4).1).sum();
            off = [off[0] + angle / count as f64, off[1] + mean.angle_between(regular.of(number)) / count as f64];
        }
        // ∫∫ √(x² + y²) over a square of side 1 is 0.383.
        assert!((off[0] / side_rad - 0.383).abs() < 0.05, "{off:?} of {side_rad}");
        assert!(off[1] / side_rad < 0.05, "{off:?} of {side_rad}");
        assert!(regular.cell(9, 4).part(0, 1).1.distance(regular.of(9)) < 1e-12);
    }
}
