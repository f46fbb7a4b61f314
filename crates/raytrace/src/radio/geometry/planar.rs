//! Point location in a planar face: finds the triangle that a point of the plane lies on.

use crate::radio::lattice::R2;
use glam::{DVec2, DVec3};

/// Faces of more triangles than this get a grid.
const LINEAR_LIMIT: usize = 12;

/// Triangles projected along the dominant axis of their plane's normal, with a uniform grid when there are many.
#[derive(Clone, Debug)]
pub struct PlanarIndex {
    bounds: PlanarBounds,
    triangles: Vec<[DVec2; 3]>,
    grid: Option<Box<Grid>>,
}

/// Cells in row-major order; the triangles of cell `i` are `items[starts[i]..starts[i + 1]]`.
#[derive(Clone, Debug)]
struct Grid {
    side: usize,
    starts: Vec<u32>,
    items: Vec<u32>,
}

/// The box of a face's triangles, laid out on two axes.
#[derive(Clone, Copy, Debug)]
pub struct PlanarBounds {
    drop: usize,
    /// Least coordinates along the two, metres.
    pub min: DVec2,
    /// Greatest coordinates along the two, metres.
    pub max: DVec2,
}

/// Twice a projected triangle's.
fn doubled_area([a, b, c]: &[DVec2; 3]) -> f64 {
    (b - a).perp_dot(c - a).abs()
}

/// The unit square, folded into a triangle.
fn within([a, b, c]: &[DVec2; 3], place: DVec2) -> DVec2 {
    let DVec2 { x, y } = if place.x + place.y > 1.0 { 1.0 - place } else { place };
    a + (b - a) * x + (c - a) * y
}

impl PlanarBounds {
    /// A point's coordinates along the two axes.
    pub fn project(&self, p: DVec3) -> [f64; 2] {
        project(self.drop, p).to_array()
    }
}

impl PlanarIndex {
    /// The box of all triangles.
    pub fn bounds(&self) -> PlanarBounds {
        self.bounds
    }

    /// Indexes coplanar triangles whose plane has the given normal.
    pub fn new(normal: DVec3, triangles: impl Iterator<Item = [DVec3; 3]>) -> Self {
        let n = normal.abs();
        let drop = if n.x >= n.y && n.x >= n.z { 0 } else { 1 + usize::from(n.z >= n.y) };
        let triangles: Vec<[DVec2; 3]> = triangles.map(|t| t.map(|p| project(drop, p))).collect();
        let (mut min, mut max) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for p in triangles.iter().flatten() {
            (min, max) = (min.min(*p), max.max(*p));
        }
        let mut index = Self { bounds: PlanarBounds { drop, min, max }, triangles, grid: None };
        if index.triangles.len() > LINEAR_LIMIT {
            index.grid = Some(Box::new(index.build_grid()));
        }
        index
    }

    /// The corners, in order around it, of the bounding rectangle's preimage on the plane n·x = `offset_m`.
    pub fn hull(&self, normal: DVec3, offset_m: f64) -> [DVec3; 4] {
        let PlanarBounds { min, max, .. } = self.bounds;
        [min, DVec2::new(max.x, min.y), max, DVec2::new(min.x, max.y)].map(|at| self.lift(normal, offset_m, at))
    }

    /// `count` points of the plane n·x = `offset_m`, spread evenly over the triangles' area.
    pub fn spread(&self, normal: DVec3, offset_m: f64, count: usize) -> Vec<DVec3> {
        let total: f64 = self.triangles.iter().map(doubled_area).sum();
        let (mut index, mut before) = (0, 0.0);
        (0..count)
            .map(|i| {
                let target = total * (i as f64 + 0.5) / count as f64;
                while index + 1 < self.triangles.len() && before + doubled_area(&self.triangles[index]) < target {
                    before += doubled_area(&self.triangles[index]);
                    index += 1;
                }
                let place = DVec2::new((0.5 + i as f64 * R2.x) % 1.0, (0.5 + i as f64 * R2.y) % 1.0);
                self.lift(normal, offset_m, within(&self.triangles[index], place))
            })
            .collect()
    }

