//! ITU-R P.2040-3 and P.2040-4, Table 3: electrical properties of building materials, `ε_r = a·f^b`, `σ = c·f^d` with f in GHz.

use crate::model::{Permittivity, RadioMaterial};
use crate::{Error, Result};

/// Vacuum permittivity, F/m (CODATA 2018).
pub const VACUUM_PERMITTIVITY_F_PER_M: f64 = 8.854_187_812_8e-12;

/// One row of Table 3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ItuMaterial {
    /// Name, lower case, underscores.
    pub name: &'static str,
    /// ε_r = a·f^b.
    pub a: f64,
    /// Exponent of ε_r.
    pub b: f64,
    /// σ = c·f^d, S/m.
    pub c: f64,
    /// Exponent of σ.
    pub d: f64,
    /// Frequencies the row holds for, GHz, both ends included.
    pub range_ghz: [f64; 2],
    /// Edition of the recommendation from which on the row is there.
    pub edition: u32,
}

const fn row(name: &'static str, a: f64, b: f64, c: f64, d: f64, low: f64, high: f64) -> ItuMaterial {
    ItuMaterial { name, a, b, c, d, range_ghz: [low, high], edition: 3 }
}

const fn new(name: &'static str, a: f64, b: f64, c: f64, d: f64, low: f64, high: f64) -> ItuMaterial {
    ItuMaterial { edition: 4, ..row(name, a, b, c, d, low, high) }
}

/// Recommendation ITU-R P.2040-3 (08/2023), Table 3, whose rows P.2040-4 keeps, and behind them for each name those that P.2040-4 (2025) adds. Of rows
/// that hold at one frequency the first is taken.
pub const TABLE_3: [ItuMaterial; 38] = [
    row("vacuum", 1.0, 0.0, 0.0, 0.0, 0.001, 100.0),
    row("concrete", 5.24, 0.0, 0.0462, 0.7822, 1.0, 100.0),
    new("concrete", 5.17, 0.0, 0.0145, 1.0900, 110.0, 330.0),
    row("brick", 3.91, 0.0, 0.0238, 0.16, 1.0, 40.0),
    new("brick", 4.15, 0.0, 0.0006, 1.5712, 110.0, 330.0),
    row("plasterboard", 2.73, 0.0, 0.0085, 0.9395, 1.0, 100.0),
    new("plasterboard", 2.56, 0.0, 0.0001, 1.7799, 110.0, 330.0),
    new("plasterboard", 2.65, 0.0, 0.0002, 1.598, 100.0, 400.0),
    row("wood", 1.99, 0.0, 0.0047, 1.0718, 0.001, 100.0),
    new("wood", 1.82, 0.0, 0.0040, 1.0761, 110.0, 330.0),
    new("wood", 2.1183, 0.0, 0.0055, 1.1113, 100.0, 400.0),
    row("glass", 6.31, 0.0, 0.0036, 1.3394, 0.1, 100.0),
    row("glass", 5.79, 0.0, 0.0004, 1.658, 220.0, 450.0),
    new("glass", 6.5767, 0.0, 0.0012, 1.4697, 100.0, 400.0),
    new("clear_acrylic", 2.58, 0.0, 0.0001, 1.6524, 110.0, 330.0),
    row("ceiling_board", 1.48, 0.0, 0.0011, 1.0750, 1.0, 100.0),
    row("ceiling_board", 1.52, 0.0, 0.0029, 1.029, 220.0, 450.0),
    new("ceiling_board", 1.2567, 0.0, 0.000_13, 1.454, 100.0, 400.0),
    row("chipboard", 2.58, 0.0, 0.0217, 0.7800, 1.0, 100.0),
    new("chipboard", 2.16, 0.0, 0.0023, 1.359, 100.0, 200.0),
    row("plywood", 2.71, 0.0, 0.33, 0.0, 1.0, 40.0),
    new("plywood", 1.94, 0.0, 0.0067, 0.9982, 110.0, 330.0),
    new("plywood", 2.17, 0.0, 0.0063, 1.045, 100.0, 400.0),
    row("marble", 7.074, 0.0, 0.0055, 0.9262, 1.0, 60.0),
    new("marble", 7.94, 0.0, 0.0001, 1.7330, 110.0, 330.0),
    new("marble", 8.62, 0.0, 0.0027, 1.15, 100.0, 400.0),
    row("floorboard", 3.66, 0.0, 0.0044, 1.3515, 50.0, 100.0),
    new("floorboard", 5.27, 0.0, 2.22e-17, 7.3413, 220.0, 300.0),
    new("floorboard", 5.27, 0.0, 0.0003, 2.0298, 300.0, 400.0),
    new("floorboard", 5.27, 0.0, 49.8726, 0.0, 400.0, 450.0),
    new("floorboard", 3.1575, 0.0, 0.001_675, 1.327_75, 100.0, 400.0),
    new("vinyl_tile", 3.62, 0.0, 0.0051, 0.8422, 1.0, 40.0),
    new("carpet_tile", 2.08, 0.0, 0.0009, 0.8200, 1.0, 40.0),
    new("asphalt_concrete", 4.83, 0.0, 0.0108, 1.3969, 1.0, 40.0),
    row("metal", 1.0, 0.0, 1e7, 0.0, 1.0, 100.0),
    row("very_dry_ground", 3.0, 0.0, 0.000_15, 2.52, 1.0, 10.0),
    row("medium_dry_ground", 15.0, -0.1, 0.035, 1.63, 1.0, 10.0),
    row("wet_ground", 30.0, -0.4, 0.15, 1.30, 1.0, 10.0),
];

