//! Why a chain of points is no path, as far as the scene says.

use corf_scene::Scene;
use glam::DVec3;

/// Points this close to a triangle are on it, metres.
const ON_SURFACE_M: f64 = 1e-3;
/// A mirror sends on within this, degrees.
const MIRROR_DEG: f64 = 0.5;
/// Crossings nearer than this to the ends of a leg are the surfaces that it leaves and meets, metres.
const CLEAR_M: f64 = 2e-5;

/// Finds reasons in a scene.
pub struct Reasons<'s> {
    /// The scene.
    pub scene: &'s Scene,
    /// Interactions that are traced at most.
    pub max_interactions: usize,
    /// Whether slabs are passed.
    pub transmission: bool,
}

impl Reasons<'_> {
    /// The first thing that speaks against a chain.
    pub fn of(&self, [from, to]: [DVec3; 2], turns: &[DVec3]) -> String {
        if turns.len() > self.max_interactions {
            return format!(
                "it turns {} times, and {} interactions are traced (--max-interactions)",
                turns.len(),
                self.max_interactions
            );
        }
        let points: Vec<DVec3> = [from].into_iter().chain(turns.iter().copied()).chain([to]).collect();
        for (k, three) in points.windows(3).enumerate() {
            let normals = self.surfaces_at(three[1]);
            if normals.is_empty() {
                return format!("point {} is on no surface", k + 1);
            }
            let (arrives, leaves) = ((three[1] - three[0]).normalize_or_zero(), (three[2] - three[1]).normalize_or_zero());
            let off_deg = |n: &DVec3| (arrives - *n * (2.0 * arrives.dot(*n))).angle_between(leaves).to_degrees();
            let best = normals.iter().map(off_deg).fold(f64::INFINITY, f64::min);
            if best > MIRROR_DEG {
                return format!("at point {} a mirror sends on {best:.1} degrees off it", k + 1);
            }
        }
        let crossed: Vec<(usize, u32)> = points
            .windows(2)
            .enumerate()
            .flat_map(|(k, leg)| self.crossed(leg[0], leg[1]).into_iter().map(move |object| (k, object)))
            .collect();
        let name = |object: u32| self.scene.objects.get(object as usize).map_or("", |o| o.name.as_str());
        match crossed.first() {
            Some((k, object)) if !self.transmission => format!("leg {} is blocked by \"{}\"", k + 1, name(*object)),
            Some((k, object)) if turns.len() + crossed.len() > self.max_interactions => format!(
                "it turns {} times and passes {} slabs, the first of \"{}\" on leg {}, and {} interactions are traced (--max-interactions)",
                turns.len(),
                crossed.len(),
                name(*object),
                k + 1,
                self.max_interactions
            ),
            Some((k, object)) => format!("leg {} passes \"{}\", which may let too little through", k + 1, name(*object)),
            None => "nothing in the scene speaks against it".to_owned(),
        }
    }

    /// Unit normals of the triangles that a point is on.
    fn surfaces_at(&self, point: DVec3) -> Vec<DVec3> {
        let all = (0..self.scene.triangles.len()).filter_map(|i| {
            let [a, b, c] = self.scene.corners_f64(i);
            let (min, max) = (a.min(b).min(c) - ON_SURFACE_M, a.max(b).max(c) + ON_SURFACE_M);
            if point.cmplt(min).any() || point.cmpgt(max).any() {
                return None;
            }
            let n = (b - a).cross(c - a).normalize_or_zero();
            let inside = [(a, b), (b, c), (c, a)]
                .iter()
                .all(|(p, q)| n.cross((*q - *p).normalize_or_zero()).dot(point - *p) >= -ON_SURFACE_M);
            (inside && (point - a).dot(n).abs() <= ON_SURFACE_M).then_some(n)
        });
        all.collect()
    }

    /// Objects whose surfaces a leg crosses, once for each place, in the order of the way.
    fn crossed(&self, from: DVec3, to: DVec3) -> Vec<u32> {
        let way = to - from;
        let length = way.length();
        let mut hits: Vec<(f64, u32)> = (0..self.scene.triangles.len())
            .filter_map(|i| {
                let [a, b, c] = self.scene.corners_f64(i);
                // Möller and Trumbore (1997).
                let (e1, e2) = (b - a, c - a);
                let p = way.cross(e2);
                let det = e1.dot(p);
                if det == 0.0 {
                    return None;
                }
                let s = from - a;
                let (u, q) = (s.dot(p) / det, s.cross(e1));
                let (v, t) = (way.dot(q) / det, e2.dot(q) / det);
                let within = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t * length > CLEAR_M && (1.0 - t) * length > CLEAR_M;
                within.then(|| (t * length, self.scene.triangles[i].object))
            })
            .collect();
        hits.sort_by(|a, b| a.0.total_cmp(&b.0));
        // The diagonal of two triangles is one place.
        hits.dedup_by(|a, b| (a.0 - b.0).abs() <= CLEAR_M);
        hits.into_iter().map(|(_, object)| object).collect()
    }
}
