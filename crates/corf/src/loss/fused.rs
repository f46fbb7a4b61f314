//! (1 − γ)·L1 + γ·(1 − SSIM) with its gradient, in three passes over rows.
//!
//! With the moments μ_x = E x, E x², E xy under the window, S = (2μ_xμ_y + C₁)(2σ_xy + C₂) / ((μ_x² + μ_y² + C₁)(σ_x² + σ_y² + C₂)) is
//! differentiated with respect to the moments; the window being symmetric, its adjoint is the same blur:
//! dS/dx = E[∂S/∂μ_x] + 2x E[∂S/∂E x²] + y E[∂S/∂E xy]. The target's own moments do not change and are kept.

use super::{C1, C2, RADIUS, WINDOW};
use crate::{
    device::{
        Planes,
        cpu::{
            blend::AREA,
            project::{TILE_HEIGHT, TILE_WIDTH},
        },
    },
    simd::{Isa, Kernel, Lanes},
};
use rayon::prelude::*;

/// Rows are padded to a multiple of this.
const ROW_UNIT: usize = 16;
/// Zeros before and after a row, so that the window may reach beyond it (5 needed; a full unit keeps loads in range).
const MARGIN: usize = ROW_UNIT;
/// Rows per unit of parallel work.
const BAND: usize = 8;

/// Numbers from one row to the next of an image of this width.
pub(crate) fn stride_of(width: usize) -> usize {
    width.next_multiple_of(ROW_UNIT)
}

/// A target image with what SSIM needs to know of it.
pub(crate) struct Target {
    pub width: usize,
    pub height: usize,
    pub channels: usize,
    stride: usize,
    /// `[channel][row][stride]`.
    pixels: Vec<f32>,
    /// μ_y and E y² under the window, likewise.
    mean: Vec<f32>,
    mean_square: Vec<f32>,
    /// Per row of a channel, the columns that do not count, if there are any: what is rendered there is taken to be the target, and has no gradient.
    left_out: Option<Vec<Vec<usize>>>,
}

impl Target {
    /// An image of which only those pixels count, row-major, that `mask` has true.
    pub fn new(isa: Isa, image: &Planes, mask: Option<&[bool]>) -> Self {
        let stride = stride_of(image.width);
        let mut pixels = vec![0.0; image.channels * image.height * stride];
        for (i, v) in image.pixels.iter().enumerate() {
            let (c, x, y) = (i % image.channels, i / image.channels % image.width, i / image.channels / image.width);
            pixels[(c * image.height + y) * stride + x] = *v;
        }
        let rows = image.channels * image.height;
        let mut across = vec![0.0; rows * 2 * stride];
        across.par_chunks_mut(2 * stride).zip(pixels.par_chunks(stride)).for_each(|(out, row)| {
            let (mean, square) = out.split_at_mut(stride);
            isa.dispatch(TargetRow { row, width: image.width, mean, square });
        });
        let (mut mean, mut mean_square) = (vec![0.0; rows * stride], vec![0.0; rows * stride]);
        mean.par_chunks_mut(stride).zip(mean_square.par_chunks_mut(stride)).enumerate().for_each(|(row, (mean, square))| {
            isa.dispatch(Down { across: &across, row, height: image.height, stride, out: [mean, square] });
        });
        let columns = |row: &[bool]| row.iter().enumerate().filter(|(_, counts)| !**counts).map(|(x, _)| x).collect();
        let left_out = mask.map(|m| m.chunks(image.width.max(1)).map(columns).collect());
        Self { width: image.width, height: image.height, channels: image.channels, stride, pixels, mean, mean_square, left_out }
    }

    /// Columns of a row (of all channels' rows) that do not count.
    fn left_out(&self, row: usize) -> &[usize] {
        self.left_out.as_ref().map_or(&[], |rows| &rows[row % self.height])
    }
}

/// Scratch of one image's loss, and its results.
#[derive(Default)]
pub(crate) struct ImageLoss {
    /// The rendered image, row-major like the target.
    image: Vec<f32>,
    /// Per row: x, x², xy blurred along the row.
    across: Vec<f32>,
    /// Per row: the three derivatives of S, blurred along the row.
    derivatives: Vec<f32>,
    /// dL/dimage, `[channel][row][stride]`.
    pub gradient: Vec<f32>,
    /// Per row: Σ S, Σ |x − y|.
    sums: Vec<[f64; 2]>,
}

