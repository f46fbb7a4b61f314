//! Gaussians and their optimiser state in memory.
//!
//! Geometry and both opacities of one Gaussian are twelve consecutive numbers ([`Core`]), its harmonics one consecutive run per
//! modality, channel by channel: a step touches the Gaussians it sees, one after the other, and nothing else.

use crate::{
    Appearance, Gaussians, Result,
    device::{DeviceState, Duplicate, Modality, Outline, ScreenGradient},
    gaussians::logit,
};

/// Offsets in a Gaussian's twelve numbers.
pub(crate) const POSITION: usize = 0;
pub(crate) const ROTATION: usize = 3;
pub(crate) const LOG_SCALE: usize = 7;
pub(crate) const LIGHT_OPACITY: usize = 10;
pub(crate) const RADIO_OPACITY: usize = 11;
/// Numbers of a [`Core`].
pub const CORE: usize = 12;
/// Position (3), quaternion (4), ln scale (3), opacity logits (optical, RF).
pub type Core = [f32; CORE];

/// One modality's harmonics: `[gaussian][channel][coefficient]`.
#[derive(Clone, Debug)]
pub(crate) struct Harmonics {
    pub channels: usize,
    pub degree: usize,
    pub value: Vec<f32>,
    pub moment1: Vec<f32>,
    pub moment2: Vec<f32>,
}

/// All Gaussians with Adam's moments.
#[derive(Clone, Debug)]
pub(crate) struct Store {
    pub value: Vec<Core>,
    pub moment1: Vec<Core>,
    pub moment2: Vec<Core>,
    /// Decay factor of each Gaussian's position learning rate, in `[0, 1]`.
    pub position_rate: Vec<f32>,
    /// Sums of positional gradients on the screen; empty where none have been asked for.
    pub screen: Vec<ScreenGradient>,
    /// Optical, RF.
    pub harmonics: [Harmonics; 2],
}

impl Harmonics {
    fn empty(like: &Appearance) -> Self {
        Self { channels: like.channels, degree: like.sh_degree, value: vec![], moment1: vec![], moment2: vec![] }
    }

    pub fn coefficients(&self) -> usize {
        (self.degree + 1) * (self.degree + 1)
    }

    pub fn stride(&self) -> usize {
        self.coefficients() * self.channels
    }

    fn append(&mut self, from: &Appearance) {
        self.value.extend(self.by_channel(from));
        self.moment1.resize(self.value.len(), 0.0);
        self.moment2.resize(self.value.len(), 0.0);
    }

    /// `[gaussian][coefficient][channel]` to `[gaussian][channel][coefficient]`.
    fn by_channel(&self, from: &Appearance) -> Vec<f32> {
        let (k, c) = (self.coefficients(), self.channels);
        let mut out = Vec::with_capacity(from.sh.len());
        for one in from.sh.chunks_exact(k * c) {
            for channel in 0..c {
                out.extend((0..k).map(|coefficient| one[coefficient * c + channel]));
            }
        }
        out
    }

    /// The way back.
    fn by_coefficient(&self, values: &[f32]) -> Vec<f32> {
        let (k, c) = (self.coefficients(), self.channels);
        let mut out = Vec::with_capacity(values.len());
        for one in values.chunks_exact(k * c) {
            for coefficient in 0..k {
                out.extend((0..c).map(|channel| one[channel * k + coefficient]));
            }
        }
        out
    }
}

/// Keeps the runs of `stride` numbers whose flag is true.
fn retain_runs<T: Copy>(data: &mut Vec<T>, stride: usize, keep: &[bool]) {
    let mut to = 0;
    for (i, _) in keep.iter().enumerate().filter(|(_, keep)| **keep) {
        data.copy_within(i * stride..(i + 1) * stride, to);
        to += stride;
    }
    data.truncate(to);
}

impl Store {
    /// No Gaussians yet, with the channels and degrees of `like`.
    pub fn new(like: &Gaussians) -> Result<Self> {
        like.check_colours()?;
        let harmonics = [Harmonics::empty(&like.light), Harmonics::empty(&like.radio)];
        Ok(Self { value: vec![], moment1: vec![], moment2: vec![], position_rate: vec![], screen: vec![], harmonics })
    }

    /// Holds nothing and allocates nothing: stands in while the real store is being updated.
    pub fn hollow() -> Self {
        let harmonics = || Harmonics { channels: 0, degree: 0, value: vec![], moment1: vec![], moment2: vec![] };
        let harmonics = [harmonics(), harmonics()];
        Self { value: vec![], moment1: vec![], moment2: vec![], position_rate: vec![], screen: vec![], harmonics }
    }

    pub fn len(&self) -> usize {
        self.value.len()
    }

    /// Sets to zero what a modality has not seen, and the geometry of what neither has.
    pub fn clear_unless(&mut self, seen: &[[bool; 2]]) {
        for (i, seen) in seen.iter().enumerate() {
            if !seen[0] && !seen[1] {
                self.value[i] = [0.0; 12];
            }
            for (h, seen) in self.harmonics.iter_mut().zip(seen) {
                let stride = h.stride();
                if !seen {
                    h.value[i * stride..(i + 1) * stride].fill(0.0);
                }
            }
        }
    }

    /// Channels and degree of both modalities.
    fn held(&self) -> [(usize, usize); 2] {
        [0, 1].map(|g| (self.harmonics[g].channels, self.harmonics[g].degree))
    }

    pub fn append(&mut self, new: &Gaussians) -> Result<()> {
        new.check_appendable(self.held())?;
        self.extend(cores(new));
        self.harmonics[0].append(&new.light);
        self.harmonics[1].append(&new.radio);
        Ok(())
    }

