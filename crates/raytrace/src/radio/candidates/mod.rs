//! Candidates of specular paths: sequences of faces that a wave may bounce off, found by beams and by rays, for the image method to check.

pub(in crate::radio) mod beams;
pub(in crate::radio) mod candidate_filter;
pub(in crate::radio) mod chain;
pub(in crate::radio) mod chains;
pub(in crate::radio) mod walk;
