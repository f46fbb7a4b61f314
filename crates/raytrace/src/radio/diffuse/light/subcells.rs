//! Subcells: the distribution of light within a patch, or over the facets of a pool.
//!
//! A table holds what leaves a slot in every direction, as if light fell evenly on it. Behind slats, under furniture and in corners it
//! does not: what light cannot reach a receiver often cannot see either, and an even share of the light would be spent on it unseen
//! (in the lobby, 4 % of all that is mirrored once and then scattered; up to a quarter on frames and cushions). Photons are therefore
//! counted by subcell as well, and a slot's light is moved between its subcells as far as they differ by more than chance.

use super::patches::GRAINS;
use super::shrinkage::{Member, own_shares};
use std::ops::Range;

/// Slot and subcells of one side of a patch.
#[derive(Clone, Copy, Debug)]
pub struct SubcellRange {
    /// The slot.
    pub slot: u32,
    /// The first of the slot's subcells that are the patch's own.
    first: u32,
    /// Area of each of them, m².
    subcell_m2: f32,
    /// Those that lie open, a bit each; of a facet no larger than a subcell, none: it is one.
    open: u32,
}

impl SubcellRange {
    /// A home in a slot whose subcells so far are `taken`, for a side of this open area; returns how many it takes.
    pub fn new(slot: u32, taken: u32, area_m2: f64, open: u32, patch_m: f64) -> (Self, u32) {
        let is_subcell = open == 0 || area_m2 * GRAINS as f64 <= patch_m * patch_m;
        let (open, count, parts) = if is_subcell { (0, 1, 1) } else { (open, GRAINS as u32, open.count_ones()) };
        (Self { slot, first: taken, subcell_m2: (area_m2 / f64::from(parts)) as f32, open }, count)
    }

    /// The slot's subcell that a patch's subcell is.
    pub fn subcell(&self, subcell: usize) -> u32 {
        self.first + if self.is_subcell() { 0 } else { subcell as u32 }
    }

    /// Area of a patch's subcell, m².
    pub fn subcell_m2(&self, subcell: usize) -> f32 {
        if self.is_subcell() || self.open >> subcell & 1 == 1 { self.subcell_m2 } else { 0.0 }
    }

    /// The slot's subcells that are the patch's own.
    pub fn range(&self) -> Range<usize> {
        let first = self.first as usize;
        first..first + if self.is_subcell() { 1 } else { GRAINS }
    }

    /// Whether all of the patch is one subcell.
    pub fn is_subcell(&self) -> bool {
        self.open == 0
    }
}

/// Scattered power of every subcell, relative to its expected one.
///
/// `expected` is the power that light interpolated between patches would leave there, `found` the photons', `power` that of the whole
/// slot and `spread` that of a typical photon; `None` where they tell no more than chance.
pub fn weights(expected: &[f32], found: &[f32], power: f64, spread: f64) -> Option<Box<[f32]>> {
    let lit: Vec<usize> = (0..expected.len()).filter(|&i| expected[i] > 0.0).collect();
    let members: Vec<Member> =
        lit.iter().map(|&i| Member { area_m2: f64::from(expected[i]), power: f64::from(found[i]) }).collect();
    let (even, all) = members.iter().fold((0.0, 0.0), |(e, f), m| (e + m.area_m2, f + m.power));
    if members.is_empty() || all <= 0.0 || power <= 0.0 {
        return None;
    }
    let excess = power / even - 1.0;
    let whole = 1.0 + excess * (1.0 - spread / power / (excess * excess)).max(0.0);
    let shares = own_shares(&members, spread);
    if whole == 1.0 && shares.iter().all(|share| *share == 0.0) {
        return None;
    }
    let rate = all / even;
    let moved: Vec<f64> = members.iter().zip(&shares).map(|(m, s)| s * m.power / (m.area_m2 * rate) + (1.0 - s)).collect();
    let kept: f64 = members.iter().zip(&moved).map(|(m, w)| m.area_m2 * w).sum();
    let mut weights = vec![1.0; expected.len()].into_boxed_slice();
    for (i, w) in lit.into_iter().zip(moved) {
        weights[i] = (w * whole * even / kept) as f32;
    }
    Some(weights)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_light_stays_and_a_shaded_half_is_left_dark() {
        let expected = [1000.0f32; 20];
        let even: Vec<f32> = (0..20).map(|i| if i % 2 == 0 { 970.0 } else { 1030.0 }).collect();
        assert!(weights(&expected, &even, 20_000.0, 1.0).is_none());
        let half: Vec<f32> = (0..20).map(|i| if i < 10 { 2000.0 } else { 0.0 }).collect();
        let found = weights(&expected, &half, 20_000.0, 1.0).unwrap();
        let wanted = |i: usize| if i < 10 { 2.0 } else { 0.0 };
        assert!(found.iter().enumerate().all(|(i, w)| (w - wanted(i)).abs() < 1e-2), "{found:?}");
    }

    #[test]
    fn all_grains_together_send_what_the_slot_does() {
        let expected = [3.0f32, 0.0, 9.0, 6.0];
        let found = weights(&expected, &[300.0, 7.0, 100.0, 200.0], 5e4, 1.0).unwrap();
        let sent: f32 = expected.iter().zip(&found).map(|(e, w)| e * w).sum();
        assert!((sent / 5e4 - 1.0).abs() < 1e-3, "{sent}");
    }

    #[test]
    fn few_photons_move_little() {
        let expected = [0.16f32; 25];
        let mut found = [0.0f32; 25];
        (found[3], found[11], found[20]) = (1.0, 1.0, 2.0);
        let weights = weights(&expected, &found, 4.0, 1.0);
        assert!(weights.is_none_or(|w| w.iter().all(|w| *w > 0.6 && *w < 5.0)));
    }
}
