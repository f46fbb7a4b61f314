//! A coverage map as a picture: colours, walls, transmitters, axes in metres and a scale.

use corf_raytrace::radio::coverage::CoveragePlane;
use corf_scene::draw::{Canvas, PictureFormat, TextAnchor, clip, hex, metre_axes, text};
use corf_scene::{Raster, Scene, color};
use glam::{DVec2, DVec3};

/// Pixels of the map's longer side, about.
const MAP_PIXELS: f64 = 900.0;
/// Margins: left, top, right, bottom, pixels.
const MARGIN: [usize; 4] = [64, 66, 130, 56];
/// The colours span this much at most, dB; what is weaker has the darkest one.
const MAX_SPAN_DB: f64 = 70.0;
/// The picture's range is a multiple of this, dB.
const STEP_DB: f64 = 5.0;
/// Height of capitals, pixels.
const CAP: f32 = 11.0;
const INK: [f32; 3] = hex(0x1a1a1a);
const BODY: [f32; 3] = hex(0xb4b4b4);
const PAPER: [f32; 3] = hex(0xffffff);

/// A map with the range of its colours.
pub struct CoveragePicture<'m> {
    gain: &'m Raster<f32>,
    plane: &'m CoveragePlane,
    tx_power_dbm: f64,
    range_dbm: [f64; 2],
}

