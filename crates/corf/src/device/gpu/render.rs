//! Pictures on request.

use super::{
    GpuDevice,
    frame::{Extent, FAILED, Leaves, NEEDED, STATE_WORDS},
    params::{self, Params},
};
use crate::{
    Error, Result,
    device::{
        Layer, Planes, RenderRequest, Rendering, View,
        cpu::geometry::{Grid, Pose},
    },
};
use corf_scene::Raster;

/// A picture as it comes off the device.
struct Picture {
    /// Planes of r, g, b, Σ α T / z, each of all pixels.
    image: Vec<f32>,
    transmittance: Vec<f32>,
    main_contributor: Vec<u32>,
}

impl GpuDevice {
    pub(super) fn render_request(&mut self, request: &RenderRequest) -> Result<Rendering> {
        if request.main_contributor && request.optical.is_none() {
            return Err(Error::invalid(
                "render request",
                "a main contributor without an optical view",
                "ask for the optical view as well",
            ));
        }
        let wanted = [request.optical, request.rf];
        for (view, _) in wanted.iter().flatten() {
            if view.camera.width == 0 || view.camera.height == 0 {
                let what = format!("a camera of {}x{} pixels", view.camera.width, view.camera.height);
                return Err(Error::invalid("render request", what, "give a camera with pixels"));
            }
        }
        let mut out = Rendering::default();
        match wanted {
            // Seen from one place: one projection, one depth order, one blend.
            [Some((a, _)), Some((b, _))] if a.world_from_camera == b.world_from_camera => {
                self.render_together(wanted, request.main_contributor, &mut out)?;
            }
            [optical, rf] => {
                if optical.is_some() {
                    self.render_together([optical, None], request.main_contributor, &mut out)?;
                }
                if rf.is_some() {
                    self.render_together([None, rf], false, &mut out)?;
                }
            }
        }
        Ok(out)
    }

    /// Renders modalities that share a pose.
    fn render_together(&mut self, wanted: [Option<(View, [f32; 3])>; 2], name: bool, out: &mut Rendering) -> Result<()> {
        let Some(pose) = wanted.iter().flatten().map(|(v, _)| Pose::new(&v.world_from_camera)).next() else { return Ok(()) };
        let grids = wanted.map(|w| w.map(|(v, _)| Grid::new(&v.camera, self.raster.antialias)));
        let backgrounds = wanted.map(|w| w.map_or([0.0; 3], |(_, b)| b));
        let mut params =
            Params::new(&pose, &grids, backgrounds, self.raster.near_m, self.store.len(), &self.optimizer, self.fixed.tile);
        if self.fuse && !name {
            params.fuse();
        }
        let picture = self.picture(params, name)?;
        let mut first = 0;
        for (g, grid) in grids.iter().enumerate() {
            let Some(grid) = grid else { continue };
            let pixels = grid.width * grid.height;
            let layer = layer(grid, self.store.harmonics[g].channels, &picture, first);
            if g == 0 {
                out.optical = Some(layer);
                if name {
                    let names = picture.main_contributor[..pixels].to_vec();
                    out.main_contributor = Some(Raster::from_vec(grid.width, grid.height, names));
                }
            } else {
                out.rf = Some(layer);
            }
            first += pixels;
        }
        Ok(())
    }

    /// Renders once, and again with more room where there was too little.
    fn picture(&mut self, mut params: Params, name: bool) -> Result<Picture> {
        let n = self.store.len();
        let mut extent = Extent { gaussians: n, ..Extent::default() };
        extent.include(&params);
        let mut pairs = 2 * n;
        loop {
            self.memory.reserve(&self.context, &self.fixed, &extent, pairs)?;
            let m = &self.memory;
            params.pair_capacity = m.pair_capacity as u32;
            let uniform = self.context.buffer("frame constants", params::SIZE, wgpu::BufferUsages::UNIFORM)?;
            self.context.queue.write_buffer(&uniform, 0, bytemuck::bytes_of(&params));
            m.reset(&self.context, n);
            let leaves = if name { Leaves::MainContributors } else { Leaves::Images };
            let bound = self.forward.bind(&self.context, &uniform, &self.store, m, leaves)?;
            let mut encoder = self.context.encoder();
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                bound.record(&mut pass, &params, 0, n, m, &mut |_| {});
            }
            self.context.submit(encoder);
            let pixels = params.pixel_total as usize;
            let sources = [
                (&m.state, STATE_WORDS),
                (&m.image.buffer, 4 * pixels),
                (&m.transmittance.buffer, pixels),
                (&m.main_contributor.buffer, if name { pixels } else { 0 }),
            ];
            let mut read = self.context.read::<u32>("rendering", &sources)?;
            if read[0][FAILED] != 0 {
                pairs = read[0][NEEDED] as usize + read[0][NEEDED] as usize / 4;
                continue;
            }
            let main_contributor = read.pop().unwrap_or_default();
            let floats = |words: Option<Vec<u32>>| words.unwrap_or_default().into_iter().map(f32::from_bits).collect();
            let transmittance = floats(read.pop());
            return Ok(Picture { image: floats(read.pop()), transmittance, main_contributor });
        }
    }
}

/// One modality of a picture.
fn layer(grid: &Grid, channels: usize, picture: &Picture, first: usize) -> Layer {
    let (width, height) = (grid.width, grid.height);
    let (pixels, total) = (width * height, picture.transmittance.len());
    let plane = |k: usize| &picture.image[k * total + first..k * total + first + pixels];
    let planes: Vec<&[f32]> = (0..channels).map(plane).collect();
    let color = (0..pixels).flat_map(|p| planes.iter().map(move |plane| plane[p])).collect();
    Layer {
        color: Planes { width, height, channels, pixels: color },
        inverse_depth: Raster::from_vec(width, height, plane(3).to_vec()),
        transmittance: Raster::from_vec(width, height, picture.transmittance[first..first + pixels].to_vec()),
    }
}
