//! The constants of one frame, as the host writes and the shaders read them.

use super::capacity::BufferCapacity;
use crate::{
    OptimizerConfig, Result,
    device::{
        DenseStep,
        cpu::geometry::{Grid, Pose},
    },
};
use bytemuck::Zeroable;
use corf_gpu::{Context, record};

/// Pixels across and down a block of the loss kernels: with the window's halo nearly 128 columns, a thread each.
pub(crate) const LOSS_BLOCK: [u32; 2] = [112, 8];
/// Pixels of a workgroup of the kernels that leave out what a mask does.
pub(crate) const MASK_GROUP: u32 = 256;
/// Widest σ at which opacity 1 still gives 1/255: sqrt(2 ln 255) standard deviations.
const MAX_DEVIATIONS: f32 = 3.33;
/// Place of the mask of an image of which all pixels count.
const NO_MASK: u32 = u32::MAX;

record! {
    /// One image of a frame.
    pub(crate) struct GridParams {
        focal: [f32; 2],
        centre: [f32; 2],
        /// Bounds of x/z and y/z inside J.
        x_limits: [f32; 2],
        y_limits: [f32; 2],
        /// Half extent in pixels per (standard deviation / z), for culling.
        reach: [f32; 2],
        /// Pixels; 0 where the modality is not rendered.
        pub size: [u32; 2],
        /// Tiles across and down.
        tiles: [u32; 2],
        first_tile: u32,
        pub first_pixel: u32,
        background: [f32; 4],
        /// First word of the target.
        pub target_at: u32,
        pub channels: u32,
        pub first_block: u32,
        /// Loss blocks across.
        blocks: u32,
        /// Weight of the loss over its number of values.
        pub scale: f32,
        /// dL/d(inverse depth) per unit of confidence; 0 without a depth target.
        pub depth_scale: f32,
        /// First word of the inverse depths and their confidences.
        pub depth_at: u32,
        /// Numbers of a word of the target, as a power of two: 4 bytes, 2 sums of bytes, 1 float.
        pub target_shift: u32,
        /// Value of a byte's or a sum's unit.
        pub target_unit: f32,
        /// First word of the mask, one bit a pixel, 1 where it counts; [`NO_MASK`] without one.
        pub mask_at: u32,
        padding: [u32; 2],
    }
}

record! {
    /// Learning rates of one modality's appearance.
    pub(crate) struct RateParams {
        sh_dc: f32,
        sh_rest: f32,
        opacity: f32,
        /// Coefficients of a channel that have a gradient; read by dense steps alone.
        learnt: u32,
    }
}

record! {
    /// One frame: where it is taken from, what is rendered, how it is trained.
    pub(crate) struct Params {
        /// Rows of R, with t.
        camera_from_world: [[f32; 4]; 3],
        /// The camera's centre in the world; w: the near plane.
        eye: [f32; 4],
        pub grids: [GridParams; 2],
        rates: [RateParams; 2],
        position_rate: f32,
        position_decay: f32,
        log_scale_rate: f32,
        rotation_rate: f32,
        beta1: f32,
        beta2: f32,
        epsilon: f32,
        ssim_weight: f32,
        pub train_geometry: u32,
        gaussians: u32,
        pair_capacity: u32,
        pub tile_total: u32,
        pub pixel_total: u32,
        pub blocks_total: u32,
        /// 1: both images have one camera and share one list of pairs.
        pub fused: u32,
        pub visible_capacity: u32,
        /// Index of the tile shape; used by the host alone.
        pub shape: u32,
        /// Of a dense step: what it marks the Gaussians it sees with.
        pub marker: u32,
        /// Of a dense step: whether it sums their gradients on the screen.
        pub screen_gradients: u32,
        padding: u32,
    }
}

/// The constants in WGSL.
pub(super) fn declarations() -> String {
    GridParams::declaration() + &RateParams::declaration() + &Params::declaration()
}

impl GridParams {
    /// Bytes of the target of an image that is rendered.
    pub fn target_bytes(&self) -> usize {
        ((self.size[0] * self.size[1] * self.channels) as usize * 4) >> self.target_shift
    }
}

/// Bytes of one frame's constants.
pub(crate) const SIZE: u64 = size_of::<Params>() as u64;

/// Half extent in pixels per (standard deviation / z): |row of J| ≤ f/z · sqrt(1 + x̂²) with |x̂| at most the larger limit.
fn reach(f: f32, limits: [f32; 2]) -> f32 {
    let x = limits[0].abs().max(limits[1].abs());
    MAX_DEVIATIONS * f * (1.0 + x * x).sqrt()
}

