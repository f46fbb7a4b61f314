//! What `corf paths` and `corf coverage` share: a scene, how its radio is traced, and between which antennas.

pub mod chains;
pub mod coverage_picture;
mod flags;
mod receivers;
mod table;

pub(crate) use flags::path_args_over;
pub use flags::{InteractionArgs, PathArgs, PathValues, ScatteringArgs};
pub use receivers::receivers;

use crate::note;
use crate::scenes::in_use;
use crate::terminal::messages;
use crate::terminal::progress::Stage;
use anyhow::Result;
use clap::Args;
use corf_raytrace::bvh::Bvh;
use corf_raytrace::radio::{
    Antenna, AntennaArray, AntennaPattern, DiffuseField, DiffuseSettings, PlanarArray, Polarization, RadioSettings, RadioTracer,
    Search, Solids, Transmitter,
};
use corf_raytrace::sensor::{geometry_warnings, open_edges_note};
use corf_scene::config::{ElementGrid, Orientation, SceneConfig, SpectrumConfig, read_toml};
use corf_scene::mounting::{Mount, Surfaces};
use corf_scene::near_field::SPEED_OF_LIGHT;
use corf_scene::{Error, Scene, bounds, near_field};
use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Settings of a link's tracing: the keys of `--config RF.toml`, with the defaults of what it leaves out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LinkConfig {
    /// Interactions on a path at most: reflections, transmissions and scatterings together, 0 to 5. Files of earlier versions call it `max_depth`.
    #[serde(alias = "max_depth", alias = "max_reflections")]
    pub max_interactions: usize,
    /// Whether the direct ray is traced. Without it what comes straight through slabs stays: that is transmission's.
    pub line_of_sight: bool,
    /// Whether specular reflections are traced.
    pub reflection: bool,
    /// Whether paths go through slabs.
    pub transmission: bool,
    /// Whether paths that diffract once at an edge of a mesh are traced.
    pub diffraction: bool,
    /// Whether they are at open edges of single sheets as well.
    pub edge_diffraction: bool,
    /// Rays that look for chains of faces where there are too many to try them all.
    pub rays: usize,
    /// Whether the diffuse field is gathered as well.
    pub diffuse: bool,
    /// Directions over the sphere in which a receiver gathers the diffuse field. Default 120 000; 10 000 in `corf coverage`, where a cell's
    /// total alone counts, which needs far fewer than a spectrum.
    pub directions: Option<usize>,
    /// Photons that bring the diffuse field's indirect light, once for all receivers.
    pub photons: usize,
    /// Side of the patches on which they are kept, metres.
    pub patch_size_m: f64,
    /// Paths weaker than this are dropped, dB relative to 1 W transmitted.
    pub min_gain_db: f64,
    /// Transmit power, dBm.
    pub tx_power_dbm: f64,
    /// Seed of the diffuse field's phases.
    pub seed: u64,
    /// The transmit array; the element and the spacing that it leaves out are those of the scene's `[transmitter]`.
    pub transmitter: LinkArray,
    /// The receive array; the element and the spacing that it leaves out are those of the scene's `[receiver]`.
    pub receiver: LinkArray,
}

/// `[transmitter]` and `[receiver]` of a link file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LinkArray {
    /// Elements along array −z. Default 1.
    pub rows: Option<usize>,
    /// Elements along array y. Default 1.
    pub cols: Option<usize>,
    /// Element spacing in wavelengths, `0.5` or `[between columns, between rows]`.
    pub spacing_wavelengths: Option<SpacingArg>,
    /// Element pattern.
    pub pattern: Option<AntennaPattern>,
    /// Polarisation.
    pub polarization: Option<Polarization>,
    /// Attitude: where its boresight (+x) and zenith (+z) point.
    pub orientation: Option<Orientation>,
}

/// Spacing of elements, wavelengths.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Spacing")]
#[serde(untagged)]
pub enum SpacingArg {
    /// Along both axes.
    Both(f64),
    /// Between columns, between rows.
    Each([f64; 2]),
}

