//! An sRGB drawing surface with coverage-based antialiasing, and its encoding as PNG or JPEG.

use crate::Raster;
use image::{ExtendedColorType, ImageEncoder, codecs};

/// An sRGB colour, components in `[0, 1]`.
pub type Rgb = [f32; 3];

/// `0xrrggbb` as a colour.
pub const fn hex(code: u32) -> Rgb {
    [((code >> 16) & 255) as f32 / 255.0, ((code >> 8) & 255) as f32 / 255.0, (code & 255) as f32 / 255.0]
}

/// Linear interpolation, `t` clamped.
pub fn mix(a: Rgb, b: Rgb, t: f32) -> Rgb {
    let t = t.clamp(0.0, 1.0);
    [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t, a[2] + (b[2] - a[2]) * t]
}

/// A colour times a factor.
pub fn scale(a: Rgb, k: f32) -> Rgb {
    a.map(|v| v * k)
}

/// 0 below `a`, 1 above `b`, smooth between.
pub fn smoothstep(a: f32, b: f32, x: f32) -> f32 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Encoding of an image in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureFormat {
    /// Lossless: prints and flat colours.
    Png,
    /// Photo-like noise, at this quality.
    Jpeg(u8),
}

/// An image under construction.
#[derive(Clone, Debug)]
pub struct Canvas {
    pixels: Raster<Rgb>,
}

impl Canvas {
    /// One colour.
    pub fn filled(width: usize, height: usize, colour: Rgb) -> Self {
        Self { pixels: Raster::filled(width, height, colour) }
    }

    /// A colour at every pixel, from its centre in `[0, 1]²` (u right, v down).
    pub fn shaded(width: usize, height: usize, f: impl Fn(f32, f32) -> Rgb) -> Self {
        let at = |i: usize, n: usize| (i as f32 + 0.5) / n as f32;
        Self { pixels: Raster::from_fn(width, height, |x, y| f(at(x, width), at(y, height))) }
    }

