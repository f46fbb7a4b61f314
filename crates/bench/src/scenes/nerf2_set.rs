//! A data set's scene traced anew with the roles of NeRF²: an array that stands still, and a transmitter that goes where the platform went.
//!
//! ```text
//! spectrum/00001.png     8-bit grey, 360x90: column c is azimuth c + 1 degrees, row r elevation r + 1 degrees in the gateway's frame
//! tx_pos.csv             a line `x,y,z`, then the transmitter of every spectrum, world metres
//! gateway_info.yml       position, and orientation as a quaternion x, y, z, w: world from the gateway's frame, whose z is the array's boresight
//! train_index.txt, test_index.txt      stems, the data set's split
//! export.json            what the grey levels are, and of which data set and scene
//! ```
//!
//! Nothing of the data set's spectra is used: they are arrivals at the moving end, and these are those at the fixed one. The array is the platform's, at the
//! place and in the attitude of the scene's transmitter or where it is asked for; the transmitter is one element of the platform's, upright, for NeRF² knows
//! of it no more than where it is. Spectra are of the data set's kind with its settings, formed on the sphere at a quarter of a degree and read off bilinearly
//! in linear power. Grey is the level in decibels over one range for all of them.

use crate::scenes::behind::{SceneBehind, recorded};
use crate::terminal::interrupt;
use crate::terminal::messages;
use crate::terminal::progress::Progress;
use anyhow::Result;
use corf_raytrace::bvh::Bvh;
use corf_raytrace::radio::{Antenna, RadioTracer};
use corf_raytrace::sensor::{Extent, RadioSensor, SensorPlan};
use corf_raytrace::spectrum::Grid;
use corf_scene::config::{Orientation, SpectrumKind, TransmitterConfig};
use corf_scene::dataset::{Dataset, stem};
use corf_scene::export::File;
use corf_scene::keyframe::DbRange;
use corf_scene::model::ARRAY_FROM_CAMERA;
use corf_scene::{Equirectangular, Error, Raster, Rigid3, bounds, io};
use glam::{DMat3, DQuat, DVec3};
use serde_json::json;
use std::path::Path;

/// Columns of a spectrum: azimuths of 1 to 360 degrees.
const AZIMUTHS: usize = 360;
/// Rows of a spectrum: elevations of 1 to 90 degrees.
const ELEVATIONS: usize = 90;
/// The sphere on which spectra are formed.
const SPHERE: Equirectangular = Equirectangular { width: 1440, height: 720 };
/// Least stems of a list: NeRF²'s loader takes a single one for no list.
const LEAST_STEMS: usize = 2;

/// Place and attitude of the array.
#[derive(Clone, Copy, Debug)]
pub struct Gateway {
    /// World metres; the scene's transmitter's where there is none.
    pub position: Option<DVec3>,
    /// World point on its boresight; the transmitter's attitude where there is none.
    pub towards: Option<DVec3>,
}

/// What is traced.
pub struct Nerf2Set<'d> {
    dataset: &'d Dataset,
    behind: SceneBehind,
    /// Pose of a camera whose array is the gateway's.
    pose: Rigid3,
}

impl<'d> Nerf2Set<'d> {
    /// Prepares the export; `scene` is the scene file that the data set was generated from.
    ///
    /// # Errors
    /// A data set that was imported, another scene than the recorded one, a list of one keyframe, a gateway that looks nowhere.
    pub fn new(dataset: &'d Dataset, scene: Option<&Path>, gateway: Gateway) -> Result<Self> {
        let place = dataset.dir().display().to_string();
        // Whoever imported a data set is not asked for a scene.
        recorded(dataset)?;
        let Some(path) = scene else {
            let help = "give --scene SCENE.toml, the file that the data set was generated from";
            return Err(Error::invalid(place, "its spectra have to be traced anew, and a data set holds no mesh", help).into());
        };
        for (name, list) in [("trains", dataset.train_indices()), ("is held out", dataset.test_indices())] {
            if list.len() < LEAST_STEMS {
                let what = format!("{} keyframes where one at least {name}: NeRF²'s loader reads no list of one", list.len());
                return Err(Error::invalid(place, what, "take a data set of more keyframes").into());
            }
        }
        let behind = SceneBehind::open(dataset, path)?;
        let stands = behind.config.transmitter_of(&behind.scene_config)?;
        let position = gateway.position.unwrap_or_else(|| stands.position());
        bounds::position("--gateway", position)?;
        let pose = match gateway.towards {
            None => {
                Rigid3 { rotation: stands.orientation.world_from_array() * ARRAY_FROM_CAMERA.rotation, translation: position }
            }
            Some(towards) if towards.distance(position) > 0.0 => {
                let along = (towards - position).normalize();
                let up = if along.cross(DVec3::Z).length() > 1e-6 { DVec3::Z } else { DVec3::X };
                Rigid3::looking_at(position, towards, up)
            }
            Some(_) => {
                let what = "it is where the gateway is";
                return Err(Error::invalid("--gateway-towards", what, "give another point on the boresight").into());
            }
        };
        Ok(Self { dataset, behind, pose })
    }

