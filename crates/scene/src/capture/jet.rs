//! Which Jet a set of pictures is painted in, and how far its levels can be trusted.
//!
//! There are two Jets: matplotlib's, and three equal trapezoids in OpenCV and MATLAB. Read as the other, a level is off by up to 3.5 % of the range.
//! Most programs paint from a table of 256 colours of the curve, whose steps give a picture away even where both curves have the same colours; this
//! program paints from matplotlib's curve without one. What fits is measured over all pictures, and so is what is left over.

use crate::{Raster, color};
use std::sync::LazyLock;

/// A Jet and how pictures are painted in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Jet {
    /// matplotlib's curve.
    Matplotlib,
    /// matplotlib's table of 256 colours.
    MatplotlibTable,
    /// The trapezoids, without a table.
    Trapezoids,
    /// OpenCV's table: the trapezoids at i/255.
    OpenCv,
    /// MATLAB's table: the trapezoids at (i + 1)/256.
    Matlab,
}

/// Those painted from a table, in the order in which one is taken of several that fit equally well.
const TABLES: [Jet; 3] = [Jet::MatplotlibTable, Jet::OpenCv, Jet::Matlab];
/// Those painted from the curve.
const CURVES: [Jet; 2] = [Jet::Matplotlib, Jet::Trapezoids];
/// Colours of a table.
const COLOURS: usize = 256;
/// One step of eight bits.
const STEP: f32 = 1.0 / 255.0;

/// Pixels of a picture that are compared with all Jets: enough to tell them apart, few enough for sets of a hundred thousand.
const SAMPLES: usize = 4096;
/// Share of pixels that may be off a table in which a picture is painted: markers, a scale bar.
const STRAY: f64 = 0.01;
/// A Jet fits as well as the best if its colours are not further off than this many times: of thousands of pixels, twice that is no chance.
const AS_GOOD: f64 = 1.02;
/// Mean distance from a Jet's colours above which a picture is not painted in it, of full scale: eight bits are off by 0.002, other maps by more than
/// 0.1.
const LARGEST_MISS: f64 = 0.05;
/// Distance (rms) above which colours were changed after they were painted; eight bits alone are off by less.
const CHANGED: f64 = 1.0 / 255.0;
/// Least change of a channel along a Jet, of its full scale: matplotlib's red rises over 0.31 of the range.
const LEAST_SLOPE: f64 = 1.0 / 0.31;

/// Pure blue, which matplotlib's Jet is at all scalars from 0.11 to 0.125, and their middle.
const ONE_COLOUR: ([f32; 3], f32) = ([0.0, 0.0, 1.0], 0.1175);

type Colour = [f32; 3];

static COLOURS_OF_TABLES: LazyLock<[Vec<Colour>; 3]> =
    LazyLock::new(|| TABLES.map(|jet| (0..COLOURS).map(|i| jet.of_table(i)).collect()));

impl Jet {
    /// Colour `i` of its table.
    fn of_table(self, i: usize) -> Colour {
        let level = i as f32 * STEP;
        match self {
            Self::Matplotlib | Self::MatplotlibTable => color::jet(level),
            Self::Trapezoids | Self::OpenCv => color::jet_of_trapezoids(level),
            Self::Matlab => color::jet_of_trapezoids((i + 1) as f32 / COLOURS as f32),
        }
    }

    /// The level in `[0, 1]` of a colour, RGB in `[0, 1]`.
    pub fn level(self, rgb: Colour) -> f32 {
        match self {
            Self::Matplotlib | Self::MatplotlibTable if rgb == ONE_COLOUR.0 => ONE_COLOUR.1,
            Self::Matplotlib => color::scalar_from_jet(rgb),
            Self::Trapezoids => color::scalar_from_jet_of_trapezoids(rgb),
            Self::MatplotlibTable => nearest(&COLOURS_OF_TABLES[0], rgb).0 as f32 * STEP,
            Self::OpenCv => nearest(&COLOURS_OF_TABLES[1], rgb).0 as f32 * STEP,
            Self::Matlab => nearest(&COLOURS_OF_TABLES[2], rgb).0 as f32 * STEP,
        }
    }

