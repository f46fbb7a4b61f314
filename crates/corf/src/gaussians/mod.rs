//! The coupled representation: one geometry, one opacity and colour per modality.

pub(crate) mod harmonics;

use crate::{Error, Result};

/// Degree-0 real spherical harmonic, `1 / (2√π)`.
pub const SH_C0: f32 = 0.282_094_8;

/// N coupled Gaussians as structure of arrays (paper Eq. (12): `{μ, Σ, o_opt, c_opt, o_rf, c_rf}`).
///
/// `Σ = R(q) diag(exp(2·log_scale)) R(q)ᵀ`, world frame, metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaussians {
    /// Means μ, metres, world frame; N.
    pub position: Vec<[f32; 3]>,
    /// Rotations as quaternions `(w, x, y, z)`, not necessarily normalised; N.
    pub rotation: Vec<[f32; 4]>,
    /// ln of the standard deviations in metres; N.
    pub log_scale: Vec<[f32; 3]>,
    /// Opacity and colour in light: 3 channels, sRGB-encoded `[0, 1]`.
    pub light: Appearance,
    /// Opacity and colour at 60 GHz: 3 channels (Jet RGB) or 1 (scalar dB in `[0, 1]`).
    pub radio: Appearance,
}

/// One modality's opacity and view-dependent colour of N Gaussians.
#[derive(Clone, Debug, PartialEq)]
pub struct Appearance {
    /// Colour channels C.
    pub channels: usize,
    /// Spherical-harmonic degree L; K = (L+1)² coefficients.
    pub sh_degree: usize,
    /// Opacity before the logistic function; N.
    pub opacity_logit: Vec<f32>,
    /// Coefficients, `[gaussian][coefficient][channel]`; N·K·C. Colour = max(0, 0.5 + Σ_k sh_k Y_k(d)), d from camera to Gaussian in world axes.
    pub sh: Vec<f32>,
}

impl Appearance {
    /// No Gaussians yet.
    pub fn empty(channels: usize, sh_degree: usize) -> Self {
        Self { channels, sh_degree, opacity_logit: Vec::new(), sh: Vec::new() }
    }

    /// Coefficients per channel, K = (L+1)².
    pub fn coefficients(&self) -> usize {
        (self.sh_degree + 1) * (self.sh_degree + 1)
    }

    /// Numbers per Gaussian in `sh`, K·C.
    pub fn stride(&self) -> usize {
        self.coefficients() * self.channels
    }

    /// Refuses an appearance of other than `n` Gaussians, or of other channels and degree than those `held`.
    pub(crate) fn check_complete(&self, place: &str, n: usize, held: (usize, usize)) -> Result<()> {
        let complete = self.opacity_logit.len() == n && self.sh.len() == n * self.stride();
        if (self.channels, self.sh_degree) == held && complete {
            return Ok(());
        }
        let what = format!(
            "{} channels of degree {} with {} opacities and {} coefficients for {n} Gaussians; the device holds {} channels of degree {}",
            self.channels,
            self.sh_degree,
            self.opacity_logit.len(),
            self.sh.len(),
            held.0,
            held.1
        );
        let help =
            "give every Gaussian one opacity and (degree+1)² coefficients per channel, of the device's own channels and degree";
        Err(Error::invalid(place, what, help))
    }
}

/// ln of a hundred kilometres in metres.
const LARGEST_LOG_SCALE: f32 = 11.6;

