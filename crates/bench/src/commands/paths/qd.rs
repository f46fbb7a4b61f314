//! `corf paths --format qd`: a link along a way, for network simulators.

use super::{Format, Paths, scenario};
use crate::commands::Verdict;
use crate::note;
use crate::radio_link::LinkSetup;
use crate::run::claim_fresh;
use anyhow::Result;
use corf_raytrace::radio::export::{QdForm, qd_scenario};
use corf_raytrace::radio::{Antenna, AntennaPattern, DiffuseSettings, SPEED_OF_LIGHT};
use corf_scene::{Error, bounds, io, trajectory};
use glam::DVec3;

impl Format {
    /// How the channels along a way are written, if that is asked for.
    pub(super) fn qd(self) -> Option<QdForm> {
        match self {
            Self::Qd => Some(QdForm::Text),
            Self::QdJson => Some(QdForm::Json),
            _ => None,
        }
    }
}

impl Paths {
    /// Traces the link at every step and writes the folder.
    ///
    /// # Errors
    /// What the format cannot hold, receivers without a time, an occupied folder, and those of tracing.
    pub(super) fn way(&self, form: QdForm) -> Result<Verdict> {
        let Some(out) = &self.out else {
            return Err(Error::invalid("--out", "a scenario is a folder", "give --out FOLDER").into());
        };
        if self.bandwidth.is_some() {
            let help = "leave it out: the simulator forms the channel of its own band";
            return Err(Error::invalid("--bandwidth", "a scenario holds paths alone", help).into());
        }
        if self.velocities().is_some() {
            let help = "leave it out: receivers and their --interval, or the trajectory's speed, say it";
            return Err(Error::invalid(self.moving(), "what moves has its places here, one a step", help).into());
        }
        self.keep_output_apart(out)?;
        let mut setup = LinkSetup::load(&self.scene, &self.link, self.tx_array, self.rx_array)?;
        setup.place_transmitter(self.tx.iter().map(|p| p.0))?;
        if setup.transmitters.len() != 1 {
            let what = format!("{} transmitters: ns-3 asks for the channels between them as well", setup.transmitters.len());
            return Err(Error::invalid("--tx", what, "write a folder for each").into());
        }
        scenario::check(&setup, "ns-3", "its codebook the array")?;
        let interval_s = self.interval_s(&setup)?;
        let folder = claim_fresh(out)?;
        let traced = self.trace(&setup, &DiffuseSettings::default(), Format::Qd)?;
        for (name, bytes) in qd_scenario(&traced.set, interval_s, form)? {
            io::write_atomic(folder.path().join(name), &bytes)?;
        }
        folder.finish()?;
        let (steps, bare) = (traced.set.receivers.len(), traced.set.links.iter().filter(|link| link.paths.is_empty()).count());
        note!(
            "{steps} steps {interval_s} s apart with up to {} paths each, {bare} of them without any; delays are lengths over \
             {SPEED_OF_LIGHT} m/s, where NIST's own tracer takes 3e8",
            traced.set.max_paths()
        );
        let element = |antenna: &Antenna| antenna.pattern != AntennaPattern::Iso || antenna.beam.is_some();
        if element(&setup.transmitters[0].array.element) || element(&setup.rx_array.element) {
            note!(
                "gains have the patterns of the scene's antennas, which ns-3 multiplies by those of its codebook: isotropic elements leave that to it"
            );
        }
        coarse(&traced.set.receivers, interval_s, setup.config.radio.frequency_hz);
        Ok(Verdict::Done)
    }

    /// Seconds from one receiver to the next.
    fn interval_s(&self, setup: &LinkSetup) -> Result<f64> {
        if let Some(interval_s) = self.interval {
            bounds::number("--interval", interval_s, &(1e-9..=1e6), "seconds, e.g. 0.001")?;
            return Ok(interval_s);
        }
        match (self.rx_trajectory, &setup.config.trajectory) {
            (Some(steps), Some(way)) if steps > 0 && self.rx.is_empty() && self.rx_file.is_none() => {
                Ok(trajectory::loop_length_m(way)? / way.speed_m_per_s / steps as f64)
            }
            (Some(_), None) => {
                let help = "add waypoints_m under [trajectory], or give --rx-file and --interval";
                Err(Error::invalid(setup.config.source.display().to_string(), "it has no [trajectory]", help).into())
            }
            _ => {
                let help = "give --rx-trajectory N alone, or --interval SECONDS with --rx-file or --rx";
                Err(Error::invalid("--interval", "receivers in a row have no time", help).into())
            }
        }
    }
}

/// Says where steps are too far apart for their phases to tell of motion: a path may then change by half a wavelength between two of them.
fn coarse(receivers: &[DVec3], interval_s: f64, frequency_hz: f64) {
    let longest_m = receivers.windows(2).map(|pair| pair[0].distance(pair[1])).fold(0.0, f64::max);
    let half_wave_m = 0.5 * SPEED_OF_LIGHT / frequency_hz;
    if longest_m > half_wave_m {
        note!(
            "steps are up to {:.2} mm apart and half a wavelength is {:.2} mm: phases are right at each, and turn too far between two of \
             them to show a Doppler shift; {:.1e} s between steps would",
            1e3 * longest_m,
            1e3 * half_wave_m,
            interval_s * half_wave_m / longest_m
        );
    }
}
