//! Free space of a room in plan, by rays: where a platform can stand, a loop that it can go round, and a place for a transmitter.

use corf_raytrace::bvh::{Bvh, Ray};
use corf_scene::solids::Solids;
use corf_scene::trajectory::{self, TrajectoryConfig};
use corf_scene::{Error, Result, Rigid3, Scene};
use glam::{DVec2, DVec3, IVec2, Vec3};
use rayon::prelude::*;
use std::collections::{BTreeMap, VecDeque};

/// Cells along the longer side of a scene, at most.
const MOST_CELLS: f64 = 240.0;
/// Side of a cell at least, metres.
const LEAST_CELL_M: f64 = 0.1;
/// Directions in plan in which a place has to be clear.
const DIRECTIONS: usize = 24;
/// Heights above the floor at which it has to be, up to over the sensor, metres; what is lower is rolled over.
const FOOT_M: f64 = 0.08;
const LEVELS: usize = 8;
/// Room above the sensor, metres.
const HEAD_M: f64 = 0.15;
/// Clearances of the loop from everything, metres, the widest that leaves a loop.
const CLEARANCES_M: [f64; 5] = [0.8, 0.6, 0.45, 0.35, 0.28];
/// What is nearer to something than this, metres, is not free; the smooth way may come nearer than its corners do, but not so near.
const LEAST_CLEAR_M: f64 = 0.2;
/// The smooth way keeps this share of its corners' clearance.
const KEPT: f64 = 0.75;
/// Corners of a loop that people can read and change.
const CORNERS: std::ops::RangeInclusive<usize> = 3..=40;
/// Poses for a metre of a loop that is tried.
const POSES_PER_M: f64 = 6.0;
/// Rooms lower and higher than this are more likely a unit mistaken, metres: a hall of 15 m is high, a room of 27 was meant in decimetres.
const PLAUSIBLE_ROOM_M: [f64; 2] = [1.8, 15.0];
/// Horizontal surfaces whose heights differ by less are one floor, metres.
const STOREY_BIN_M: f64 = 0.05;
/// A floor has this share of the area of the largest horizontal surface.
const FLOOR_SHARE: f64 = 0.25;
/// The shortest loop worth going round, metres.
const LEAST_LOOP_M: f64 = 2.0;
/// A scene with what is asked about its free space.
pub struct FreeSpace<'a> {
    scene: &'a Scene,
    bvh: &'a Bvh,
    solids: Solids,
    /// Height of the floor, metres.
    pub floor_m: f64,
    /// Height of the sensor above it, metres.
    pub height_m: f64,
    /// Height of the ceiling above the middle of the free cells, if there is one, metres.
    pub ceiling_m: Option<f64>,
    /// Middle of the cell (0, 0), metres.
    corner: DVec2,
    /// Side of a cell, metres.
    pub cell_m: f64,
    /// Clearance of each free cell from everything, up to the widest of [`CLEARANCES_M`], metres.
    clear_m: BTreeMap<[i32; 2], f64>,
}

/// A closed way.
pub struct Loop {
    /// Its corners in plan, metres.
    pub waypoints_m: Vec<[f64; 2]>,
    /// What it keeps from everything, metres.
    pub clearance_m: f64,
    /// Its length, metres.
    pub length_m: f64,
}

impl Loop {
    /// Area that its corners enclose, m².
    fn area_m2(&self) -> f64 {
        let corners = self.waypoints_m.iter().map(|p| DVec2::from_array(*p));
        let doubled: f64 =
            corners.clone().zip(corners.cycle().skip(1)).take(self.waypoints_m.len()).map(|(a, b)| a.perp_dot(b)).sum();
        0.5 * doubled.abs()
    }
}

