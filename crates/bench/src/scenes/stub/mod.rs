//! A scene file for a mesh that has none: materials by their names, a loop through the free space, a transmitter, all of it marked as a guess.

mod free_space;
mod materials;
mod preview;

use crate::terminal::progress::Stage;
use corf_raytrace::bvh::Bvh;
use corf_scene::config::UpAxis;
use corf_scene::trajectory::TrajectoryConfig;
use corf_scene::words::verb;
use corf_scene::{Error, Result, Scene};
use free_space::{FreeSpace, rounded};
use glam::DVec3;
use std::path::Path;

/// Diagonals of scenes that can be metres.
const PLAUSIBLE_DIAGONAL_M: [f64; 2] = [1.5, 2000.0];
/// The sensor's height above the floor where nothing is said, metres.
const SENSOR_M: f64 = 1.5;
/// The same as a share of a low room.
const SENSOR_SHARE: f64 = 0.6;
/// A mesh lower than this is no room but a sheet or what stands in one, metres.
const LEAST_ROOM_M: f64 = 0.5;

/// What the files hold and what has to be said of them.
pub struct Stub {
    /// The scene file's text.
    pub scene: String,
    /// The text of a data set of it in a minute's work.
    pub dataset: String,
    /// The preview, PNG.
    pub preview: Vec<u8>,
    /// What was guessed and what is doubtful, in words.
    pub notes: Vec<String>,
    /// Corners of the loop.
    pub waypoints: usize,
    /// Its length, metres.
    pub length_m: f64,
    /// What it keeps from everything, metres.
    pub clearance_m: f64,
    /// Where the transmitter stands, metres.
    pub transmitter_m: DVec3,
    /// Names of the materials that have to be filled in.
    pub unknown: Vec<String>,
}

/// The mesh of a scene file to be written.
pub struct MeshSource<'s> {
    /// The mesh file, for messages.
    pub mesh: &'s Path,
    /// Its path as the scene file names it.
    pub file: &'s str,
    /// Its up axis, where that is not its format's.
    pub up: Option<UpAxis>,
    /// Name of the scene file.
    pub toml: &'s str,
    /// The sensor's height above the floor, metres.
    pub height_m: Option<f64>,
}

/// Makes the files of a mesh.
///
/// # Errors
/// A mesh whose size cannot be metres, without a floor, or without room for a platform and a loop.
pub fn make(scene: &Scene, source: &MeshSource<'_>) -> Result<Stub> {
    let place = source.mesh.display().to_string();
    let Some(bounds) = scene.bounds() else {
        return Err(Error::invalid(place, "there is no triangle", "give a mesh with triangles"));
    };
    let diagonal_m = f64::from((bounds.max - bounds.min).length());
    if !(PLAUSIBLE_DIAGONAL_M[0]..=PLAUSIBLE_DIAGONAL_M[1]).contains(&diagonal_m) {
        let help = "positions are metres: export it again in metres (it may be in millimetres, centimetres or inches)";
        return Err(Error::invalid(place, format!("its diagonal is {diagonal_m:.3} m, which is no room's"), help));
    }
    let bvh = Stage::of("search tree of the scene", || Bvh::build(scene));
    let height_m = source.height_m.unwrap_or_else(|| usual_height_m(f64::from(bounds.max.z - bounds.min.z)));
    let space = Stage::of("free space", || FreeSpace::of(scene, &bvh, height_m, &place))?;
    let config = |waypoints_m: Vec<[f64; 2]>| TrajectoryConfig {
        waypoints_m,
        height_m: rounded(space.sensor_m()),
        height_amplitude_m: 0.0,
        pitch_amplitude_deg: 5.0,
        yaw_amplitude_deg: 10.0,
        speed_m_per_s: 0.5,
    };
    let way = Stage::of("a loop", || space.find_loop(config, &place)).map_err(|e| with_doubt(e, &space))?;
    let trajectory = config(way.waypoints_m.clone());
    let Some((transmitter_m, seen)) = Stage::of("a transmitter's place", || space.transmitter(&trajectory)) else {
        let help = "give the sensor another height (--height), or write the scene file by hand";
        return Err(with_doubt(Error::invalid(place, "no place for a transmitter was found off the loop", help), &space));
    };
    let (entries, unknown) = materials::entries(scene);
    let mut notes = Vec::new();
    if space.ceiling_m.is_none() {
        notes.push("there is no ceiling over the free floor: waves leave through the top".to_owned());
    } else {
        notes.extend(space.doubtful_height());
    }
    if seen < 1.0 {
        notes.push(format!("the transmitter sees {:.0} % of the loop", 100.0 * seen));
    }
    if !unknown.is_empty() {
        let whose = verb(unknown.len(), "whose name says", "whose names say");
        notes.push(format!("to be filled in: radio properties of {}, {whose} nothing", unknown.join(", ")));
    }
    let preview = Stage::of("preview", || preview::draw(&space, &bvh, &trajectory, transmitter_m))?;
    let stub = Stub {
        scene: scene_text(source, &trajectory, (&way, transmitter_m, seen), &entries),
        dataset: dataset_text(source.toml),
        preview,
        notes,
        waypoints: way.waypoints_m.len(),
        length_m: way.length_m,
        clearance_m: way.clearance_m,
        transmitter_m,
        unknown,
    };
    Ok(stub)
}

