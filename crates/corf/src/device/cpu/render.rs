//! The forward pass over whole images, and renders on request.

use super::{
    CpuDevice,
    blend::{AREA, Forward, MainContributor, Tile},
    geometry::{Grid, Scene},
    project::{CHUNK, Projection, Splat, TILE_HEIGHT, TILE_WIDTH},
    store::Store,
    tiles::{DepthOrder, TileLists, tile_count},
};
use crate::simd::Isa;
use crate::{
    Error, Result,
    device::{Layer, Planes, RenderRequest, Rendering, View, check_camera},
};
use corf_scene::Raster;
use rayon::prelude::*;

/// One modality's image, tile by tile, with the lists it was made from.
#[derive(Default)]
pub(crate) struct Image {
    pub lists: TileLists,
    /// Position in the lists of each (Gaussian, tile) pair of each chunk.
    pub places: Vec<Vec<u32>>,
    /// `[tile][channel][128]`, background included.
    pub color: Vec<f32>,
    /// `[tile][128]`; written only where asked for.
    pub inverse_depth: Vec<f32>,
    /// `[tile][128]`.
    pub transmittance: Vec<f32>,
}

/// All that a pose produces on the way to its images; kept between steps for its memory.
#[derive(Default)]
pub(crate) struct Frame {
    pub projection: Projection,
    pub order: DepthOrder,
    /// Optical, RF.
    pub images: [Image; 2],
}

/// The tile at place `index` of an image.
pub(crate) fn tile_at<'a>(grid: &Grid, lists: &'a TileLists, splats: &'a [Splat], index: usize) -> Tile<'a> {
    let columns = grid.width.div_ceil(TILE_WIDTH);
    Tile {
        x: index % columns * TILE_WIDTH,
        y: index / columns * TILE_HEIGHT,
        width: grid.width,
        height: grid.height,
        list: lists.of(index),
        splats,
    }
}

impl Frame {
    /// Projection and lists.
    pub fn project(&mut self, isa: Isa, store: &Store, scene: &Scene, near_m: f32) {
        self.projection.run(isa, store, scene, near_m);
    }

    /// Depth order and tile lists of every image of the scene.
    pub fn sort(&mut self, scene: &Scene) {
        self.order.run(&self.projection);
        let (projection, order) = (&self.projection, &self.order.order);
        let [light, radio] = &mut self.images;
        let fill = |g: usize, image: &mut Image| {
            if let Some(grid) = &scene.grids[g] {
                image.places.resize_with(projection.chunks.len(), Vec::new);
                image.lists.run(g, grid, projection, order, &mut image.places);
            }
        };
        rayon::join(|| fill(0, light), || fill(1, radio));
    }

    /// Blends every image of the scene; `channels`, `backgrounds` and `depth` per modality.
    pub fn blend(&mut self, isa: Isa, scene: &Scene, channels: [usize; 2], backgrounds: [[f32; 3]; 2], depth: [bool; 2]) {
        let [light, radio] = &mut self.images;
        let splats = &self.projection.splats;
        let blend = |g: usize, image: &mut Image| {
            let Some(grid) = &scene.grids[g] else { return };
            let background = backgrounds[g];
            match (channels[g], depth[g]) {
                (1, false) => image.blend::<1, false>(isa, grid, &splats[g], background),
                (1, true) => image.blend::<1, true>(isa, grid, &splats[g], background),
                (_, false) => image.blend::<3, false>(isa, grid, &splats[g], background),
                (_, true) => image.blend::<3, true>(isa, grid, &splats[g], background),
            }
        };
        rayon::join(|| blend(0, light), || blend(1, radio));
    }
}

