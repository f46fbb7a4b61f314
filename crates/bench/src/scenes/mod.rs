//! Scenes and what is made from them: data sets, and what a command says of the scene it uses.

pub mod behind;
pub mod generate;
pub mod in_use;
pub(crate) mod lobby;
pub mod nerf2_set;
pub mod oidn;
pub mod stub;