    /// Adds geometry and opacities with fresh optimiser state.
    fn extend(&mut self, cores: impl Iterator<Item = Core>) {
        self.value.extend(cores);
        let total = self.value.len();
        self.moment1.resize(total, [0.0; 12]);
        self.moment2.resize(total, [0.0; 12]);
        self.position_rate.resize(total, 1.0);
        self.screen.clear();
    }

    /// Adds copies behind those held, with fresh optimiser state.
    pub fn duplicate(&mut self, duplicates: &[Duplicate]) -> Result<()> {
        Duplicate::check_all(duplicates, self.len())?;
        let copies: Vec<Core> = duplicates.iter().map(|d| d.core(&self.value[d.source as usize])).collect();
        self.extend(copies.into_iter());
        for h in &mut self.harmonics {
            let stride = h.stride();
            for d in duplicates {
                let first = d.source as usize * stride;
                h.value.extend_from_within(first..first + stride);
            }
            h.moment1.resize(h.value.len(), 0.0);
            h.moment2.resize(h.value.len(), 0.0);
        }
        Ok(())
    }

    /// Lowers a modality's opacities above `most` to it, and clears the moments of all of them.
    pub fn cap_opacity(&mut self, modality: Modality, most: f32) {
        let (most, at) = (logit(most), LIGHT_OPACITY + modality.index());
        for (value, (m, v)) in self.value.iter_mut().zip(self.moment1.iter_mut().zip(&mut self.moment2)) {
            value[at] = value[at].min(most);
            (m[at], v[at]) = (0.0, 0.0);
        }
    }

    pub fn retain(&mut self, keep: &[bool]) {
        assert_eq!(keep.len(), self.len(), "one flag per Gaussian");
        retain_runs(&mut self.value, 1, keep);
        retain_runs(&mut self.moment1, 1, keep);
        retain_runs(&mut self.moment2, 1, keep);
        retain_runs(&mut self.position_rate, 1, keep);
        self.screen.clear();
        for h in &mut self.harmonics {
            let stride = h.stride();
            retain_runs(&mut h.value, stride, keep);
            retain_runs(&mut h.moment1, stride, keep);
            retain_runs(&mut h.moment2, stride, keep);
        }
    }

    pub fn reset_radio(&mut self, radio: &Appearance) -> Result<()> {
        let held = &self.harmonics[1];
        radio.check_complete("RF appearance", self.len(), (held.channels, held.degree))?;
        for (i, logit) in radio.opacity_logit.iter().enumerate() {
            self.value[i][RADIO_OPACITY] = *logit;
            self.moment1[i][RADIO_OPACITY] = 0.0;
            self.moment2[i][RADIO_OPACITY] = 0.0;
        }
        self.harmonics[1] = Harmonics::empty(radio);
        self.harmonics[1].append(radio);
        Ok(())
    }

    /// The parameters (or their gradients) in the shape of the public structure.
    pub fn to_gaussians(&self) -> Gaussians {
        self.shaped(&self.value, [&self.harmonics[0].value, &self.harmonics[1].value])
    }

    fn shaped(&self, cores: &[Core], sh: [&Vec<f32>; 2]) -> Gaussians {
        let appearance = |g: usize, offset: usize| {
            let h = &self.harmonics[g];
            Appearance {
                channels: h.channels,
                sh_degree: h.degree,
                opacity_logit: cores.iter().map(|c| c[offset]).collect(),
                sh: h.by_coefficient(sh[g]),
            }
        };
        Gaussians {
            position: cores.iter().map(|c| [c[0], c[1], c[2]]).collect(),
            rotation: cores.iter().map(|c| [c[3], c[4], c[5], c[6]]).collect(),
            log_scale: cores.iter().map(|c| [c[7], c[8], c[9]]).collect(),
            light: appearance(0, LIGHT_OPACITY),
            radio: appearance(1, RADIO_OPACITY),
        }
    }

    pub fn outlines(&self) -> Vec<Outline> {
        let outline = |c: &Core| Outline {
            position: [c[0], c[1], c[2]],
            largest_log_scale: c[LOG_SCALE].max(c[LOG_SCALE + 1]).max(c[LOG_SCALE + 2]),
            opacity_logit: [c[LIGHT_OPACITY], c[RADIO_OPACITY]],
        };
        self.value.iter().map(outline).collect()
    }

    pub fn state(&self) -> DeviceState {
        let [a, b] = &self.harmonics;
        DeviceState {
            gaussians: self.to_gaussians(),
            moments: [self.shaped(&self.moment1, [&a.moment1, &b.moment1]), self.shaped(&self.moment2, [&a.moment2, &b.moment2])],
            position_rate: self.position_rate.clone(),
        }
    }

    pub fn restore(&mut self, state: &DeviceState) -> Result<()> {
        state.check(self.held(), self.len())?;
        self.append(&state.gaussians)?;
        let [first, second] = &state.moments;
        self.moment1 = cores(first).collect();
        self.moment2 = cores(second).collect();
        for (h, pick) in self.harmonics.iter_mut().zip([|g: &Gaussians| g.light.clone(), |g: &Gaussians| g.radio.clone()]) {
            h.moment1 = h.by_channel(&pick(first));
            h.moment2 = h.by_channel(&pick(second));
        }
        self.position_rate.copy_from_slice(&state.position_rate);
        Ok(())
    }
}

/// Geometry and opacities, Gaussian by Gaussian.
fn cores(g: &Gaussians) -> impl Iterator<Item = Core> + '_ {
    (0..g.len()).map(|i| {
        let ([x, y, z], [qw, qx, qy, qz], [a, b, c]) = (g.position[i], g.rotation[i], g.log_scale[i]);
        [x, y, z, qw, qx, qy, qz, a, b, c, g.light.opacity_logit[i], g.radio.opacity_logit[i]]
    })
}
