//! Tone mapping: from linear radiance to an 8-bit picture.

use super::LightFrame;
use corf_scene::Raster;
use corf_scene::color::{TONE_KNEE, quantize8, srgb_from_linear};
use rayon::prelude::*;

/// Exposes, rolls highlights off and encodes in sRGB.
///
/// With `x = 2^exposure_ev · radiance` per channel: `y = x` up to the knee `k = 0.6`, and `y = k + (1 − k)·(1 − exp(−(x − k)/(1 − k)))`
/// above: slope 1 at the knee, white only at infinity. `y` is then sRGB-encoded (IEC 61966-2-1) and rounded to 8 bits. Values that are
/// negative or not a number become black.
pub fn develop(radiance: &Raster<[f32; 3]>, exposure_ev: f32) -> Raster<[u8; 3]> {
    let gain = exposure_ev.exp2();
    radiance.map(|rgb| rgb.map(|c| quantize8(srgb_from_linear(shoulder((c * gain).max(0.0))))))
}

/// Develops a frame: as [`develop`], but the paths of a pixel that see an emitter straight are developed apart from the others and the two
/// mixed by their shares, both linear. A pixel of which half is a white lamp is half white, however bright the lamp.
pub fn develop_frame(frame: &LightFrame, exposure_ev: f32) -> Raster<[u8; 3]> {
    let (radiance, lamp) = (frame.radiance.pixels(), frame.lamp.pixels());
    let developed = radiance.par_iter().zip(lamp).map(|(r, l)| develop_pixel(*r, *l, exposure_ev).map(quantize8));
    Raster::from_vec(frame.radiance.width(), frame.radiance.height(), developed.collect())
}

/// One pixel of [`develop_frame`], before rounding to 8 bits: sRGB values from 0 to 1.
pub fn develop_pixel(radiance: [f32; 3], lamp: [f32; 4], exposure_ev: f32) -> [f32; 3] {
    let gain = exposure_ev.exp2();
    let exposed =
        |radiance: f32, share: f32| if share > 0.0 { share * shoulder((radiance / share * gain).max(0.0)) } else { 0.0 };
    std::array::from_fn(|c| srgb_from_linear(exposed(lamp[c], lamp[3]) + exposed(radiance[c] - lamp[c], 1.0 - lamp[3])))
}

/// Tone-mapped and sRGB-encoded value of an exposed radiance (radiance × 2^EV), from 0 to 1, before it is rounded to 8 bits.
pub(super) fn develop_value(exposed: f32) -> f32 {
    srgb_from_linear(shoulder(exposed.max(0.0)))
}

fn shoulder(x: f32) -> f32 {
    if x <= TONE_KNEE { x } else { TONE_KNEE + (1.0 - TONE_KNEE) * (1.0 - (-(x - TONE_KNEE) / (1.0 - TONE_KNEE)).exp()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_below_the_knee_smooth_and_monotone_above() {
        assert_eq!(shoulder(0.18), 0.18);
        let h = 1e-3;
        assert!(((shoulder(TONE_KNEE + h) - shoulder(TONE_KNEE - h)) / (2.0 * h) - 1.0).abs() < 2e-3, "slope 1 across the knee");
        let mut last = 0.0;
        for i in 0..400 {
            let y = shoulder(i as f32 * 0.01);
            assert!(y <= 1.0 && y >= last);
            last = y;
        }
    }

    #[test]
    fn a_grey_card_lands_on_its_srgb_value_and_a_stop_doubles() {
        let card = Raster::filled(1, 1, [0.18f32; 3]);
        assert_eq!(develop(&card, 0.0)[(0, 0)], [118; 3]);
        assert_eq!(develop(&card, 1.0), develop(&Raster::filled(1, 1, [0.36; 3]), 0.0));
        assert_eq!(develop(&Raster::filled(1, 1, [f32::NAN, -1.0, 0.0]), 0.0)[(0, 0)], [0; 3]);
    }
}
