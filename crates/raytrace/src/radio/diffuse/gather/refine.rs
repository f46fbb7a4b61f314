//! Adaptive refinement of a receiver's lattice: more directions are traced where neighbouring ones disagree.
//!
//! Outlines, shadow edges and things smaller than the lattice's spacing make nearly all of its error; smooth surfaces make none. The cell
//! of a lattice direction is the parallelogram of its two shortest steps, whose copies tile the sphere. A cell whose neighbours differ by
//! more than a share of what a reader of the given angular resolution sees there is cut into k×k directions, and speaks from then on
//! with their mean; the surfaces seen first and what lies behind them apart.
//!
//! A cell that differs from all its neighbours, where they agree, has met something small by chance, and others like it have missed theirs:
//! to speak with the mean would correct the lucky ones alone, downwards. Of its k×k directions only those count that meet such a thing
//! as well: their mean is what a cell says that met one, without the noise of what exactly it met (Rao and Blackwell). What is left of the
//! bias is the neighbours', which such a cell still has cut: they find the rest of the thing besides.

use super::bins::Bins;
use super::fireflies;
use super::image_receivers::ImageReceivers;
use super::ray::{DepthLayer, GatherTracer, Lattice};
use super::sampling::MOST_ALONG_SIDE;
use super::small_faces;
use crate::radio::diffuse::{Contribution, DIRECTIONS_PER_TASK, DiffuseField, in_tasks};
use crate::radio::lattice::{Directions, neighbours};
use crate::radio::{Antenna, Arrival};
use glam::DVec3;
use rayon::prelude::*;

/// Difference of neighbours that is left alone, over the power within the reader's resolution. About twenty cells lie along an edge through it,
/// each wrong by this over √12: three per cent together.
const TOLERATED: f64 = 0.02;
/// Most directions along the side of a cell that is refined only because it differs from neighbours that agree: that evens out its own
/// value.
const MOST_LUCKY: usize = 4;
/// Regions this much fainter than the brightest are left alone.
const FAINTEST: f64 = 1e-5;
/// Share of power that a strong mirror, or a slab, passes on.
const STRONG_MIRROR: f64 = 0.9;
/// Limit of Russian roulette for sample points: those of less power than this many times the mean direction's take part.
const FAINT: f64 = 2.0;
/// Number of further comparisons of refined cells with their neighbours.
const ROUNDS: usize = 2;

/// Power that a cell receives through one object seen first.
#[derive(Clone, Copy)]
struct Part {
    object: u32,
    power: f64,
    weighted_delay: f64,
    weighted_direction: DVec3,
}

/// Power that a cell receives in one layer, by object seen first.
struct Seen {
    /// Directions along the cell's side that were looked along.
    side: usize,
    /// Whether some of them speak for all, those that met what the first one met: in full it is cut where its neighbours ask for it.
    partial: bool,
    parts: Vec<Part>,
}

impl Seen {
    fn of_side(side: usize) -> Self {
        Self { side, partial: false, parts: Vec::new() }
    }

    fn power(&self) -> f64 {
        self.parts.iter().map(|p| p.power).sum()
    }
}

/// Refinement of a layer of a cell that the difference to its neighbours asks for.
#[derive(Clone, Copy)]
struct RefinementRequest {
    /// Directions along the side that the neighbours' differences ask for.
    side: usize,
    /// Least and largest power of the neighbours.
    neighbours: [f64; 2],
    /// Power received within the reader's resolution, the cell's layer left out.
    others: f64,
}

impl RefinementRequest {
    const NONE: Self = Self { side: 1, neighbours: [0.0; 2], others: f64::INFINITY };

    /// Directions along the side that a difference asks for, so many times the tolerated one. The error of n samples across an edge falls
    /// as n^−¾, and n is the square of the side.
    fn side(times_tolerated: f64) -> usize {
        (times_tolerated.powf(2.0 / 3.0).ceil() as usize).clamp(1, MOST_ALONG_SIDE)
    }

    /// Largest difference between the neighbours' powers and a power that the cell's layer may receive, in multiples of the tolerated one.
    fn times_tolerated(&self, power: f64) -> f64 {
        let [least, most] = self.neighbours;
        (power - least).max(most - power) / (TOLERATED * (self.others + power))
    }
}

/// One direction of the lattice and what is known of its cell.
struct DirectionCell {
    index: usize,
    direction: DVec3,
    /// Power from the surfaces seen first, and from behind them: by [`LAYERS`].
    seen: [Seen; 2],
}

