//! Light shared by all views: what diffuse surfaces receive, worked out once in the world and looked up by every camera path.
//!
//! The reflection model's diffuse term factorises as `c·(1 − E(v))·H` with `H = ∫ L·l_z·(1 − E(l))/(1 − Ē)/π dl`, which does not depend
//! on the viewer. The surface is cut into flat charts ([`charts`]); on both sides of each lie lattices of points at which H is worked
//! out as a vector, so that interpolated and mapped normals find it too ([`field`]). Three kinds of lattice:
//!
//! - **coarse**: all light, solved once for the whole scene ([`solve`]); what rays with a wide footprint look up;
//! - **direct**: light straight from emitters with extent, at spacings halved from level to level, each tile filled when a ray first asks
//!   for it ([`direct`]); lights without extent are left to whoever looks, so that their shadows stay sharp;
//! - **indirect**: all other light, gathered from the coarse lattice, likewise ([`gather`]).
//!
//! A ray's footprint says which level it needs; coarser ones are read where they are smooth. Mirrors, highlights, glass and emitters are
//! traced for every camera path ([`view`]) and end in the lattices at the first diffuse surface.
//!
//! Sources of bias: light varies bilinearly between lattice points (down to [`CacheSettings::finest_m`]), is blurred by that much across
//! contact shadows, and wide rays see textures averaged and without normal maps.

mod charts;
mod direct;
mod field;
mod gather;
#[cfg(feature = "gpu")]
mod packed;
mod sealed;
mod site;
mod solve;
mod view;
mod walk;

use super::surface::Surface;
use super::{LightTracer, luminance};
#[cfg(feature = "gpu")]
pub(super) use packed::{Job, Packed};
pub use view::ViewSettings;

use charts::Charts;
use corf_scene::{Error, Result, bounds};
use direct::DirectSettings;
use field::{Field, Received, Tile, rough_cells};

/// First pair of a walk's numbers; those before belong to its start.
const FIRST_WALK_PAIR: u32 = 2;
/// Keys of the samplers of the solution and of gathered tiles.
const STAGE_SOLVE: u64 = 0xcac4_e001;
const STAGE_GATHER: u64 = 0xcac4_e100;
/// Weight of a point that is likely to be inside of something.
const DOUBTFUL: f32 = 1e-3;
/// A cell is read at a finer level where interpolation errs by more than this share of the light.
const TOLERANCE: f32 = 0.01;
/// Contrast limit: a cell is also read at a finer level where its corners differ by more than this share of the light.
const CONTRAST: f32 = 0.3;
/// Light below this share of the scene's mean counts as this much in both.
const DARK: f32 = 0.1;

/// Resolution and sampling of the light cache.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CacheSettings {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Radiance of everything beyond the scene.
    pub background: [f32; 3],
    /// Points wished for in the coarse lattice on as much plain surface, which sets its spacing. Small and narrow parts have more of them, and
    /// surface has two sides.
    pub coarse_points: usize,
    /// Shadow rays of a point of the coarse lattice.
    pub coarse_rays: u32,
    /// Walks of a point of the coarse lattice.
    pub coarse_walks: u32,
    /// Shadow rays of a point of the direct lattices.
    pub direct_rays: u32,
    /// Walks of a point of the indirect lattices.
    pub gather_walks: u32,
    /// Times light is passed on between surfaces, at most.
    pub max_passes: u32,
    /// Smallest spacing of direct lattices, metres.
    pub finest_m: f32,
}

impl Default for CacheSettings {
    fn default() -> Self {
        Self {
            seed: 0,
            background: [0.0; 3],
            coarse_points: 50_000,
            coarse_rays: 64,
            coarse_walks: 48,
            direct_rays: 160,
            gather_walks: 256,
            max_passes: 64,
            finest_m: 0.01,
        }
    }
}

impl CacheSettings {
    /// Density for images of few pixels, which are noisier themselves: half the rays and coarse points, and direct lattices of 2 cm at the finest.
    /// With 4 cm there, the lobby loses 0.5 % of its light; with a quarter of the rays, walls are blotched.
    pub fn for_small_images() -> Self {
        Self {
            coarse_points: 20_000,
            coarse_rays: 24,
            coarse_walks: 24,
            direct_rays: 100,
            gather_walks: 160,
            finest_m: 0.02,
            ..Self::default()
        }
    }
}

/// Direct lattices begin at this share of the coarse spacing, indirect ones at the coarse spacing; both are halved so often at most.
const DIRECT_START: usize = 2;
const INDIRECT_LEVELS: usize = 3;

/// Edges of the lattices' cells, metres.
struct Spacings {
    coarse_m: f32,
    direct_m: Vec<f32>,
    indirect_m: Vec<f32>,
}

impl Spacings {
    /// Those of a scene with so much surface.
    fn of(area_m2: f64, settings: &CacheSettings) -> Self {
        let coarse_m = ((area_m2 / settings.coarse_points.max(1) as f64).sqrt() as f32).clamp(1e-4, 0.5);
        let mut direct_m = Vec::new();
        let mut spacing_m = coarse_m;
        while direct_m.len() <= DIRECT_START || spacing_m > settings.finest_m * 0.99 {
            direct_m.push(spacing_m);
            spacing_m *= 0.5;
        }
        let indirect_m = (0..INDIRECT_LEVELS).map(|k| coarse_m * 0.5f32.powi(k as i32)).collect();
        Self { coarse_m, direct_m, indirect_m }
    }
}

