//! The command as a user runs it, bad input and interrupts included: one program, so that what all tests need is linked and made once.

#![allow(clippy::unwrap_used)]

mod common;

mod archives;
#[cfg(all(unix, feature = "slow"))]
mod array;
mod bad_input;
#[cfg(all(unix, feature = "slow"))]
mod baselines;
mod blocks;
#[cfg(feature = "slow")]
mod cells;
mod denoiser;
mod depth_prior;
#[cfg(feature = "slow")]
mod determinism;
mod docs;
mod doppler;
mod exchange;
mod exports;
mod faults_captures;
mod faults_colmap;
#[cfg(feature = "slow")]
mod faults_dataset;
mod faults_device;
#[cfg(unix)]
mod faults_disk;
#[cfg(feature = "slow")]
mod faults_gltf;
#[cfg(feature = "slow")]
mod faults_numbers;
mod faults_obj;
mod faults_paths;
mod faults_records;
mod faults_scenes;
mod faults_server;
mod faults_transparency;
mod faults_units;
mod fields;
mod figures;
mod fixed_array;
mod growing;
#[cfg(feature = "slow")]
mod implicit;
#[cfg(feature = "slow")]
mod import;
mod import_circles;
#[cfg(all(unix, feature = "slow"))]
mod interrupt;
mod links;
#[cfg(feature = "slow")]
mod live;
#[cfg(feature = "slow")]
mod lpips;
mod made_room;
#[cfg(feature = "slow")]
mod masks;
mod mitsuba;
mod network_traces;
mod new_transmitter;
#[cfg(feature = "slow")]
mod predictions;
#[cfg(feature = "slow")]
mod protocols;
mod public_names;
mod publish;
mod query;
mod questions;
#[cfg(feature = "slow")]
mod report;
#[cfg(feature = "slow")]
mod scale;
mod scene_new;
#[cfg(feature = "slow")]
mod settings;
#[cfg(feature = "slow")]
mod spectra;
mod uncertainty;
mod view;
#[cfg(feature = "slow")]
mod views;
mod whole_way;
