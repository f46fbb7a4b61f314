//! Firefly clamp: caps single arrivals far above the power of their angular neighbourhood.
//!
//! A facet that a direction meets once in a hundred samplings counts a hundredfold when it is met, and then outweighs all that a reader sees
//! around it. A hundred samplings are right together; each of them is closer to the truth without the thing than with it. So a single
//! arrival that brings much more than all others around it together, and more than any one of them, brings no more than a share of theirs,
//! and what is cut goes to all arrivals in proportion: power is kept, and what several directions agree on stays as it is. The pixels that lose
//! are the rare thing's, by what it brings on average; the more directions, the less an arrival has that could be cut, so the bias ends with
//! the error. Renderers of light know it as the rejection of fireflies (DeCoro, Weyrich and Rusinkiewicz, Computer Graphics Forum 29, 2010).

use super::bins::Bins;
use crate::radio::Arrival;

/// Least power of an arrival's neighbourhood, as a share of the brightest one's, for the arrival to be capped: beside nothing brighter than
/// this, an arrival is all there is to see, and stays.
const FAINTEST: f64 = 1e-3;

/// Cuts arrivals of more than `most_share` of what else arrives within the reader's resolution around them, degrees.
pub fn cut(arrivals: &mut [Arrival], resolution_deg: f64, most_share: f64) {
    let mut bins = Bins::new(resolution_deg);
    arrivals.iter().for_each(|a| bins.add(a.direction, a.power));
    let around = bins.around();
    let faintest = FAINTEST * around.iter().fold(0.0, |most: f64, near| most.max(near.power));
    let (mut whole, mut left) = (0.0, 0.0);
    for arrival in &mut *arrivals {
        whole += arrival.power;
        let near = &around[bins.at(arrival.direction)];
        let others = near.power - arrival.power;
        if others > faintest {
            let other = if arrival.power < near.largest[0] { near.largest[0] } else { near.largest[1] };
            arrival.power = arrival.power.min(other.max(most_share * others));
        }
        left += arrival.power;
    }
    if left < whole {
        arrivals.iter_mut().for_each(|a| a.power *= whole / left);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::lattice;
    use glam::DVec3;

    const COUNT: usize = 5_000;

    /// Arrivals of power 1 from all directions of a uniform lattice.
    fn even() -> Vec<Arrival> {
        let direction = |i| lattice::fibonacci(i, COUNT);
        (0..COUNT).map(|i| Arrival { direction: direction(i), power: 1.0, delay_s: 1e-8, object: 0, phase_rad: None }).collect()
    }

    fn power(arrivals: &[Arrival]) -> f64 {
        arrivals.iter().map(|a| a.power).sum()
    }

    #[test]
    fn one_that_outweighs_all_around_it_is_cut_and_its_power_goes_to_all() {
        let mut arrivals = even();
        arrivals[700].power = 1000.0;
        let before = power(&arrivals);
        cut(&mut arrivals, 4.0, 0.1);
        assert!((power(&arrivals) / before - 1.0).abs() < 1e-12);
        // Nine bins of some 4° hold 15 to 30 others.
        let others = arrivals[0].power;
        assert!((before / COUNT as f64 / others - 1.0).abs() < 1e-2, "{others}");
        assert!((1.0..4.0).contains(&(arrivals[700].power / others)), "{}", arrivals[700].power / others);
    }

    #[test]
    fn what_several_agree_on_stays_and_so_does_what_stands_alone() {
        let mut arrivals = even();
        let near = (0..COUNT).filter(|&i| arrivals[i].direction.angle_between(DVec3::Y) < 0.06).collect::<Vec<_>>();
        assert!(near.len() > 2);
        near.iter().for_each(|&i| arrivals[i].power = 1000.0);
        let before = arrivals.clone();
        cut(&mut arrivals, 4.0, 0.1);
        assert_eq!(arrivals, before);
        let mut alone = before[near[0]..=near[0]].to_vec();
        cut(&mut alone, 4.0, 0.1);
        assert_eq!(alone[0], before[near[0]]);
        cut(&mut [], 4.0, 0.1);
    }
}