impl Default for LinkConfig {
    fn default() -> Self {
        let (paths, radio) = (RadioSettings::default(), SpectrumConfig::default());
        Self {
            max_interactions: radio.max_interactions,
            line_of_sight: true,
            reflection: true,
            transmission: true,
            diffraction: false,
            edge_diffraction: false,
            rays: radio.rays,
            diffuse: false,
            directions: None,
            photons: radio.photons,
            patch_size_m: radio.patch_size_m,
            min_gain_db: paths.min_gain_db,
            tx_power_dbm: 30.0,
            seed: 0,
            transmitter: LinkArray::default(),
            receiver: LinkArray::default(),
        }
    }
}

/// Flags of every command that traces links.
#[derive(Args, Clone, Debug)]
pub struct LinkArgs {
    /// Settings of the link (.toml), whose keys `corf config --explain paths` lists; flags take precedence.
    #[arg(long, value_name = "RF.toml")]
    pub config: Option<PathBuf>,
    /// Transmitter of this name in the scene's `[transmitters]`; may be repeated. Without it `[transmitter]`.
    #[arg(long, value_name = "NAME")]
    pub transmitter: Vec<String>,
    /// How paths are found.
    #[command(flatten)]
    pub paths: PathArgs,
    /// Gather the diffuse field as well.
    #[arg(long)]
    pub diffuse: bool,
    /// How scattered power is sampled.
    #[command(flatten)]
    pub scattering: ScatteringArgs,
    /// Transmit power, dBm (default 30).
    #[arg(long, value_name = "DBM", allow_hyphen_values = true)]
    pub tx_power_dbm: Option<f64>,
    /// Seed of the diffuse field's random phases (default 0).
    #[arg(long)]
    pub seed: Option<u64>,
}

/// A point on the command line.
#[derive(Clone, Copy, Debug)]
pub struct PointArg(pub DVec3);

impl FromStr for PointArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = text.split(',').filter_map(|p| p.trim().parse().ok()).filter(|v: &f64| v.is_finite()).collect();
        match (numbers.as_slice(), text.matches(',').count()) {
            ([x, y, z], 2) => {
                let point = DVec3::new(*x, *y, *z);
                bounds::position(text, point).map_err(|_| format!("\"{text}\": coordinates are in metres, at most 1e6"))?;
                Ok(Self(point))
            }
            _ => Err(format!("\"{text}\" is not three numbers x,y,z")),
        }
    }
}

/// The size of an array on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ArraySizeArg {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub columns: usize,
}

/// Arrays of more elements than this on a side are more likely a mistake, …
const MAX_SIDE: usize = 1024;
/// … and those of more in all.
const MAX_ELEMENTS: usize = 4096;

impl FromStr for ArraySizeArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let side = |s: &str| s.trim().parse().ok().filter(|n| (1..=MAX_SIDE).contains(n));
        match text.split_once(['x', 'X', '×']).map(|(r, c)| (side(r), side(c))) {
            Some((Some(rows), Some(columns))) => Ok(Self { rows, columns }),
            _ => Err(format!("\"{text}\" is no array: give ROWSxCOLUMNS, e.g. 8x8")),
        }
    }
}

/// Antennas on surfaces that are named one by one.
const MOUNTS_TOLD: usize = 5;

/// A transmitter of a link.
#[derive(Clone, Debug, PartialEq)]
pub struct TransmitEnd {
    /// World position, metres; off the surface that it is mounted on.
    pub position: DVec3,
    /// Its array.
    pub array: AntennaArray,
    /// The surface that it is mounted on, if it is on one.
    pub mount: Option<Mount>,
}

impl TransmitEnd {
    /// An array at a place.
    ///
    /// # Errors
    /// A place between two bodies.
    fn at(surfaces: &Surfaces<'_>, position: DVec3, array: AntennaArray) -> Result<Self> {
        let mount = surfaces.mount("transmitter", position, facing(&array))?;
        Ok(Self { position: mount.as_ref().map_or(position, Mount::position), array, mount })
    }
}

