//! `corf paths`: propagation paths between points, what a link makes of them, and their export.

mod link_table;
mod qd;
mod scenario;

use self::link_table::Form;
use super::{Verdict, print};
use crate::files::ending::{check_file, ending};
use crate::files::separation::{Reads, keep_apart, keep_from_scene};
pub(super) use crate::radio_link::PointArg;
use crate::radio_link::{ArraySizeArg, LinkArgs, LinkSetup, receivers};
use crate::run::claim_fresh;
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use anyhow::Result;
use clap::{Args, ValueEnum};
use corf_raytrace::radio::channel::{
    ArrayLink, ChannelRay, LinkStatistics, Subcarriers, TapFilter, frequency_response, impulse_response,
};
use corf_raytrace::radio::export::{Link, PathSet, deepmimo_arrays, sionna_arrays, sionna_json};
use corf_raytrace::radio::{AntennaArray, Arrival, Complex, DiffuseSettings, WorldExtent, json};
use corf_scene::mounting::Mount;
use corf_scene::npz::{Array, Values, encode_npz};
use corf_scene::{Error, bounds, io};
use glam::DVec3;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Taps after the last path that an impulse response shows.
const TAPS_AFTER: i64 = 4;

/// Complex numbers of a link's frequency response; more are more likely a mistake.
const MAX_RESPONSES: usize = 20_000_000;

/// Least memory of a link of a few paths, bytes.
const LINK_BYTES: f64 = 2e3;

/// The longest impulse response, taps.
const MAX_TAPS: i64 = 1 << 24;

/// `corf paths`.
#[derive(Args)]
pub struct Paths {
    /// Scene file (.toml).
    scene: PathBuf,
    /// Transmitter, world metres; may be repeated: the scene's own there. Without it where that is, or those of --transmitter.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    tx: Vec<PointArg>,
    /// Receiver, world metres; may be repeated.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    rx: Vec<PointArg>,
    /// More receivers: x, y, z in metres a line, or the columns of these names in any order (.csv), or a NumPy array N x 3 (.npy).
    #[arg(long, value_name = "FILE")]
    rx_file: Option<PathBuf>,
    /// More receivers: this many, equally spaced along the scene's trajectory.
    #[arg(long, value_name = "N")]
    rx_trajectory: Option<usize>,
    /// Elements of the transmit array (default 1x1).
    #[arg(long, value_name = "ROWSxCOLS")]
    tx_array: Option<ArraySizeArg>,
    /// Elements of the receive array (default 1x1).
    #[arg(long, value_name = "ROWSxCOLS")]
    rx_array: Option<ArraySizeArg>,
    /// Velocity of the receivers, m/s in world axes: every path then has its Doppler shift, `doppler_hz`, which is positive where the path becomes
    /// shorter (json and sionna).
    #[arg(long, value_name = "VX,VY,VZ", allow_hyphen_values = true)]
    velocity: Option<Velocity>,
    /// Velocity of the transmitters, m/s in world axes: as --velocity.
    #[arg(long, value_name = "VX,VY,VZ", allow_hyphen_values = true)]
    tx_velocity: Option<Velocity>,
    #[command(flatten)]
    link: LinkArgs,
    /// Bandwidth over which to give the frequency and impulse response, Hz: between single elements with the first polarisations (`h`), and of
    /// several ports between all (`h_ports` by receive and transmit port, as in `a_ports`; npz: `channel`).
    #[arg(long, value_name = "HZ")]
    bandwidth: Option<f64>,
    /// Subcarriers of the frequency response.
    #[arg(long, value_name = "N", default_value_t = 64, requires = "bandwidth")]
    subcarriers: usize,
    /// Of qd and qd-json: seconds from one receiver to the next, which are one that moves. Along a trajectory its speed says them.
    #[arg(long, value_name = "SECONDS", conflicts_with = "rx_trajectory")]
    interval: Option<f64>,
    /// Output: paths with link statistics, a table of links, Sionna RT's arrays, DeepMIMO's matrices, or a scenario that DeepMIMO or ns-3 loads.
    /// Without it the ending of --out says: `.csv` and `.npz` are a table, `.json` and none are json.
    #[arg(long, value_enum)]
    format: Option<Format>,
    /// Output file; without it, standard output. `.csv` or `.npz` for `table`, `.npz` for `npz` and, if wished, `sionna`; a new folder for
    /// `deepmimo`, the scenario's name, `qd` and `qd-json`.
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
}

