//! Memory that buffers take on all devices of this process together, and the most it has been.

use std::sync::atomic::{AtomicI64, Ordering};

/// Bytes on all devices as last looked at, …
static TAKEN: AtomicI64 = AtomicI64::new(0);
/// … and the most since [`reset_peak_memory`].
static PEAK: AtomicI64 = AtomicI64::new(0);

/// One device's share, as last looked at; given back where it is dropped.
#[derive(Default)]
pub(crate) struct Share(AtomicI64);

impl Share {
    /// Looks at what the device's buffers take now. What has come and gone since the last look is not seen, so one looks where memory is made and
    /// where work is handed over.
    pub(crate) fn look(&self, device: &wgpu::Device) {
        self.set(device.get_internal_counters().hal.buffer_memory.read() as i64);
    }

    fn set(&self, now: i64) {
        let more = now - self.0.swap(now, Ordering::Relaxed);
        let taken = TAKEN.fetch_add(more, Ordering::Relaxed) + more;
        PEAK.fetch_max(taken, Ordering::Relaxed);
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        self.set(0);
    }
}

/// The most bytes that buffers took on all devices of this process together, since its start or [`reset_peak_memory`]; `None` where no device was
/// at work or its driver's interface does not count (wgpu counts on Vulkan and DirectX 12).
pub fn peak_memory_bytes() -> Option<u64> {
    u64::try_from(PEAK.load(Ordering::Relaxed)).ok().filter(|bytes| *bytes > 0)
}

/// Forgets the peak so far, so that the next [`peak_memory_bytes`] speaks of what follows.
pub fn reset_peak_memory() {
    PEAK.store(TAKEN.load(Ordering::Relaxed), Ordering::Relaxed);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AdapterOptions, Context};

    /// Other tests of this process take memory too: only what is larger than theirs can be told.
    #[test]
    #[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
    fn the_peak_stays_when_the_memory_is_gone() {
        const BYTES: u64 = 96 << 20;
        let context = Context::open(&AdapterOptions { software: true, ..Default::default() }).unwrap();
        reset_peak_memory();
        let before = peak_memory_bytes().unwrap_or(0);
        drop(context.storage("large", BYTES).unwrap());
        let peak = peak_memory_bytes().unwrap();
        assert!((before + BYTES..before + 2 * BYTES).contains(&peak), "{before} and then {peak} bytes");
        context.wait("giving back").unwrap();
        drop(context);
        reset_peak_memory();
        assert!(peak_memory_bytes().unwrap_or(0) < before + BYTES);
    }
}
