//! The harness and the `corf` command: methods, metrics, plans, cells, tables, report.

mod cell_clock;
pub mod cells;
pub mod cluster;
pub mod commands;
pub mod coverage_picture;
pub mod device;
pub mod escape;
pub mod generate;
pub mod harness;
pub mod input;
pub mod interrupt;
pub mod json;
pub mod link;
pub mod method;
pub mod methods;
pub mod metrics;
pub mod numbers;
pub mod oidn;
pub mod plan;
pub mod prediction_folder;
pub mod predictions;
pub mod progress;
pub mod provenance;
pub mod record;
pub mod report;
pub mod run;
pub mod say;
pub mod schema;
pub mod splice;
pub mod split;
pub mod stats;
pub mod suite;
pub mod sweep;
pub mod table;
pub mod workload;

pub use corf_scene::bounds;