/// Boresight of an array, world, of one that has one.
fn facing(array: &AntennaArray) -> Option<DVec3> {
    let Antenna { pattern, beam, world_from_antenna, .. } = array.element;
    let several = array.grid.rows * array.grid.columns > 1;
    let has_one = several || beam.is_some() || pattern.has_boresight();
    has_one.then_some(world_from_antenna.x_axis)
}

/// A scene ready to be traced.
pub struct LinkSetup {
    /// The scene file.
    pub config: SceneConfig,
    /// Its geometry and materials.
    pub scene: Scene,
    /// Settings of the tracing.
    pub link: LinkConfig,
    /// The transmitters asked for, one at least.
    pub transmitters: Vec<TransmitEnd>,
    /// Receive array.
    pub rx_array: AntennaArray,
    solids: Solids,
}

impl LinkSetup {
    /// Reads the scene and the settings, flags over file over defaults.
    ///
    /// # Errors
    /// A file that cannot be read, a value out of range, a material that cannot be used.
    pub fn load(
        scene: &Path,
        arguments: &LinkArgs,
        tx_grid: Option<ArraySizeArg>,
        rx_grid: Option<ArraySizeArg>,
    ) -> Result<Self> {
        let config = SceneConfig::load(scene)?;
        let mut link: LinkConfig = arguments.config.as_ref().map(read_toml).transpose()?.unwrap_or_default();
        if let Some(path) = &arguments.config {
            let folder = path.parent().unwrap_or(Path::new(""));
            let receiver = grid_of(
                &link.receiver,
                rx_grid,
                config.receiver.spacing_wavelengths,
                &format!("{}: [receiver]", path.display()),
            )?;
            let receiver =
                ElementGrid { rows: receiver.rows, cols: receiver.columns, spacing_wavelengths: receiver.spacing_wavelengths };
            for (end, array, elements) in
                [("transmitter", &mut link.transmitter, None), ("receiver", &mut link.receiver, Some(receiver))]
            {
                let place = format!("{}: {end}.pattern", path.display());
                array.pattern = array.pattern.map(|pattern| pattern.read(folder, &place, elements)).transpose()?;
            }
        }
        path_args_over!(arguments.paths, link);
        link.diffuse |= arguments.diffuse;
        arguments.scattering.check_unused(link.diffuse, "add --diffuse (diffuse = true), or leave it out")?;
        link.directions = arguments.scattering.directions.or(link.directions);
        link.photons = arguments.scattering.photons.unwrap_or(link.photons);
        link.patch_size_m = arguments.scattering.patch_size.unwrap_or(link.patch_size_m);
        link.tx_power_dbm = arguments.tx_power_dbm.unwrap_or(link.tx_power_dbm);
        link.seed = arguments.seed.unwrap_or(link.seed);
        bounds::number("tx_power_dbm", link.tx_power_dbm, &bounds::POWER_DBM, "dBm, e.g. 20")?;
        bounds::number("min_gain_db", link.min_gain_db, &bounds::GAIN_DB, "dB, e.g. -200")?;
        if link.edge_diffraction && !link.diffraction {
            let help = "set diffraction = true as well, or leave it out";
            return Err(Error::invalid("edge_diffraction", "open edges diffract where edges do", help).into());
        }
        let place = |end: &str| arguments.config.as_ref().map_or(end.to_owned(), |p| format!("{}: [{end}]", p.display()));
        let end = |name: Option<&str>| -> Result<(DVec3, AntennaArray)> {
            let transmitter = config.transmitter_named(name, "--transmitter")?;
            let of_scene = (Antenna::from(transmitter), transmitter.spacing_wavelengths);
            let array = array(&link.transmitter, tx_grid, of_scene, &place("transmitter"))?;
            Ok((transmitter.position(), array))
        };
        let ends = match arguments.transmitter.as_slice() {
            [] => vec![end(None)?],
            names => names.iter().map(|name| end(Some(name))).collect::<Result<_>>()?,
        };
        let of_scene = (Antenna::element_of(&config.receiver, DMat3::IDENTITY), config.receiver.spacing_wavelengths);
        let rx_array = array(&link.receiver, rx_grid, of_scene, &place("receiver"))?;
        let scene = in_use::load(&config)?;
        config.check_radio(&scene)?;
        messages::findings(geometry_warnings(&scene, link.transmission));
        let (solids, surfaces) = (Solids::of(&scene), Surfaces::of(&scene));
        let at = |(position, array): (DVec3, AntennaArray)| TransmitEnd::at(&surfaces, position, array);
        let transmitters: Vec<TransmitEnd> = ends.into_iter().map(at).collect::<Result<_>>()?;
        drop(surfaces);
        Ok(Self { config, scene, link, transmitters, rx_array, solids })
    }

