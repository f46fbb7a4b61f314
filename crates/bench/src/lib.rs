//! The harness and the `corf` command: methods, metrics, plans, cells, tables, report.

pub mod charts;
pub mod commands;
pub mod comparison;
pub mod device;
pub mod documents;
pub mod experiment;
pub mod files;
pub mod live;
pub mod methods;
pub mod metrics;
pub mod radio_link;
pub mod record;
pub mod render;
pub mod report;
pub mod run;
pub mod scenes;
pub mod split;
pub mod studies;
pub mod table;
pub mod terminal;
pub mod viewer;

pub use corf_scene::bounds;