    /// Tangent-space normals (glTF: x right, y up in the image, stored ·0.5 + 0.5) of a height field that repeats; `strength` is the
    /// slope of one unit of height per pixel.
    pub fn normals(width: usize, height: usize, strength: f32, f: impl Fn(f32, f32) -> f32) -> Self {
        let field = Raster::from_fn(width, height, |x, y| f((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32));
        let slope = |x: usize, y: usize| {
            let dx = field[((x + 1) % width, y)] - field[((x + width - 1) % width, y)];
            let dy = field[(x, (y + 1) % height)] - field[(x, (y + height - 1) % height)];
            let n = [-0.5 * strength * dx, 0.5 * strength * dy, 1.0];
            let length = (n[0] * n[0] + n[1] * n[1] + 1.0).sqrt();
            n.map(|v| v / length * 0.5 + 0.5)
        };
        Self { pixels: Raster::from_fn(width, height, slope) }
    }

    /// Paints `colour` wherever the signed distance `f(x, y)` (pixels, negative inside) says, within a box `[x0, y0, x1, y1]`.
    pub fn fill(&mut self, bounds: [f32; 4], colour: Rgb, f: impl Fn(f32, f32) -> f32) {
        let (w, h) = (self.pixels.width(), self.pixels.height());
        let clamp = |v: f32, n: usize| v.max(0.0).min(n as f32) as usize;
        for y in clamp(bounds[1] - 1.0, h)..clamp(bounds[3] + 2.0, h) {
            for x in clamp(bounds[0] - 1.0, w)..clamp(bounds[2] + 2.0, w) {
                let coverage = (0.5 - f(x as f32 + 0.5, y as f32 + 0.5)).clamp(0.0, 1.0);
                if coverage > 0.0 {
                    self.pixels[(x, y)] = mix(self.pixels[(x, y)], colour, coverage);
                }
            }
        }
    }

    /// A rectangle, pixels.
    pub fn rect(&mut self, x0: f32, y0: f32, x1: f32, y1: f32, colour: Rgb) {
        self.fill([x0, y0, x1, y1], colour, |x, y| (x0 - x).max(x - x1).max(y0 - y).max(y - y1));
    }

    /// A disc, pixels.
    pub fn disc(&mut self, cx: f32, cy: f32, r: f32, colour: Rgb) {
        self.ring(cx, cy, 0.0, r, colour);
    }

    /// A ring between two radii, pixels.
    pub fn ring(&mut self, cx: f32, cy: f32, inner: f32, outer: f32, colour: Rgb) {
        self.fill([cx - outer, cy - outer, cx + outer, cy + outer], colour, |x, y| {
            let d = ((x - cx) * (x - cx) + (y - cy) * (y - cy)).sqrt();
            if inner > 0.0 { (d - outer).max(inner - d) } else { d - outer }
        });
    }

    /// A line with round ends, `width` pixels wide.
    pub fn line(&mut self, a: [f32; 2], b: [f32; 2], width: f32, colour: Rgb) {
        let r = 0.5 * width;
        let bounds = [a[0].min(b[0]) - r, a[1].min(b[1]) - r, a[0].max(b[0]) + r, a[1].max(b[1]) + r];
        let d = [b[0] - a[0], b[1] - a[1]];
        let l2 = (d[0] * d[0] + d[1] * d[1]).max(1e-9);
        self.fill(bounds, colour, |x, y| {
            let t = (((x - a[0]) * d[0] + (y - a[1]) * d[1]) / l2).clamp(0.0, 1.0);
            let (ex, ey) = (x - a[0] - t * d[0], y - a[1] - t * d[1]);
            (ex * ex + ey * ey).sqrt() - r
        });
    }

    /// A convex polygon (either orientation), pixels.
    pub fn polygon(&mut self, points: &[[f32; 2]], colour: Rgb) {
        let n = points.len();
        let area: f32 = (0..n).map(|i| points[i][0] * points[(i + 1) % n][1] - points[(i + 1) % n][0] * points[i][1]).sum();
        let flip = if area < 0.0 { -1.0 } else { 1.0 };
        let bounds = points.iter().fold([f32::MAX, f32::MAX, f32::MIN, f32::MIN], |b, p| {
            [b[0].min(p[0]), b[1].min(p[1]), b[2].max(p[0]), b[3].max(p[1])]
        });
        self.fill(bounds, colour, |x, y| {
            (0..n).fold(f32::MIN, |worst, i| {
                let (a, b) = (points[i], points[(i + 1) % n]);
                let (ex, ey) = (b[0] - a[0], b[1] - a[1]);
                let outside = flip * (ey * (x - a[0]) - ex * (y - a[1])) / (ex * ex + ey * ey).sqrt().max(1e-6);
                worst.max(outside)
            })
        });
    }

    /// Recolours every pixel: `f(u, v, colour)`.
    pub fn recolour(&mut self, f: impl Fn(f32, f32, Rgb) -> Rgb) {
        let (w, h) = (self.pixels.width(), self.pixels.height());
        for y in 0..h {
            for x in 0..w {
                self.pixels[(x, y)] = f((x as f32 + 0.5) / w as f32, (y as f32 + 0.5) / h as f32, self.pixels[(x, y)]);
            }
        }
    }

    /// The image file's bytes.
    pub fn encode(&self, format: PictureFormat) -> Vec<u8> {
        let (w, h) = (self.pixels.width() as u32, self.pixels.height() as u32);
        let rgb: Vec<u8> = self.pixels.pixels().iter().flat_map(|p| p.map(crate::color::quantize8)).collect();
        let mut bytes = Vec::new();
        let written = match format {
            PictureFormat::Png => codecs::png::PngEncoder::new_with_quality(
                &mut bytes,
                codecs::png::CompressionType::Default,
                codecs::png::FilterType::Adaptive,
            )
            .write_image(&rgb, w, h, ExtendedColorType::Rgb8),
            PictureFormat::Jpeg(quality) => {
                codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, quality).write_image(&rgb, w, h, ExtendedColorType::Rgb8)
            }
        };
        // Nothing here depends on input: the sizes are this module's constants and the sink is memory.
        written.expect("an RGB image of fixed size encodes into memory");
        bytes
    }
}
