//! The light cache as a GPU holds it: charts, lattices, slots of tiles, and the coarse lattice's light.

use super::super::records;
use super::charts::Charts;
use super::field::{Field, Lattice, Point, Received, TileKey};
use super::solve::{Link, Node, pass_on};
use super::{CacheSettings, DARK, LightCache, LightTracer};
use corf_scene::{Error, Result};
use glam::{UVec2, Vec3};
use rayon::prelude::*;

/// A tile that is to be filled.
#[derive(Clone, Copy, Debug)]
pub(in crate::light) struct Job {
    /// Field that it is of: 0 the coarse one, then the direct ones, then the indirect ones.
    pub field: u32,
    pub chart: u32,
    /// 0 the front, 1 the back.
    pub side: u32,
    /// Its number in the field.
    pub number: u32,
    /// Indices of its first point in the lattice, and points along each coordinate.
    pub first: UVec2,
    pub points: UVec2,
    /// Its slot: numbers of the tiles of all fields, one field behind the other.
    pub slot: u32,
}

/// The light cache's layout. Slots are the tiles of all fields, one field behind the other.
pub(in crate::light) struct Packed<'a> {
    cache: LightCache<'a>,
    /// First slot of each field, and the end.
    bases: Vec<u32>,
}

impl<'a> Packed<'a> {
    /// The cache of a scene, its coarse lattice yet to be solved.
    ///
    /// # Errors
    /// More tiles than can be numbered.
    pub fn new(tracer: &'a LightTracer<'a>, settings: &CacheSettings) -> Result<Self> {
        Self::of(LightCache::unsolved(tracer, settings))
    }

    /// # Errors
    /// Those of [`Self::new`].
    pub fn of(cache: LightCache<'a>) -> Result<Self> {
        let mut bases = vec![0u32];
        let mut total = 0usize;
        for field in fields(&cache) {
            total += field.len();
            let Some(end) = u32::try_from(total).ok().filter(|end| *end < 1 << 30) else {
                let what = "the scene's surface has more than a thousand million tiles of light";
                return Err(Error::invalid("gpu", what, "choose --device cpu, or the method path"));
            };
            bases.push(end);
        }
        Ok(Self { cache, bases })
    }

    pub fn settings(&self) -> &CacheSettings {
        &self.cache.settings
    }

    /// Number of the coarse lattice's slots, which are the first.
    pub fn coarse_slots(&self) -> u32 {
        self.bases[1]
    }

    /// Number of slots.
    pub fn slots(&self) -> u32 {
        self.bases.last().copied().unwrap_or_default()
    }

    /// Numbers of direct and indirect fields.
    pub fn levels(&self) -> [u32; 2] {
        [self.cache.direct.len() as u32, self.cache.indirect.len() as u32]
    }

    /// Spacing of each field, metres.
    pub fn spacings_m(&self) -> Vec<f32> {
        fields(&self.cache).map(Field::spacing_m).collect()
    }

    /// Light below this counts as this much where cells are judged.
    pub fn dark(&self) -> f32 {
        DARK * self.cache.mean_light
    }

    /// Number of charts.
    pub fn charts(&self) -> u32 {
        self.cache.charts.list.len() as u32
    }

    /// The chart of a triangle of the scene.
    pub fn chart_of(&self, triangle: u32) -> u32 {
        self.cache.charts.of_triangle[triangle as usize]
    }

    /// Charts, and their triangles as `place_of` numbers them.
    pub fn chart_records(&self, place_of: &[u32]) -> (Vec<records::Chart>, Vec<u32>) {
        let charts: &Charts = &self.cache.charts;
        let (mut list, mut members) = (Vec::with_capacity(charts.list.len()), Vec::new());
        for (index, chart) in (0u32..).zip(&charts.list) {
            let of = charts.members(index);
            list.push(records::Chart {
                origin: chart.origin.to_array(),
                first: members.len() as u32,
                x_axis: chart.axes[0].to_array(),
                count: of.len() as u32,
                y_axis: chart.axes[1].to_array(),
                normal: chart.normal.to_array(),
                size: chart.size.to_array(),
                ..Default::default()
            });
            members.extend(of.iter().map(|t| place_of[*t as usize]));
        }
        (list, members)
    }