impl<'a> FreeSpace<'a> {
    /// Finds the floor and the free cells for a sensor so high above it.
    ///
    /// # Errors
    /// No floor, a room too low, no place where a platform could stand; `place` names the mesh.
    pub fn of(scene: &'a Scene, bvh: &'a Bvh, height_m: f64, place: &str) -> Result<Self> {
        let Some(bounds) = scene.bounds() else {
            return Err(Error::invalid(place, "there is no triangle", "give a mesh with triangles"));
        };
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let floor_m = floor(scene).ok_or_else(|| {
            let help = "a room needs a floor: check which axis is up (--up), or export the floor with the rest";
            Error::invalid(place, "no surface lies flat, so there is no floor", help)
        })?;
        let size = (max - min).truncate();
        let cell_m = (size.max_element() / MOST_CELLS).max(LEAST_CELL_M);
        let mut space = Self {
            scene,
            bvh,
            solids: Solids::of(scene),
            floor_m,
            height_m,
            ceiling_m: None,
            corner: min.truncate() + 0.5 * cell_m,
            cell_m,
            clear_m: BTreeMap::new(),
        };
        let cells = (size / cell_m).ceil().as_ivec2();
        let all: Vec<[i32; 2]> = (0..cells.y.max(1)).flat_map(|y| (0..cells.x.max(1)).map(move |x| [x, y])).collect();
        let over: Vec<([i32; 2], f64, Option<f64>)> = all
            .par_iter()
            .filter_map(|&cell| space.clearance_m(space.middle(cell)).map(|(clear, ceiling)| (cell, clear, ceiling)))
            .collect();
        // Within doors, where there is a within.
        let roofed: Vec<_> = over.iter().copied().filter(|(.., ceiling)| ceiling.is_some()).collect();
        let free = if roofed.len() as f64 * cell_m * cell_m >= 1.0 { roofed } else { over };
        let mut ceilings: Vec<f64> = free.iter().filter_map(|(.., ceiling)| *ceiling).collect();
        ceilings.sort_by(f64::total_cmp);
        space.ceiling_m = ceilings.get(ceilings.len() / 2).copied();
        space.clear_m = free.into_iter().map(|(cell, clear, _)| (cell, clear)).collect();
        if space.clear_m.is_empty() {
            let what = match ceiling_over(&space, min, max) {
                Some(room_m) => {
                    format!("{room_m:.2} m are between floor and ceiling, and the sensor stands {height_m:.2} m high")
                }
                None => format!("nowhere on the floor at {floor_m:.2} m is room for a platform {height_m:.2} m high"),
            };
            let help =
                "give the sensor's height above the floor (--height), and check that positions are metres and z is up (--up)";
            return Err(Error::invalid(place, what, help));
        }
        Ok(space)
    }

    fn middle(&self, cell: [i32; 2]) -> DVec2 {
        self.corner + self.cell_m * IVec2::from_array(cell).as_dvec2()
    }

    /// Distance along a ray to the first surface, metres.
    fn distance_m(&self, from: DVec3, direction: DVec3) -> f64 {
        self.bvh.intersect(&Ray::new(from.as_vec3(), direction.as_vec3())).map_or(f64::INFINITY, |hit| f64::from(hit.t))
    }

    /// Height of the sensor, metres.
    pub fn sensor_m(&self) -> f64 {
        self.floor_m + self.height_m
    }

    /// How far a platform at a place keeps from everything, up to the widest clearance, and how high the ceiling is above the floor; `None` where it
    /// cannot stand.
    fn clearance_m(&self, at: DVec2) -> Option<(f64, Option<f64>)> {
        let sensor = at.extend(self.sensor_m());
        // The floor is what is below, and nothing hangs between.
        let below_m = self.distance_m(sensor, DVec3::NEG_Z);
        if (below_m - self.height_m).abs() > FOOT_M || self.solids.containing(sensor).is_some() && !self.in_room(sensor) {
            return None;
        }
        let above_m = self.distance_m(sensor, DVec3::Z);
        if above_m < HEAD_M {
            return None;
        }
        let mut clear_m = CLEARANCES_M[0];
        for level in 0..LEVELS {
            let z = self.floor_m + FOOT_M + (self.height_m + HEAD_M - FOOT_M) * level as f64 / (LEVELS - 1) as f64;
            let z = z.min(self.sensor_m() + 0.9 * above_m);
            for k in 0..DIRECTIONS {
                let (sin, cos) = (std::f64::consts::TAU * (k as f64 + 0.5 * (level % 2) as f64) / DIRECTIONS as f64).sin_cos();
                clear_m = clear_m.min(self.distance_m(at.extend(z), DVec3::new(cos, sin, 0.0)));
            }
        }
        (clear_m >= LEAST_CLEAR_M).then_some((clear_m, above_m.is_finite().then_some(self.height_m + above_m)))
    }

    /// Whether the body around a point is the room itself, closed and facing outward.
    fn in_room(&self, point: DVec3) -> bool {
        self.solids.parting(point, point).is_none()
    }