    /// Its name, with the program that paints in it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Matplotlib => "matplotlib's Jet",
            Self::MatplotlibTable => "matplotlib's Jet of 256 colours",
            Self::Trapezoids => "OpenCV's and MATLAB's Jet",
            Self::OpenCv => "OpenCV's Jet of 256 colours",
            Self::Matlab => "MATLAB's Jet of 256 colours",
        }
    }

    fn is_table(self) -> bool {
        TABLES.contains(&self)
    }

    fn is_matplotlib(self) -> bool {
        matches!(self, Self::Matplotlib | Self::MatplotlibTable)
    }
}

/// The nearest of some colours, and its squared distance.
fn nearest(colours: &[Colour], rgb: Colour) -> (usize, f32) {
    let distance2 = |c: &Colour| (0..3).map(|k| (c[k] - rgb[k]).powi(2)).sum::<f32>();
    let each = colours.iter().map(distance2).enumerate();
    each.min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, f32::INFINITY))
}

/// Whether a colour is one of a table in eight bits, rounded or cut.
fn is_of(table: Colour, rgb: Colour) -> bool {
    (0..3).all(|c| (-1.01..=0.51).contains(&((rgb[c] - table[c]) / STEP)))
}

/// Pixels as one Jet has them.
#[derive(Clone, Copy, Debug, Default)]
struct Fit {
    /// Sum of squared distances.
    squares: f64,
    /// Pixels that are none of its table.
    stray: usize,
}

/// How pictures compare with all Jets; those of several pictures add up.
#[derive(Clone, Debug, Default)]
pub(super) struct Measured {
    pixels: usize,
    tables: [Fit; 3],
    curves: [Fit; 2],
    /// Sums of the squared differences between the levels that two Jets give pixels: tables first.
    apart: [[f64; 5]; 5],
}

impl Measured {
    /// Compares a picture, RGB in `[0, 1]`.
    ///
    /// # Errors
    /// It is painted in no Jet: what it looks like.
    pub fn of(picture: &Raster<Colour>) -> Result<Self, String> {
        let stride = picture.pixels().len().div_ceil(SAMPLES).max(1);
        let mut measured = Self::default();
        let (mut misses, mut others) = ([0.0; 2], [0.0; OTHERS.len()]);
        for &rgb in picture.pixels().iter().step_by(stride) {
            measured.pixels += 1;
            for (k, fit) in measured.tables.iter_mut().enumerate() {
                let (i, distance2) = nearest(&COLOURS_OF_TABLES[k], rgb);
                fit.squares += f64::from(distance2);
                fit.stray += usize::from(!is_of(COLOURS_OF_TABLES[k][i], rgb));
            }
            let levels: [f32; 5] = std::array::from_fn(|k| TABLES.iter().chain(&CURVES).nth(k).map_or(0.0, |jet| jet.level(rgb)));
            for (k, fit) in measured.curves.iter_mut().enumerate() {
                let own = if k == 0 { color::jet(levels[3]) } else { color::jet_of_trapezoids(levels[4]) };
                fit.squares += (0..3).map(|c| f64::from(own[c] - rgb[c]).powi(2)).sum::<f64>();
                misses[k] += miss(own, rgb);
            }
            for (a, b) in (0..5).flat_map(|a| (0..5).map(move |b| (a, b))) {
                measured.apart[a][b] += f64::from(levels[a] - levels[b]).powi(2);
            }
        }
        let count = measured.pixels as f64;
        let own = misses[0].min(misses[1]) / count;
        if own <= CHANGED {
            return Ok(measured);
        }
        for &rgb in picture.pixels().iter().step_by(stride) {
            for (sum, (_, knots)) in others.iter_mut().zip(OTHERS) {
                *sum += nearest_of(knots, rgb);
            }
        }
        let other = others.iter().zip(OTHERS).min_by(|a, b| a.0.total_cmp(b.0)).map(|(sum, (name, _))| (sum / count, *name));
        match other {
            Some((off, name)) if off < 0.5 * own => Err(format!(
                "its colours look like {name} and are neither grey nor Jet ({:.0} % off Jet on average)",
                100.0 * own
            )),
            _ if own > LARGEST_MISS => {
                Err(format!("its colours are neither grey nor Jet ({:.0} % off Jet on average)", 100.0 * own))
            }
            _ => Ok(measured),
        }
    }

