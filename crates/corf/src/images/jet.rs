//! Levels of many Jet colours at once.

use crate::simd::{Isa, Kernel, Lanes};
use corf_scene::color::{Segment, jet_segments};

/// Lanes of the widest instruction set.
const MOST_LANES: usize = 16;

/// [`scalar_from_jet`](corf_scene::color::scalar_from_jet) of colours that lie one behind the other, bit for bit: nothing is fused, so that every
/// instruction set rounds alike.
pub(crate) fn levels(colours: &[f32]) -> Vec<f32> {
    levels_on(Isa::detect(), colours)
}

fn levels_on(isa: Isa, colours: &[f32]) -> Vec<f32> {
    let mut levels = vec![0.0; colours.len() / 3];
    isa.dispatch(Nearest { curve: jet_segments(), colours, levels: &mut levels });
    levels
}

/// The nearest points of a curve to some colours.
struct Nearest<'a> {
    curve: &'a [Segment],
    colours: &'a [f32],
    levels: &'a mut [f32],
}

impl Kernel for Nearest<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let mut rgb = [[0.0; MOST_LANES]; 3];
        let mut found = [0.0; MOST_LANES];
        for (colours, levels) in self.colours.chunks(3 * L::WIDTH).zip(self.levels.chunks_mut(L::WIDTH)) {
            for (i, colour) in colours.chunks_exact(3).enumerate() {
                (rgb[0][i], rgb[1][i], rgb[2][i]) = (colour[0], colour[1], colour[2]);
            }
            nearest::<L>(self.curve, [L::load(&rgb[0]), L::load(&rgb[1]), L::load(&rgb[2])]).store(&mut found);
            levels.copy_from_slice(&found[..levels.len()]);
        }
    }
}

/// The scalars of the nearest points, segment by segment.
#[inline(always)]
fn nearest<L: Lanes>(curve: &[Segment], [r, g, b]: [L; 3]) -> L {
    let (mut least, mut scalars) = (L::splat(f32::INFINITY), L::splat(0.0));
    for segment in curve {
        let [x, y, z] = segment.start.map(L::splat);
        let [dx, dy, dz] = segment.direction.map(L::splat);
        let along = (r - x) * dx + (g - y) * dy + (b - z) * dz;
        let t = (along / L::splat(segment.length2)).max(L::splat(0.0)).min(L::splat(1.0));
        let [off_r, off_g, off_b] = [x + t * dx - r, y + t * dy - g, z + t * dz - b];
        let distance2 = off_r * off_r + off_g * off_g + off_b * off_b;
        // False of what is no number.
        let is_nearer = least.gt(distance2);
        least = L::select(is_nearer, distance2, least);
        scalars = L::select(is_nearer, L::splat(segment.scalar) + t * L::splat(segment.length), scalars);
    }
    scalars
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::{Rng, color};

    #[test]
    fn many_at_once_are_each_alone_on_every_instruction_set() {
        let mut rng = Rng::keyed(1, 0, 0);
        let off_the_curve = (0..30_000).map(|_| 1.4 * rng.uniform() - 0.2).collect::<Vec<_>>();
        let on_it = (0..=1000).flat_map(|i| color::jet(i as f32 / 1000.0));
        let corners = (0..27).flat_map(|i| [i % 3, i / 3 % 3, i / 9].map(|v| 0.5 * v as f32));
        let no_numbers = [f32::NAN, 0.5, 0.5, 0.0, f32::INFINITY, 0.0, 1.0, 0.0, f32::NEG_INFINITY, 1e30, -1e30, -0.0];
        let colours: Vec<f32> = off_the_curve.into_iter().chain(on_it).chain(corners).chain(no_numbers).collect();
        let alone: Vec<u32> = colours.chunks_exact(3).map(|c| color::scalar_from_jet([c[0], c[1], c[2]]).to_bits()).collect();
        for isa in Isa::available() {
            // A count that no width divides, and fewer than one width.
            for count in [alone.len(), 5, 0] {
                let together: Vec<u32> = levels_on(isa, &colours[..3 * count]).into_iter().map(f32::to_bits).collect();
                assert!(together == alone[..count], "{isa:?}, {count}");
            }
        }
    }
}