impl Params {
    /// Constants of a frame: its pose, the images to render (optical, RF) and their background colours. It has no tiles until
    /// [`Self::set_tiles`], which comes after [`Self::fuse`].
    pub fn new(
        pose: &Pose,
        grids: &[Option<Grid>; 2],
        backgrounds: [[f32; 3]; 2],
        near_m: f32,
        gaussians: usize,
        optimizer: &OptimizerConfig,
    ) -> Self {
        let mut p = Self::zeroed();
        for (row, out) in p.camera_from_world.iter_mut().enumerate() {
            let [a, b, c] = pose.rotation[row];
            *out = [a, b, c, pose.translation[row]];
        }
        let [x, y, z] = pose.eye;
        p.eye = [x, y, z, near_m];
        p.gaussians = gaussians as u32;
        for (g, grid) in grids.iter().enumerate() {
            let out = &mut p.grids[g];
            out.mask_at = NO_MASK;
            (out.first_pixel, out.first_block) = (p.pixel_total, p.blocks_total);
            let Some(grid) = grid else { continue };
            let size = [grid.width as u32, grid.height as u32];
            out.focal = [grid.fx, grid.fy];
            out.centre = [grid.cx, grid.cy];
            (out.x_limits, out.y_limits) = (grid.x_limits, grid.y_limits);
            out.reach = [reach(grid.fx, grid.x_limits), reach(grid.fy, grid.y_limits)];
            out.size = size;
            out.blocks = size[0].div_ceil(LOSS_BLOCK[0]);
            let [r, gr, b] = backgrounds[g];
            out.background = [r, gr, b, 0.0];
            p.pixel_total += size[0] * size[1];
            p.blocks_total += out.blocks * size[1].div_ceil(LOSS_BLOCK[1]);
        }
        for (out, r) in p.rates.iter_mut().zip([&optimizer.light, &optimizer.radio]) {
            *out = RateParams { sh_dc: r.sh_dc, sh_rest: r.sh_dc / r.sh_rest_divisor, opacity: r.opacity, learnt: 0 };
        }
        p.position_rate = optimizer.position_rate_m;
        p.position_decay = optimizer.position_decay;
        p.log_scale_rate = optimizer.log_scale_rate;
        p.rotation_rate = optimizer.rotation_rate;
        (p.beta1, p.beta2, p.epsilon) = (optimizer.beta1, optimizer.beta2, optimizer.epsilon);
        p.ssim_weight = optimizer.ssim_weight;
        p
    }

    /// Workgroups that give another value to pixels of the optical image that do not count; none where all do.
    pub fn mask_groups(&self) -> u32 {
        let [width, height] = self.grids[0].size;
        if self.grids[0].mask_at == NO_MASK { 0 } else { (width * height).div_ceil(MASK_GROUP) }
    }

    /// Makes it a dense step.
    pub fn set_dense(&mut self, dense: &DenseStep, marker: u32) {
        (self.marker, self.screen_gradients) = (marker, u32::from(dense.screen_gradients));
        self.rates.iter_mut().for_each(|r| r.learnt = dense.coefficients() as u32);
    }

    /// Sets the capacities of the buffers.
    pub fn set_room(&mut self, room: BufferCapacity) {
        self.pair_capacity = room.pairs as u32;
        self.visible_capacity = (room.visible as u32).min(self.gaussians);
    }

    /// One list of pairs for both images, if they have one camera.
    pub fn fuse(&mut self) {
        let [a, b] = &self.grids;
        let alike = |a: [f32; 2], b: [f32; 2]| a == b;
        if a.size[0] > 0 && a.size == b.size && alike(a.focal, b.focal) && alike(a.centre, b.centre) {
            self.fused = 1;
        }
    }

    /// Divides the images into tiles of shape `shape`, `tile` pixels across and down; those of images with one list count once.
    pub fn set_tiles(&mut self, shape: usize, tile: [u32; 2]) {
        self.shape = shape as u32;
        self.tile_total = 0;
        for (g, grid) in self.grids.iter_mut().enumerate() {
            grid.tiles = [0, 1].map(|axis| grid.size[axis].div_ceil(tile[axis]));
            grid.first_tile = self.tile_total;
            if g == 0 || self.fused == 0 {
                self.tile_total += grid.tiles[0] * grid.tiles[1];
            }
        }
    }
}

/// The constants of several frames in one buffer, at dynamic offsets.
pub(crate) struct Uniforms {
    pub buffer: wgpu::Buffer,
    stride: u64,
}

impl Uniforms {
    pub fn new<'a>(context: &Context, frames: impl ExactSizeIterator<Item = &'a Params>) -> Result<Self> {
        let stride = SIZE.next_multiple_of(u64::from(context.limits.min_uniform_buffer_offset_alignment));
        let mut bytes = vec![0_u8; stride as usize * frames.len()];
        for (frame, chunk) in frames.zip(bytes.chunks_exact_mut(stride as usize)) {
            chunk[..SIZE as usize].copy_from_slice(bytemuck::bytes_of(frame));
        }
        let buffer = context.buffer("frame constants", bytes.len() as u64, wgpu::BufferUsages::UNIFORM)?;
        context.queue.write_buffer(&buffer, 0, &bytes);
        Ok(Self { buffer, stride })
    }

    /// Offset of a frame's constants in the buffer, bytes.
    pub fn offset(&self, frame: usize) -> u32 {
        (self.stride * frame as u64) as u32
    }
}