    /// These and another picture's.
    pub fn and(mut self, other: &Self) -> Self {
        self.pixels += other.pixels;
        let add = |a: &mut Fit, b: &Fit| *a = Fit { squares: a.squares + b.squares, stray: a.stray + b.stray };
        self.tables.iter_mut().zip(&other.tables).for_each(|(a, b)| add(a, b));
        self.curves.iter_mut().zip(&other.curves).for_each(|(a, b)| add(a, b));
        self.apart.as_flattened_mut().iter_mut().zip(other.apart.as_flattened()).for_each(|(a, b)| *a += b);
        self
    }

    /// The Jet that fits best.
    pub fn choice(&self) -> Choice {
        let count = self.pixels.max(1) as f64;
        let off = |fit: &Fit| (fit.squares / count).sqrt();
        // All that fit as well as the best, best first, each with its place in `apart`.
        let of_tables = self.tables.iter().enumerate().filter(|(_, fit)| fit.stray as f64 <= STRAY * count);
        let mut fitting: Vec<(usize, f64)> = of_tables.map(|(k, fit)| (k, off(fit))).collect();
        if fitting.is_empty() {
            let curves = self.curves.map(|fit| off(&fit));
            let most = AS_GOOD * curves[0].min(curves[1]);
            fitting =
                curves.into_iter().enumerate().filter(|(_, off)| *off <= most).map(|(k, off)| (k + TABLES.len(), off)).collect();
        }
        fitting.sort_by(|a, b| a.1.total_cmp(&b.1));
        let (best, off) = fitting.first().copied().unwrap_or((TABLES.len(), 0.0));
        let jet = TABLES.iter().chain(&CURVES).nth(best).copied().unwrap_or(Jet::Matplotlib);
        let ambiguity = fitting.iter().map(|(k, _)| (self.apart[best][*k] / count).sqrt()).fold(0.0, f64::max);
        Choice { jet, off, ambiguity }
    }
}

/// The Jet of a set of pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Choice {
    /// Which one.
    pub jet: Jet,
    /// Distance of the pictures' colours from it, root mean square, of full scale.
    pub off: f64,
    /// Difference to the levels by another Jet that fits as well, root mean square, of the range.
    pub ambiguity: f64,
}

impl Choice {
    /// Whether colours were changed after they were painted.
    pub fn is_changed(&self) -> bool {
        self.off > CHANGED
    }

    /// How far levels may be off, of the range: the step of the table or half of that of eight bits, what another Jet would have it, and what the
    /// measured distance amounts to along the curve.
    pub fn error(&self) -> f64 {
        let step = f64::from(STEP) * if self.jet.is_table() { 1.0 } else { 0.5 };
        step + self.ambiguity + if self.is_changed() { self.off / LEAST_SLOPE } else { 0.0 }
    }

    /// What was found, in words; `range_db` is the width of the range.
    pub fn words(&self, range_db: f64) -> String {
        let mut text = format!(
            "painted in {}, from whose colours they are {:.1} of 255 off (rms): levels are right to {:.2} dB",
            self.jet.name(),
            255.0 * self.off,
            self.error() * range_db
        );
        if self.jet.is_matplotlib() {
            text += &format!(", and to {:.2} dB between 11 and 12.5 % of the range, where it is one colour", 0.0075 * range_db);
        }
        if self.ambiguity > f64::from(STEP) {
            text += "; another Jet has the same colours at other levels, and nothing tells which it is";
        }
        if self.is_changed() {
            text += "; colours were changed after they were painted, as by lossy compression (JPEG) or a change of size";
        }
        text
    }
}

fn miss(a: Colour, b: Colour) -> f64 {
    (0..3).map(|c| f64::from(a[c] - b[c]).abs()).fold(0.0, f64::max)
}

