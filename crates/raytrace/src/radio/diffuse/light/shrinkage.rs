//! Empirical Bayes smoothing of the photon map: a patch's own estimate is weighed against that of its surroundings.
//!
//! Photons are counted: a dark patch's estimate is noise long before its neighbourhood's is. Patches form blocks of 4×4, blocks form
//! regions of 4×4. From its members' spread a block's own variation τ² is what counting photons does not explain, and every member is
//! drawn towards the block's mean by the share v/(τ² + v) that noise v has in what is seen of it (empirical Bayes). Where light varies,
//! at shadow edges and in corners, τ² is large and nothing happens; the power of every block and region stays what it was.

/// One of several estimates of the same kind.
#[derive(Clone, Copy, Debug)]
pub struct Member {
    pub area_m2: f64,
    /// Sum of its photons' powers.
    pub power: f64,
}

/// Weights of the members' own estimates against their common mean; `spread` is Σp²/Σp of the photons, the power of a typical one.
///
/// A member's noise is that of the mean's rate on its area, not of its own photons: a patch where none fell by chance is not certain.
pub fn own_shares(members: &[Member], spread: f64) -> Vec<f64> {
    let area_m2: f64 = members.iter().map(|m| m.area_m2).sum();
    let mean = members.iter().map(|m| m.power).sum::<f64>() / area_m2;
    let noise = |m: &Member| mean * spread / m.area_m2;
    let variance: f64 = members
        .iter()
        .map(|m| m.area_m2 * ((m.power / m.area_m2 - mean).powi(2) - noise(m) * (1.0 - m.area_m2 / area_m2)))
        .sum::<f64>()
        / area_m2;
    let own = variance.max(0.0);
    members.iter().map(|m| if mean > 0.0 { own / (own + noise(m)) } else { 1.0 }).collect()
}

/// Tables of sums, one of each member of a region, drawn towards their blocks and these towards the region; `power` and `squares` are the
/// places of Σp and Σp² in a table.
pub fn smooth(blocks: &mut [Vec<(f64, Vec<f32>)>], power: usize, squares: usize) {
    let wholes: Vec<(f64, Vec<f32>)> = blocks.iter().map(|block| pooled(block)).collect();
    let region = pooled(&wholes);
    let mut means = wholes.clone();
    draw(&mut means, &region, &region.1, power, squares);
    for ((block, whole), (_, mean)) in blocks.iter_mut().zip(&wholes).zip(&means) {
        draw(block, whole, mean, power, squares);
    }
}

/// Area and sums of all members together.
fn pooled(members: &[(f64, Vec<f32>)]) -> (f64, Vec<f32>) {
    let mut sum = vec![0f32; members[0].1.len()];
    for (_, table) in members {
        sum.iter_mut().zip(table).for_each(|(s, v)| *s += v);
    }
    (members.iter().map(|m| m.0).sum(), sum)
}

/// Draws the members' tables towards `target`, sums over all their area: what all of them say together, `whole`, or what is better known.
fn draw(members: &mut [(f64, Vec<f32>)], (area_m2, whole): &(f64, Vec<f32>), target: &[f32], power: usize, squares: usize) {
    if whole[power] <= 0.0 || members.len() < 2 {
        for (own_m2, table) in members {
            table.iter_mut().zip(target).for_each(|(v, t)| *v = scaled(*t, *own_m2 / area_m2));
        }
        return;
    }
    let described: Vec<Member> = members.iter().map(|m| Member { area_m2: m.0, power: f64::from(m.1[power]) }).collect();
    let shares = own_shares(&described, f64::from(whole[squares] / whole[power]));
    for ((own_m2, table), share) in members.iter_mut().zip(&shares) {
        let (own, common) = (*share as f32, ((1.0 - share) * *own_m2 / area_m2) as f32);
        table.iter_mut().zip(target).for_each(|(v, t)| *v = own * *v + common * t);
    }
    let kept: f64 = members.iter().map(|(_, table)| f64::from(table[power])).sum();
    if kept > 0.0 {
        let factor = f64::from(target[power]) / kept;
        members.iter_mut().flat_map(|(_, table)| table).for_each(|v| *v = scaled(*v, factor));
    }
}

fn scaled(value: f32, factor: f64) -> f32 {
    (f64::from(value) * factor) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    /// Photons of unit power on `true_rates` × area, counted.
    fn counted(rng: &mut Rng, true_rates: &[f64]) -> Vec<(f64, Vec<f32>)> {
        true_rates
            .iter()
            .map(|rate| {
                let mut n = 0;
                let mut left = (-rate).exp();
                let mut u = rng.uniform_f64();
                // Poisson numbers by their cumulative distribution.
                while u > left && n < 400 {
                    u -= left;
                    n += 1;
                    left *= rate / f64::from(n);
                }
                (1.0, vec![n as f32, n as f32])
            })
            .collect()
    }

    fn error(blocks: &[Vec<(f64, Vec<f32>)>], rates: &[Vec<f64>]) -> f64 {
        let pairs = blocks.iter().flatten().zip(rates.iter().flatten());
        pairs.map(|((_, t), r)| (f64::from(t[0]) - r).powi(2)).sum::<f64>()
    }

    #[test]
    fn even_light_is_smoothed_and_an_edge_is_kept() {
        let mut rng = Rng::keyed(5, 0, 0);
        let even = vec![vec![9.0; 16]; 16];
        // Half of every block lies in shadow.
        let edge = vec![(0..16).map(|i| if i % 4 < 2 { 200.0 } else { 2.0 }).collect::<Vec<f64>>(); 16];
        for (rates, at_most) in [(&even, 0.15), (&edge, 1.1)] {
            let (mut before, mut after) = (0.0, 0.0);
            for _ in 0..20 {
                let mut blocks: Vec<_> = rates.iter().map(|r| counted(&mut rng, r)).collect();
                before += error(&blocks, rates);
                let whole: f64 = blocks.iter().flatten().map(|b| f64::from(b.1[0])).sum();
                smooth(&mut blocks, 0, 1);
                after += error(&blocks, rates);
                let kept: f64 = blocks.iter().flatten().map(|b| f64::from(b.1[0])).sum();
                assert!((kept / whole - 1.0).abs() < 1e-5, "{whole} {kept}");
            }
            assert!(after < at_most * before, "{after} of {before}");
        }
    }
}
