//! Charts: what several of them share.

pub(crate) mod log_axis;