/// Points along other colour maps, of 255, by which they are known.
const OTHERS: &[(&str, &[[u8; 3]])] = &[
    (
        "viridis",
        &[
            [68, 1, 84],
            [71, 44, 122],
            [59, 81, 139],
            [44, 113, 142],
            [33, 144, 141],
            [39, 173, 129],
            [92, 200, 99],
            [170, 220, 50],
            [253, 231, 37],
        ],
    ),
    (
        "turbo",
        &[
            [48, 18, 59],
            [67, 78, 186],
            [69, 132, 249],
            [40, 187, 235],
            [26, 228, 182],
            [85, 250, 118],
            [164, 252, 59],
            [216, 227, 53],
            [249, 186, 56],
            [251, 128, 34],
            [229, 70, 10],
            [185, 30, 1],
            [122, 4, 2],
        ],
    ),
    ("plasma", &[[12, 7, 134], [92, 0, 165], [155, 23, 158], [203, 71, 119], [236, 120, 83], [253, 178, 47], [239, 248, 33]]),
    ("inferno", &[[0, 0, 3], [50, 9, 93], [120, 28, 109], [187, 55, 84], [237, 104, 37], [251, 179, 24], [252, 254, 164]]),
    ("magma", &[[0, 0, 3], [43, 17, 94], [113, 31, 129], [182, 54, 121], [240, 96, 93], [254, 174, 118], [251, 252, 191]]),
    ("cividis", &[[0, 34, 77], [67, 78, 107], [124, 123, 120], [186, 172, 108], [253, 231, 55]]),
    ("hot", &[[10, 0, 0], [255, 0, 0], [255, 255, 0], [255, 255, 255]]),
    (
        "rainbow",
        &[
            [127, 0, 255],
            [63, 97, 250],
            [0, 180, 235],
            [64, 236, 211],
            [128, 254, 179],
            [190, 236, 142],
            [254, 180, 97],
            [255, 97, 49],
            [255, 0, 0],
        ],
    ),
    ("hsv", &[[255, 0, 0], [255, 255, 0], [0, 255, 0], [0, 255, 255], [0, 0, 255], [255, 0, 255], [255, 0, 23]]),
    ("a grey scale with some colour in it", &[[0, 0, 0], [255, 255, 255]]),
];

