//! Pictures on request.

use super::{
    GpuDevice,
    capacity::BufferCapacity,
    frame::{Extent, FAILED, Leaves, STATE_WORDS},
    params::{Params, Uniforms},
    train::STEPS_PER_SUBMISSION,
};
use crate::{
    Error, Result,
    device::{
        Layer, Planes, RenderRequest, Rendering, View, check_camera,
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
        if request.main_contributor && request.light.is_none() {
            return Err(Error::invalid(
                "render request",
                "a main contributor without an optical view",
                "ask for the optical view as well",
            ));
        }
        let wanted = [request.light, request.radio];
        for (view, _) in wanted.iter().flatten() {
            check_camera(&view.camera)?;
        }
        let mut out = Rendering::default();
        match wanted {
            // Seen from one place: one projection, one depth order, one blend.
            [Some((a, _)), Some((b, _))] if a.world_from_camera == b.world_from_camera => {
                self.render_together(wanted, request.main_contributor, &mut out)?;
            }
            [light, radio] => {
                if light.is_some() {
                    self.render_together([light, None], request.main_contributor, &mut out)?;
                }
                if radio.is_some() {
                    self.render_together([None, radio], false, &mut out)?;
                }
            }
        }
        Ok(out)
    }

    /// The constants of a frame of modalities that share a pose.
    pub(super) fn frame(&self, wanted: [Option<(View, [f32; 3])>; 2], name: bool) -> Option<Params> {
        let pose = wanted.iter().flatten().map(|(v, _)| Pose::new(&v.world_from_camera)).next()?;
        let grids = wanted.map(|w| w.map(|(v, _)| Grid::new(&v.camera, self.raster.antialias)));
        let backgrounds = wanted.map(|w| w.map_or([0.0; 3], |(_, b)| b));
        let mut params = Params::new(&pose, &grids, backgrounds, self.raster.near_m, self.store.len(), &self.optimizer);
        if self.fuse && !name {
            params.fuse();
        }
        params.set_tiles(0, self.shapes[0].tile);
        Some(params)
    }

    /// Renders modalities that share a pose.
    fn render_together(&mut self, wanted: [Option<(View, [f32; 3])>; 2], name: bool, out: &mut Rendering) -> Result<()> {
        let Some(params) = self.frame(wanted, name) else { return Ok(()) };
        let picture = self.picture(params, name)?;
        let mut first = 0;
        for (g, view) in wanted.iter().enumerate() {
            let Some((View { camera, .. }, _)) = view else { continue };
            let (width, height) = (camera.width, camera.height);
            let layer = layer([width, height], self.store.harmonics[g].channels, &picture, first);
            if g == 0 {
                out.light = Some(layer);
                if name {
                    let names = picture.main_contributor[..width * height].to_vec();
                    out.main_contributor = Some(Raster::from_vec(width, height, names));
                }
            } else {
                out.radio = Some(layer);
            }
            first += width * height;
        }
        Ok(())
    }

    /// Draws pictures one after the other and leaves them on the device, as many to a submission as a batch of training steps has: what
    /// a display would do. Both images of a request are drawn with the optical pose if it has both.
    ///
    /// # Errors
    /// No memory, a lost device.
    pub fn draw(&mut self, requests: &[RenderRequest]) -> Result<()> {
        self.ready()?;
        let mut frames: Vec<Params> = requests.iter().filter_map(|r| self.frame([r.light, r.radio], false)).collect();
        let n = self.store.len();
        let mut extent = Extent { gaussians: n, ..Extent::default() };
        frames.iter().for_each(|p| extent.include(p, &self.shapes));
        let mut room = BufferCapacity::guess(n, self.least_room, extent.most(&self.context, &self.shapes[0]));
        loop {
            self.memory.reserve(&self.context, &self.shapes[0], &extent, room)?;
            let m = &self.memory;
            frames.iter_mut().for_each(|p| p.set_room(m.room));
            let uniforms = Uniforms::new(&self.context, frames.iter())?;
            m.reset(&self.context, n);
            let bound = self.forward.bind(&self.context, &uniforms.buffer, self.store.values(), m, Leaves::Images)?;
            for (batch, some) in frames.chunks(STEPS_PER_SUBMISSION).enumerate() {
                let mut encoder = self.context.encoder();
                {
                    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                    for (k, p) in some.iter().enumerate() {
                        let offset = uniforms.offset(batch * STEPS_PER_SUBMISSION + k);
                        bound.record(&mut pass, p, offset, n, m, &mut |_| {});
                    }
                }
                self.context.submit(encoder);
            }
            let state = self.context.read::<u32>("drawing", &[(&m.state, STATE_WORDS)])?;
            if state[0][FAILED] == 0 {
                return Ok(());
            }
            room = BufferCapacity::asked(&state[0], extent.most(&self.context, &self.shapes[0]));
        }
    }

    /// Renders once, and again with more room where there was too little.
    fn picture(&mut self, mut params: Params, name: bool) -> Result<Picture> {
        let n = self.store.len();
        let mut extent = Extent { gaussians: n, ..Extent::default() };
        extent.include(&params, &self.shapes);
        let mut room = BufferCapacity::guess(n, self.least_room, extent.most(&self.context, &self.shapes[0]));
        loop {
            self.memory.reserve(&self.context, &self.shapes[0], &extent, room)?;
            let m = &self.memory;
            params.set_room(m.room);
            let uniforms = Uniforms::new(&self.context, std::iter::once(&params))?;
            m.reset(&self.context, n);
            let leaves = if name { Leaves::MainContributors } else { Leaves::Images };
            let bound = self.forward.bind(&self.context, &uniforms.buffer, self.values(), m, leaves)?;
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
                room = BufferCapacity::asked(&read[0], extent.most(&self.context, &self.shapes[0]));
                continue;
            }
            let main_contributor = read.pop().unwrap_or_default();
            let floats = |words: Option<Vec<u32>>| words.unwrap_or_default().into_iter().map(f32::from_bits).collect();
            let transmittance = floats(read.pop());
            return Ok(Picture { image: floats(read.pop()), transmittance, main_contributor });
        }
    }
}

/// One modality of a picture of `width × height` pixels.
fn layer([width, height]: [usize; 2], channels: usize, picture: &Picture, first: usize) -> Layer {
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
