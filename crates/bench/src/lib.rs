//! The harness and the `corf` command: methods, metrics, plans, cells, tables, report.
//!
//! ```no_run
//! use corf_bench::split::{Protocol, Split};
//! use corf_bench::{device::Backend, methods, metrics::input::Verify, run::harness, table};
//!
//! let input = Verify::default().open("data/mini".as_ref())?; // of `corf dataset generate` or `corf dataset import`
//! let split = Split::of(&input.dataset, Protocol::TEST)?;
//! let mut records = vec![];
//! for id in ["corf-gs", "nearest"] {
//!     let method = methods::create(id, &toml::Table::new(), &Backend::Cpu)?;
//!     records.push(harness::run_cell(id, method.as_ref(), &input, &split, 1, None, &mut |_| Ok(()), |_, _| Ok(()), |_| Ok(()))?);
//! }
//! let compared = table::plain(&table::rows(&records), &table::short_columns(), None);
//! # Ok::<_, anyhow::Error>(())
//! ```

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
pub mod publish;
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
pub mod uncertainty;
pub mod viewer;

pub use corf_scene::bounds;
