//! The report of `corf bench light` as lines.

use super::{Report, Together};
use crate::scenes::generate;
use std::fmt::Write;

/// The report as a person reads it.
pub fn text(report: &Report) -> String {
    let percent = |v: Option<f64>| v.map_or("-".to_string(), |v| format!("{:.2} %", 100.0 * v));
    let mut out = format!(
        "{}: {}x{}, {} samples a pixel ({:?}) on {}, reference {} + {} unbiased; {} threads\nprepared in {:.1} s, exposure {} EV\n\
         keyframe   PSNR dB  error   noise dB   reference dB     radiance ratio   two views   rays/pixel   seconds    again",
        report.dataset,
        report.width,
        report.height,
        report.samples_per_pixel,
        report.method,
        report.device,
        report.reference_samples,
        report.reference_samples,
        report.threads,
        report.prepare_seconds,
        report.exposure_ev,
    );
    for v in &report.views {
        let _ = write!(
            out,
            "\n{:>8} {:>9.2} ±{:<5.2} {:>10.2} {:>14.2} {:>10.4} ±{:.4} {:>11} {:>12.1} {:>9.2} {:>8.2}",
            v.keyframe,
            v.psnr_db,
            v.psnr_error_db,
            v.noise_psnr_db,
            v.reference_psnr_db,
            v.radiance_ratio,
            v.radiance_ratio_error,
            percent(v.two_views_difference),
            v.rays_a_pixel,
            v.seconds,
            v.seconds_again
        );
    }
    let _ = write!(
        out,
        "\n     all {:>9.2} ±{:<5.2} {:>25} {:>10.4} {:>19} {:>22.2}",
        report.psnr_db,
        report.psnr_error_db,
        "",
        report.radiance_ratio,
        percent(report.two_views_difference),
        report.seconds_a_view
    );
    if let Some(Together { views, seconds_a_view, seconds_a_view_again }) = report.together {
        let _ = write!(
            out,
            "\n{views} views handed over at once: {seconds_a_view:.3} s a view, again {seconds_a_view_again:.3} s\n\
             where the time went, seconds (times): {}",
            generate::spent_text(&report.spent)
        );
    }
    if let Some(all) = &report.against_processor {
        let _ = write!(out, "\nagainst the processor: PSNR dB    light    seconds    again   times faster");
        let named = report.views.iter().filter_map(|v| Some((v.keyframe.to_string(), v.against_processor.as_ref()?)));
        for (name, a) in named.chain([("all".to_owned(), all)]) {
            let _ = write!(
                out,
                "\n{name:>22} {:>8.2} {:>8.5} {:>10.2} {:>8.2} {:>14.1}",
                a.psnr_db, a.radiance_ratio, a.seconds, a.seconds_again, a.times_faster
            );
        }
    }
    out
}
