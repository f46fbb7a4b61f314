//! Reconstruction from keyframes as they land in a live folder ([`corf_scene::live`]): who takes them, what is said of each, what is kept.
//!
//! | file | job |
//! |---|---|
//! | `inbox.rs` | a thread that looks into the folder, stamps arrivals and reads what has landed |
//! | `order.rs` | which numbers may still come |
//! | `outcome.rs` | what happens to keyframes that come too fast, and why a run ends |
//! | `session.rs` | numbers keyframes, holds some out, and passes the others on |
//! | `earlier.rs` | what an unfinished session of the same run has left |
//! | `recorder.rs` | a thread that makes a data set of all that was taken |
//! | `log.rs` | a line for every keyframe, and the record of the whole |

mod earlier;
mod inbox;
mod log;
mod order;
mod outcome;
mod recorder;
mod session;

pub use log::{DepthSources, LiveRecord};
pub use outcome::{EndedBy, WhenBehind};
pub use session::{DATASET, Receipt, Session, SessionOptions, Taken};