    /// What is strange about the height between floor and ceiling, or of the mesh where there is no ceiling.
    pub fn doubtful_height(&self) -> Option<String> {
        let top_m = self.scene.bounds().map(|bounds| f64::from(bounds.max.z));
        let (height_m, of) = match (self.ceiling_m, top_m) {
            (Some(room_m), _) => (room_m, "are between floor and ceiling"),
            (None, top_m) => (top_m? - self.floor_m, "are between the floor and the mesh's top"),
        };
        let is_plausible = (PLAUSIBLE_ROOM_M[0]..=PLAUSIBLE_ROOM_M[1]).contains(&height_m);
        (!is_plausible).then(|| format!("{height_m:.2} m {of}: positions are metres; was it exported in another unit?"))
    }

    /// Whether nothing is between two places at the sensor's height, nor below it.
    fn is_clear_between(&self, a: DVec2, b: DVec2) -> bool {
        (0..LEVELS).all(|level| {
            let z = self.floor_m + FOOT_M + (self.height_m - FOOT_M) * level as f64 / (LEVELS - 1) as f64;
            let (a, b): (Vec3, Vec3) = (a.extend(z).as_vec3(), b.extend(z).as_vec3());
            a == b || !self.bvh.occluded(&Ray::segment(a, b))
        })
    }

    /// The loop at the widest clearance that leaves one around at least half as much floor as any.
    ///
    /// # Errors
    /// No loop: the free space is too small.
    pub fn find_loop(&self, speed: impl Fn(Vec<[f64; 2]>) -> TrajectoryConfig, place: &str) -> Result<Loop> {
        let found: Vec<Loop> = CLEARANCES_M.into_iter().filter_map(|clearance_m| self.loop_at(clearance_m, &speed)).collect();
        let largest_m2 = found.iter().map(Loop::area_m2).fold(0.0, f64::max);
        found.into_iter().find(|way| way.length_m >= LEAST_LOOP_M && way.area_m2() >= 0.5 * largest_m2).ok_or_else(|| {
            let area_m2 = self.clear_m.len() as f64 * self.cell_m * self.cell_m;
            let what = format!("{area_m2:.1} m² of floor are free, and no loop of {LEAST_LOOP_M} m was found in them");
            Error::invalid(place, what, "give the sensor another height (--height), or write waypoints_m by hand")
        })
    }

    /// The loop along the rim of the largest piece of free space with this clearance.
    fn loop_at(&self, clearance_m: f64, config: &impl Fn(Vec<[f64; 2]>) -> TrajectoryConfig) -> Option<Loop> {
        let piece = self.largest_piece(clearance_m);
        let rim = contour(&piece);
        let n = rim.len();
        // From few corners to many, until the smooth way through them is clear.
        for longest in [n / 3, n / 5, n / 8, n / 12, n / 20, n / 32, 3, 2].into_iter().filter(|longest| *longest >= 2) {
            let corners = self.shortened(&rim, &piece, longest);
            if !CORNERS.contains(&corners.len()) {
                continue;
            }
            let waypoints_m: Vec<[f64; 2]> = corners.iter().map(|cell| self.middle(*cell).to_array().map(rounded)).collect();
            let way = config(waypoints_m.clone());
            if let Some((length_m, kept_m)) = self.check(&way).filter(|(_, kept_m)| *kept_m >= KEPT * clearance_m) {
                return Some(Loop { waypoints_m, clearance_m: kept_m, length_m });
            }
        }
        None
    }

    /// Length of a way and what it keeps from everything, if a platform can go it.
    fn check(&self, way: &TrajectoryConfig) -> Option<(f64, f64)> {
        way.validate("trajectory").ok()?;
        let length = |poses: &[DVec2]| -> f64 { (0..poses.len()).map(|i| poses[i].distance(poses[(i + 1) % poses.len()])).sum() };
        let at = |count: usize| -> Option<Vec<DVec2>> {
            Some(
                trajectory::generate(way, count).ok()?.iter().map(|pose| pose.world_from_camera.translation.truncate()).collect(),
            )
        };
        let count = (length(&at(64)?) * POSES_PER_M).ceil().clamp(64.0, 20_000.0) as usize;
        let places = at(count)?;
        let clear: Option<Vec<f64>> = places.par_iter().map(|at| self.clearance_m(*at).map(|(clear_m, _)| clear_m)).collect();
        let is_clear = (0..count).all(|i| self.is_clear_between(places[i], places[(i + 1) % count]));
        let clear_m = clear?.into_iter().fold(f64::INFINITY, f64::min);
        is_clear.then(|| (length(&places), clear_m))
    }