/// A velocity on the command line.
#[derive(Clone, Copy, Debug, Default)]
struct Velocity(DVec3);

/// The largest speed: beyond it the shift is no longer proportional to it to 1e-4.
const MAX_SPEED_M_S: f64 = 3e4;

impl FromStr for Velocity {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let v = text.parse::<PointArg>().map_err(|_| format!("\"{text}\" is not three numbers vx,vy,vz"))?.0;
        if v.length() > MAX_SPEED_M_S {
            return Err(format!("\"{text}\": speeds are in metres per second, up to {MAX_SPEED_M_S}"));
        }
        Ok(Self(v))
    }
}

/// Output format of `corf paths`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Format {
    /// One object a link: paths under Sionna's names, link statistics, responses.
    Json,
    /// A row a link: positions, number of paths, gain, power, spreads, K-factor, as CSV or NPZ by the ending of --out.
    Table,
    /// The arrays of Sionna RT's `Paths` object, in its shapes.
    Sionna,
    /// DeepMIMO's matrices, one archive.
    Npz,
    /// A scenario folder of DeepMIMO 4, which forms channels of it: paths of single elements with their first ports, the scene, its materials.
    Deepmimo,
    /// A scenario folder of NIST's quasi-deterministic channels, which ns-3's models of 802.11ad and ay read: the receivers, in their order, are one
    /// that moves.
    Qd,
    /// The same with one object a line, as newer versions of NIST's programs have it.
    QdJson,
}

/// Result of tracing: paths and diffuse arrivals of each link.
struct Traced<'s> {
    set: PathSet<'s>,
    diffuse: Vec<Vec<Arrival>>,
    /// Surfaces that receivers are mounted on.
    mounts: Vec<Option<Mount>>,
}

impl Paths {
    /// Runs the command.
    ///
    /// # Errors
    /// A scene that cannot be read or traced, a transmitter at the receiver, an end inside of a body.
    pub fn run(self) -> Result<Verdict> {
        let form = self.out.as_deref().and_then(Form::of);
        let format = match (self.format, &self.out) {
            (Some(format), _) => format,
            (None, _) if form.is_some() => Format::Table,
            (None, Some(out)) if ending(out).is_some_and(|ending| ending != "json") => {
                let help = "give a name that ends in .json, .csv or .npz, or say --format";
                return Err(Error::invalid(format!("--out {}", out.display()), "its ending is that of no output", help).into());
            }
            (None, _) => Format::Json,
        };
        if format == Format::Deepmimo {
            return self.scenario();
        }
        if let Some(form) = format.qd() {
            return self.way(form);
        }
        if self.interval.is_some() {
            let help = "leave it out, or choose --format qd or qd-json";
            return Err(Error::invalid("--interval", "receivers are places here, and have no time", help).into());
        }
        if let Some(out) = &self.out {
            check_file("--out", out)?;
        }
        let archive = form == Some(Form::Npz);
        let table = (format == Format::Table).then(|| Form::of_output(self.out.as_deref())).transpose()?;
        match (format, &self.out) {
            (Format::Npz, Some(_)) if archive => {}
            (Format::Npz, _) => return Err(Error::invalid("--out", "npz is a file", "give --out FILE.npz").into()),
            (Format::Json, Some(path)) if form.is_some() => {
                let help = "choose --format table, npz (DeepMIMO) or sionna, or a .json file";
                return Err(
                    Error::invalid(path.display().to_string(), "JSON goes neither into an archive nor a CSV", help).into()
                );
            }
            _ => {}
        }
        if let Some(out) = &self.out {
            self.keep_output_apart(out)?;
        }
        let mut setup = LinkSetup::load(&self.scene, &self.link, self.tx_array, self.rx_array)?;
        setup.place_transmitter(self.tx.iter().map(|p| p.0))?;
        let ports: Vec<usize> = setup.transmitters.iter().map(|tx| tx.array.ports()).collect();
        if format == Format::Sionna && ports.iter().any(|n| *n != ports[0]) {
            let what = format!("{ports:?} ports, where Sionna RT has one transmit array for all");
            return Err(
                Error::invalid("--transmitter", what, "give transmitters alike, one at a time, or --format json or npz").into()
            );
        }
        if matches!(format, Format::Npz | Format::Table) && self.velocities().is_some() {
            let help = "choose --format json or sionna, or leave the velocity out";
            let what = if table.is_some() {
                "a table of links has no shifts of paths"
            } else {
                "DeepMIMO's matrices are of things that stand still"
            };
            return Err(Error::invalid(self.moving(), what, help).into());
        }
        if table.is_some() && self.bandwidth.is_some() {
            let help = "choose --format json or npz, or leave the bandwidth out";
            return Err(Error::invalid("--bandwidth", "a table of links holds no responses", help).into());
        }
        let channel = self.bandwidth.is_some() || setup.has_ports();
        if setup.link.diffuse && (format == Format::Sionna || format == Format::Npz && !channel) {
            let what = "scattered power has no coefficient that this format could hold";
            let help = "choose --format json, or for npz a --bandwidth: its `channel` has all power; or leave diffuse out";
            return Err(Error::invalid("--diffuse", what, help).into());
        }
        let subcarriers = self.subcarriers(&setup)?;
        let sampling = setup.diffuse_settings(DiffuseSettings::default().directions);
        let traced = self.trace(&setup, &sampling, format)?;
        let bytes = match format {
            Format::Json => self.json(&setup, &traced, subcarriers)?.into_bytes(),
            Format::Table => self.table(&setup, &traced, table.unwrap_or(Form::Csv))?,
            Format::Sionna if archive => encode_npz(&sionna_arrays(&traced.set))?,
            Format::Sionna => serde_json::to_string(&sionna_json(&traced.set))?.into_bytes(),
            // Scenarios are folders, written above.
            Format::Npz | Format::Deepmimo | Format::Qd | Format::QdJson => {
                encode_npz(&self.deepmimo(&setup, &traced, subcarriers))?
            }
        };
        match &self.out {
            Some(path) => io::write_atomic(path, &bytes)?,
            None => print(&String::from_utf8_lossy(&bytes))?,
        }
        Ok(Verdict::Done)
    }