    /// Moves the transmitter to each of these places, if there are any.
    ///
    /// # Errors
    /// Several transmitters: which of them would stand where?
    pub fn place_transmitter(&mut self, places: impl IntoIterator<Item = DVec3>) -> Result<()> {
        let array = self.transmitters[0].array;
        let surfaces = Surfaces::of(&self.scene);
        let placed: Vec<TransmitEnd> =
            places.into_iter().map(|position| TransmitEnd::at(&surfaces, position, array)).collect::<Result<_>>()?;
        match (placed.is_empty(), self.transmitters.len()) {
            (true, _) => {}
            (false, 1) => self.transmitters = placed,
            _ => {
                return Err(
                    Error::invalid("--tx", "several --transmitter have places of their own", "give one or the other").into()
                );
            }
        }
        Ok(())
    }

    /// Mounts the receivers that are on surfaces: each moves off its own. Notes of these, and of transmitters, on standard error.
    ///
    /// # Errors
    /// A receiver between two bodies.
    pub fn mount(&self, receivers: &mut [DVec3]) -> Result<Vec<Option<Mount>>> {
        let (surfaces, facing) = (Surfaces::of(&self.scene), facing(&self.rx_array));
        let mounts: Vec<Option<Mount>> =
            receivers.iter().map(|rx| Ok(surfaces.mount("receiver", *rx, facing)?)).collect::<Result<_>>()?;
        for (rx, mount) in receivers.iter_mut().zip(&mounts) {
            *rx = mount.as_ref().map_or(*rx, Mount::position);
        }
        let transmitters = self.transmitters.iter().filter_map(|tx| Some((tx.mount.as_ref()?, "the transmitter")));
        let all: Vec<(&Mount, &str)> = transmitters.chain(mounts.iter().flatten().map(|m| (m, "a receiver"))).collect();
        all.iter().take(MOUNTS_TOLD).for_each(|(mount, whose)| note!("{}", mount.words(whose)));
        if all.len() > MOUNTS_TOLD {
            note!("and {} more antennas are on surfaces", all.len() - MOUNTS_TOLD);
        }
        Ok(mounts)
    }

    /// Refuses arrays of several elements where links are between single ones.
    ///
    /// # Errors
    /// The end that has one.
    pub fn check_single_elements(&self) -> Result<()> {
        let transmitters = self.transmitters.iter().map(|tx| ("transmitter", &tx.array));
        for (end, array) in transmitters.chain([("receiver", &self.rx_array)]) {
            if array.grid.rows * array.grid.columns > 1 {
                let what =
                    format!("an array of {}x{}, where gains are between single elements", array.grid.rows, array.grid.columns);
                return Err(Error::invalid(format!("[{end}]"), what, "leave rows and cols out, or use `corf paths`").into());
            }
        }
        Ok(())
    }

    /// Whether any link has more than one pair of ports.
    pub fn has_ports(&self) -> bool {
        self.transmitters.iter().any(|tx| tx.array.ports() * self.rx_array.ports() > 1)
    }