/// Layers that are refined independently: most outlines are those of the surfaces seen first, and surfaces behind them cost more rays.
const LAYERS: [DepthLayer; 2] = [DepthLayer::Front, DepthLayer::Beyond];

impl DirectionCell {
    /// Everything it receives, by object.
    fn arrivals(self) -> impl Iterator<Item = Arrival> {
        let [Seen { mut parts, .. }, beyond] = self.seen;
        for part in beyond.parts {
            add(&mut parts, part);
        }
        parts.into_iter().map(|part| part.arrival())
    }
}

/// A receiver and the lattice it looks along.
pub struct Gathering<'g, 'f, 't, 'a> {
    pub field: &'f DiffuseField<'t, 'a>,
    pub rx: DVec3,
    pub antenna: &'g Antenna,
    /// Over the whole sphere.
    pub directions: &'f Directions,
    /// Angular resolution of the arrivals' reader, degrees; 0 refines nothing.
    pub resolution_deg: f64,
    /// Whether what the directions meet is shared with the transmitter's own rays.
    pub shared: bool,
    /// Small faces, which are sampled over their area and not by directions.
    pub small: Option<small_faces::Seen>,
    /// Mirrors in sight, where what they show is shared as well.
    pub views: Option<ImageReceivers>,
    /// Directions along the side of a cell whose first direction finds a strong mirror.
    pub mirror_side: usize,
}

impl Gathering<'_, '_, '_, '_> {
    /// The arrivals of those directions that are `wanted`, near ones together, of points of small faces, and of the transmitter's own rays.
    pub fn arrivals(&self, wanted: impl Fn(DVec3) -> bool + Sync) -> Vec<Arrival> {
        let (mut arrivals, directions) = if self.resolution_deg > 0.0 { self.refined(&wanted) } else { self.plain(&wanted) };
        let power: f64 = arrivals.iter().map(|a| a.power).sum();
        if let Some(small) = &self.small {
            arrivals.extend(self.small(small, &wanted));
        }
        if let Some(views) = &self.views {
            let faint = FAINT * power / directions.max(1) as f64;
            arrivals.extend(self.landed_by(views, faint, &wanted));
        } else {
            let landed = self.field.landed(self.rx, self.antenna, self.lattice(), &wanted);
            arrivals.extend(landed.into_iter().map(|(direction, c)| once(direction, c.object, &c)));
        }
        let share = self.field.policy.firefly_share;
        if share > 0.0 && self.resolution_deg > 0.0 {
            fireflies::cut(&mut arrivals, self.resolution_deg, share);
        }
        arrivals
    }

    /// One arrival per direction that receives anything, and the number of all of them.
    fn plain(&self, wanted: impl Fn(DVec3) -> bool + Sync) -> (Vec<Arrival>, usize) {
        let found = self.look(wanted, |look, index, direction| {
            arrival(direction, |report| look.along(index, direction, DepthLayer::All, &mut |c| report(c)))
        });
        let directions = found.len();
        (found.into_iter().flatten().collect(), directions)
    }

    /// One arrival per point of a small face in a `wanted` direction.
    fn small(&self, seen: &small_faces::Seen, wanted: impl Fn(DVec3) -> bool + Sync) -> Vec<Arrival> {
        let numbered: Vec<_> = seen.points.iter().enumerate().filter(|(_, point)| wanted(point.direction)).collect();
        in_tasks(&numbered, |points| {
            let look = GatherTracer::new(self.field, self.rx, self.antenna, self.lattice());
            let arrivals =
                points.iter().map(|&(i, point)| arrival(point.direction, |report| look.at(i, point, &mut |c| report(c))));
            arrivals.flatten().collect()
        })
    }

    /// One arrival per point that the transmitter's own rays fell on and that is seen by a way, by ways; chance decides about those that send
    /// less power than what is `faint`.
    pub fn landed_by(&self, views: &ImageReceivers, faint: f64, wanted: impl Fn(DVec3) -> bool + Sync) -> Vec<Arrival> {
        let Some(light_hits) = &self.field.light_hits else { return Vec::new() };
        let lattice = self.lattice();
        let per_view: Vec<Vec<Arrival>> = views
            .all()
            .par_iter()
            .map(|view| {
                let look = GatherTracer::new(self.field, self.rx, self.antenna, lattice);
                let mut arrivals = Vec::new();
                light_hits.tree.shown(view, lattice.sampling, |i| {
                    let landed = look.landed_by(view, i, &light_hits.all[i], faint, &wanted);
                    arrivals.extend(landed.map(|(direction, object, c)| once(direction, object, &c)));
                });
                arrivals
            })
            .collect();
        per_view.into_iter().flatten().collect()
    }

