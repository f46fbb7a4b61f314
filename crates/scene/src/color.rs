//! Colour: the sRGB transfer function and the Jet map in which RF spectra are published.

use std::sync::LazyLock;

/// Exposed radiance up to which images are linear; above it highlights roll off towards 1. What develops images and what describes them share it.
pub const TONE_KNEE: f32 = 0.6;

/// sRGB encoding of linear light (IEC 61966-2-1), both in `[0, 1]`; values outside are clamped.
pub fn srgb_from_linear(linear: f32) -> f32 {
    let l = linear.clamp(0.0, 1.0);
    if l <= 0.003_130_8 { 12.92 * l } else { 1.055 * l.powf(1.0 / 2.4) - 0.055 }
}

/// Linear light of an sRGB value in `[0, 1]` (IEC 61966-2-1).
pub fn linear_from_srgb(srgb: f32) -> f32 {
    let s = srgb.clamp(0.0, 1.0);
    if s <= 0.040_45 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
}

/// `[0, 1]` to 8 bits, rounding to nearest.
pub fn quantize8(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// Piecewise-linear interpolation through `(x, y)` knots, constant outside.
fn through(knots: &[(f32, f32)], x: f32) -> f32 {
    let after = knots.partition_point(|k| k.0 <= x);
    if after == 0 {
        return knots[0].1;
    }
    if after == knots.len() {
        return knots[after - 1].1;
    }
    let (a, b) = (knots[after - 1], knots[after]);
    a.1 + (b.1 - a.1) * (x - a.0) / (b.0 - a.0)
}

/// The Jet colour of a scalar in `[0, 1]` (matplotlib's breakpoints, continuous rather than tabulated), RGB in `[0, 1]`.
pub fn jet(scalar: f32) -> [f32; 3] {
    let s = scalar.clamp(0.0, 1.0);
    [
        through(&[(0.35, 0.0), (0.66, 1.0), (0.89, 1.0), (1.0, 0.5)], s),
        through(&[(0.125, 0.0), (0.375, 1.0), (0.64, 1.0), (0.91, 0.0)], s),
        through(&[(0.0, 0.5), (0.11, 1.0), (0.34, 1.0), (0.65, 0.0)], s),
    ]
}

/// The viridis colour of a scalar in `[0, 1]` (nine of matplotlib's points, linear between), RGB in `[0, 1]`: evenly rising lightness.
pub fn viridis(scalar: f32) -> [f32; 3] {
    const POINTS: [[f32; 3]; 9] = [
        [68.0, 1.0, 84.0],
        [71.0, 44.0, 122.0],
        [59.0, 81.0, 139.0],
        [44.0, 113.0, 142.0],
        [33.0, 144.0, 141.0],
        [39.0, 173.0, 129.0],
        [92.0, 200.0, 99.0],
        [170.0, 220.0, 50.0],
        [253.0, 231.0, 37.0],
    ];
    let along = scalar.clamp(0.0, 1.0) * 8.0;
    let i = (along as usize).min(7);
    let t = along - i as f32;
    std::array::from_fn(|c| (POINTS[i][c] + t * (POINTS[i + 1][c] - POINTS[i][c])) / 255.0)
}

/// The Jet colour of a scalar in `[0, 1]` as OpenCV and MATLAB have it: three equal trapezoids a quarter apart, RGB in `[0, 1]`.
pub fn jet_of_trapezoids(scalar: f32) -> [f32; 3] {
    let s = 4.0 * scalar.clamp(0.0, 1.0);
    [3.0, 2.0, 1.0].map(|middle| (1.5 - (s - middle).abs()).clamp(0.0, 1.0))
}

/// A straight piece of a curve of colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Scalar of its beginning.
    pub scalar: f32,
    /// How much the scalar grows along it.
    pub length: f32,
    /// Colour of its beginning.
    pub start: [f32; 3],
    /// Colour of its end, less that of its beginning.
    pub direction: [f32; 3],
    /// Square of the distance between both colours.
    pub length2: f32,
}

/// Jet is piecewise linear between these scalars.
static JET: LazyLock<Vec<Segment>> =
    LazyLock::new(|| segments(&[0.0, 0.11, 0.125, 0.34, 0.35, 0.375, 0.64, 0.65, 0.66, 0.89, 0.91, 1.0], jet));
static JET_OF_TRAPEZOIDS: LazyLock<Vec<Segment>> =
    LazyLock::new(|| segments(&[0.0, 0.125, 0.375, 0.625, 0.875, 1.0], jet_of_trapezoids));

/// The pieces of [`jet`], in the order of scalars.
pub fn jet_segments() -> &'static [Segment] {
    &JET
}

/// The scalar in `[0, 1]` whose Jet colour is nearest to `rgb` in the Euclidean sense: exact on the curve, the projection off it. Of equally near
/// ones it is the smallest; of a colour that is no number it is 0.
pub fn scalar_from_jet(rgb: [f32; 3]) -> f32 {
    nearest_on(&JET, rgb)
}

/// The scalar in `[0, 1]` whose colour by [`jet_of_trapezoids`] is nearest to `rgb`, as [`scalar_from_jet`] has it.
pub fn scalar_from_jet_of_trapezoids(rgb: [f32; 3]) -> f32 {
    nearest_on(&JET_OF_TRAPEZOIDS, rgb)
}