    /// Tracer settings for a transmit array.
    pub fn radio_settings(&self, tx_array: &AntennaArray) -> RadioSettings {
        RadioSettings {
            frequency_hz: self.config.radio.frequency_hz,
            max_interactions: self.link.max_interactions,
            line_of_sight: self.link.line_of_sight,
            reflection: self.link.reflection,
            transmission: self.link.transmission,
            diffraction: self.link.diffraction,
            edge_diffraction: self.link.edge_diffraction,
            search: Search::Auto { rays: self.link.rays },
            min_gain_db: self.link.min_gain_db,
            tx_antenna: tx_array.element,
            rx_antenna: self.rx_array.element,
            ..RadioSettings::default()
        }
    }

    /// Sampling of the diffuse field, in so many directions unless others are asked for; these are asked for from now on.
    pub fn diffuse_settings(&mut self, directions: usize) -> DiffuseSettings {
        let directions = *self.link.directions.get_or_insert(directions);
        let (photons, patch_size_m) = (self.link.photons, self.link.patch_size_m);
        DiffuseSettings { directions, photons, patch_size_m, ..DiffuseSettings::default() }
    }

    /// Visits every transmitter, with its number and, where that is asked for, its diffuse field; those with one element in common share a tracer.
    ///
    /// # Errors
    /// A transmitter that cannot be traced, and what `visit` says.
    pub fn each_transmitter(
        &self,
        sampling: &DiffuseSettings,
        mut visit: impl FnMut(usize, &Transmitter<'_, '_>, Option<&DiffuseField<'_, '_>>) -> Result<()>,
    ) -> Result<()> {
        let bvh = Stage::of("search tree of the scene", || Bvh::build(&self.scene));
        let traced_from = |array: &AntennaArray| RadioTracer::new(&self.scene, &bvh, self.radio_settings(array));
        let mut tracer = traced_from(&self.transmitters[0].array)?;
        messages::findings(open_edges_note(&tracer));
        for (number, TransmitEnd { position, array, .. }) in self.transmitters.iter().enumerate() {
            let (position, array) = (*position, *array);
            if tracer.settings().tx_antenna != array.element {
                tracer = traced_from(&array)?;
            }
            let transmitter = Stage::of("mirrors that the transmitter sees", || tracer.transmitter(position))?;
            let photons = || Stage::of("photons of the radio field", || DiffuseField::new(&tracer, position, sampling));
            let field = self.link.diffuse.then(photons).transpose()?;
            visit(number, &transmitter, field.as_ref())?;
        }
        Ok(())
    }

    /// Warns of receivers within 2λ of a transmitter, element by element, on standard error.
    ///
    /// # Errors
    /// The first that is within λ/2π.
    pub fn check_distances(&self, receivers: &[DVec3]) -> Result<()> {
        let frequency_hz = self.config.radio.frequency_hz;
        let (wavelength_m, doubtful_m) = (SPEED_OF_LIGHT / frequency_hz, near_field::doubtful_under_m(frequency_hz));
        let mut doubtful = Vec::new();
        for rx in receivers {
            for tx in &self.transmitters {
                let distance_m = self.rx_array.distance_m(*rx, (&tx.array, tx.position), wavelength_m, doubtful_m);
                near_field::check(&format!("receiver at {rx}"), distance_m, frequency_hz)?;
                doubtful.extend((distance_m < doubtful_m).then_some(distance_m));
            }
        }
        if !doubtful.is_empty() {
            note!("{}", near_field::doubtful("receiver", &doubtful, frequency_hz));
        }
        Ok(())
    }

    /// The closed bodies of the scene.
    pub fn solids(&self) -> &Solids {
        &self.solids
    }

    /// Refuses a transmitter in a closed object smaller than the scene.
    ///
    /// # Errors
    /// Where it is, and the object.
    pub fn check_transmitter(&self, tx: DVec3) -> Result<()> {
        Ok(self.solids.check_link(&self.scene, tx, tx)?)
    }

    /// Refuses a link one end of which lies in a closed object.
    ///
    /// # Errors
    /// The end, where it is, and the object.
    pub fn check_link(&self, tx: DVec3, rx: DVec3) -> Result<()> {
        Ok(self.solids.check_link(&self.scene, tx, rx)?)
    }
}