/// Surface of a scene's triangles, one side, m².
fn surface_m2(tracer: &LightTracer<'_>) -> f64 {
    let areas = (0..tracer.scene.triangles.len()).map(|i| {
        let [a, b, c] = tracer.scene.corners(i);
        f64::from(0.5 * (b - a).cross(c - a).length())
    });
    areas.filter(|a| a.is_finite()).sum()
}

/// A scene's light, ready to be looked up.
#[derive(Debug)]
pub struct LightCache<'a> {
    tracer: &'a LightTracer<'a>,
    charts: Charts,
    coarse: Field,
    /// Finest last.
    direct: Vec<Field>,
    indirect: Vec<Field>,
    /// Mean luminance of received light over the coarse lattice's lit points.
    mean_light: f32,
    settings: CacheSettings,
}

impl<'a> LightCache<'a> {
    /// Solves the light of a scene on the coarse lattice (tens of seconds of one core for a furnished lobby). `tell(done, all)` is
    /// called now and then, on any thread; when it answers `false`, the work is given up and the result is `None`.
    pub fn new(
        tracer: &'a LightTracer<'a>,
        settings: &CacheSettings,
        report: &(dyn Fn(usize, usize) -> bool + Sync),
    ) -> Option<Self> {
        let mut cache = Self::unsolved(tracer, settings);
        cache.coarse = solve::solve(tracer, &cache.charts, cache.coarse.spacing_m(), settings, report)?;
        cache.settle();
        Some(cache)
    }

    /// Charts and empty lattices.
    pub(super) fn unsolved(tracer: &'a LightTracer<'a>, settings: &CacheSettings) -> Self {
        let charts = Charts::new(tracer);
        let spacings = Spacings::of(surface_m2(tracer), settings);
        let fields = |spacings_m: &[f32]| spacings_m.iter().map(|spacing_m| Field::new(&charts, *spacing_m)).collect();
        let (direct, indirect) = (fields(&spacings.direct_m), fields(&spacings.indirect_m));
        let coarse = Field::new(&charts, spacings.coarse_m);
        Self { tracer, charts, coarse, direct, indirect, mean_light: 0.0, settings: *settings }
    }

    /// Refuses a scene whose lattices, still empty, would not fit the memory.
    ///
    /// # Errors
    /// They do not: it is mostly a model in other units than metres.
    pub fn check_size(tracer: &LightTracer<'_>, settings: &CacheSettings) -> Result<()> {
        let area_m2 = surface_m2(tracer);
        let Spacings { coarse_m, direct_m, indirect_m } = Spacings::of(area_m2, settings);
        let edges_m =
            [coarse_m].into_iter().chain(direct_m).chain(indirect_m).map(|s| f64::from(s) * f64::from(field::TILE_CELLS));
        let tiles: f64 = edges_m.map(|edge_m| 2.0 * area_m2 / (edge_m * edge_m)).sum();
        let what = format!("{tiles:.3e} tiles of light on {area_m2:.3e} m² of surface");
        let help = "give the scene in metres, or choose the method path";
        if tiles > f64::from(u32::MAX) {
            return Err(Error::invalid("light", format!("{what} are more than can be numbered"), help));
        }
        bounds::memory("light", &what, tiles * field::EMPTY_TILE_BYTES as f64, help)
    }

    /// Takes the coarse lattice's light for solved.
    fn settle(&mut self) {
        self.mean_light = self.coarse.mean(&self.charts, |received, n| luminance(received.at(n)));
    }

    /// Light that a surface receives, seen by a ray with a footprint of so many metres; without lights that have no extent unless the
    /// footprint is wide. The second part says whether they are in it.
    fn received(&self, surface: &Surface, triangle: u32, footprint_m: f32) -> (Received, bool) {
        let (index, side, at) = self.charts.locate(surface, triangle);
        let chart = &self.charts.list[index as usize];
        if footprint_m > self.coarse.spacing_m() {
            let (received, _) = self.coarse.at(chart, index, side, at, |_| unreachable!("the coarse lattice is full"));
            return (received, true);
        }
        let level = |fields: &[Field], start: usize, fill: &dyn Fn(usize, &field::TileKey) -> Tile| -> Received {
            // The footprint asks for a spacing of its own size at most.
            let wanted = fields.iter().position(|f| f.spacing_m() <= footprint_m).unwrap_or(fields.len() - 1);
            let mut k = wanted.min(start);
            loop {
                let (received, rough) = fields[k].at(chart, index, side, at, |key| fill(k, key));
                if !rough || k >= wanted {
                    return received;
                }
                k += 1;
            }
        };
        let mut sum = level(&self.direct, DIRECT_START, &|k, key| self.direct_tile(k, key));
        sum.add_scaled(&level(&self.indirect, 0, &|k, key| self.indirect_tile(k, key)), 1.0);
        (sum, false)
    }

    fn direct_tile(&self, level: usize, key: &field::TileKey) -> Tile {
        let spacing_m = self.direct[level].spacing_m();
        let settings =
            DirectSettings { seed: self.settings.seed, rays: self.settings.direct_rays, spacing_m, parts: None, punctual: false };
        self.marked(key, direct::fill(self.tracer, &self.charts, key, &settings))
    }

    fn indirect_tile(&self, level: usize, key: &field::TileKey) -> Tile {
        self.marked(key, self.gather_tile(self.indirect[level].spacing_m(), key))
    }

    fn marked(&self, key: &field::TileKey, mut tile: Tile) -> Tile {
        let n = self.charts.normal(key.chart, key.side);
        tile.rough = rough_cells(key.points, &tile.values, n, TOLERANCE, CONTRAST, DARK * self.mean_light);
        tile
    }
}
