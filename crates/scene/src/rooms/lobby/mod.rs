//! The lobby: a procedural stand-in for a real one, built in code so that anyone can rebuild it byte for byte.
//!
//! An L-shaped hall, 14 × 15 m in plan (x east 0–14, y north 0–15, the corner x > 8.5, y > 9 cut out), 3.5 m high, z up. Light and radio see
//! different rooms: prints are part of their plaster wall and invisible to radio, while steel studs behind the west lining, lift doors, steel
//! cabinets and window glass carry most of what radio sees. Shell surfaces and window panes are single sheets, each the slab its
//! `thickness_m` says; furniture and fittings are closed shells of thin material, wound outwards; leaves are sheets.

mod architecture;
mod fixtures;
mod layout;

use crate::Result;
use crate::builder::glb;
use crate::builder::mesh_builder::BuiltObject;
use std::path::Path;

/// Every object of the lobby, in the order of the file.
fn objects() -> Vec<BuiltObject> {
    let mut all = architecture::objects();
    all.extend(fixtures::objects());
    all.extend(layout::objects());
    all
}

/// The lobby as a binary glTF 2.0 file: the same bytes every time.
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
