//! The keyframe that a run's page opens on.

use crate::experiment::cells::record_of_model;
use crate::metrics::FrameMetrics;
use crate::record::{METRICS, Outcome, Record};
use crate::run::RunInfo;
use crate::split::Split;
use std::path::Path;

/// Index of the held-out keyframe that was predicted best, by the record beside the run (`corf evaluate`) or in the comparison that keeps it; without one
/// that in the middle of those held out, since the first stands where the way begins and little was seen from there.
pub(super) fn opening(folder: &Path, info: &RunInfo, split: &Split) -> usize {
    let of_comparison = || Record::read(&record_of_model(folder, info.seed)?).ok();
    let record = Record::read(&folder.join(METRICS)).ok().or_else(of_comparison);
    let record = record.filter(|r| r.method == info.method && r.seed == info.seed);
    let frames = match record.map(|r| r.outcome) {
        Some(Outcome::Done(numbers)) => numbers.frames,
        _ => Vec::new(),
    };
    best(&frames, &split.held_out).or(split.held_out.get(split.held_out.len() / 2).copied()).unwrap_or(0)
}

/// The keyframe with the largest sum of PSNRs, light and radio.
fn best(frames: &[FrameMetrics], held_out: &[usize]) -> Option<usize> {
    let psnr_db = |frame: &FrameMetrics| {
        frame.light.map_or(0.0, |light| light.psnr_opt) + frame.spectrum.as_ref().map_or(0.0, |spectrum| spectrum.psnr_rf_scalar)
    };
    let candidates = frames.iter().filter(|frame| held_out.contains(&frame.index) && psnr_db(frame).is_finite());
    candidates.max_by(|a, b| psnr_db(a).total_cmp(&psnr_db(b))).map(|frame| frame.index)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::LightMetrics;

    #[test]
    fn the_best_frame_of_those_held_out_is_opened() {
        let frame = |index, psnr_opt| FrameMetrics {
            index,
            masked_out: false,
            light: Some(LightMetrics { psnr_opt, ssim_opt: 0.9 }),
            spectrum: None,
            lpips: Default::default(),
        };
        let frames = [frame(0, 20.0), frame(8, 31.0), frame(16, 28.0), frame(17, 40.0), frame(24, f64::INFINITY)];
        assert_eq!(best(&frames, &[0, 8, 16, 24]), Some(8));
        assert_eq!(best(&frames, &[3]), None);
    }
}
