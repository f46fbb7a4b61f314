//! Working memory that grows.

use crate::context::Context;
use corf_scene::Result;

/// Most bytes beyond what is asked for.
const MOST_SLACK: u64 = 8 << 20;

/// A buffer that is replaced by a larger one when it is too small; its contents are then lost.
pub struct Scratch {
    label: &'static str,
    /// The memory as it is now.
    pub buffer: wgpu::Buffer,
}

impl Scratch {
    /// Hardly any memory yet.
    ///
    /// # Errors
    /// Those of [`Context::buffer`].
    pub fn new(context: &Context, label: &'static str) -> Result<Self> {
        Ok(Self { label, buffer: context.storage(label, 16)? })
    }

    /// Room for `count` items of `bytes` bytes each; whether the memory is new.
    ///
    /// # Errors
    /// Those of [`Context::buffer`]; what was there is gone then.
    pub fn reserve(&mut self, context: &Context, count: usize, bytes: usize) -> Result<bool> {
        let size = (count * bytes) as u64;
        let grows = self.buffer.size() < size;
        if grows {
            // The old memory is given back before the new is asked for; should there be none, the next call finds this small.
            self.buffer.destroy();
            self.buffer = context.storage(self.label, 16)?;
            let slack = (size / 4).min(MOST_SLACK).min(context.largest_buffer().saturating_sub(size));
            self.buffer = context.storage(self.label, size + slack)?;
        }
        Ok(grows)
    }
}