impl Gaussians {
    /// No Gaussians yet; `rf_channels` is 3 (Jet) or 1 (dB).
    pub fn empty(radio_channels: usize, sh_degree: usize) -> Self {
        Self {
            position: Vec::new(),
            rotation: Vec::new(),
            log_scale: Vec::new(),
            light: Appearance::empty(3, sh_degree),
            radio: Appearance::empty(radio_channels, sh_degree),
        }
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// Refuses what no reconstruction learns unless it diverges: numbers that are none, and standard deviations of more than a hundred kilometres.
    /// Gaussians of either kind may be drawn nowhere, so that no image says a word of them.
    ///
    /// # Errors
    /// The first of them, by its number in the field.
    pub fn check_learnt(&self) -> Result<()> {
        let diverged = |i: usize, name: &str, value: f32| {
            let what = format!("Gaussian {i} has {name} = {value}: the reconstruction has diverged");
            Err(Error::invalid("the reconstructed field", what, "set smaller learning rates or weights"))
        };
        let is_none = |v: &f32| !v.is_finite();
        for i in 0..self.len() {
            for (names, values) in [
                (&["x", "y", "z"][..], &self.position[i][..]),
                (&["rot_0", "rot_1", "rot_2", "rot_3"], &self.rotation[i]),
                (&["scale_0", "scale_1", "scale_2"], &self.log_scale[i]),
            ] {
                if let Some(k) = values.iter().position(is_none) {
                    return diverged(i, names[k], values[k]);
                }
            }
            if let Some(k) = self.log_scale[i].iter().position(|s| *s > LARGEST_LOG_SCALE) {
                return diverged(i, ["scale_0", "scale_1", "scale_2"][k], self.log_scale[i][k]);
            }
            for (prefix, a) in [("", &self.light), ("rf_", &self.radio)] {
                if is_none(&a.opacity_logit[i]) {
                    return diverged(i, &format!("{prefix}opacity"), a.opacity_logit[i]);
                }
                if let Some(v) = a.sh[i * a.stride()..(i + 1) * a.stride()].iter().find(|v| is_none(v)) {
                    return diverged(i, &format!("{prefix}f_dc or {prefix}f_rest"), *v);
                }
            }
        }
        Ok(())
    }

    /// Refuses colours that no device holds: harmonics above degree 3, light of other than 3 channels, RF of other than 3 or 1.
    pub(crate) fn check_colours(&self) -> Result<()> {
        for (name, a) in [("optical", &self.light), ("rf", &self.radio)] {
            if a.sh_degree > 3 {
                let what = format!("spherical harmonics of degree {}", a.sh_degree);
                return Err(Error::invalid(format!("{name}.sh_degree"), what, "degrees 0 to 3 are supported"));
            }
            if !(a.channels == 3 || (name == "rf" && a.channels == 1)) {
                let what = format!("{} colour channels", a.channels);
                return Err(Error::invalid(format!("{name}.channels"), what, "light has 3 channels; RF has 3 (Jet) or 1 (dB)"));
            }
        }
        Ok(())
    }

    /// Refuses Gaussians that are incomplete, or not of the channels and harmonic degrees that a device holds in light and in RF.
    pub(crate) fn check_appendable(&self, held: [(usize, usize); 2]) -> Result<()> {
        let n = self.len();
        if self.rotation.len() != n || self.log_scale.len() != n {
            let what = format!("{n} positions, {} rotations, {} scales", self.rotation.len(), self.log_scale.len());
            return Err(Error::invalid("appended Gaussians", what, "give one of each per Gaussian"));
        }
        self.light.check_complete("appended Gaussians, optical", n, held[0])?;
        self.radio.check_complete("appended Gaussians, rf", n, held[1])
    }
}

/// The logistic function.
pub fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// The inverse of [`sigmoid`], for a probability strictly between 0 and 1.
pub fn logit(p: f32) -> f32 {
    (p / (1.0 - p)).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_diverged_is_named() {
        let mut g = Gaussians::empty(1, 1);
        for _ in 0..3 {
            g.position.push([1.0, 2.0, 3.0e6]);
            g.rotation.push([1.0, 0.0, 0.0, 0.0]);
            g.log_scale.push([-60.0, 11.0, 0.0]);
            for a in [&mut g.light, &mut g.radio] {
                a.opacity_logit.push(-200.0);
                a.sh.extend(vec![0.1; a.stride()]);
            }
        }
        assert!(g.check_learnt().is_ok());
        let of = |change: &dyn Fn(&mut Gaussians)| {
            let mut changed = g.clone();
            change(&mut changed);
            changed.check_learnt().err().map(|e| e.to_string()).unwrap_or_default()
        };
        for (text, words) in [
            (of(&|g| g.position[1][0] = f32::NAN), "Gaussian 1 has x = NaN: the reconstruction has diverged"),
            (of(&|g| g.rotation[2][3] = f32::INFINITY), "Gaussian 2 has rot_3 = inf"),
            (of(&|g| g.log_scale[0][1] = 12.9), "Gaussian 0 has scale_1 = 12.9"),
            (of(&|g| g.log_scale[0][1] = f32::NEG_INFINITY), "scale_1 = -inf"),
            (of(&|g| g.radio.opacity_logit[2] = f32::NAN), "Gaussian 2 has rf_opacity = NaN"),
            (of(&|g| g.light.sh[13] = f32::NAN), "Gaussian 1 has f_dc or f_rest = NaN"),
        ] {
            assert!(text.contains(words) && text.contains("set smaller learning rates"), "{words} in {text}");
        }
    }
}
