//! Low-discrepancy sample points: Owen-scrambled Sobol' pairs, padded to any dimension.
//!
//! Each pair of dimensions is the (0, 2)-sequence of Sobol' with its order shuffled and its digits scrambled by hash-based Owen
//! scrambling (Laine and Karras 2011; Burley, *Practical Hash-based Owen Scrambling*, JCGT 2020). Every power-of-two block of samples
//! is stratified in every pair; distinct pairs, pixels and frames are independent.

use corf_scene::Rng;

/// The sample points of one pixel.
#[derive(Clone, Debug)]
pub(super) struct Sampler {
    seed: u64,
    index: u32,
}

/// The stage of [`Rng::keyed`] that seeds pixels.
const STAGE_PIXEL: u64 = 0x11617;

/// Seed of all pixels of a frame.
pub(super) fn frame_seed(seed: u64, frame_key: u64) -> u64 {
    Rng::keyed(seed, STAGE_PIXEL, frame_key).next_u64()
}

impl Sampler {
    /// The sampler of pixel number `pixel` of a frame.
    pub fn new(seed: u64, frame_key: u64, pixel: u64) -> Self {
        Self::of_item(frame_seed(seed, frame_key), pixel)
    }

    /// The sampler of an item under a frame's seed.
    pub fn of_item(frame_seed: u64, item: u64) -> Self {
        Self { seed: Rng::keyed(frame_seed, STAGE_PIXEL, item).next_u64(), index: 0 }
    }

    /// Begins sample `index`.
    pub fn start(&mut self, index: u32) {
        self.index = index;
    }

    /// Pair number `dimension` of this sample, each in `[0, 1)`.
    #[inline]
    pub fn pair(&self, dimension: u32) -> [f32; 2] {
        let key = mix(self.seed ^ (u64::from(dimension) << 32));
        let shuffled = scramble(self.index.reverse_bits(), key as u32).reverse_bits();
        let x = scramble(shuffled, (key >> 32) as u32);
        let y = scramble(second_dimension(shuffled), (key >> 16) as u32 ^ 0x9e37_79b9);
        [unit(x.reverse_bits()), unit(y.reverse_bits())]
    }
}

/// Bits to `[0, 1)`, 24 of them.
#[inline(always)]
fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 * (1.0 / 16_777_216.0)
}

/// A finaliser with full avalanche (SplitMix64's).
#[inline(always)]
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A hash in which a bit only changes higher bits: on reversed digits, a nested uniform (Owen) scramble. The even factors are
/// arbitrary; the tests hold the property that makes it valid.
#[inline(always)]
fn scramble(mut x: u32, seed: u32) -> u32 {
    x = x.wrapping_add(seed);
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_mul((seed >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x
}

/// Digits of Sobol's second dimension, least significant first: the Pascal matrix modulo 2 applied to the index's bits, which is the
/// XOR over all supersets of each bit's position.
#[inline(always)]
fn second_dimension(mut v: u32) -> u32 {
    v ^= (v >> 1) & 0x5555_5555;
    v ^= (v >> 2) & 0x3333_3333;
    v ^= (v >> 4) & 0x0f0f_0f0f;
    v ^= (v >> 8) & 0x00ff_00ff;
    v ^ (v >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_power_of_two_block_is_a_net_in_every_pair() {
        for (pixel, log) in [(0u64, 4u32), (1, 5), (77, 6), (1234, 8)] {
            let n = 1u32 << log;
            for dimension in 0..5 {
                let points: Vec<[f32; 2]> = (0..n)
                    .map(|i| {
                        let mut s = Sampler::new(3, 9, pixel);
                        s.start(i);
                        s.pair(dimension)
                    })
                    .collect();
                // Each of the n elementary intervals 2^-a × 2^-b, a + b = log, holds exactly one point.
                for a in 0..=log {
                    let (nx, ny) = (1 << a, 1 << (log - a));
                    let mut seen = vec![0; n as usize];
                    for p in &points {
                        seen[(p[0] * nx as f32) as usize * ny + (p[1] * ny as f32) as usize] += 1;
                    }
                    assert!(seen.iter().all(|c| *c == 1), "pixel {pixel}, pair {dimension}, {nx} x {ny}: {seen:?}");
                }
            }
        }
    }

    #[test]
    fn pixels_and_pairs_are_uncorrelated() {
        // The first point over many pixels is uniform: mean and covariance within five standard errors.
        let n = 20_000;
        let draws: Vec<[f32; 4]> = (0..n)
            .map(|i| {
                let mut s = Sampler::new(1, 2, i);
                s.start(0);
                let (a, b) = (s.pair(0), s.pair(1));
                [a[0], a[1], b[0], b[1]]
            })
            .collect();
        for a in 0..4 {
            for b in 0..=a {
                let mean = |f: &dyn Fn(&[f32; 4]) -> f64| draws.iter().map(f).sum::<f64>() / n as f64;
                let covariance = mean(&|d| (f64::from(d[a]) - 0.5) * (f64::from(d[b]) - 0.5));
                let expected = if a == b { 1.0 / 12.0 } else { 0.0 };
                assert!((covariance - expected).abs() < 5.0 * (1.0 / 12.0) / (n as f64).sqrt(), "{a} {b} {covariance}");
            }
        }
    }
}