/// The known names, each once, in the table's order.
pub fn names() -> Vec<&'static str> {
    let mut names: Vec<&'static str> = TABLE_3.iter().map(|m| m.name).collect();
    names.dedup();
    names
}

/// Real relative permittivity and conductivity (S/m) of a Table 3 material.
///
/// # Errors
/// An unknown name, or a frequency outside the row's validity range.
pub fn properties(name: &str, frequency_hz: f64) -> Result<(f64, f64)> {
    let (m, f_ghz) = (row_at(name, frequency_hz)?, frequency_hz / 1e9);
    Ok((m.a * f_ghz.powf(m.b), m.c * f_ghz.powf(m.d)))
}

/// The row of Table 3 that gives a material's [`properties`], and its place in words.
///
/// # Errors
/// Those of [`properties`].
pub fn source(name: &str, frequency_hz: f64) -> Result<String> {
    let m = row_at(name, frequency_hz)?;
    let range = match m.edition {
        3 => String::new(),
        _ => format!(", {} to {} GHz", m.range_ghz[0], m.range_ghz[1]),
    };
    Ok(format!("ITU-R P.2040-{}, table 3, \"{name}\"{range}", m.edition))
}

fn row_at(name: &str, frequency_hz: f64) -> Result<&'static ItuMaterial> {
    let rows: Vec<&'static ItuMaterial> = TABLE_3.iter().filter(|m| m.name == name).collect();
    if rows.is_empty() {
        let near = crate::words::nearest(name, names()).map_or(String::new(), |n| format!("did you mean `{n}`? "));
        return Err(Error::invalid(
            format!("radio material `{name}`"),
            "ITU-R P.2040 has no such material",
            format!("{near}known: {}", names().join(", ")),
        ));
    }
    let f_ghz = frequency_hz / 1e9;
    let inside = |m: &ItuMaterial| (m.range_ghz[0]..=m.range_ghz[1]).contains(&f_ghz);
    rows.iter().find(|m| inside(m)).copied().ok_or_else(|| {
        let ranges: Vec<String> = rows.iter().map(|m| format!("{} to {} GHz", m.range_ghz[0], m.range_ghz[1])).collect();
        Error::invalid(
            format!("radio material `{name}`"),
            format!("ITU-R P.2040 defines it from {}, not at {f_ghz} GHz", ranges.join(" and ")),
            "give relative_permittivity and conductivity_s_per_m from a measurement at the carrier, or choose another material",
        )
    })
}

