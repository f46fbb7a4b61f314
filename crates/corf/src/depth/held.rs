//! What a matcher keeps of a view.

use std::any::Any;
use std::fmt;
use std::sync::Arc;

/// A view's copy in a matcher's own memory, for as long as the view is there.
#[derive(Clone)]
pub struct HeldView(Arc<dyn Any + Send + Sync>);

impl HeldView {
    /// Wraps what a matcher keeps.
    pub fn new(content: impl Any + Send + Sync) -> Self {
        Self(Arc::new(content))
    }

    /// The wrapped content, if it is of this type.
    pub fn content<T: Any>(&self) -> Option<&T> {
        self.0.downcast_ref()
    }
}

impl fmt::Debug for HeldView {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("HeldView")
    }
}