    /// Cells of the largest connected piece with this clearance.
    fn largest_piece(&self, clearance_m: f64) -> BTreeMap<[i32; 2], f64> {
        let mut left: BTreeMap<[i32; 2], f64> =
            self.clear_m.iter().filter(|(_, m)| **m >= clearance_m).map(|(c, m)| (*c, *m)).collect();
        let mut largest = BTreeMap::new();
        while let Some((first, clear_m)) = left.pop_first() {
            let (mut piece, mut queue) = (BTreeMap::from([(first, clear_m)]), VecDeque::from([first]));
            while let Some([x, y]) = queue.pop_front() {
                for next in [[x + 1, y], [x - 1, y], [x, y + 1], [x, y - 1]] {
                    if let Some(clear_m) = left.remove(&next) {
                        piece.insert(next, clear_m);
                        queue.push_back(next);
                    }
                }
            }
            if piece.len() > largest.len() {
                largest = piece;
            }
        }
        largest
    }

    /// Corners of a rim such that the straight lines between them, over `longest` cells of it at most, stay within the piece.
    fn shortened(&self, rim: &[[i32; 2]], piece: &BTreeMap<[i32; 2], f64>, longest: usize) -> Vec<[i32; 2]> {
        let n = rim.len();
        let within = |a: [i32; 2], b: [i32; 2]| {
            let (a, b) = (IVec2::from_array(a).as_dvec2(), IVec2::from_array(b).as_dvec2());
            let steps = (2.0 * a.distance(b)).ceil() as usize;
            (0..=steps).all(|i| piece.contains_key(&a.lerp(b, i as f64 / steps.max(1) as f64).round().as_ivec2().to_array()))
        };
        let (mut corners, mut at) = (Vec::new(), 0);
        while at < n {
            corners.push(rim[at]);
            let reach = (1..=longest.min(n - at)).rev().find(|step| within(rim[at], rim[(at + step) % n])).unwrap_or(1);
            at += reach;
        }
        corners.dedup();
        if corners.len() > 1 && corners.first() == corners.last() {
            corners.pop();
        }
        corners
    }

    /// A place for a transmitter under the ceiling, over the free floor, that sees most of a loop and stands off it; with the share that it sees.
    pub fn transmitter(&self, waypoints: &TrajectoryConfig) -> Option<(DVec3, f64)> {
        let poses: Vec<DVec3> =
            trajectory::generate(waypoints, 48).ok()?.iter().map(|p| p.world_from_camera.translation).collect();
        let height_m = self.ceiling_m.map_or(2.5, |ceiling_m| (ceiling_m - 0.4).min(2.5)).max(self.height_m);
        let z = rounded(self.floor_m + height_m);
        let score = |cell: &[i32; 2]| -> Option<(usize, f64, DVec3)> {
            let at = self.middle(*cell).extend(z);
            let at = DVec3::new(rounded(at.x), rounded(at.y), at.z);
            let near_m = poses.iter().map(|p| p.distance(at)).fold(f64::INFINITY, f64::min);
            let directions =
                (0..DIRECTIONS).map(|k| DVec2::from_angle(std::f64::consts::TAU * k as f64 / DIRECTIONS as f64).extend(0.0));
            let free = near_m > 0.5
                && directions.chain([DVec3::Z, DVec3::NEG_Z]).all(|d| self.distance_m(at, d) > 0.2)
                && self.solids.parting(at, poses[0]).is_none();
            let seen = || poses.iter().filter(|p| !self.bvh.occluded(&Ray::segment(at.as_vec3(), p.as_vec3()))).count();
            free.then(|| (seen(), near_m, at))
        };
        let cells: Vec<[i32; 2]> = self.clear_m.keys().copied().collect();
        let scored: Vec<(usize, f64, DVec3)> = cells.par_iter().filter_map(score).collect();
        let best = scored.into_iter().max_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)))?;
        Some((best.2, best.0 as f64 / poses.len() as f64))
    }

    /// Mean distance that a camera at a pose sees, metres, up to 20 in each direction.
    pub fn sight_m(&self, world_from_camera: &Rigid3) -> f64 {
        const FARTHEST_M: f64 = 20.0;
        let rays = (-2..=2).flat_map(|x| [-0.3, 0.0, 0.3].map(|y| DVec3::new(0.4 * f64::from(x), y, 1.0)));
        let seen: Vec<f64> = rays
            .map(|ray| {
                self.distance_m(world_from_camera.translation, (world_from_camera.rotation * ray).normalize()).min(FARTHEST_M)
            })
            .collect();
        seen.iter().sum::<f64>() / seen.len() as f64
    }

    /// The middles of the free cells, metres.
    pub fn free_cells(&self) -> impl Iterator<Item = DVec2> {
        self.clear_m.keys().map(|cell| self.middle(*cell))
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        self.scene
    }
}

