//! Capacity of a frame's buffers.

/// Capacity of the buffers in (Gaussian, tile) pairs and in visible Gaussians. The numbers needed are known once a frame is projected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct BufferCapacity {
    pub pairs: usize,
    pub visible: usize,
}

impl BufferCapacity {
    /// A first guess for `n` Gaussians, not below `least`, and not beyond the `most` that there can be room for.
    pub fn guess(n: usize, least: usize, most: Self) -> Self {
        Self { pairs: n.max(least).min(most.pairs), visible: (n / 4).max(least).min(most.visible) }
    }

    /// Room for both.
    pub fn with(self, other: Self) -> Self {
        Self { pairs: self.pairs.max(other.pairs), visible: self.visible.max(other.visible) }
    }
}
