//! Where the time of training goes on a device with a clock of its own.

use serde::{Deserialize, Serialize};
use std::fmt::Write as _;

/// Time of training steps, on the host and on a device that has a clock of its own.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrainingTimes {
    /// Batches of steps: a keyframe's, mostly.
    pub batches: usize,
    /// Submissions to the device.
    pub submissions: usize,
    /// Times that steps were submitted again, for lack of room.
    pub repeated: usize,
    /// Seconds of the host to record steps and hand them over.
    pub recording_s: f64,
    /// Seconds that the host waited for the device's report.
    pub waiting_s: f64,
    /// Seconds between submissions of one batch in which the device had nothing to do.
    pub starved_s: f64,
    /// Visible Gaussians of each batch's last step, summed over batches.
    pub visible: u64,
    /// (Gaussian, tile) pairs of each batch's largest frame, summed over batches.
    pub pairs: u64,
    /// By size of the images.
    pub frames: Vec<FrameTimes>,
    /// What else is on the host's way from keyframe to keyframe: a name, seconds.
    pub host: Vec<(String, f64)>,
}

/// Time of the steps on images of one size, by the device's clock.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameTimes {
    /// Pixels of the optical image, and of the spectrum, across and down; 0 where it was not rendered.
    #[serde(rename = "optical")]
    pub light: [u32; 2],
    /// Of the spectrum.
    #[serde(rename = "rf")]
    pub radio: [u32; 2],
    /// Steps.
    pub steps: usize,
    /// Each kernel's name and seconds.
    pub kernels: Vec<(String, f64)>,
}

impl TrainingTimes {
    /// A table for people: what a batch takes, then a row a size, a column a kernel, milliseconds a step.
    pub fn table(&self) -> String {
        let batches = self.batches.max(1) as f64;
        let on_device: f64 = self.frames.iter().flat_map(|f| &f.kernels).map(|k| k.1).sum();
        let mut text = format!(
            "ms a batch of steps ({} in {} submissions, {} repeated; {:.0} visible Gaussians, {:.0} pairs):",
            self.batches,
            self.submissions,
            self.repeated,
            self.visible as f64 / batches,
            self.pairs as f64 / batches
        );
        let own =
            [("kernels", on_device), ("starved", self.starved_s), ("recording", self.recording_s), ("waiting", self.waiting_s)];
        for (name, seconds) in own.into_iter().chain(self.host.iter().map(|(name, s)| (name.as_str(), *s))) {
            let _ = write!(text, "  {name} {:.2}", 1e3 * seconds / batches);
        }
        text.push('\n');
        let Some(first) = self.frames.first() else { return text };
        let _ = write!(text, "{:<22}{:>8}{:>9}", "ms a step", "steps", "all");
        first.kernels.iter().for_each(|(name, _)| {
            let _ = write!(text, "{name:>11}");
        });
        for frame in &self.frames {
            let ([a, b], [c, d]) = (frame.light, frame.radio);
            let per_step = 1e3 / frame.steps.max(1) as f64;
            let all: f64 = frame.kernels.iter().map(|k| k.1).sum();
            let _ = write!(text, "\n{:<22}{:>8}{:>9.3}", format!("{a}x{b} + {c}x{d}"), frame.steps, all * per_step);
            for (_, seconds) in &frame.kernels {
                let _ = write!(text, "{:>11.3}", seconds * per_step);
            }
        }
        text
    }
}
