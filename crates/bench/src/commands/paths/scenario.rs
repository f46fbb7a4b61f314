//! `corf paths --format deepmimo`: a folder that DeepMIMO loads. What it cannot hold, no other program's scenario can.

use crate::note;
use crate::radio_link::LinkSetup;
use anyhow::Result;
use corf_raytrace::radio::export::{PathSet, deepmimo_scenario};
use corf_scene::words::counted;
use corf_scene::{Error, io};
use std::path::Path;

/// What no name of a scenario may contain.
const FORBIDDEN: [char; 11] = ['/', '\\', ':', '*', '?', '"', '\'', '<', '>', '|', '\n'];

/// The folder asked for, whose last part is the scenario's name.
///
/// # Errors
/// None, or a name that DeepMIMO would not find: it looks names up in lower case.
pub(in crate::commands) fn name(out: Option<&Path>) -> Result<&Path> {
    let help = "give --out FOLDER, its last part without capital letters or any of \\ : * ? \" ' < > |";
    let Some(out) = out else { return Err(Error::invalid("--out", "a scenario is a folder", help).into()) };
    let name = out.file_name().and_then(|n| n.to_str()).unwrap_or_default();
    if name.is_empty() || name.contains(FORBIDDEN) || name.to_lowercase() != name {
        return Err(Error::invalid(out.display().to_string(), "its last part is no name of a DeepMIMO scenario", help).into());
    }
    Ok(out)
}

/// Refuses what the scenario of a program, `reader`, cannot hold; `shape` says how it is told of an array.
///
/// # Errors
/// Scattered power, which has no coefficient; arrays, which the program forms itself.
pub(in crate::commands) fn check(setup: &LinkSetup, reader: &str, shape: &str) -> Result<()> {
    if setup.link.diffuse {
        let help = "leave diffuse out, or choose --format json, or npz with a --bandwidth: its `channel` has all power";
        return Err(Error::invalid("--diffuse", "scattered power has no coefficient that a scenario could hold", help).into());
    }
    let arrays = setup.transmitters.iter().map(|tx| ("transmitter", &tx.array)).chain([("receiver", &setup.rx_array)]);
    for (end, array) in arrays {
        if array.grid.rows * array.grid.columns > 1 {
            let what = format!("{reader} forms arrays itself, of the paths between single elements");
            let help = format!("leave rows and cols out, and give {shape}");
            return Err(Error::invalid(format!("[{end}]"), what, help).into());
        }
    }
    if setup.has_ports() {
        note!("the scenario has the first ports of antennas with two polarisations");
    }
    Ok(())
}

/// Writes the folder.
///
/// # Errors
/// Those of [`deepmimo_scenario`], and of writing.
pub(in crate::commands) fn write(setup: &LinkSetup, set: &PathSet<'_>, out: &Path) -> Result<()> {
    let settings = setup.radio_settings(&setup.transmitters[0].array);
    for (name, bytes) in deepmimo_scenario(set, &setup.scene, &settings)? {
        io::write_atomic(out.join(name), &bytes)?;
    }
    Ok(())
}

/// Says how it is loaded.
pub(in crate::commands) fn report(set: &PathSet<'_>, out: &Path) {
    let (links, paths) = (set.links.len(), set.max_paths());
    note!(
        "{} with up to {} each: deepmimo.config.set(\"scenarios_folder\", PARENT), then deepmimo.load(\"{}\", max_paths={paths}), \
         by name alone, for it reads an absolute path in small letters; compute_channels divides a response over N subcarriers by √N (27.1 dB at 512), \
         and taps in time by nothing",
        counted(links, "link"),
        counted(paths, "path"),
        out.file_name().unwrap_or_default().display()
    );
}