impl ImageLoss {
    /// The loss of a tile-major image; `self.gradient` becomes `weight` times its gradient.
    pub fn run(&mut self, isa: Isa, tiles: &[f32], target: &Target, weight: f32, ssim_weight: f32) -> f32 {
        let (stride, height) = (target.stride, target.height);
        let rows = target.channels * height;
        self.image.resize(rows * stride, 0.0);
        self.across.resize(rows * 3 * stride, 0.0);
        self.derivatives.resize(rows * 3 * stride, 0.0);
        self.gradient.resize(rows * stride, 0.0);
        self.sums.resize(rows, [0.0; 2]);
        let (image, across) = (&mut self.image, &mut self.across);
        image.par_chunks_mut(BAND * stride).zip(across.par_chunks_mut(BAND * 3 * stride)).enumerate().for_each(
            |(band, (image, across))| {
                isa.dispatch(AlongRows { tiles, target, first: band * BAND, image, across });
            },
        );
        let across = &self.across;
        let pass = self.derivatives.par_chunks_mut(BAND * 3 * stride).zip(self.sums.par_chunks_mut(BAND));
        pass.enumerate().for_each(|(band, (derivatives, sums))| {
            isa.dispatch(Similarity { across, target, first: band * BAND, derivatives, sums });
        });
        let (image, derivatives) = (&self.image, &self.derivatives);
        let scale = weight / (target.width * rows) as f32;
        let pass = self.gradient.par_chunks_mut(BAND * stride).zip(self.sums.par_chunks_mut(BAND));
        pass.enumerate().for_each(|(band, (gradient, sums))| {
            isa.dispatch(Gradient { image, derivatives, target, first: band * BAND, scale, ssim_weight, gradient, sums });
        });
        let [similarity, difference] = self.sums.iter().fold([0.0; 2], |a, s| [a[0] + s[0], a[1] + s[1]]);
        let n = (target.width * rows) as f64;
        let gamma = f64::from(ssim_weight);
        ((1.0 - gamma) * difference / n + gamma * (1.0 - similarity / n)) as f32
    }
}

/// A row with zeros around it.
struct Padded<'a> {
    row: &'a mut [f32],
}

/// The window along a padded row.
#[inline(always)]
fn blur_row<L: Lanes>(padded: &Padded<'_>, out: &mut [f32]) {
    for at in (0..out.len()).step_by(L::WIDTH) {
        let centre = at + MARGIN;
        let mut sum = L::splat(WINDOW[0] as f32) * L::load(&padded.row[centre..centre + L::WIDTH]);
        for i in 1..=RADIUS {
            let pair =
                L::load(&padded.row[centre - i..centre - i + L::WIDTH]) + L::load(&padded.row[centre + i..centre + i + L::WIDTH]);
            sum = pair.mul_add(L::splat(WINDOW[i] as f32), sum);
        }
        sum.store(&mut out[at..at + L::WIDTH]);
    }
}

/// The window down one column group at `at`: `N` planes interleaved row by row (`[row][plane][stride]`).
#[inline(always)]
fn blur_down<L: Lanes, const N: usize>(across: &[f32], row: usize, height: usize, stride: usize, at: usize) -> [L; N] {
    let first_of_channel = row - row % height;
    let y = row % height;
    let mut out = [L::splat(0.0); N];
    for i in y.saturating_sub(RADIUS)..=(y + RADIUS).min(height - 1) {
        let k = L::splat(WINDOW[i.abs_diff(y)] as f32);
        for n in 0..N {
            let from = ((first_of_channel + i) * N + n) * stride + at;
            out[n] = k.mul_add(L::load(&across[from..from + L::WIDTH]), out[n]);
        }
    }
    out
}

struct TargetRow<'a> {
    row: &'a [f32],
    width: usize,
    mean: &'a mut [f32],
    square: &'a mut [f32],
}

impl Kernel for TargetRow<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let mut buffer = vec![0.0; self.row.len() + 2 * MARGIN];
        buffer[MARGIN..MARGIN + self.width].copy_from_slice(&self.row[..self.width]);
        blur_row::<L>(&Padded { row: &mut buffer }, self.mean);
        for v in &mut buffer {
            *v *= *v;
        }
        blur_row::<L>(&Padded { row: &mut buffer }, self.square);
    }
}

struct Down<'a> {
    across: &'a [f32],
    row: usize,
    height: usize,
    stride: usize,
    out: [&'a mut [f32]; 2],
}

impl Kernel for Down<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        for at in (0..self.stride).step_by(L::WIDTH) {
            let [mean, square] = blur_down::<L, 2>(self.across, self.row, self.height, self.stride, at);
            mean.store(&mut self.out[0][at..at + L::WIDTH]);
            square.store(&mut self.out[1][at..at + L::WIDTH]);
        }
    }
}