    /// An arrival per direction and object, those of cut cells together, and the number of directions.
    fn refined(&self, wanted: impl Fn(DVec3) -> bool + Sync) -> (Vec<Arrival>, usize) {
        let mut cells: Vec<DirectionCell> = self.look(wanted, |look, index, direction| {
            let mut seen = [1; 2].map(Seen::of_side);
            along(look, index, direction, DepthLayer::All, &mut seen);
            let mut cell = DirectionCell { index, direction, seen };
            if self.mirror_side > 1 && look.beyond() >= STRONG_MIRROR {
                let shown = self.cut(&cell, 1, self.mirror_side, |look, _| look.beyond() >= STRONG_MIRROR, look);
                if let Some(seen) = shown {
                    cell.seen[1] = Seen { partial: true, ..seen };
                }
            }
            cell
        });
        for _ in 0..ROUNDS {
            self.refine(&mut cells);
        }
        let directions = cells.len();
        (cells.into_iter().flat_map(DirectionCell::arrivals).collect(), directions)
    }

    /// Results of `find` along every `wanted` direction of the lattice.
    fn look<T: Send>(
        &self,
        wanted: impl Fn(DVec3) -> bool + Sync,
        find: impl Fn(&mut GatherTracer<'_, '_, '_>, usize, DVec3) -> T + Sync,
    ) -> Vec<T> {
        in_tasks(self.directions.along(), |numbers| {
            let mut look = GatherTracer::new(self.field, self.rx, self.antenna, self.lattice());
            let directions = numbers.iter().map(|&number| (number as usize, self.directions.of(number as usize)));
            let directions = directions.filter(|(_, direction)| wanted(*direction));
            directions.map(|(number, direction)| find(&mut look, number, direction)).collect()
        })
    }

    fn lattice(&self) -> Lattice<'_> {
        let lattice = Lattice::new(self.directions.count(), self.resolution_deg > 0.0, self.shared);
        Lattice { small: self.small.as_ref(), views: self.views.as_ref(), ..lattice }
    }

    /// Cuts every cell whose neighbours call for it, and those that differ from all of them.
    fn refine(&self, cells: &mut [DirectionCell]) {
        let wishes = self.wishes(cells);
        cells.par_chunks_mut(DIRECTIONS_PER_TASK).zip(wishes.par_chunks(DIRECTIONS_PER_TASK)).for_each(|(cells, wishes)| {
            let mut look = GatherTracer::new(self.field, self.rx, self.antenna, self.lattice());
            for (cell, wishes) in cells.iter_mut().zip(wishes) {
                for (layer, wish) in wishes.iter().enumerate() {
                    let seen = &cell.seen[layer];
                    let own = wish.times_tolerated(seen.power());
                    let cut = if wish.side > seen.side || (wish.side > 1 && seen.partial) {
                        self.cut(cell, layer, wish.side, |_, _| true, &mut look)
                    } else if seen.side == 1 && own > 1.0 {
                        let side = RefinementRequest::side(own).min(MOST_LUCKY);
                        let lucky = self.cut(cell, layer, side, |_, power| wish.times_tolerated(power) > 1.0, &mut look);
                        lucky.map(|seen| Seen { partial: true, ..seen })
                    } else {
                        None
                    };
                    // Where none counts, what the cell met is smaller still, and its own word stands.
                    if let Some(seen) = cut {
                        cell.seen[layer] = seen;
                    }
                }
            }
        });
    }

