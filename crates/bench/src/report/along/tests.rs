//! Truths about figures along the way: who is in them, what is said of outages, and that they are sound SVG.

use super::*;
use crate::metrics::outage::rates as link;
use crate::metrics::{FrameMetrics, SpectrumMetrics, radio};

fn frame(index: usize, link: Option<LinkRates>) -> FrameMetrics {
    let radio = radio::RadioMetrics { psp_similarity: 1.0, energy_capture_1: 1.0, energy_capture_5: 1.0, ..Default::default() };
    let beams =
        BeamMetrics { codebook_loss_db: 3.0, beam_top1: 0.0, beam_top3: 1.0, rate_loss_bps_hz: 0.5, rate_loss_percent: 9.0 };
    let spectrum = SpectrumMetrics {
        psnr_rf_jet: 20.0,
        ssim_rf_jet: 0.9,
        psnr_rf_scalar: 20.0,
        ssim_rf_scalar: 0.9,
        radio: Some(radio),
        beams: link.map(|_| beams),
        link,
    };
    FrameMetrics { index, masked_out: false, light: None, spectrum: Some(spectrum), lpips: Default::default() }
}

fn numbers(frames: Vec<FrameMetrics>) -> Numbers {
    Numbers::of(frames, Some(1.0), None, None, Vec::new(), None)
}

/// Sixteen keyframes half a metre apart; those at 0 and at 8 are held out.
fn positions() -> Vec<DVec3> {
    (0..16).map(|i| DVec3::new(0.5 * f64::from(i), 0.0, 1.6)).collect()
}

fn two(links: [LinkRates; 2]) -> Numbers {
    numbers(links.into_iter().zip([0, 8]).map(|(link, index)| frame(index, Some(link))).collect())
}

#[test]
fn rows_without_rates_or_of_other_keyframes_are_left_out_and_colours_stay() {
    let old = numbers(vec![frame(0, None), frame(8, None)]);
    let ours = two([link(5.0, 5.0, 5.0, None); 2]);
    let elsewhere = numbers(vec![frame(1, Some(link(5.0, 5.0, 5.0, None)))]);
    let half = numbers(vec![frame(0, Some(link(5.0, 5.0, 5.0, None))), frame(8, None)]);
    let cells = [("old", &old), ("ours", &ours), ("elsewhere", &elsewhere), ("half", &half), ("again", &ours)];
    let way = Way::of(&cells, &positions()).unwrap();
    assert_eq!(way.tracks.iter().map(|t| (t.label.as_str(), t.row)).collect::<Vec<_>>(), [("ours", 1), ("again", 4)]);
    assert_eq!(way.axis.stops, [0.0, 4.0]);
    assert!(Way::of(&cells[..1], &positions()).is_none() && Way::of(&[], &positions()).is_none());
}

#[test]
fn outages_are_counted_and_blockage_is_told_from_distance() {
    let note = |links| Way::of(&[("a", &two(links))], &positions()).unwrap().note();
    let served = link(5.0, 5.0, 5.0, Some(8.0));
    assert!(note([served; 2]).contains("in outage at 0 of 2 keyframes. "));
    let blocked = link(0.2, 0.1, 5.0, Some(8.0));
    assert!(note([served, blocked]).contains("in outage at 1 of 2 keyframes, at 1 of them by blockage"));
    let far = link(0.2, 0.2, 0.2, Some(0.3));
    assert!(note([far, blocked]).contains("in outage at 2 of 2 keyframes, at 1 of them by blockage"));
    let unknown = link(0.2, 0.2, 0.2, None);
    assert!(note([served, unknown]).contains("in outage at 1 of 2 keyframes. "), "what is not known is not said");
}

#[test]
fn figures_are_sound_whatever_the_rows_are_called() {
    let label = "none of its parts: <b>surface</b> points & a \"lobe\" for the beam\u{1b}[31m";
    let all = two([link(5.0, 0.1, 5.0, Some(8.0)), link(0.2, 0.1, 5.0, Some(0.4))]);
    let nothing = two([link(0.0, 0.0, 0.0, None); 2]);
    let one = numbers(vec![frame(8, Some(link(5.0, 4.0, 3.0, None)))]);
    for numbers in [&all, &nothing, &one] {
        let way = Way::of(&[(label, numbers), ("b", numbers)], &positions()).unwrap();
        for svg in [beam::svg(&way).unwrap(), rate::svg(&way).unwrap(), outage::svg(&way).unwrap()] {
            assert!(!svg.contains("<b>") && !svg.contains('\u{1b}') && !svg.contains("NaN") && !svg.contains("inf"), "{svg}");
            assert!(svg.contains("&lt;b&gt;surface") && svg.contains('…'), "a long name is cut");
            // The last thing that is drawn, the name of the lowest axis, ends shortly above the foot: no empty strip, nothing cut.
            let number = |text: &str| text.split('"').next().unwrap().parse::<f64>().unwrap();
            let height = number(svg.split("height=\"").nth(1).unwrap());
            let lowest = svg.split("<text x=").skip(1).map(|t| number(t.split("y=\"").nth(1).unwrap())).fold(0.0, f64::max);
            assert!((8.0..32.0).contains(&(height - lowest)), "text down to {lowest} of {height}");
            let inline = without_size(&svg);
            let head = &inline[..inline.find('>').unwrap()];
            assert!(
                head.starts_with("<svg ")
                    && head.contains("viewBox=\"0 0 1000 ")
                    && !head.contains(" width=")
                    && !head.contains(" height="),
                "{head}"
            );
            assert_eq!(&inline[head.len()..], &svg[svg.find('>').unwrap()..]);
        }
    }
}