    /// Traces all spectra and gives the files of the set, in the order in which they are to be written.
    ///
    /// # Errors
    /// A place that cannot be traced, no power at all, an interrupt.
    pub fn trace(&self) -> Result<Vec<File>> {
        let spectra = self.spectra()?;
        let peak = spectra.iter().flat_map(|s| s.pixels()).copied().fold(0f32, f32::max);
        if peak <= 0.0 {
            let what = "nothing arrives at the gateway from any of the places";
            return Err(Error::invalid("--gateway", what, "stand it, or turn it, elsewhere").into());
        }
        let max_db = 10.0 * f64::from(peak).log10();
        let range = DbRange { min_db: max_db - self.behind.config.radio.dynamic_range_db, max_db };
        let mut files = Vec::with_capacity(spectra.len() + 5);
        for (index, spectrum) in spectra.iter().enumerate() {
            let grey = spectrum.map(|linear| (255.0 * range.scalar(*linear)).round() as u8);
            files.push((format!("spectrum/{}.png", stem(index)), io::encode_png8(&grey)?));
        }
        let stems = |list: &[usize]| list.iter().map(|i| stem(*i) + "\n").collect::<String>().into_bytes();
        files.push(("train_index.txt".into(), stems(self.dataset.train_indices())));
        files.push(("test_index.txt".into(), stems(self.dataset.test_indices())));
        let places = self.dataset.poses().iter().map(|p| p.world_from_camera.translation);
        let lines: String = places.map(|p| format!("{},{},{}\n", p.x, p.y, p.z)).collect();
        files.push(("tx_pos.csv".into(), format!("x,y,z\n{lines}").into_bytes()));
        let (p, q) = (self.pose.translation, self.world_from_gateway());
        let gateway =
            format!("gateway1:\n  position: [{}, {}, {}]\n  orientation: [{}, {}, {}, {}]\n", p.x, p.y, p.z, q.x, q.y, q.z, q.w);
        files.push(("gateway_info.yml".into(), gateway.into_bytes()));
        files.push(("export.json".into(), serde_json::to_vec_pretty(&self.statement(range))?));
        Ok(files)
    }

    /// Linear spectra at the gateway, one a place of the transmitter.
    fn spectra(&self) -> Result<Vec<Raster<f32>>> {
        let SceneBehind { config, scene_config, scene } = &self.behind;
        let receiver = scene_config.receiver;
        let element = TransmitterConfig {
            pattern: receiver.pattern,
            polarization: receiver.polarization,
            position_m: self.pose.translation.to_array(),
            orientation: Orientation::default(),
            rows: 1,
            cols: 1,
            spacing_wavelengths: receiver.spacing_wavelengths,
            beam: None,
        };
        let mut plan = SensorPlan::from_parts(&config.radio, config.seed, &element, scene_config);
        plan.tracing.tx_antenna = Antenna::from(&element);
        let bvh = Bvh::build(scene);
        let tracer = RadioTracer::new(scene, &bvh, plan.tracing)?;
        let extent = match plan.spectrum.kind {
            // Of a lobe's spectrum nothing behind the array is read off.
            SpectrumKind::Mpc => Extent::Front,
            kind => Extent::needed(&[kind], Grid::Sphere(SPHERE), receiver.rear),
        };
        let poses = self.dataset.poses();
        let mut progress = Progress::start("spectra at the gateway", poses.len(), "places");
        let mut spectra = Vec::with_capacity(poses.len());
        for place in poses {
            interrupt::check()?;
            let transmitter = TransmitterConfig { position_m: place.world_from_camera.translation.to_array(), ..element };
            let sensor = RadioSensor::new(&SensorPlan { transmitter, ..plan }, scene, &tracer)?;
            let findings = sensor.check([&self.pose])?;
            if place.index == 0 {
                messages::findings(findings);
            }
            let received = sensor.receive(&self.pose, extent)?;
            let sphere = sensor.settings().form(&received.port_pairs, Grid::Sphere(SPHERE), &self.pose);
            spectra.push(read_off(&sphere));
            progress.set(place.index + 1, poses.len());
        }
        progress.finish();
        Ok(spectra)
    }

