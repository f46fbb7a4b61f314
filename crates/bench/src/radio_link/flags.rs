//! The flags by which every command that traces radio says how. Their defaults are those of a data set's `[rf]` ([`SpectrumConfig`]) or of what a
//! command reads; `corf coverage` alone has a default of its own, of directions, and says why.
//!
//! [`SpectrumConfig`]: corf_scene::config::SpectrumConfig

use clap::Args;
use corf_scene::{Error, Result};

/// Which interactions a path may have.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct InteractionArgs {
    /// Interactions on a path at most: reflections, transmissions and scatterings together (default 3).
    #[arg(long, visible_alias = "depth", value_name = "COUNT")]
    pub max_interactions: Option<usize>,
    /// Leave out transmission through slabs.
    #[arg(long)]
    pub no_transmission: bool,
}

impl InteractionArgs {
    /// Puts what was given over a configuration's values.
    pub fn over(&self, max_interactions: &mut usize, transmission: &mut bool) {
        *max_interactions = self.max_interactions.unwrap_or(*max_interactions);
        *transmission &= !self.no_transmission;
    }
}

/// How paths without scattering are found.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct PathArgs {
    #[command(flatten)]
    interactions: InteractionArgs,
    /// Rays that look for chains of faces where there are too many to try them all (default 200 000).
    #[arg(long, value_name = "COUNT")]
    rays: Option<usize>,
    /// Trace paths that diffract once at an edge of a body or a corner of walls.
    #[arg(long)]
    diffraction: bool,
    /// Trace paths that diffract once at the open edge of a single sheet as well.
    #[arg(long)]
    edge_diffraction: bool,
}

/// The values of a configuration that [`PathArgs`] go over.
pub struct PathValues<'a> {
    /// Most interactions on a path.
    pub max_interactions: &'a mut usize,
    /// Whether paths go through slabs.
    pub transmission: &'a mut bool,
    /// Rays that look for chains of faces.
    pub rays: &'a mut usize,
    /// Whether paths diffract.
    pub diffraction: &'a mut bool,
    /// Whether they do at open edges.
    pub edge_diffraction: &'a mut bool,
}

impl PathArgs {
    /// Puts what was given over a configuration's values.
    pub fn over(&self, values: PathValues<'_>) {
        self.interactions.over(values.max_interactions, values.transmission);
        *values.rays = self.rays.unwrap_or(*values.rays);
        *values.diffraction |= self.diffraction;
        *values.edge_diffraction |= self.edge_diffraction;
    }
}

/// The values of a configuration that `$args` ([`PathArgs`]) go over, which [`SpectrumConfig`](corf_scene::config::SpectrumConfig) and `LinkConfig` name alike.
macro_rules! path_args_over {
    ($args:expr, $config:expr) => {
        $args.over($crate::radio_link::PathValues {
            max_interactions: &mut $config.max_interactions,
            transmission: &mut $config.transmission,
            rays: &mut $config.rays,
            diffraction: &mut $config.diffraction,
            edge_diffraction: &mut $config.edge_diffraction,
        })
    };
}
pub(crate) use path_args_over;

/// How scattered power is sampled.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct ScatteringArgs {
    /// Directions over the sphere in which a receiver gathers scattered power (default 120 000: 0.6° apart).
    #[arg(long, value_name = "COUNT")]
    pub directions: Option<usize>,
    /// Photons that bring indirect light to the surfaces, once for all receivers (default 1 000 000).
    #[arg(long, value_name = "COUNT")]
    pub photons: Option<usize>,
    /// Side of the patches on which they are kept, metres (default 0.16).
    #[arg(long, value_name = "METRES", allow_hyphen_values = true)]
    pub patch_size: Option<f64>,
}

impl ScatteringArgs {
    /// Puts what was given over a configuration's values.
    pub fn over(&self, directions: &mut usize, photons: &mut usize, patch_size_m: &mut f64) {
        *directions = self.directions.unwrap_or(*directions);
        *photons = self.photons.unwrap_or(*photons);
        *patch_size_m = self.patch_size.unwrap_or(*patch_size_m);
    }

    /// The first flag that was given.
    pub fn given(&self) -> Option<&'static str> {
        let flags = [
            ("--directions", self.directions.is_some()),
            ("--photons", self.photons.is_some()),
            ("--patch-size", self.patch_size.is_some()),
        ];
        flags.into_iter().find(|(_, given)| *given).map(|(flag, _)| flag)
    }

    /// Refuses flags that sample nothing, where nothing scatters; `help` says how it would.
    ///
    /// # Errors
    /// The first flag that was given.
    pub fn check_unused(&self, scatters: bool, help: &str) -> Result<()> {
        match self.given().filter(|_| !scatters) {
            Some(flag) => Err(Error::invalid(flag, "no scattered power is traced that it could sample", help)),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{CommandFactory, Parser};
    use corf_scene::config::SpectrumConfig;

    #[derive(Parser)]
    struct Flags {
        #[command(flatten)]
        paths: PathArgs,
        #[command(flatten)]
        scattering: ScatteringArgs,
    }

    #[test]
    fn flags_say_the_defaults_of_data_sets() {
        let radio = SpectrumConfig::default();
        let grouped = |n: usize| {
            let digits = n.to_string();
            let parts: Vec<&str> = digits.as_bytes().rchunks(3).rev().map(|part| std::str::from_utf8(part).unwrap()).collect();
            parts.join(" ")
        };
        // However its lines are broken.
        let help = Flags::command().render_long_help().to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        for default in [
            radio.max_interactions.to_string(),
            grouped(radio.rays),
            grouped(radio.directions),
            grouped(radio.photons),
            radio.patch_size_m.to_string(),
        ] {
            assert!(help.contains(&format!("(default {default}")), "{default}: {help}");
        }
    }

    #[test]
    fn what_is_given_goes_over_what_a_file_says_and_the_rest_stays() {
        let flags = |text: &str| Flags::try_parse_from(["corf"].into_iter().chain(text.split_whitespace())).unwrap();
        let over = |text: &str| {
            let mut radio = SpectrumConfig { diffraction: true, rays: 7, ..SpectrumConfig::default() };
            let given = flags(text);
            path_args_over!(given.paths, radio);
            given.scattering.over(&mut radio.directions, &mut radio.photons, &mut radio.patch_size_m);
            radio
        };
        let file = SpectrumConfig { diffraction: true, rays: 7, ..SpectrumConfig::default() };
        assert_eq!(over(""), file);
        // The earlier name of the limit is as good as its name.
        for name in ["--max-interactions", "--depth"] {
            let wanted = SpectrumConfig { max_interactions: 2, transmission: false, photons: 5, ..file };
            assert_eq!(over(&format!("{name} 2 --no-transmission --photons 5")), wanted);
        }
        let unused = flags("--patch-size 0.5").scattering;
        assert!(unused.check_unused(true, "").is_ok() && unused.check_unused(false, "").is_err());
    }
}
