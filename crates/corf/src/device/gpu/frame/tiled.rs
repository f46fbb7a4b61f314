//! The kernels of a forward pass that know how large a tile is.

use crate::{
    Error, Result,
    device::gpu::{
        options::LARGEST_BLEND,
        params::Params,
        shaders::{Blend, Fixed},
    },
};
use corf_gpu::{Bound, Context, Kernel};

/// Images of at most so many pixels are small: they leave a large GPU's threads without work (an H200 holds 270 336), and pixels whose lists
/// several threads share are drawn sooner. On a reconstructed field the blend of 94 000 pixels takes 0.18 ms instead of 0.27, of 375 000 as
/// long, of 1.5 million 0.30 instead of 0.17.
const SMALL_PIXELS: u32 = 1 << 18;
/// Threads that share a pixel's list in small images.
const SMALL_SEGMENTS: u32 = 4;

/// Rasterisation kernels of one tile shape. Pairs of kernels blend the images apart and both at once.
pub(crate) struct Tiled {
    project: Kernel,
    emit: Kernel,
    keep: [Kernel; 2],
    /// Kernels for small images, where these are drawn otherwise.
    keep_small: Option<[Kernel; 2]>,
    /// Tiles of the largest small image.
    small_tiles: u32,
}

/// Rasterisation kernels bound to their buffers, of a training step or of a rendering.
pub(crate) struct BoundTiled {
    pub project: Bound,
    pub emit: Bound,
    blend: [Bound; 2],
    blend_small: Option<[Bound; 2]>,
    small_tiles: u32,
}

impl Tiled {
    /// Kernels with so many threads for a pixel's list, or as many as the image's size suggests.
    pub fn new(context: &Context, fixed: &Fixed, segments: Option<u32>) -> Result<Self> {
        let keep = |both, segments| fixed.forward(Blend { both, main_contributor: false, checkpoints: true, segments });
        let usual = segments.unwrap_or(1);
        let area = fixed.tile[0] * fixed.tile[1];
        let fits = area * SMALL_SEGMENTS <= LARGEST_BLEND
            && fixed.split_bytes(SMALL_SEGMENTS) <= context.limits.max_compute_workgroup_storage_size;
        let small = (segments.is_none() && fits).then(|| {
            let small = |both| keep(both, SMALL_SEGMENTS);
            Kernel::all(context, [("blend, keep, small", small(false)), ("blend both, keep, small", small(true))])
        });
        let [project, emit, single, double] = Kernel::all(
            context,
            [
                ("project", fixed.project()),
                ("emit pairs", fixed.emit()),
                ("blend, keep", keep(false, usual)),
                ("blend both, keep", keep(true, usual)),
            ],
        )?;
        Ok(Self { project, emit, keep: [single, double], keep_small: small.transpose()?, small_tiles: SMALL_PIXELS / area })
    }

    /// Binds buffers, with `blend` in place of the kernels that leave checkpoints, if it is given.
    pub fn bind(
        &self,
        projected: impl Fn(&Kernel) -> Result<Bound>,
        emitted: impl Fn(&Kernel) -> Result<Bound>,
        blended: impl Fn(&Kernel) -> Result<Bound>,
        blend: Option<[&Kernel; 2]>,
    ) -> Result<BoundTiled> {
        let small = self.keep_small.as_ref().filter(|_| blend.is_none());
        let [single, double] = blend.unwrap_or(self.keep.each_ref());
        Ok(BoundTiled {
            project: projected(&self.project)?,
            emit: emitted(&self.emit)?,
            blend: [blended(single)?, blended(double)?],
            blend_small: small.map(|[one, both]| Ok::<_, Error>([blended(one)?, blended(both)?])).transpose()?,
            small_tiles: self.small_tiles,
        })
    }
}

impl BoundTiled {
    /// The blend that suits a frame.
    pub fn blend(&self, p: &Params) -> &Bound {
        let small = self.blend_small.as_ref().filter(|_| p.tile_total <= self.small_tiles);
        &small.unwrap_or(&self.blend)[p.fused as usize]
    }
}