    /// The point at a `place` ∈ [0, 1)² of the triangle in which a `share` ∈ [0, 1) of all triangles' area ends: evenly spread over the area
    /// where both are so.
    pub fn point(&self, normal: DVec3, offset_m: f64, share: f64, place: DVec2) -> DVec3 {
        let mut left = share * self.triangles.iter().map(doubled_area).sum::<f64>();
        let ends = self.triangles.iter().find(|triangle| {
            left -= doubled_area(triangle);
            left < 0.0
        });
        self.lift(normal, offset_m, within(ends.unwrap_or(&self.triangles[self.triangles.len() - 1]), place))
    }

    /// The centre of the triangles' area, which a face with a hole or a notch may not hold.
    pub fn centroid(&self, normal: DVec3, offset_m: f64) -> DVec3 {
        let (mut sum, mut total) = (DVec2::ZERO, 0.0);
        for [a, b, c] in &self.triangles {
            let area = doubled_area(&[*a, *b, *c]);
            sum += (a + b + c) * (area / 3.0);
            total += area;
        }
        self.lift(normal, offset_m, sum / total)
    }

    /// The point of the plane above a projected one.
    fn lift(&self, normal: DVec3, offset_m: f64, at: DVec2) -> DVec3 {
        let mut p = DVec3::ZERO;
        let drop = self.bounds.drop;
        (p[(drop + 1) % 3], p[(drop + 2) % 3]) = (at.x, at.y);
        p[drop] = (offset_m - normal.dot(p)) / normal[drop];
        p
    }

    /// Whether a point of the plane lies on one of the triangles, or within `slack_m` (laid out) of one; edges belong to them.
    pub fn contains(&self, point: DVec3, slack_m: f64) -> bool {
        let PlanarBounds { drop, min, max } = self.bounds;
        let p = project(drop, point);
        if p.cmplt(min - slack_m).any() || p.cmpgt(max + slack_m).any() {
            return false;
        }
        match &self.grid {
            None => self.triangles.iter().any(|t| inside(t, p, slack_m)),
            Some(grid) => {
                let (x, y) = self.cell(grid.side, p);
                let cell = y * grid.side + x;
                let range = grid.starts[cell] as usize..grid.starts[cell + 1] as usize;
                grid.items[range].iter().any(|&t| inside(&self.triangles[t as usize], p, slack_m))
            }
        }
    }

    fn cell(&self, side: usize, p: DVec2) -> (usize, usize) {
        let PlanarBounds { min, max, .. } = self.bounds;
        let at = (p - min) / (max - min).max(DVec2::splat(f64::MIN_POSITIVE)) * side as f64;
        // `as` saturates: a point just outside falls into the border cell.
        ((at.x as usize).min(side - 1), (at.y as usize).min(side - 1))
    }

    fn build_grid(&self) -> Grid {
        let side = ((self.triangles.len() as f64).sqrt() as usize).clamp(2, 256);
        let mut cells: Vec<Vec<u32>> = vec![Vec::new(); side * side];
        for (i, t) in self.triangles.iter().enumerate() {
            let (x0, y0) = self.cell(side, t[0].min(t[1]).min(t[2]));
            let (x1, y1) = self.cell(side, t[0].max(t[1]).max(t[2]));
            for y in y0..=y1 {
                for x in x0..=x1 {
                    cells[y * side + x].push(i as u32);
                }
            }
        }
        let mut starts = vec![0u32];
        let mut items = Vec::new();
        for cell in cells {
            items.extend(cell);
            starts.push(items.len() as u32);
        }
        Grid { side, starts, items }
    }
}

fn project(drop: usize, p: DVec3) -> DVec2 {
    match drop {
        0 => DVec2::new(p.y, p.z),
        1 => DVec2::new(p.z, p.x),
        _ => DVec2::new(p.x, p.y),
    }
}