/// The largest relative permittivity, which ferroelectrics reach.
const MAX_PERMITTIVITY: f64 = 1e5;
/// The largest conductivity, S/m; silver has 6.3e7.
const MAX_CONDUCTIVITY_S_PER_M: f64 = 1e9;
/// The thinnest slab, metres: a few atoms.
const MIN_THICKNESS_M: f64 = 1e-9;

impl RadioMaterial {
    /// `(ε_r, ε_im)` of `η = ε_r − j·ε_im`, `ε_im = σ/(2πf·ε₀) ≥ 0` (time convention e^{+jωt}).
    ///
    /// # Errors
    /// An unknown ITU name, or a frequency outside its validity range.
    pub fn complex_permittivity(&self, frequency_hz: f64) -> Result<(f64, f64)> {
        let (relative, conductivity) = match &self.permittivity {
            Permittivity::Itu(name) => properties(name, frequency_hz)?,
            Permittivity::Constant { relative_permittivity, conductivity_s_per_m } => {
                (*relative_permittivity, *conductivity_s_per_m)
            }
        };
        Ok((relative, conductivity / (std::f64::consts::TAU * frequency_hz * VACUUM_PERMITTIVITY_F_PER_M)))
    }

    /// Checks thickness, permittivity and scattering against their ranges; `place` says where the material came from.
    ///
    /// # Errors
    /// The first property out of range.
    pub fn validate(&self, place: &str) -> Result<()> {
        let fail = |what: String, help: &str| Err(Error::invalid(format!("{place}: radio material `{}`", self.id), what, help));
        if !(self.thickness_m.is_finite() && self.thickness_m >= MIN_THICKNESS_M) {
            return fail(
                format!("thickness_m = {:?}", self.thickness_m),
                "give the slab's thickness in metres, above 0 (1e-9 at least)",
            );
        }
        if self.thickness_m > 10.0 {
            return fail(
                format!("thickness_m = {} is over 10 m", self.thickness_m),
                "thicknesses are in metres, not millimetres",
            );
        }
        match &self.permittivity {
            Permittivity::Itu(name) => {
                if !names().contains(&name.as_str()) {
                    let near = crate::words::nearest(name, names()).map_or(String::new(), |n| format!("did you mean `{n}`? "));
                    let help = format!("{near}known: {}", names().join(", "));
                    return fail(format!("itu = \"{name}\" is not in ITU-R P.2040"), &help);
                }
            }
            Permittivity::Constant { relative_permittivity: e, conductivity_s_per_m: s } => {
                if !(1.0..=MAX_PERMITTIVITY).contains(e) {
                    return fail(format!("relative_permittivity = {e:?}"), "give a value from 1 to 1e5");
                }
                if !(0.0..=MAX_CONDUCTIVITY_S_PER_M).contains(s) {
                    return fail(format!("conductivity_s_per_m = {s:?}"), "give a value from 0 to 1e9, in S/m");
                }
            }
        }
        match self.scattering.out_of_range() {
            Some((what, help)) => fail(what, help),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Half of the last digit the design's table prints.
    const PRINTED: f64 = 6e-6;

    #[test]
    fn conductivities_at_60_ghz_are_the_published_ones() {
        for (name, relative, conductivity) in [
            ("concrete", 5.24, 1.13635),
            ("plasterboard", 2.73, 0.39810),
            ("glass", 6.31, 0.86688),
            ("wood", 1.99, 0.37837),
            ("ceiling_board", 1.48, 0.08972),
            ("floorboard", 3.66, 1.11333),
            ("chipboard", 2.58, 0.52895),
            ("metal", 1.0, 1e7),
        ] {
            let (e, s) = properties(name, 60e9).unwrap();
            assert!((e - relative).abs() < PRINTED && (s - conductivity).abs() < PRINTED, "{name}: {e} {s}");
        }
        let (e, s) = properties("marble", 60e9).unwrap();
        assert!((e - 7.074).abs() < PRINTED && (s - 0.244).abs() < 6e-4, "{e} {s}");
    }

    #[test]
    fn frequency_enters_in_gigahertz() {
        // At 1 GHz f^d = 1: the conductivity is the table's c itself.
        assert_eq!(properties("concrete", 1e9).unwrap(), (5.24, 0.0462));
        // Wet ground at 10 GHz: 30·10^-0.4 = 11.943.
        assert!((properties("wet_ground", 10e9).unwrap().0 - 11.943).abs() < 1e-3);
    }

    #[test]
    fn nothing_is_extrapolated() {
        for name in ["brick", "plywood", "very_dry_ground"] {
            let message = properties(name, 60e9).unwrap_err().to_string();
            assert!(message.contains(name) && message.contains("60 GHz") && message.contains(" to "), "{message}");
        }
        assert!(properties("marble", 60.1e9).is_err());
        assert!(properties("glass", 460e9).is_err() && properties("clear_acrylic", 60e9).is_err());
        assert!((properties("glass", 300e9).unwrap().0 - 5.79).abs() < 1e-12);
    }

    #[test]
    fn rows_of_the_fourth_edition_hold_where_it_says_and_say_so() {
        // Both ends of ranges, and the row that comes first where two hold.
        for (name, f_ghz, relative, conductivity) in [
            ("concrete", 110.0, 5.17, 0.0145 * 110f64.powf(1.09)),
            ("plasterboard", 105.0, 2.65, 0.0002 * 105f64.powf(1.598)),
            ("plasterboard", 140.0, 2.56, 0.0001 * 140f64.powf(1.7799)),
            ("glass", 150.0, 6.5767, 0.0012 * 150f64.powf(1.4697)),
            ("floorboard", 450.0, 5.27, 49.8726),
            ("vinyl_tile", 40.0, 3.62, 0.0051 * 40f64.powf(0.8422)),
            ("carpet_tile", 1.0, 2.08, 0.0009),
            ("asphalt_concrete", 28.0, 4.83, 0.0108 * 28f64.powf(1.3969)),
            ("clear_acrylic", 330.0, 2.58, 0.0001 * 330f64.powf(1.6524)),
        ] {
            let (e, s) = properties(name, f_ghz * 1e9).unwrap();
            assert!((e - relative).abs() < 1e-12 && (s / conductivity - 1.0).abs() < 1e-12, "{name}: {e} {s}");
            let source = source(name, f_ghz * 1e9).unwrap();
            assert!(source.starts_with("ITU-R P.2040-4") && source.contains(" GHz"), "{source}");
        }
        // What the third edition has is said as it ever was.
        assert_eq!(source("concrete", 60e9).unwrap(), "ITU-R P.2040-3, table 3, \"concrete\"");
        // At 300 GHz the pieces of floorboard's conductivity meet: 2.22e-17·300^7.3413 against 0.0003·300^2.0298.
        let pieces = [299.999, 300.001].map(|f: f64| properties("floorboard", f * 1e9).unwrap().1);
        assert!((pieces[0] / pieces[1] - 1.0).abs() < 0.07, "{pieces:?}");
        let pieces = [399.999, 400.001].map(|f: f64| properties("floorboard", f * 1e9).unwrap().1);
        assert!((pieces[0] / pieces[1] - 1.0).abs() < 0.16, "{pieces:?}");
    }

    #[test]
    fn an_unknown_name_lists_the_known_ones() {
        let message = properties("concret", 60e9).unwrap_err().to_string();
        assert!(message.contains("did you mean `concrete`") && message.contains("plasterboard"), "{message}");
    }

    #[test]
    fn loss_has_the_sign_of_e_plus_j_omega_t() {
        let m = RadioMaterial {
            id: "concrete".into(),
            permittivity: Permittivity::Itu("concrete".into()),
            thickness_m: 0.1,
            scattering: Default::default(),
        };
        let (_, im) = m.complex_permittivity(60e9).unwrap();
        // σ/(2πf·ε0) = 1.13635 / 3.33795 = 0.34043.
        assert!((im - 0.34043).abs() < 2e-5, "{im}");
    }
}
