//! The baselines that CORF-GS is compared with, as published: RF-3DGS ([`rf_3dgs`]), NeRF² ([`nerf2`]) and WRF-GS+ ([`wrf_gs_plus`]), and the
//! networks of the latter two ([`mlp`]). Splatting is that of [`corf::device`]; nothing in `corf` knows of them.

pub mod mlp;
pub mod nerf2;
pub mod rf_3dgs;
mod stage;
#[cfg(test)]
#[path = "../../../tests/synthetic.rs"]
mod synthetic;
pub mod wrf_gs_plus;