/// The grid of elements asked for, at the scene's spacing where none is given.
fn grid_of(given: &LinkArray, grid: Option<ArraySizeArg>, spacing: [f64; 2], place: &str) -> Result<PlanarArray> {
    let rows = grid.map_or(given.rows.unwrap_or(1), |g| g.rows);
    let columns = grid.map_or(given.cols.unwrap_or(1), |g| g.columns);
    let spacing_wavelengths = match given.spacing_wavelengths {
        Some(SpacingArg::Both(s)) => [s, s],
        Some(SpacingArg::Each(pair)) => pair,
        None => spacing,
    };
    let sides = 1..=MAX_SIDE;
    let spaced = spacing_wavelengths.iter().all(|s| bounds::SPACING_WAVELENGTHS.contains(s));
    if !(sides.contains(&rows) && sides.contains(&columns) && rows * columns <= MAX_ELEMENTS && spaced) {
        let what = format!("{rows}x{columns} elements {spacing_wavelengths:?} wavelengths apart is no array");
        let help = format!("give rows and cols from 1 to {MAX_SIDE}, {MAX_ELEMENTS} elements in all, and spacings above 0");
        return Err(Error::invalid(place, what, help).into());
    }
    Ok(PlanarArray { rows, columns, spacing_wavelengths })
}

/// The array asked for, of the scene's elements at the scene's spacing. One element keeps the scene's beam; the ports of several are no beam.
fn array(
    given: &LinkArray,
    grid: Option<ArraySizeArg>,
    (scene, spacing): (Antenna, [f64; 2]),
    place: &str,
) -> Result<AntennaArray> {
    let grid = grid_of(given, grid, spacing, place)?;
    let several = grid.elements() > 1;
    if let Some(orientation) = given.orientation {
        orientation.validate(&format!("{place}.orientation"))?;
    }
    let element = Antenna {
        pattern: given.pattern.unwrap_or(scene.pattern),
        polarization: given.polarization.unwrap_or(scene.polarization),
        world_from_antenna: given.orientation.map_or(scene.world_from_antenna, |o| o.world_from_array()),
        beam: scene.beam.filter(|_| !several),
    };
    if !element.world_from_antenna.is_finite() {
        return Err(Error::invalid(place, "its orientation is not finite", "give yaw_deg, pitch_deg, roll_deg in degrees").into());
    }
    if let Some(elements) = element.pattern.elements() {
        let PlanarArray { rows, columns, spacing_wavelengths } = grid;
        if several {
            elements.check_array(&ElementGrid { rows, cols: columns, spacing_wavelengths }, &format!("{place}.pattern"))?;
        } else if elements.array.count() > 1 {
            note!(
                "{place}: elements have a response each; a link of one element has the mean of their gains (--rx-array for all of them)"
            );
        }
    }
    Ok(AntennaArray { element, grid })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_earlier_versions_name_the_limit_otherwise() {
        let of = |text: &str| corf_scene::config::from_toml::<LinkConfig>(text, "RF.toml");
        for name in ["max_interactions", "max_depth", "max_reflections"] {
            assert_eq!(of(&format!("{name} = 2")).unwrap(), LinkConfig { max_interactions: 2, ..LinkConfig::default() });
        }
        assert!(of("max_interactions = 2\nmax_depth = 3").unwrap_err().to_string().contains("duplicate field"));
    }

    #[test]
    fn points_and_grids_are_read_or_refused() {
        assert_eq!("1, -2.5,3".parse::<PointArg>().map(|p| p.0), Ok(DVec3::new(1.0, -2.5, 3.0)));
        assert_eq!("4x8".parse(), Ok(ArraySizeArg { rows: 4, columns: 8 }));
        for bad in ["1,2", "1,2,nan", "1,2,3,4", "a,b,c"] {
            assert!(bad.parse::<PointArg>().is_err(), "{bad}");
        }
        for bad in ["4", "0x8", "4x", "-1x3", "4x5000"] {
            assert!(bad.parse::<ArraySizeArg>().is_err(), "{bad}");
        }
    }
}