/// Pass 1: tiles to rows; x, x², xy blurred along each row.
struct AlongRows<'a> {
    tiles: &'a [f32],
    target: &'a Target,
    first: usize,
    image: &'a mut [f32],
    across: &'a mut [f32],
}

impl Kernel for AlongRows<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let t = self.target;
        let (stride, width) = (t.stride, t.width);
        let columns = width.div_ceil(TILE_WIDTH);
        let mut buffers = vec![0.0_f32; 3 * (stride + 2 * MARGIN)];
        let (x_row, rest) = buffers.split_at_mut(stride + 2 * MARGIN);
        let (xx_row, xy_row) = rest.split_at_mut(stride + 2 * MARGIN);
        for (k, (image, across)) in self.image.chunks_exact_mut(stride).zip(self.across.chunks_exact_mut(3 * stride)).enumerate()
        {
            let row = self.first + k;
            let (channel, y) = (row / t.height, row % t.height);
            for tile in 0..columns {
                let from = (((y / TILE_HEIGHT) * columns + tile) * t.channels + channel) * AREA + (y % TILE_HEIGHT) * TILE_WIDTH;
                let x = tile * TILE_WIDTH;
                let n = TILE_WIDTH.min(width - x);
                image[x..x + n].copy_from_slice(&self.tiles[from..from + n]);
            }
            // The buffer may hold a larger level's image; pass 3 counts on zeros here.
            image[width..].fill(0.0);
            let truth = &t.pixels[row * stride..(row + 1) * stride];
            t.left_out(row).iter().for_each(|&x| image[x] = truth[x]);
            for i in 0..width {
                let x = image[i];
                x_row[MARGIN + i] = x;
                xx_row[MARGIN + i] = x * x;
                xy_row[MARGIN + i] = x * truth[i];
            }
            blur_row::<L>(&Padded { row: x_row }, &mut across[..stride]);
            blur_row::<L>(&Padded { row: xx_row }, &mut across[stride..2 * stride]);
            blur_row::<L>(&Padded { row: xy_row }, &mut across[2 * stride..]);
        }
    }
}

/// Pass 2: moments down the columns, S and its derivatives, these blurred along each row.
struct Similarity<'a> {
    across: &'a [f32],
    target: &'a Target,
    first: usize,
    derivatives: &'a mut [f32],
    sums: &'a mut [[f64; 2]],
}

impl Kernel for Similarity<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let t = self.target;
        let stride = t.stride;
        let padded = stride + 2 * MARGIN;
        let mut buffers = vec![0.0_f32; 3 * padded];
        let mut similarity = vec![0.0_f32; stride];
        let (c1, c2, one, two) = (L::splat(C1 as f32), L::splat(C2 as f32), L::splat(1.0), L::splat(2.0));
        for (k, (out, sums)) in self.derivatives.chunks_exact_mut(3 * stride).zip(self.sums).enumerate() {
            let row = self.first + k;
            for at in (0..stride).step_by(L::WIDTH) {
                let [mx, xx, xy] = blur_down::<L, 3>(self.across, row, t.height, stride, at);
                let from = row * stride + at;
                let my = L::load(&t.mean[from..from + L::WIDTH]);
                let yy = L::load(&t.mean_square[from..from + L::WIDTH]);
                let a1 = two * mx * my + c1;
                let a2 = two * (xy - mx * my) + c2;
                let b1 = mx * mx + my * my + c1;
                let b2 = (xx - mx * mx) + (yy - my * my) + c2;
                let (r1, r2) = (one / b1, one / b2);
                let r = r1 * r2;
                let s = a1 * a2 * r;
                // ∂S/∂E xy, ∂S/∂E x², ∂S/∂μ_x (the last through μ itself and through both (co)variances).
                let d_xy = two * a1 * r;
                let d_xx = -(s * r2);
                let d_mean = two * (my * a2 * r - mx * s * r1) - my * d_xy - two * mx * d_xx;
                s.store(&mut similarity[at..at + L::WIDTH]);
                d_mean.store(&mut buffers[MARGIN + at..MARGIN + at + L::WIDTH]);
                d_xx.store(&mut buffers[padded + MARGIN + at..padded + MARGIN + at + L::WIDTH]);
                d_xy.store(&mut buffers[2 * padded + MARGIN + at..2 * padded + MARGIN + at + L::WIDTH]);
            }
            similarity[t.width..].fill(0.0);
            let mut sum = L::splat(0.0);
            for at in (0..stride).step_by(L::WIDTH) {
                sum = sum + L::load(&similarity[at..at + L::WIDTH]);
            }
            sums[0] = f64::from(sum.sum());
            for (buffer, out) in buffers.chunks_exact_mut(padded).zip(out.chunks_exact_mut(stride)) {
                // Beyond the border there is no S.
                buffer[MARGIN + t.width..].fill(0.0);
                blur_row::<L>(&Padded { row: buffer }, out);
            }
        }
    }
}