    /// Traces and writes a scenario folder.
    fn scenario(&self) -> Result<Verdict> {
        let out = scenario::name(self.out.as_deref())?;
        if self.bandwidth.is_some() {
            let help = "leave it out, and give compute_channels the band: ChannelParameters(ofdm={\"bandwidth\": …})";
            return Err(Error::invalid("--bandwidth", "DeepMIMO forms the channel itself", help).into());
        }
        if self.velocities().is_some() {
            let what = "a scenario of DeepMIMO holds no velocities: they would be lost";
            let help = "leave it out, and give them to what deepmimo.load returns: rx_vel, tx_vel, or set_doppler with the doppler_hz of --format json";
            return Err(Error::invalid(self.moving(), what, help).into());
        }
        let mut setup = LinkSetup::load(&self.scene, &self.link, self.tx_array, self.rx_array)?;
        setup.place_transmitter(self.tx.iter().map(|p| p.0))?;
        scenario::check(&setup, "DeepMIMO", "compute_channels the shape: bs_antenna, ue_antenna")?;
        let folder = claim_fresh(out)?;
        let traced = self.trace(&setup, &DiffuseSettings::default(), Format::Deepmimo)?;
        scenario::write(&setup, &traced.set, folder.path())?;
        folder.finish()?;
        scenario::report(&traced.set, out);
        Ok(Verdict::Done)
    }

