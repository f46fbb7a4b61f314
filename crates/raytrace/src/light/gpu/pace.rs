//! How much a device is given to do at once.

/// How long dispatches are, in paths: 4 million at first (6 ms on a large GPU, a second on one two hundred times slower), then as many as take
/// [`DISPATCH_SECONDS`]: the end of each leaves most of the device idle.
pub(super) struct Pace {
    /// Paths of a dispatch.
    pub paths: u32,
}

pub(super) const FEWEST_PATHS: u32 = 4 << 20;
const MOST_PATHS: u32 = 256 << 20;
/// Far below what watchdogs bark at.
const DISPATCH_SECONDS: f64 = 0.2;

impl Default for Pace {
    fn default() -> Self {
        Self { paths: FEWEST_PATHS }
    }
}

impl Pace {
    /// Learns that so many paths took so many seconds.
    pub fn learn(&mut self, paths: u64, seconds: f64) {
        // What fills no dispatch says little.
        if paths >= u64::from(FEWEST_PATHS) / 2 {
            let affordable = (paths as f64 / seconds.max(1e-6) * DISPATCH_SECONDS).min(2.0 * f64::from(self.paths));
            self.paths = (affordable as u32).clamp(FEWEST_PATHS, MOST_PATHS);
        }
    }

    /// What may be done at once where at first it is so much.
    pub fn scaled(&self, at_first: u32) -> u32 {
        (u64::from(at_first) * u64::from(self.paths) / u64::from(FEWEST_PATHS)).min(u64::from(u32::MAX)) as u32
    }
}
