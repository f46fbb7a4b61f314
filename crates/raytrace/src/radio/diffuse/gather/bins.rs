//! Power by direction, as a reader of some angular resolution tells it apart.

use crate::radio::lattice;
use glam::DVec3;
use rayon::prelude::*;

/// An octahedral map of the sphere, in bins about as wide as the resolution.
pub struct Bins {
    side: usize,
    bins: Vec<Bin>,
}

/// Power that arrives from the directions of a bin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bin {
    /// Sum over all arrivals.
    pub power: f64,
    /// Power of the strongest arrival and of the second strongest.
    pub largest: [f64; 2],
}

impl Bin {
    fn with(self, other: &Self) -> Self {
        let [first, second] = self.largest;
        let [other_first, other_second] = other.largest;
        let second = first.min(other_first).max(if first >= other_first { second } else { other_second });
        Self { power: self.power + other.power, largest: [first.max(other_first), second] }
    }
}

impl Bins {
    pub fn new(resolution_deg: f64) -> Self {
        let side = ((4.0 * std::f64::consts::PI).sqrt() / resolution_deg.to_radians()).ceil().clamp(4.0, 4096.0) as usize;
        Self { side, bins: vec![Bin::default(); side * side] }
    }

    pub fn at(&self, d: DVec3) -> usize {
        lattice::octahedral(d, self.side)
    }

    pub fn add(&mut self, direction: DVec3, power: f64) {
        let at = self.at(direction);
        self.bins[at] = self.bins[at].with(&Bin { power, largest: [power, 0.0] });
    }

    /// Every bin and the eight around it together, across the folds too.
    pub fn around(&self) -> Vec<Bin> {
        let last = self.side as i64 - 1;
        let folded = |x: i64, y: i64| {
            let (x, y) = if (0..=last).contains(&x) { (x, y) } else { (x.clamp(0, last), last - y) };
            let (x, y) = if (0..=last).contains(&y) { (x, y) } else { (last - x, y.clamp(0, last)) };
            &self.bins[(y * (last + 1) + x) as usize]
        };
        (0..self.bins.len() as i64)
            .into_par_iter()
            .map(|i| {
                let (x, y) = (i % (last + 1), i / (last + 1));
                let near = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (x + dx, y + dy)));
                near.fold(Bin::default(), |sum, (x, y)| sum.with(folded(x, y)))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_around_a_direction_hold_what_lies_near_it() {
        let mut rng = corf_scene::Rng::keyed(3, 0, 0);
        for _ in 0..2000 {
            let d = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
            let mut near =
                || (d + 0.4f64.to_radians() * DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize()).normalize();
            let mut bins = Bins::new(2.0);
            for power in [1.0, 4.0, 2.0, 3.0] {
                bins.add(near(), power);
            }
            bins.add(-d, 5.0);
            assert_eq!(bins.around()[bins.at(d)], Bin { power: 10.0, largest: [4.0, 3.0] }, "{d}");
        }
    }
}