    /// Looks at a layer of a cell along side × side directions: the mean of those that count by how they looked and their power, if any does.
    fn cut(
        &self,
        cell: &DirectionCell,
        layer: usize,
        side: usize,
        counts: impl Fn(&GatherTracer<'_, '_, '_>, f64) -> bool,
        look: &mut GatherTracer<'_, '_, '_>,
    ) -> Option<Seen> {
        let mut mean = Seen::of_side(side);
        let mut counted = 0;
        let parts = self.directions.cell(cell.index, MOST_ALONG_SIDE);
        for i in 0..side * side {
            let (number, direction) = parts.part(i, side);
            let mut seen = [side; 2].map(Seen::of_side);
            along(look, number, direction, LAYERS[layer], &mut seen);
            let [front, beyond] = seen;
            let seen = if layer == 0 { front } else { beyond };
            if counts(look, seen.power()) {
                counted += 1;
                seen.parts.into_iter().for_each(|part| add(&mut mean.parts, part));
            }
        }
        mean.parts.iter_mut().for_each(|part| part.scale(1.0 / f64::from(counted)));
        (counted > 0).then_some(mean)
    }

    /// Refinement that each cell's neighbours ask of it, by layer.
    fn wishes(&self, cells: &[DirectionCell]) -> Vec<[RefinementRequest; 2]> {
        let count = self.directions.count();
        let mut by_index = vec![[f64::NAN; 2]; count];
        let mut bins = Bins::new(self.resolution_deg);
        for cell in cells {
            let powers = [0, 1].map(|layer| cell.seen[layer].power());
            by_index[cell.index] = powers;
            bins.add(cell.direction, powers[0] + powers[1]);
        }
        let seen = bins.around();
        let least = FAINTEST * seen.iter().fold(0.0, |m: f64, s| m.max(s.power));
        cells
            .par_iter()
            .map(|cell| {
                let whole = seen[bins.at(cell.direction)].power;
                if whole <= least {
                    return [RefinementRequest::NONE; 2];
                }
                let own = by_index[cell.index];
                let steps = neighbours(cell.index, count);
                let mut ranges = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
                let neighbours = steps.iter().flat_map(|&s| [cell.index.checked_sub(s), Some(cell.index + s)]);
                for powers in neighbours.filter_map(|neighbour| by_index.get(neighbour?).filter(|powers| !powers[0].is_nan())) {
                    for (range, power) in ranges.iter_mut().zip(powers) {
                        *range = [range[0].min(*power), range[1].max(*power)];
                    }
                }
                [0, 1].map(|layer| match ranges[layer] {
                    [least, most] if least <= most => RefinementRequest {
                        side: RefinementRequest::side((most - least) / (TOLERATED * whole)),
                        neighbours: ranges[layer],
                        others: (whole - own[layer]).max(0.0),
                    },
                    _ => RefinementRequest::NONE,
                })
            })
            .collect()
    }
}

impl Part {
    fn scale(&mut self, factor: f64) {
        self.power *= factor;
        self.weighted_delay *= factor;
        self.weighted_direction *= factor;
    }

    fn arrival(&self) -> Arrival {
        Arrival {
            direction: self.weighted_direction.normalize_or_zero(),
            power: self.power,
            delay_s: self.weighted_delay / self.power,
            object: self.object,
            phase_rad: None,
        }
    }
}

/// A single contribution as an arrival from a direction in which an object is seen first.
fn once(direction: DVec3, object: u32, c: &Contribution) -> Arrival {
    Arrival { direction, power: c.power, delay_s: c.delay_s, object, phase_rad: None }
}

/// Sum of all contributions of one direction as an arrival; `None` where there is no power.
fn arrival(direction: DVec3, look: impl FnOnce(&mut dyn FnMut(Contribution)) -> Option<u32>) -> Option<Arrival> {
    let (mut power, mut weighted_delay) = (0.0, 0.0);
    let object = look(&mut |c| {
        power += c.power;
        weighted_delay += c.power * c.delay_s;
    });
    let delay_s = weighted_delay / power;
    object.filter(|_| power > 0.0).map(|object| Arrival { direction, power, delay_s, object, phase_rad: None })
}

/// Looks along one direction and adds what comes from there to what was seen.
fn along(look: &mut GatherTracer<'_, '_, '_>, number: usize, direction: DVec3, layer: DepthLayer, seen: &mut [Seen; 2]) {
    let mut sums = [(0.0, 0.0); 2];
    let object = look.along(number, direction, layer, &mut |c| {
        let (power, weighted_delay) = &mut sums[usize::from(c.after > 0)];
        *power += c.power;
        *weighted_delay += c.power * c.delay_s;
    });
    let Some(object) = object else { return };
    for (seen, (power, weighted_delay)) in seen.iter_mut().zip(sums).filter(|(_, (power, _))| *power > 0.0) {
        add(&mut seen.parts, Part { object, power, weighted_delay, weighted_direction: direction * power });
    }
}

/// Adds a part to that of the same object.
fn add(parts: &mut Vec<Part>, part: Part) {
    match parts.iter_mut().find(|p| p.object == part.object) {
        Some(same) => {
            same.power += part.power;
            same.weighted_delay += part.weighted_delay;
            same.weighted_direction += part.weighted_direction;
        }
        None => parts.push(part),
    }
}