impl<'m> CoveragePicture<'m> {
    /// Chooses the range: up to the strongest cell, down to the weakest one or [`MAX_SPAN_DB`] below.
    pub fn new(gain: &'m Raster<f32>, plane: &'m CoveragePlane, tx_power_dbm: f64) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for gain in gain.pixels().iter().filter(|g| **g > 0.0) {
            let dbm = 10.0 * f64::from(*gain).log10() + tx_power_dbm;
            (low, high) = (low.min(dbm), high.max(dbm));
        }
        let range_dbm = if high.is_finite() {
            let top = (high / STEP_DB).ceil() * STEP_DB;
            [(low / STEP_DB).floor() * STEP_DB, top]
        } else {
            [tx_power_dbm - MAX_SPAN_DB, tx_power_dbm]
        };
        let range_dbm = [range_dbm[0].max(range_dbm[1] - MAX_SPAN_DB).min(range_dbm[1] - STEP_DB), range_dbm[1]];
        Self { gain, plane, tx_power_dbm, range_dbm }
    }

    /// Darkest and lightest colour, dBm.
    pub fn range_dbm(&self) -> [f64; 2] {
        self.range_dbm
    }

    /// The PNG's bytes.
    pub fn draw(&self, scene: &Scene, transmitters: &[DVec3]) -> Vec<u8> {
        let plane = self.plane;
        let scale = ((MAP_PIXELS / plane.columns.max(plane.rows) as f64).round()).max(1.0) as usize;
        let (width, height) = (plane.columns * scale, plane.rows * scale);
        let [left, top, right, bottom] = MARGIN;
        let mut canvas = Canvas::filled(left + width + right, top + height + bottom, PAPER);
        let size = [canvas_size(left + width + right), canvas_size(top + height + bottom)];
        canvas.recolour(|u, v, paper| {
            let (x, y) = ((u * size[0]) as usize, (v * size[1]) as usize);
            if x < left || y < top || x >= left + width || y >= top + height {
                return paper;
            }
            let (x, y) = (x - left, y - top);
            match self.gain[(x / scale, y / scale)] {
                // Hatched: the inside of a body.
                gain if gain.is_nan() => {
                    if (x + y) % 8 < 2 {
                        INK
                    } else {
                        BODY
                    }
                }
                gain => color::viridis(self.scalar(gain)),
            }
        });
        let per_metre = scale as f64 / plane.cell_m;
        let pixel = |p: DVec2| [(left as f64 + p.x * per_metre) as f32, (top + height) as f32 - (p.y * per_metre) as f32];
        self.walls(&mut canvas, scene, &pixel);
        for (number, tx) in transmitters.iter().enumerate() {
            let [x, y] = pixel(plane.project(*tx));
            canvas.disc(x, y, 8.0, INK);
            canvas.disc(x, y, 6.0, hex(0xe8303a));
            canvas.disc(x, y, 2.0, PAPER);
            let inside = x > left as f32 && x < (left + width) as f32;
            let (label_x, anchor) = if inside && x + 60.0 > (left + width) as f32 {
                (x - 12.0, TextAnchor::Right)
            } else {
                (x + 12.0, TextAnchor::Left)
            };
            let label = if transmitters.len() == 1 { "TX".into() } else { format!("TX{number}") };
            text(&mut canvas, &label, [label_x, y + 5.0], anchor, CAP, PAPER);
        }
        self.title(&mut canvas, transmitters.len());
        self.axes(&mut canvas, width, height, per_metre);
        self.scale(&mut canvas, width, height);
        canvas.encode(PictureFormat::Png)
    }

    /// Normalised level of a linear gain: 0 at the lower end of the dBm range, 1 at its upper end.
    fn scalar(&self, gain: f32) -> f32 {
        let dbm = 10.0 * f64::from(gain.max(f32::MIN_POSITIVE)).log10() + self.tx_power_dbm;
        ((dbm - self.range_dbm[0]) / (self.range_dbm[1] - self.range_dbm[0])) as f32
    }

    fn walls(&self, canvas: &mut Canvas, scene: &Scene, pixel: &impl Fn(DVec2) -> [f32; 2]) {
        let plane = self.plane;
        let size = DVec2::new(plane.columns as f64, plane.rows as f64) * plane.cell_m;
        for [a, b] in plane.cut(scene) {
            if let Some([a, b]) = clip(a, b, size) {
                canvas.line(pixel(a), pixel(b), 2.2, INK);
            }
        }
    }

    /// Frame and ticks.
    fn axes(&self, canvas: &mut Canvas, width: usize, height: usize, per_metre: f64) {
        let plane = self.plane;
        let [left, top, ..] = MARGIN.map(|m| m as f32);
        let (right, bottom) = (left + width as f32, top + height as f32);
        // Horizontal planes are labelled in world coordinates, others from their corner.
        let flat = self.is_ground_plan();
        let from = if flat { DVec2::new(plane.corner.x, plane.corner.y) } else { DVec2::ZERO };
        let names = if flat { ["X m", "Y m"] } else { ["U m", "V m"] };
        metre_axes(canvas, [left, top, right, bottom], from, per_metre, names, (CAP, INK));
    }

    fn title(&self, canvas: &mut Canvas, transmitters: usize) {
        let [left, top, ..] = MARGIN.map(|m| m as f32);
        let height_of = if self.is_ground_plan() { format!(" AT z = {:.2} m", self.plane.corner.z) } else { String::new() };
        let of = if transmitters == 1 { String::new() } else { format!(" OF THE STRONGEST OF {transmitters}") };
        let title = format!("RSSI{height_of}{of}, {} dBm TRANSMITTED", self.tx_power_dbm);
        text(canvas, &title, [left, top - 38.0], TextAnchor::Left, CAP + 1.0, INK);
    }

    /// Whether it is horizontal, columns to the east.
    fn is_ground_plan(&self) -> bool {
        self.plane.along_u == DVec3::X && self.plane.along_v == DVec3::Y
    }

    /// The colour scale right of the map.
    fn scale(&self, canvas: &mut Canvas, width: usize, height: usize) {
        let (left, top) = ((MARGIN[0] + width + 26) as f32, MARGIN[1] as f32);
        let (bar, bottom) = (20.0, top + height as f32);
        for y in 0..height {
            let colour = color::viridis(1.0 - (y as f32 + 0.5) / height as f32);
            canvas.rect(left, top + y as f32, left + bar, top + y as f32 + 1.0, colour);
        }
        let [low, high] = self.range_dbm;
        let step = if high - low > 30.0 { 10.0 } else { 5.0 };
        for i in (low / step).ceil() as i64..=(high / step).floor() as i64 {
            let dbm = i as f64 * step;
            let y = bottom - ((dbm - low) / (high - low)) as f32 * (bottom - top);
            canvas.line([left + bar, y], [left + bar + 5.0, y], 1.2, INK);
            text(canvas, &format!("{dbm}"), [left + bar + 14.0, y + 0.5 * CAP], TextAnchor::Left, CAP, INK);
        }
        text(canvas, "dBm", [left, top - 14.0], TextAnchor::Left, CAP, INK);
    }
}

fn canvas_size(pixels: usize) -> f32 {
    pixels as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_holds_the_strongest_cell_and_70_db_at_most() {
        let plane = CoveragePlane::new(DVec3::ZERO, DVec3::X, DVec3::Y, 0.5).unwrap();
        let range = |values: [f32; 4]| CoveragePicture::new(&Raster::from_vec(2, 2, values.to_vec()), &plane, 0.0).range_dbm();
        assert_eq!(range([1.1e-6, 1e-8, f32::NAN, 2e-9]), [-90.0, -55.0]);
        assert_eq!(range([1.1e-6, 1e-20, 0.0, f32::NAN]), [-125.0, -55.0]);
        assert_eq!(range([0.0, 0.0, 0.0, f32::NAN]), [-70.0, 0.0]);
        assert_eq!(range([1e-6; 4]), [-65.0, -60.0]);
    }
}