/// Closed point-in-triangle test of either orientation; without slack a shared edge's function is an exact negative in the neighbour.
fn inside(t: &[DVec2; 3], p: DVec2, slack_m: f64) -> bool {
    let [a, b, c] = t.map(|q| q - p);
    let (u, v, w) = (b.perp_dot(c), c.perp_dot(a), a.perp_dot(b));
    let area = (t[1] - t[0]).perp_dot(t[2] - t[0]);
    if area == 0.0 {
        return false;
    }
    if slack_m == 0.0 {
        return (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    }
    let heights = [(u, c - b), (v, a - c), (w, b - a)];
    heights.into_iter().all(|(doubled_area, edge)| doubled_area * area.signum() >= -slack_m * edge.length())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_grid_answers_as_the_list_does() {
        // A 20 × 20 floor of quads with every seventh one missing.
        let mut triangles = Vec::new();
        for i in 0..400usize {
            if i % 7 == 3 {
                continue;
            }
            let o = DVec3::new((i % 20) as f64 * 0.3, (i / 20) as f64 * 0.3, 1.0);
            let (x, y) = (DVec3::X * 0.3, DVec3::Y * 0.3);
            triangles.push([o, o + x, o + x + y]);
            triangles.push([o, o + x + y, o + y]);
        }
        let index = PlanarIndex::new(DVec3::Z, triangles.iter().copied());
        assert!(index.grid.is_some());
        let mut rng = corf_scene::Rng::keyed(1, 1, 1);
        for _ in 0..20_000 {
            let p = DVec3::new(rng.uniform_f64() * 6.4 - 0.2, rng.uniform_f64() * 6.4 - 0.2, 1.0);
            let expected = index.triangles.iter().any(|t| inside(t, project(index.bounds.drop, p), 0.0));
            assert_eq!(index.contains(p, 0.0), expected, "{p}");
        }
    }

    #[test]
    fn points_are_spread_evenly_and_a_frame_holds_no_middle() {
        // A square of side 3 with a hole of side 1.
        let mut triangles = Vec::new();
        for i in (0..9usize).filter(|i| *i != 4) {
            let o = DVec3::new((i % 3) as f64, (i / 3) as f64, 0.0);
            triangles.push([o, o + DVec3::X, o + DVec3::new(1.0, 1.0, 0.0)]);
            triangles.push([o, o + DVec3::new(1.0, 1.0, 0.0), o + DVec3::Y]);
        }
        let index = PlanarIndex::new(DVec3::Z, triangles.into_iter());
        for count in [16, 64, 512] {
            let points = index.spread(DVec3::Z, 0.0, count);
            assert!(points.iter().all(|&p| index.contains(p, 0.0)));
            let mean = points.iter().sum::<DVec3>() / count as f64;
            assert!(mean.distance(DVec3::new(1.5, 1.5, 0.0)) < 1.0 / (count as f64).sqrt(), "{count}: {mean}");
        }
        // So are points of even shares and places.
        let n = 20_000;
        let points = (0..n).map(|i| index.point(DVec3::Z, 0.0, (f64::from(i) + 0.5) / f64::from(n), (R2 * f64::from(i)).fract()));
        let points: Vec<DVec3> = points.collect();
        assert!(points.iter().all(|&p| index.contains(p, 0.0)));
        let mean = points.iter().sum::<DVec3>() / f64::from(n);
        assert!(mean.distance(DVec3::new(1.5, 1.5, 0.0)) < 2e-3, "{mean}");
        let quadrant = points.iter().filter(|p| p.x < 1.0 && p.y < 1.0).count() as f64 / f64::from(n);
        assert!((quadrant - 0.125).abs() < 2e-3, "{quadrant}");
        assert!(!index.contains(index.centroid(DVec3::Z, 0.0), 0.0));
    }
}