/// The sensor's height above the floor in a mesh of this height, metres.
fn usual_height_m(mesh_m: f64) -> f64 {
    if mesh_m < LEAST_ROOM_M { SENSOR_M } else { SENSOR_M.min(rounded(SENSOR_SHARE * mesh_m)) }
}

/// An error about a room with what is strange about its height, where anything is: more likely than all else it is the unit.
fn with_doubt(error: Error, space: &FreeSpace<'_>) -> Error {
    match (error, space.doubtful_height()) {
        (Error::Invalid { place, what, help }, Some(doubt)) => {
            Error::Invalid { place, what, help: format!("{doubt} Otherwise {help}") }
        }
        (error, _) => error,
    }
}

/// The scene file: what was guessed says so.
fn scene_text(
    source: &MeshSource<'_>,
    trajectory: &TrajectoryConfig,
    (way, tx, seen): (&free_space::Loop, DVec3, f64),
    entries: &str,
) -> String {
    let quoted = |text: &str| toml::Value::String(text.to_owned()).to_string();
    let up = source.up.map_or(String::new(), |up| format!("up = \"{}\"\n", if up == UpAxis::Y { "y" } else { "z" }));
    let waypoints: Vec<String> = trajectory.waypoints_m.iter().map(|[x, y]| format!("[{x}, {y}]")).collect();
    let waypoints: Vec<String> = waypoints.chunks(8).map(|line| format!("    {},\n", line.join(", "))).collect();
    format!(
        "# A stub by `corf scene new`: what is marked as a guess is to be checked. `corf config --explain scene` explains every key.\n\n\
         [scene]\nfile = {}\n{up}\n\
         [radio]\nfrequency_hz = 60e9\n\n\
         [transmitter]\n# A GUESS: free, over the floor, {:.0} % of the loop in sight. Its attitude matters once `pattern` is not \"iso\".\nposition_m = [{}, {}, {}]\n\
         pattern = \"iso\"\npolarization = \"V\"\n\n\
         [receiver]\nrows = 8\ncols = 8\n\n\
         [trajectory]\n# A GUESS: a loop of {:.1} m through the free space, {:.2} m or more from everything.\nwaypoints_m = [\n{}]\n\
         # The sensor's height in the world, metres.\nheight_m = {}\npitch_amplitude_deg = {}\nyaw_amplitude_deg = {}\nspeed_m_per_s = {}\n\n\
         # Radio properties of the mesh's materials: itu is a name of ITU-R P.2040-3, thickness_m the slab's.\n\n{}",
        quoted(source.file),
        100.0 * seen,
        tx.x,
        tx.y,
        tx.z,
        way.length_m,
        way.clearance_m,
        waypoints.concat(),
        trajectory.height_m,
        trajectory.pitch_amplitude_deg,
        trajectory.yaw_amplitude_deg,
        trajectory.speed_m_per_s,
        entries.trim_end().to_owned() + "\n",
    )
}

/// A small data set of the scene file.
fn dataset_text(toml: &str) -> String {
    let (name, file) = (toml.trim_end_matches(".toml"), toml::Value::String(toml.to_owned()));
    let name = toml::Value::String(format!("{name}-tiny"));
    format!(
        "# A first data set of {toml}, small enough for a minute. scenes/lobby-mini.toml of corf's repository is a larger one.\n\
         name = {name}\nscene = {file}\nkeyframes = 24\nseed = 1\n\n\
         [optical]\nwidth = 96\nheight = 54\n\n[rf]\nwidth = 48\nheight = 32\ndirections = 93000\nphotons = 50000\n"
    )
}
