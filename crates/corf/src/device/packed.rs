//! Keyframes made ready for a device ahead of their upload.

use super::TrainingView;
use crate::Result;
use std::any::Any;
use std::sync::Arc;

/// A training view in the layout of one device, as made by its packer; for that device alone.
pub struct PackedView(Box<dyn Any + Send + Sync>);

/// Makes a training view, with the number of its pyramid levels, ready for upload; may be called on any thread.
pub type Packer = Arc<dyn Fn(&TrainingView, u32) -> Result<PackedView> + Send + Sync>;

impl PackedView {
    /// Wraps what a device has built.
    pub fn new(content: impl Any + Send + Sync) -> Self {
        Self(Box::new(content))
    }

    /// The wrapped content, if it is of this type.
    pub fn unwrap_as<T: Any>(self) -> Option<T> {
        self.0.downcast().ok().map(|content| *content)
    }
}
