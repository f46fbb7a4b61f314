//! The viewer: a page that shows a field from any pose beside what was observed at its keyframes.
//!
//! ```text
//! subject     a run, a comparison that keeps one, a data set, or a reconstruction at work
//! scene       what the page has to know of it: cameras, poses, ranges, colours
//! splats      the Gaussians as the page's graphics program reads them
//! points      the points of a data set's sparse model
//! keyframe    pictures and numbers of one keyframe, and its spectrum's strongest directions
//! growth      what a reconstruction at work and its page tell each other; `watching` serves that page from a thread
//! page        the parts in one HTML file, exported whole
//! guard       who is answered by the local server; `routes` what
//! server      holds its port and speaks to browsers, each in a `connection`
//! assets/     the page itself: HTML, style, and one script a job
//! ```
//!
//! The page draws as the rasteriser of the `corf` crate draws (`tools/check_view.py` compares the two).

mod connection;
mod growth;
pub mod guard;
mod keyframe;
mod opening;
mod page;
mod points;
mod routes;
mod scene;
mod server;
mod splats;
mod subject;
mod watching;

pub use page::export;
pub use routes::leads_somewhere;
pub use server::{Port, serve};
pub use subject::Subject;
pub use watching::Watching;