/// Distance of a colour from a line through points, by its channel that is furthest off.
fn nearest_of(points: &[[u8; 3]], rgb: Colour) -> f64 {
    const BETWEEN: usize = 8;
    let along = |pair: &[[u8; 3]], i: usize| {
        let t = i as f32 / BETWEEN as f32;
        std::array::from_fn(|c| STEP * (f32::from(pair[0][c]) * (1.0 - t) + f32::from(pair[1][c]) * t))
    };
    let each = points.windows(2).flat_map(|pair| (0..=BETWEEN).map(move |i| miss(along(pair, i), rgb)));
    each.fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;

    /// Levels all over the range, as a spectrum has them: few at its top.
    fn levels() -> Raster<f32> {
        Raster::from_fn(60, 40, |x, y| ((x + 60 * y) as f32 / 2399.0).powf(1.5))
    }

    /// A picture in eight bits by a table of 256 colours.
    fn painted(levels: &Raster<f32>, colour: impl Fn(usize) -> Colour, cut: bool) -> Raster<Colour> {
        levels.map(|s| {
            let i = ((s * 256.0) as usize).min(255);
            colour(i).map(|v| if cut { (255.0 * v).floor() } else { (255.0 * v).round() } * STEP)
        })
    }

    fn worst(jet: Jet, picture: &Raster<Colour>, levels: &Raster<f32>) -> f64 {
        let off = picture.pixels().iter().zip(levels.pixels()).map(|(p, s)| f64::from((jet.level(*p) - s).abs()));
        // Where matplotlib's is one colour the level is known to 0.0075.
        off.zip(levels.pixels()).filter(|(_, s)| !(0.105..0.13).contains(*s)).map(|(o, _)| o).fold(0.0, f64::max)
    }

    #[test]
    fn every_table_is_known_and_read_to_its_step() {
        for jet in TABLES {
            for cut in [false, true] {
                let picture = painted(&levels(), |i| jet.of_table(i), cut);
                let choice = Measured::of(&picture).unwrap().choice();
                assert_eq!((choice.jet, choice.is_changed()), (jet, false), "{choice:?}");
                let worst = worst(choice.jet, &picture, &levels());
                assert!(worst <= choice.error() && choice.error() < 1.01 / 255.0 + 1e-6, "{jet:?}: {worst} {choice:?}");
            }
        }
    }

    #[test]
    fn a_curve_without_a_table_is_read_to_half_a_step() {
        for (jet, paint) in [(Jet::Matplotlib, color::jet as fn(f32) -> Colour), (Jet::Trapezoids, color::jet_of_trapezoids)] {
            let picture = levels().map(|s| paint(*s).map(|v| f32::from(color::quantize8(v)) * STEP));
            let choice = Measured::of(&picture).unwrap().choice();
            assert_eq!(choice.jet, jet);
            assert!(worst(jet, &picture, &levels()) <= choice.error() && choice.error() <= 0.51 / 255.0, "{choice:?}");
        }
    }

    #[test]
    fn the_wrong_jet_is_off_by_what_the_two_differ() {
        let picture = painted(&levels(), |i| Jet::OpenCv.of_table(i), false);
        let off = worst(Jet::MatplotlibTable, &picture, &levels());
        assert!((0.03..0.04).contains(&off), "{off}");
    }

    #[test]
    fn where_only_colours_of_both_are_seen_steps_or_the_ambiguity_tell() {
        // From cyan to blue both curves are one line, on which their tables have other steps.
        let low = levels().map(|s| 0.1 + 0.2 * s);
        for jet in TABLES {
            assert_eq!(Measured::of(&painted(&low, |i| jet.of_table(i), false)).unwrap().choice().jet, jet);
        }
        // Nothing but the floor: every Jet says 0.
        let floor = Raster::filled(4, 4, [0.0, 0.0, 128.0 * STEP]);
        let choice = Measured::of(&floor).unwrap().choice();
        assert_eq!((choice.jet.level(floor.pixels()[0]), choice.ambiguity < 0.01), (0.0, true), "{choice:?}");
    }

    #[test]
    fn colours_that_were_changed_are_told_and_their_error_is_no_less_than_it_is() {
        for (amplitude, sets) in [(6.0, 1), (20.0, 2)] {
            for jet in [Jet::MatplotlibTable, Jet::OpenCv] {
                let noisy = |set: u64| {
                    let mut rng = Rng::keyed(7, 0, set);
                    painted(&levels(), |i| jet.of_table(i), false)
                        .map(|p| p.map(|v| (v + amplitude * STEP * (rng.uniform() - 0.5)).clamp(0.0, 1.0)))
                };
                let pictures: Vec<Raster<Colour>> = (0..sets).map(noisy).collect();
                let all = pictures.iter().fold(Measured::default(), |sum, p| sum.and(&Measured::of(p).unwrap()));
                let choice = all.choice();
                assert_eq!(choice.jet.is_matplotlib(), jet.is_matplotlib());
                assert!(choice.is_changed() && choice.words(70.0).contains("JPEG"));
                let squares: f64 = pictures[0]
                    .pixels()
                    .iter()
                    .zip(levels().pixels())
                    .map(|(p, s)| f64::from(choice.jet.level(*p) - s).powi(2))
                    .sum();
                let rms = (squares / levels().pixels().len() as f64).sqrt();
                assert!(rms <= choice.error() && choice.error() < 4.0 * rms, "{rms} {choice:?}");
            }
        }
    }

    #[test]
    fn other_maps_are_refused_by_name() {
        for (name, points) in OTHERS.iter().filter(|(name, _)| !name.contains("grey")) {
            for top in [1.0, 0.5] {
                let picture = levels().map(|s| {
                    let along = top * s * (points.len() - 1) as f32;
                    let i = (along as usize).min(points.len() - 2);
                    let t = along - i as f32;
                    std::array::from_fn(|c| STEP * (f32::from(points[i][c]) * (1.0 - t) + f32::from(points[i + 1][c]) * t))
                });
                let said = Measured::of(&picture).unwrap_err();
                assert!(said.contains(name) && said.contains("neither grey nor Jet"), "{name}: {said}");
            }
        }
        let tinted = levels().map(|s| [*s, *s, 0.9 * s]);
        assert!(Measured::of(&tinted).unwrap_err().contains("grey scale"));
    }
}
