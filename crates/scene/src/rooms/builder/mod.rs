//! Building blocks of rooms built in code: meshes, walls, fittings, furniture, materials, textures, and the file they are written to.
//!
//! Textures, geometry and file layout use IEEE basic operations and integer hashing only, so the bytes depend on the crate's version and
//! on that of the image encoders, not on the platform, the thread count or the time.

pub(crate) mod decor;
pub(crate) mod fittings;
pub(crate) mod furniture;
pub(crate) mod glb;
pub(crate) mod materials;
pub(crate) mod mesh_builder;
pub(crate) mod partition;
pub(crate) mod shapes;
pub(crate) mod shapes_round;
pub(crate) mod textures;
pub(crate) mod trig;
pub(crate) mod wall;

#[cfg(test)]
pub(crate) mod checks;