    /// The flag that something moves by.
    fn moving(&self) -> &'static str {
        if self.velocity.is_some() { "--velocity" } else { "--tx-velocity" }
    }

    /// Velocities of transmitters and receivers, if one was given.
    fn velocities(&self) -> Option<[DVec3; 2]> {
        (self.tx_velocity.is_some() || self.velocity.is_some())
            .then(|| [self.tx_velocity, self.velocity].map(|v| v.unwrap_or_default().0))
    }

    /// The band asked for.
    fn subcarriers(&self, setup: &LinkSetup) -> Result<Option<Subcarriers>> {
        let Some(bandwidth_hz) = self.bandwidth else { return Ok(None) };
        let carrier_hz = setup.config.radio.frequency_hz;
        if bandwidth_hz > 2.0 * carrier_hz {
            let what = format!("{bandwidth_hz} Hz around {carrier_hz} Hz reaches below 0");
            return Err(Error::invalid("--bandwidth", what, "give hertz, e.g. 400e6").into());
        }
        let pairs = setup.transmitters.iter().map(|tx| tx.array.ports() * setup.rx_array.ports()).max().unwrap_or(0);
        if pairs.saturating_mul(self.subcarriers) > MAX_RESPONSES {
            let what = format!("{} of {pairs} pairs of ports each", self.subcarriers);
            let help = format!("give fewer, or smaller arrays: {MAX_RESPONSES} in all for a link at most");
            return Err(Error::invalid("--subcarriers", what, help).into());
        }
        Ok(Some(Subcarriers::of_band(bandwidth_hz, self.subcarriers)?))
    }

    /// Refuses more links than can be held in memory at once.
    fn check_size(&self, setup: &LinkSetup, receivers: usize, format: Format) -> Result<()> {
        bounds::count("receivers", setup.transmitters.len().saturating_mul(receivers), bounds::MAX_LINKS, "links")?;
        let carriers = match self.bandwidth {
            Some(_) => self.subcarriers as f64,
            None => 1.0,
        };
        // As complex numbers of an archive, or in words.
        let bytes_each = if format == Format::Npz { 16.0 } else { 200.0 };
        let responses = match (format, setup.has_ports() || self.bandwidth.is_some()) {
            (Format::Sionna | Format::Table, _) | (_, false) => 0.0,
            _ => setup.transmitters.iter().map(|tx| (tx.array.ports() * setup.rx_array.ports()) as f64 * carriers).sum::<f64>(),
        };
        let bytes = receivers as f64 * (responses * bytes_each + setup.transmitters.len() as f64 * LINK_BYTES);
        let help = "give fewer receivers at a time, smaller arrays or fewer --subcarriers";
        Ok(bounds::memory("receivers", &format!("the channels of {receivers}"), bytes, help)?)
    }

    /// Refuses an output that lies in what is read.
    fn keep_output_apart(&self, out: &Path) -> Result<()> {
        let read = [Some(&self.scene), self.link.config.as_ref(), self.rx_file.as_ref()];
        let reads: Vec<Reads<'_>> = read.into_iter().flatten().map(|file| Reads::File(file)).collect();
        keep_apart("--out", out, &reads)?;
        keep_from_scene("--out", out)
    }

    fn trace<'s>(&self, setup: &'s LinkSetup, sampling: &DiffuseSettings, format: Format) -> Result<Traced<'s>> {
        let transmitters = &setup.transmitters;
        let mut receivers = receivers(&setup.config, &self.rx, self.rx_file.as_deref(), self.rx_trajectory)?;
        let mounts = setup.mount(&mut receivers)?;
        for rx in &receivers {
            transmitters.iter().try_for_each(|tx| setup.check_link(tx.position, *rx))?;
        }
        setup.check_distances(&receivers)?;
        let total = transmitters.len() * receivers.len();
        self.check_size(setup, receivers.len(), format)?;
        let mut progress = None;
        let mut links = vec![Vec::new(); receivers.len()];
        let mut diffuse = vec![Vec::new(); receivers.len()];
        setup.each_transmitter(sampling, |t, transmitter, field| {
            for (r, &rx) in receivers.iter().enumerate() {
                interrupt::check()?;
                links[r].push(Link { tx: transmitter.position(), rx, paths: transmitter.paths(rx)? });
                diffuse[r].push(field.map_or_else(|| Ok(Vec::new()), |f| f.gather(rx, f.antenna(), &WorldExtent::Sphere))?);
                if total > 1 {
                    // It begins behind the set-up, which says what it does itself.
                    let progress = progress.get_or_insert_with(|| Progress::start("paths", total, "links"));
                    progress.set(t * receivers.len() + r + 1, total);
                }
            }
            Ok(())
        })?;
        if let Some(progress) = progress {
            progress.finish();
        }
        let set = PathSet {
            transmitters: transmitters.iter().map(|tx| tx.position).collect(),
            receivers,
            links: links.into_iter().flatten().collect(),
            frequency_hz: setup.config.radio.frequency_hz,
            tx_arrays: transmitters.iter().map(|tx| tx.array).collect(),
            rx_array: setup.rx_array,
            object_names: setup.scene.objects.iter().map(|o| o.name.as_str()).collect(),
            velocities: self.velocities(),
        };
        Ok(Traced { set, diffuse: diffuse.into_iter().flatten().collect(), mounts })
    }

    /// One link as it is, several as a list.
    fn json(&self, setup: &LinkSetup, traced: &Traced<'_>, subcarriers: Option<Subcarriers>) -> Result<String> {
        let arrays = traced.set.tx_arrays.iter().cycle();
        let all = traced.set.links.iter().zip(&traced.diffuse).zip(arrays);
        let mut links: Vec<Value> =
            all.map(|((link, diffuse), tx)| self.link_json(setup, link, diffuse, tx, subcarriers)).collect::<Result<_>>()?;
        // Receivers in their order, and for each the transmitters in theirs.
        for (i, link) in links.iter_mut().enumerate() {
            let (t, r) = (i % setup.transmitters.len(), i / setup.transmitters.len());
            for (key, mount) in [("tx_on_surface", &setup.transmitters[t].mount), ("rx_on_surface", &traced.mounts[r])] {
                if let Some(mount) = mount {
                    link[key] = json!(mount);
                }
            }
        }
        let value = match links.len() {
            1 => links.remove(0),
            _ => json!({ "schema": "corf-links/1", "scene": setup.scene.name, "links": links }),
        };
        Ok(serde_json::to_string_pretty(&value)?)
    }

    fn link_json(
        &self,
        setup: &LinkSetup,
        link: &Link,
        diffuse: &[Arrival],
        tx_array: &AntennaArray,
        subcarriers: Option<Subcarriers>,
    ) -> Result<Value> {
        let (f, seed) = (setup.config.radio.frequency_hz, setup.link.seed);
        let mut value = json::paths_to_json(&setup.scene, f, link.tx, link.rx, &link.paths);
        if let Some([v_tx, v_rx]) = self.velocities() {
            (value["tx_velocity_m_s"], value["rx_velocity_m_s"]) = (json!(v_tx.to_array()), json!(v_rx.to_array()));
            for (value, path) in value["paths"].as_array_mut().into_iter().flatten().zip(&link.paths) {
                value["doppler_hz"] = json!(path.doppler_hz(f, v_tx, v_rx));
            }
        }
        value["tx_power_dbm"] = json!(setup.link.tx_power_dbm);
        let elements @ [tx, rx] = [&tx_array.element, &setup.rx_array.element];
        value["channel"] = json!(LinkStatistics::of(&link.paths, diffuse, elements, f, setup.link.tx_power_dbm, seed));
        value["total_power_db"] = json!(decibels(link.paths.iter().map(|path| path.received(tx, rx)).sum()));
        if setup.link.diffuse {
            let power: f64 = diffuse.iter().map(|a| a.power).sum();
            value["diffuse"] = json!({
                "power_db": decibels(power),
                "directions": diffuse.len(),
                "seed": seed,
                "where": "in `channel`, where spreads of departure lack it: scattered power does not know where it left; not in `paths` and `total_power_db`. Between ports its share is a model: the receiver's polarisations get equal parts of it, with phases of their own",
            });
        }
        if tx.ports() * rx.ports() > 1 {
            for (value, path) in value["paths"].as_array_mut().into_iter().flatten().zip(&link.paths) {
                let of_ports =
                    |r: usize| (0..tx.ports()).map(|t| path.coefficient(tx, t, rx, r)).map(|a| [a.re, a.im]).collect::<Vec<_>>();
                value["a_ports"] = json!((0..rx.ports()).map(of_ports).collect::<Vec<_>>());
            }
        }
        let pairs = |list: &[Complex]| list.iter().map(|h| [h.re, h.im]).collect::<Vec<_>>();
        let ports = tx_array.ports() * setup.rx_array.ports();
        let between = ArrayLink { paths: &link.paths, diffuse, tx: tx_array, rx: &setup.rx_array, seed };
        if self.tx_array.is_some() || self.rx_array.is_some() || ports > 1 {
            let h = between.matrix(f);
            value["channel_matrix"] = json!({ "shape": [h.rows, h.columns], "h": pairs(&h.values) });
        }
        if let Some(subcarriers) = subcarriers {
            let [from, to] = [tx, rx].map(|element| AntennaArray::single(*element));
            let rays = ArrayLink { tx: &from, rx: &to, ..between }.rays(0, 0, f);
            let offsets = subcarriers.offsets_hz();
            let bandwidth_hz = subcarriers.spacing_hz * subcarriers.count as f64;
            let last = rays.iter().map(|r| (r.delay_s * bandwidth_hz).round() as i64).max().unwrap_or(0);
            let first = rays.iter().map(|r| (r.delay_s * bandwidth_hz).round() as i64).min().unwrap_or(0);
            let taps = (first - TAPS_AFTER).max(0)..last + TAPS_AFTER + 1;
            if taps.end - taps.start > MAX_TAPS {
                let what = format!("{} taps between the first path and the last", taps.end - taps.start);
                let help = format!("give a narrower one: at most {MAX_TAPS} are written");
                return Err(Error::invalid("--bandwidth", what, help).into());
            }
            let at_offsets = |rays: &[ChannelRay]| pairs(&frequency_response(rays, &offsets));
            let at_taps = |rays: &[ChannelRay]| pairs(&impulse_response(rays, bandwidth_hz, taps.clone(), TapFilter::Sinc));
            value["frequency_response"] = json!({ "offsets_hz": offsets, "h": at_offsets(&rays) });
            value["impulse_response"] = json!({ "bandwidth_hz": bandwidth_hz, "first_tap": taps.start, "h": at_taps(&rays) });
            if ports > 1 {
                let row = |r: usize| (0..tx_array.ports()).map(|t| between.rays(r, t, f)).collect::<Vec<_>>();
                let by_ports: Vec<Vec<Vec<ChannelRay>>> = (0..setup.rx_array.ports()).map(row).collect();
                let of_each = |response: &dyn Fn(&[ChannelRay]) -> Vec<[f64; 2]>| {
                    by_ports.iter().map(|row| row.iter().map(|rays| response(rays)).collect::<Vec<_>>()).collect::<Vec<_>>()
                };
                value["frequency_response"]["h_ports"] = json!(of_each(&at_offsets));
                value["impulse_response"]["h_ports"] = json!(of_each(&at_taps));
            }
        }
        Ok(value)
    }

    /// DeepMIMO's matrices of the first transmitter, between the first ports, under their names, of further ones with `_tx1`, `_tx2` … behind;
    /// with a bandwidth or several ports the channel (users, receive ports, transmit ports, subcarriers; without a bandwidth at the carrier alone).
    fn deepmimo(&self, setup: &LinkSetup, traced: &Traced<'_>, subcarriers: Option<Subcarriers>) -> Vec<Array> {
        let set = &traced.set;
        let (f, n_tx, users) = (set.frequency_hz, set.transmitters.len(), set.receivers.len());
        let rows = set.rx_array.ports();
        let mut arrays = vec![Array::new("frequency", &[], Values::F64(vec![f]))];
        for tx in 0..n_tx {
            let columns = set.tx_arrays[tx].ports();
            let suffix = if tx == 0 { String::new() } else { format!("_tx{tx}") };
            let mut of_tx = deepmimo_arrays(set, tx);
            if subcarriers.is_some() || rows * columns > 1 {
                let offsets = subcarriers.map_or_else(|| vec![0.0], |s| s.offsets_hz());
                let mut h = vec![[0.0; 2]; users * rows * columns * offsets.len()];
                for user in 0..users {
                    let at = user * n_tx + tx;
                    let link = ArrayLink {
                        paths: &set.links[at].paths,
                        diffuse: &traced.diffuse[at],
                        tx: &set.tx_arrays[tx],
                        rx: &set.rx_array,
                        seed: setup.link.seed,
                    };
                    for (k, offset_hz) in offsets.iter().enumerate() {
                        for (i, v) in link.matrix(f + offset_hz).values.iter().enumerate() {
                            h[(user * rows * columns + i) * offsets.len() + k] = [v.re, v.im];
                        }
                    }
                }
                of_tx.push(Array::new("channel", &[users, rows, columns, offsets.len()], Values::Complex(h)));
                of_tx.push(Array::new("subcarrier_offsets", &[offsets.len()], Values::F64(offsets)));
            }
            arrays.extend(of_tx.into_iter().map(|array| Array { name: array.name.clone() + &suffix, ..array }));
        }
        arrays
    }
}

fn decibels(power: f64) -> Option<f64> {
    (power > 0.0).then(|| 10.0 * power.log10())
}