    /// Per field and chart: first slot, cells along both coordinates.
    pub fn lattices(&self) -> Vec<[u32; 4]> {
        let mut lattices = Vec::new();
        for (field, base) in fields(&self.cache).zip(&self.bases) {
            for (index, chart) in (0u32..).zip(&self.cache.charts.list) {
                let Lattice { cells, .. } = Lattice::of(chart, field.spacing_m());
                lattices.push([base + field.first_tile(index), cells.x, cells.y, 0]);
            }
        }
        lattices
    }

    /// The tile of a slot.
    pub fn job(&self, slot: u32) -> Job {
        let field = self.bases.partition_point(|base| *base <= slot) - 1;
        let number = slot - self.bases[field];
        let TileKey { chart, side, first, points, .. } = match fields(&self.cache).nth(field) {
            Some(of) => of.key_of(&self.cache.charts, number as usize),
            None => unreachable!("a slot below the end is of a field"),
        };
        Job { field: field as u32, chart, side, number, first, points, slot }
    }

    /// Whether a tile is inside of a sealed body, where it is dark.
    pub fn is_sealed(&self, job: &Job) -> bool {
        self.cache.charts.is_sealed(job.chart, job.side)
    }

    /// Solves the coarse lattice from what the points of its tiles that are not sealed receive directly and what their walks found: per point
    /// three words of four for direct light (as [`Self::coarse`] has them), a link for each walk (point at its end, throughput) and three words
    /// for the light met on the way.
    pub fn solve(&mut self, direct: &[u32], links: &[u32]) {
        let walks = self.cache.settings.coarse_walks.max(1) as usize;
        let vec3 = |w: &[u32]| Vec3::new(f32::from_bits(w[0]), f32::from_bits(w[1]), f32::from_bits(w[2]));
        let received = |w: &[u32]| Received { x: vec3(w), y: vec3(&w[4..]), z: vec3(&w[8..]) };
        let node = |(direct, record): (&[u32], &[u32])| {
            let (links, met) = record.split_at(4 * walks);
            let link = |w: &[u32]| Link { point: w[0], throughput: vec3(&w[1..]).to_array() };
            Node {
                direct: Point { received: received(direct), weight: f32::from_bits(direct[3]) },
                met: received(met),
                links: links.chunks_exact(4).map(link).collect(),
            }
        };
        let found: Vec<Node> = direct.par_chunks_exact(12).zip(links.par_chunks_exact(4 * (walks + 3))).map(node).collect();
        let mut found = found.into_iter();
        let mut nodes = Vec::new();
        for job in (0..self.coarse_slots()).map(|slot| self.job(slot)) {
            let count = job.points.element_product() as usize;
            match self.is_sealed(&job) {
                true => nodes.resize(nodes.len() + count, Node::default()),
                false => nodes.extend(found.by_ref().take(count)),
            }
        }
        let settings = self.cache.settings;
        pass_on(&self.cache.charts, &mut self.cache.coarse, &nodes, &settings);
        self.cache.settle();
    }

    /// The coarse lattice's tiles: slot, and the words of their points.
    pub fn coarse(&self) -> impl Iterator<Item = (u32, Vec<u32>)> {
        (0..self.bases[1])
            .map(|slot| (slot, self.cache.coarse.tile(slot as usize).map_or_else(Vec::new, |t| point_words(&t.values))))
    }

    /// What the processor makes of a direct or indirect tile: its points' words, and its rough cells.
    #[cfg(test)]
    pub fn filled(&self, job: &Job) -> (Vec<u32>, u64) {
        let direct = self.cache.direct.len();
        let level = job.field as usize - 1;
        let tile = match fields(&self.cache).nth(job.field as usize) {
            Some(field) if level < direct => {
                self.cache.direct_tile(level, &field.key_of(&self.cache.charts, job.number as usize))
            }
            Some(field) => self.cache.indirect_tile(level - direct, &field.key_of(&self.cache.charts, job.number as usize)),
            None => unreachable!("a job is of a field"),
        };
        (point_words(&tile.values), tile.rough)
    }
}

fn fields<'b>(cache: &'b LightCache<'_>) -> impl Iterator<Item = &'b Field> {
    std::iter::once(&cache.coarse).chain(&cache.direct).chain(&cache.indirect)
}

fn point_words(points: &[Point]) -> Vec<u32> {
    let rows = |p: &Point| [p.received.x.extend(p.weight), p.received.y.extend(0.0), p.received.z.extend(0.0)];
    points.iter().flat_map(rows).flat_map(|row| row.to_array()).map(f32::to_bits).collect()
}