/// Pass 3: the derivatives down the columns, and the sum of both terms.
struct Gradient<'a> {
    image: &'a [f32],
    derivatives: &'a [f32],
    target: &'a Target,
    first: usize,
    /// Weight of the loss over the number of values.
    scale: f32,
    ssim_weight: f32,
    gradient: &'a mut [f32],
    sums: &'a mut [[f64; 2]],
}

impl Kernel for Gradient<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let t = self.target;
        let stride = t.stride;
        let (zero, two) = (L::splat(0.0), L::splat(2.0));
        let l1 = L::splat(self.scale * (1.0 - self.ssim_weight));
        let dissimilarity = L::splat(-self.scale * self.ssim_weight);
        for (k, (out, sums)) in self.gradient.chunks_exact_mut(stride).zip(self.sums).enumerate() {
            let row = self.first + k;
            let mut difference = zero;
            for at in (0..stride).step_by(L::WIDTH) {
                let [d_mean, d_xx, d_xy] = blur_down::<L, 3>(self.derivatives, row, t.height, stride, at);
                let from = row * stride + at;
                // Columns beyond the image hold zero in both and add nothing.
                let x = L::load(&self.image[from..from + L::WIDTH]);
                let y = L::load(&t.pixels[from..from + L::WIDTH]);
                let d = x - y;
                difference = difference + d.max(-d);
                let sign = L::select(d.gt(zero), l1, L::select(zero.gt(d), -l1, zero));
                let s = d_mean + two * x * d_xx + y * d_xy;
                s.mul_add(dissimilarity, sign).store(&mut out[at..at + L::WIDTH]);
            }
            t.left_out(row).iter().for_each(|&x| out[x] = 0.0);
            sums[1] = f64::from(difference.sum());
        }
    }
}

/// η·mean(confidence·|I − target|) over the pixels of an inverse-depth image.
#[derive(Default)]
pub(crate) struct DepthLoss {
    /// `[row][stride]`.
    pub gradient: Vec<f32>,
    sums: Vec<f64>,
}

/// An inverse-depth target, row-major, with its confidences.
#[derive(Clone)]
pub(crate) struct DepthTarget {
    pub width: usize,
    pub height: usize,
    pub value: Vec<f32>,
    pub confidence: Vec<f32>,
}

impl DepthLoss {
    /// Mean of confidence·|I − target| (1/m); `self.gradient` becomes `weight` times its gradient.
    pub fn run(&mut self, tiles: &[f32], target: &DepthTarget, weight: f32) -> f32 {
        let (width, stride) = (target.width, stride_of(target.width));
        let columns = width.div_ceil(TILE_WIDTH);
        self.gradient.resize(target.height * stride, 0.0);
        self.sums.resize(target.height, 0.0);
        let n = (width * target.height) as f32;
        let scale = weight / n;
        self.gradient.par_chunks_mut(stride).zip(&mut self.sums).enumerate().with_min_len(BAND).for_each(
            |(y, (gradient, sum))| {
                let row = (y / TILE_HEIGHT) * columns * AREA + (y % TILE_HEIGHT) * TILE_WIDTH;
                let pixels = y * width..(y + 1) * width;
                let target_tiles =
                    target.value[pixels.clone()].chunks(TILE_WIDTH).zip(target.confidence[pixels].chunks(TILE_WIDTH));
                let mut total = [0.0_f32; TILE_WIDTH];
                for (tile, (gradient, (value, confidence))) in gradient.chunks_mut(TILE_WIDTH).zip(target_tiles).enumerate() {
                    let rendered = &tiles[row + tile * AREA..][..TILE_WIDTH];
                    for i in 0..value.len() {
                        let d = rendered[i] - value[i];
                        let sign = if d == 0.0 { 0.0 } else { 1.0_f32.copysign(d) };
                        gradient[i] = scale * confidence[i] * sign;
                        total[i] += confidence[i] * d.abs();
                    }
                }
                *sum = total.iter().map(|v| f64::from(*v)).sum();
            },
        );
        (self.sums.iter().sum::<f64>() / f64::from(n)) as f32
    }
}