    /// Rotation of the gateway's frame, whose x, y and z are the array's y, z and boresight.
    fn world_from_gateway(&self) -> DQuat {
        let world_from_array = corf_scene::model::world_from_array(&self.pose);
        DQuat::from_mat3(&(world_from_array * ARRAY_FROM_GATEWAY)).normalize()
    }

    fn statement(&self, range: DbRange) -> serde_json::Value {
        let header = self.dataset.header();
        let SceneBehind { config, scene_config, scene } = &self.behind;
        json!({
            "schema": "corf-nerf2/1",
            "dataset": header.name,
            "dataset_hash": self.dataset.hash(),
            "scene": scene.name,
            "frequency_hz": header.frequency_hz,
            "roles": "the array stands at the gateway, the transmitter goes where the platform went; traced, not relabelled",
            "gateway_array": scene_config.receiver,
            "transmitter": "one element of the platform's array, upright",
            "spectrum": config.radio.spectrum,
            "lobe_width_deg": config.radio.lobe_width_deg,
            "unit": header.quantity.unit(),
            "grey": "255 times the level's place in db_range, rounded; 10 log10 of linear power relative to 1 W transmitted",
            "db_range": range,
            "columns": "azimuth 1 to 360 degrees from the gateway's x to its y",
            "rows": "elevation 1 to 90 degrees above the array's plane; the gateway's z is the boresight",
        })
    }
}

/// Array from gateway: the gateway's x, y and z are the array's y, z and x.
const ARRAY_FROM_GATEWAY: DMat3 = DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X);

/// The direction of a pixel in the gateway's frame.
fn direction(column: usize, row: usize) -> DVec3 {
    let [azimuth, elevation] = [column, row].map(|i| (i as f64 + 1.0).to_radians());
    DVec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin())
}

/// The hemisphere's pixels from an image of the sphere in the array's frame, bilinear between its pixels' centres.
fn read_off(sphere: &Raster<f32>) -> Raster<f32> {
    let value = |x: i64, y: i64| {
        let x = x.rem_euclid(sphere.width() as i64) as usize;
        f64::from(sphere[(x, y.clamp(0, sphere.height() as i64 - 1) as usize)])
    };
    Raster::from_fn(AZIMUTHS, ELEVATIONS, |column, row| {
        let at = SPHERE.project(ARRAY_FROM_GATEWAY * direction(column, row)) - 0.5;
        let (near, share) = (at.floor(), at - at.floor());
        let (x, y) = (near.x as i64, near.y as i64);
        let line = |y: i64| (1.0 - share.x) * value(x, y) + share.x * value(x + 1, y);
        ((1.0 - share.y) * line(y) + share.y * line(y + 1)) as f32
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_look_where_the_published_loader_says() {
        // Along the array's y, its z, and its boresight.
        for (column, row, along) in [(359, 0, DVec3::Y), (89, 0, DVec3::Z), (179, 0, -DVec3::Y), (12, 89, DVec3::X)] {
            let seen = ARRAY_FROM_GATEWAY * direction(column, row);
            assert!(seen.angle_between(along) < 1.001_f64.to_radians(), "{column} {row}: {seen}");
        }
        assert!((ARRAY_FROM_GATEWAY.determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn what_is_smooth_on_the_sphere_is_read_off_as_it_is() {
        let power = |d: DVec3| 2.0 + d.x + 0.5 * d.y - 0.3 * d.z;
        let sphere = Raster::from_fn(SPHERE.width, SPHERE.height, |x, y| power(SPHERE.pixel_direction(x, y)) as f32);
        let seen = read_off(&sphere);
        for row in 0..ELEVATIONS {
            for column in 0..AZIMUTHS {
                let wanted = power(ARRAY_FROM_GATEWAY * direction(column, row));
                assert!((f64::from(seen[(column, row)]) / wanted - 1.0).abs() < 1e-4, "{column} {row}");
            }
        }
    }
}