/// The pieces of a curve that is straight between `knots`.
fn segments(knots: &[f32], curve: fn(f32) -> [f32; 3]) -> Vec<Segment> {
    let segment = |ends: &[f32]| {
        let (start, end) = (curve(ends[0]), curve(ends[1]));
        let direction = [0, 1, 2].map(|c| end[c] - start[c]);
        let length2 = direction.iter().fold(0.0, |sum, d| sum + d * d);
        Segment { scalar: ends[0], length: ends[1] - ends[0], start, direction, length2 }
    };
    knots.windows(2).map(segment).collect()
}

/// The scalar of the point nearest to `rgb` on a curve, segment by segment.
fn nearest_on(curve: &[Segment], rgb: [f32; 3]) -> f32 {
    let mut best = (f32::INFINITY, 0.0);
    for Segment { scalar, length, start, direction, length2 } in curve {
        let along = (0..3).fold(0.0, |sum, c| sum + (rgb[c] - start[c]) * direction[c]);
        let t = (along / length2).clamp(0.0, 1.0);
        let distance2: f32 = (0..3).map(|c| (start[c] + t * direction[c] - rgb[c]).powi(2)).sum();
        if distance2 < best.0 {
            best = (distance2, scalar + t * length);
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jet_is_inverted_within_half_an_8_bit_step() {
        for i in 0..=1000 {
            let s = i as f32 / 1000.0;
            let c = jet(s).map(|v| f32::from(quantize8(v)) / 255.0);
            // Between 0.11 and 0.125 the map is one colour, pure blue: there the scalar is known to that interval only.
            let tolerance = if (0.11..=0.125).contains(&s) { 0.015 + 0.5 / 255.0 } else { 0.5 / 255.0 };
            assert!((scalar_from_jet(c) - s).abs() < tolerance, "{s}");
        }
    }

    #[test]
    fn jet_is_matplotlibs() {
        // matplotlib 3.11, matplotlib.colormaps["jet"](level, bytes=True), R G B: eight bits are cut there.
        for (level, rgb) in [
            (0u8, [0, 0, 127]),
            (16, [0, 0, 200]),
            (64, [0, 128, 255]),
            (90, [2, 232, 244]),
            (96, [21, 255, 225]),
            (128, [124, 255, 121]),
            (160, [228, 255, 18]),
            (191, [255, 152, 0]),
            (224, [255, 29, 0]),
            (255, [127, 0, 0]),
        ] {
            for (own, other) in jet(f32::from(level) / 255.0).iter().zip(rgb) {
                assert!((-0.01..1.01).contains(&(255.0 * own - other as f32)), "{level}: {own}");
            }
        }
    }

    #[test]
    fn read_as_the_other_jet_a_level_is_off_by_nine_of_255() {
        let (mut colours, mut levels) = (0.0_f32, [0.0_f32; 2]);
        for i in 0..=255 {
            let level = i as f32 / 255.0;
            let (ours, theirs) = (jet(level), jet_of_trapezoids(level));
            (0..3).for_each(|c| colours = colours.max(255.0 * (ours[c] - theirs[c]).abs()));
            levels[0] = levels[0].max(255.0 * (scalar_from_jet(theirs) - level).abs());
            levels[1] = levels[1].max(255.0 * (scalar_from_jet_of_trapezoids(ours) - level).abs());
        }
        assert_eq!(colours.round(), 33.0);
        assert!(levels.iter().all(|off| (8.0..=9.5).contains(off)), "{levels:?}");
    }

    #[test]
    fn the_jet_of_trapezoids_is_opencvs() {
        // OpenCV 5.0, cv2.applyColorMap(COLORMAP_JET), R G B at these levels of 255.
        for (level, rgb) in [
            (0u8, [0, 0, 128]),
            (1, [0, 0, 132]),
            (31, [0, 0, 252]),
            (64, [0, 128, 255]),
            (96, [2, 255, 254]),
            (127, [126, 255, 130]),
            (159, [254, 255, 1]),
            (191, [255, 128, 0]),
            (224, [252, 0, 0]),
            (255, [128, 0, 0]),
        ] {
            let own = jet_of_trapezoids(f32::from(level) / 255.0);
            for (own, other) in own.iter().zip(rgb) {
                assert!((255.0 * own - other as f32).abs() <= 0.501, "{level}: {own}");
            }
            assert!((scalar_from_jet_of_trapezoids(own) - f32::from(level) / 255.0).abs() < 1e-5, "{level}");
        }
    }

    #[test]
    fn viridis_grows_lighter_all_along() {
        let lightness = |i: i32| {
            let [r, g, b] = viridis(i as f32 / 100.0).map(linear_from_srgb);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        assert!((1..=100).all(|i| lightness(i) > lightness(i - 1)));
    }

    #[test]
    fn jet_floor_is_half_blue() {
        assert_eq!(jet(0.0), [0.0, 0.0, 0.5]);
    }

    #[test]
    fn srgb_round_trips() {
        for i in 0..=255u8 {
            let v = f32::from(i) / 255.0;
            assert!((srgb_from_linear(linear_from_srgb(v)) - v).abs() < 1e-5);
        }
    }
}