impl Image {
    fn blend<const C: usize, const DEPTH: bool>(&mut self, isa: Isa, grid: &Grid, splats: &[Splat], background: [f32; 3]) {
        let tiles = tile_count(grid);
        self.color.resize(tiles * C * AREA, 0.0);
        self.inverse_depth.resize(tiles * AREA, 0.0);
        self.transmittance.resize(tiles * AREA, 0.0);
        let lists = &self.lists;
        self.color
            .par_chunks_mut(C * AREA)
            .zip(self.inverse_depth.par_chunks_mut(AREA))
            .zip(self.transmittance.par_chunks_mut(AREA))
            .enumerate()
            .for_each(|(index, ((color, inverse_depth), transmittance))| {
                let tile = tile_at(grid, lists, splats, index);
                isa.dispatch(Forward::<C, DEPTH> { tile, background, color, inverse_depth, transmittance });
            });
    }

    fn main_contributor(&self, isa: Isa, grid: &Grid, projection: &Projection) -> Raster<u32> {
        let mut tiles = vec![u32::MAX; tile_count(grid) * AREA];
        tiles.par_chunks_mut(AREA).enumerate().for_each(|(index, out)| {
            isa.dispatch(MainContributor { tile: tile_at(grid, &self.lists, &projection.splats[0], index), out });
        });
        untile(grid, 1, 0, &tiles).map(|&name| match name {
            u32::MAX => u32::MAX,
            name => projection.chunks[name as usize / CHUNK].ids[name as usize % CHUNK],
        })
    }

    fn layer(&self, grid: &Grid, channels: usize) -> Layer {
        let planes: Vec<Raster<f32>> = (0..channels).map(|c| untile(grid, channels, c, &self.color)).collect();
        let pixels = (0..grid.width * grid.height).flat_map(|i| planes.iter().map(move |p| p.pixels()[i])).collect();
        Layer {
            color: Planes { width: grid.width, height: grid.height, channels, pixels },
            inverse_depth: untile(grid, 1, 0, &self.inverse_depth),
            transmittance: untile(grid, 1, 0, &self.transmittance),
        }
    }
}

/// One channel of a tile-major image, row by row.
fn untile<T: Copy>(grid: &Grid, channels: usize, channel: usize, tiles: &[T]) -> Raster<T> {
    let columns = grid.width.div_ceil(TILE_WIDTH);
    Raster::from_fn(grid.width, grid.height, |x, y| {
        let tile = (y / TILE_HEIGHT) * columns + x / TILE_WIDTH;
        tiles[(tile * channels + channel) * AREA + (y % TILE_HEIGHT) * TILE_WIDTH + x % TILE_WIDTH]
    })
}

impl CpuDevice {
    pub(super) fn render_request(&mut self, request: &RenderRequest) -> Result<Rendering> {
        if request.main_contributor && request.light.is_none() {
            return Err(Error::invalid(
                "render request",
                "a main contributor without an optical view",
                "ask for the optical view as well",
            ));
        }
        let mut out = Rendering::default();
        for (g, wanted) in [&request.light, &request.radio].into_iter().enumerate() {
            let Some((view, background)) = wanted else { continue };
            let scene = self.scene_of(g, view)?;
            let channels = self.store.harmonics[g].channels;
            self.frame.project(self.isa, &self.store, &scene, self.raster.near_m);
            self.frame.sort(&scene);
            self.frame.blend(self.isa, &scene, [channels; 2], [*background; 2], [true; 2]);
            let Some(grid) = &scene.grids[g] else { continue };
            let image = &self.frame.images[g];
            let layer = Some(image.layer(grid, channels));
            if g == 0 {
                out.light = layer;
                if request.main_contributor {
                    out.main_contributor = Some(image.main_contributor(self.isa, grid, &self.frame.projection));
                }
            } else {
                out.radio = layer;
            }
        }
        Ok(out)
    }

    fn scene_of(&self, g: usize, view: &View) -> Result<Scene> {
        check_camera(&view.camera)?;
        let mut grids = [None; 2];
        grids[g] = Some(Grid::new(&view.camera, self.raster.antialias));
        Ok(Scene::new(&view.world_from_camera, grids))
    }
}