/// To a centimetre, as people write positions.
pub fn rounded(metres: f64) -> f64 {
    (metres * 100.0).round() / 100.0
}

/// The height of the lowest large horizontal surface.
fn floor(scene: &Scene) -> Option<f64> {
    let mut areas: BTreeMap<i64, (f64, f64)> = BTreeMap::new();
    for i in 0..scene.triangles.len() {
        let [a, b, c] = scene.corners_f64(i);
        let double = (b - a).cross(c - a);
        if double.z.abs() > 0.999 * double.length() && double.length() > 0.0 {
            let (area, z) = (0.5 * double.length(), (a.z + b.z + c.z) / 3.0);
            let bin = areas.entry((z / STOREY_BIN_M).round() as i64).or_default();
            *bin = (bin.0 + area, bin.1 + area * z);
        }
    }
    let largest = areas.values().map(|(area, _)| *area).fold(0.0, f64::max);
    areas.values().find(|(area, _)| *area >= FLOOR_SHARE * largest && *area > 0.0).map(|(area, moment)| moment / area)
}

/// The greatest height between floor and ceiling at some places of a box, metres, where that is too low for the sensor.
fn ceiling_over(space: &FreeSpace<'_>, min: DVec3, max: DVec3) -> Option<f64> {
    const PLACES: i32 = 9;
    let at = |i: i32, low: f64, high: f64| low + (high - low) * (f64::from(i) + 0.5) / f64::from(PLACES);
    let places = (0..PLACES * PLACES)
        .map(|i| DVec3::new(at(i % PLACES, min.x, max.x), at(i / PLACES, min.y, max.y), space.floor_m + 1e-3));
    let heights = places.map(|at| space.distance_m(at, DVec3::Z)).filter(|room_m| room_m.is_finite());
    heights.max_by(f64::total_cmp).filter(|room_m| *room_m < space.height_m + HEAD_M)
}

/// The outer rim of a connected piece of cells, once round (Moore's neighbours).
fn contour(piece: &BTreeMap<[i32; 2], f64>) -> Vec<[i32; 2]> {
    /// Neighbours in order around a cell.
    const AROUND: [[i32; 2]; 8] = [[-1, 0], [-1, 1], [0, 1], [1, 1], [1, 0], [1, -1], [0, -1], [-1, -1]];
    // The first cell by x has nothing to its left.
    let Some(&start) = piece.keys().next() else { return Vec::new() };
    let (mut rim, mut at, mut from) = (vec![start], start, 0usize);
    loop {
        let step = (1..=8).map(|k| (from + k) % 8).find(|k| piece.contains_key(&[at[0] + AROUND[*k][0], at[1] + AROUND[*k][1]]));
        let Some(step) = step else { return rim };
        at = [at[0] + AROUND[step][0], at[1] + AROUND[step][1]];
        // Back to where it came from, from which it looks on.
        from = (step + 4) % 8;
        if at == start {
            return rim;
        }
        rim.push(at);
        if rim.len() > 8 * piece.len() {
            return rim;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rim_of_a_piece_goes_once_round_it() {
        let square = |n: i32| -> BTreeMap<[i32; 2], f64> { (0..n * n).map(|i| ([i % n, i / n], 1.0)).collect() };
        let rim = contour(&square(5));
        assert_eq!(rim.len(), 16, "{rim:?}");
        assert!(rim.iter().all(|[x, y]| [0, 4].contains(x) || [0, 4].contains(y)));
        // Neighbours all the way, and closed.
        for (a, b) in rim.iter().zip(rim.iter().cycle().skip(1)) {
            assert!((a[0] - b[0]).abs() <= 1 && (a[1] - b[1]).abs() <= 1 && a != b, "{a:?} {b:?}");
        }
        assert_eq!(contour(&square(1)), [[0, 0]]);
        assert!(contour(&BTreeMap::new()).is_empty());
    }
}
