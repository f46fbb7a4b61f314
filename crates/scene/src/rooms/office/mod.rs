//! An office floor: narrow, partitioned and plain where the lobby is wide, open and rich.
//!
//! 18 × 12 m in plan (x east 0–18, y north 0–12), 2.8 m high, z up. A corridor 2 m wide runs along y = 6.5 from the west wall and bends south
//! at x = 12. South of it lies an open office with a door at its west end and an opening to the corridor's southern leg; north of it a print
//! nook, a meeting room behind glass and a closed office; east of the bend a kitchen and an office behind glass. Partitions are closed bodies
//! of gypsum board on steel studs, so that a wave passes two boards, or meets a stud that light never sees; panes, floors, the ceiling and
//! the outer walls are single sheets, each the slab its `thickness_m` says.

mod doors;
mod fittings;
mod furniture;
mod kitchen;
mod layout;
mod plan;
mod shell;

use crate::Result;
use crate::builder::glb;
use crate::builder::mesh_builder::BuiltObject;
use std::path::Path;

/// Every object of the office, in the order of the file.
fn objects() -> Vec<BuiltObject> {
    let walls = plan::Partitions::new();
    let mut all = shell::objects(&walls);
    doors::place(&mut all, &walls);
    fittings::place(&mut all, &walls);
    layout::place(&mut all);
    all
}

/// The office as a binary glTF 2.0 file: the same bytes every time.
pub fn build() -> Vec<u8> {
    glb::write(&objects())
}

/// Writes [`build`]'s bytes to `path`, through a temporary file in the same folder.
///
/// # Errors
/// The folder is not writable.
pub fn write(path: impl AsRef<Path>) -> Result<()> {
    crate::io::write_atomic(path, &build())
}

#[cfg(test)]
mod tests;
