//! Image receivers: surfaces that a receiver sees in mirrors, where the transmitter's own rays help as well.
//!
//! Two metal faces at a right angle, a door in its jamb, show a strip of a lit wall edge-on and some 0.1 mrad wide: a direction meets it
//! once in a hundred samplings, and then it is most of a dark view. The transmitter's rays fall on that strip as on any other surface. A
//! point where one fell is sent to the receiver by way of each mirror, or pair of mirrors, in sight, and shared with the directions as in
//! [`super::light_hits`]: mirrors keep densities per solid angle, so that all is as if the receiver stood at its own image. What it sees by way
//! of none, through slabs or not, is shared in the same way.
//!
//! The mirrors in sight have to be found without the directions themselves: a way that is known only where they happened to find it would
//! be counted too seldom. A coarser lattice of its own finds them, the same in every sampling.

use super::mis;
use super::sampling::{DirectionSampling, REFINED};
use crate::radio::diffuse::in_tasks;
use crate::radio::diffuse::light::illumination::{CLEARANCE_M, Illumination};
use crate::radio::field;
use crate::radio::geometry::Geometry;
use crate::radio::lattice::Directions;
use glam::{DMat3, DVec3, Vec3};
use std::collections::BTreeMap;

/// Directions of the receiver to one that looks for mirrors.
const SPARSER: usize = 2;
/// Power that a way keeps, at least, where it is found.
const KEPT: f64 = 0.5;
/// Share of the directions into a view that is relied on to be cut where it matters: one that looks into a mirror as small as it is
/// itself has no neighbours there to differ from.
const TRUST: f64 = 0.125;
/// No view.
const NONE: u32 = u32::MAX;

/// Faces that mirror well whatever the angle, and a point of each.
pub struct StrongMirrors(Vec<(u32, DVec3)>);

/// The mirrors of one receiver.
#[derive(Debug)]
pub struct ImageReceivers {
    views: Vec<ImageReceiver>,
    /// The view by way of a face alone, or [`NONE`], by face.
    by_one: Vec<u32>,
    by_more: BTreeMap<MirrorSequence, u32>,
}

/// The mirrors between the receiver and what it sees, slabs left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct MirrorSequence {
    /// The first of them, in the order in which a ray from the receiver meets them.
    mirrors: [u32; Self::MOST],
    count: usize,
}

impl MirrorSequence {
    /// Mirrors that are told apart.
    pub const MOST: usize = 2;
    /// The empty sequence: no mirror.
    pub const STRAIGHT: Self = Self { mirrors: [0; Self::MOST], count: 0 };

    /// The sequence with one more mirror.
    pub fn by(mut self, face: u32) -> Self {
        if let Some(mirror) = self.mirrors.get_mut(self.count) {
            *mirror = face;
        }
        self.count += 1;
        self
    }

    /// Number of mirrors, those beyond [`Self::MOST`] included.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The mirrors; of more than [`Self::MOST`] the first.
    pub fn mirrors(&self) -> &[u32] {
        &self.mirrors[..self.count.min(Self::MOST)]
    }
}

/// A view of the receiver: straight, or by way of one or two mirrors.
#[derive(Clone, Debug)]
pub struct ImageReceiver {
    /// Mirrors in the order in which a ray from the receiver meets them.
    pub way: MirrorSequence,
    /// Viewpoint: the receiver or its image.
    pub vantage: VirtualReceiver,
    /// Inward normals of the planes through the image and the mirrors' outlines, those of the first mirror as the others show it.
    walls: FrustumPlanes,
    /// The last mirror's unit normal, away from the image, and how far from it the mirror's plane is, metres: what it shows is before it.
    front: (Vec3, f32),
}

/// Viewpoint of a receiver: its own position, or its image in mirrors.
#[derive(Clone, Copy, Debug)]
pub struct VirtualReceiver {
    /// The receiver, or its image.
    pub image: DVec3,
    /// Directions of the receiver that look this way, about.
    pub directions: f64,
}

impl VirtualReceiver {
    /// Ratio of the densities p_t/p_r of [`super::light_hits`] at a point of a face: of the transmitter's rays over the receiver's
    /// directions, as many over the sphere, from the [`super::mis::density`] of both there. Zero where they look at different sides of the
    /// face.
    pub fn density_ratio(&self, sampling: DirectionSampling, area_m2: f64, own_per_m2: f64, transmitters_per_m2: f64) -> f64 {
        // Refinement finds no face that the sampling's own directions miss: how many meet one that is seen as it is here?
        let met = (sampling.per_sr() * own_per_m2.abs() * area_m2).min(self.directions);
        let directions = if sampling.refined { met.clamp(1.0, REFINED) } else { 1.0 };
        (transmitters_per_m2 / (directions * own_per_m2)).max(0.0)
    }
}

/// The directions that look for mirrors on behalf of `count`.
pub fn pilots(count: usize) -> Directions {
    Directions::new(count.div_ceil(SPARSER), DMat3::IDENTITY)
}

impl StrongMirrors {
    /// The strong mirrors of a scene.
    pub fn new(geometry: &Geometry<'_>, illumination: &Illumination<'_, '_>) -> Self {
        let strong = |face: &u32| {
            let response = illumination.table(*face).response(1.0);
            let amplitude = geometry.slab(*face).specular_amplitude();
            0.5 * (response.r_te.norm_squared() + response.r_tm.norm_squared()) * amplitude * amplitude >= KEPT
        };
        let point = |face: u32| geometry.faces[face as usize].spread(1).first().map(|point| (face, *point));
        Self((0..geometry.faces.len() as u32).filter(strong).filter_map(point).collect())
    }
}

impl ImageReceivers {
    /// Straight, by way of every strong mirror whose middle is in sight, and of whatever `pilots` find, in `wanted` directions; the receiver's own
    /// directions are sampled as `sampling` says. `mirrors_along` reports the mirrors that a direction meets while it keeps a
    /// share of its power.
    pub fn new(
        geometry: &Geometry<'_>,
        rx: DVec3,
        strong: &StrongMirrors,
        pilots: &Directions,
        sampling: DirectionSampling,
        wanted: impl Fn(DVec3) -> bool + Sync,
        mirrors_along: impl Fn(DVec3, f64, &mut dyn FnMut(MirrorSequence)) + Sync,
    ) -> Self {
        let mut this = Self { views: Vec::new(), by_one: vec![NONE; geometry.faces.len()], by_more: BTreeMap::new() };
        this.add(ImageReceiver::new(geometry, rx, MirrorSequence::STRAIGHT, f64::INFINITY));
        for &(number, middle) in &strong.0 {
            if !wanted((middle - rx).normalize_or_zero()) || geometry.occluded(middle, rx, CLEARANCE_M, |face| face != number) {
                continue;
            }
            let face = &geometry.faces[number as usize];
            let size_sr = face.area_m2 * mis::density(face, rx, middle).abs();
            this.add(ImageReceiver::new(geometry, rx, MirrorSequence::STRAIGHT.by(number), size_sr * sampling.per_sr()));
        }
        let ways = in_tasks(pilots.along(), |numbers| {
            let mut ways = Vec::new();
            let directions = numbers.iter().map(|&number| pilots.of(number as usize)).filter(|direction| wanted(*direction));
            directions.for_each(|direction| mirrors_along(direction, KEPT, &mut |way| ways.push(way)));
            ways
        });
        let mut found: BTreeMap<MirrorSequence, usize> = BTreeMap::new();
        ways.into_iter().for_each(|way| *found.entry(way).or_default() += 1);
        let scale = sampling.count as f64 / pilots.count() as f64;
        for (way, times) in found {
            if this.by(&way).is_none() {
                this.add(ImageReceiver::new(geometry, rx, way, times as f64 * scale));
            }
        }
        this
    }

    fn add(&mut self, view: ImageReceiver) {
        let number = self.views.len() as u32;
        match view.way.mirrors() {
            [mirror] => self.by_one[*mirror as usize] = number,
            _ => drop(self.by_more.insert(view.way, number)),
        }
        self.views.push(view);
    }

    /// All views of the receiver.
    pub fn all(&self) -> &[ImageReceiver] {
        &self.views
    }

    /// The one by way of these mirrors.
    pub fn by(&self, way: &MirrorSequence) -> Option<&ImageReceiver> {
        let number = match way.mirrors() {
            [mirror] => self.by_one[*mirror as usize],
            _ => *self.by_more.get(way)?,
        };
        self.views.get(number as usize)
    }
}

impl ImageReceiver {
    fn new(geometry: &Geometry<'_>, rx: DVec3, way: MirrorSequence, directions: f64) -> Self {
        let face = |number: &u32| &geometry.faces[*number as usize];
        let image = way.mirrors().iter().fold(rx, |image, mirror| face(mirror).mirror(image));
        let mut walls = FrustumPlanes::default();
        for (i, mirror) in way.mirrors().iter().enumerate() {
            // Unfolded: every mirror where those behind it show it.
            let shown = |corner: DVec3| way.mirrors()[i + 1..].iter().fold(corner, |corner, behind| face(behind).mirror(corner));
            let through = walls_through(image, &face(mirror).hull().map(shown));
            through.into_iter().enumerate().for_each(|(k, wall)| walls.set(4 * i + k, wall));
        }
        let front = way.mirrors().last().map_or((Vec3::ZERO, 0.0), |mirror| {
            let height_m = face(mirror).distance(image);
            ((-height_m.signum() * face(mirror).normal).as_vec3(), height_m.abs() as f32)
        });
        Self { way, vantage: VirtualReceiver { image, directions: TRUST * directions }, walls, front }
    }

    /// The least distance of a point from the walls and from the last mirror, metres: negative where the mirrors do not show it.
    pub fn within(&self, point: Vec3) -> f32 {
        let to = point - self.vantage.image.as_vec3();
        let (front, mirror_m) = self.front;
        self.walls.least(to).min(to.dot(front) - mirror_m)
    }

    /// The unit direction in which the receiver would see a point by this way, were the mirrors' faces large enough.
    pub fn towards(&self, geometry: &Geometry<'_>, point: DVec3) -> DVec3 {
        let seen_from_image = (point - self.vantage.image).normalize_or_zero();
        let mirrors = self.way.mirrors().iter().rev();
        mirrors.fold(seen_from_image, |direction, &mirror| field::mirrored(direction, geometry.faces[mirror as usize].normal))
    }

    /// The unit direction in which the receiver sees a point by this way, if the mirrors' faces reach there.
    pub fn direction(&self, geometry: &Geometry<'_>, rx: DVec3, point: DVec3) -> Option<DVec3> {
        let mut images = [rx; MirrorSequence::MOST + 1];
        for (i, &mirror) in self.way.mirrors().iter().enumerate() {
            images[i + 1] = geometry.faces[mirror as usize].mirror(images[i]);
        }
        let mut target = point;
        for (i, &mirror) in self.way.mirrors().iter().enumerate().rev() {
            let plane = &geometry.faces[mirror as usize];
            let (from, to) = (plane.distance(images[i + 1]), plane.distance(target));
            // The image stands behind the mirror, what is seen before it.
            if from * to >= 0.0 {
                return None;
            }
            let at = images[i + 1] + (target - images[i + 1]) * (from / (from - to));
            if !plane.contains(at) {
                return None;
            }
            target = at;
        }
        (target - rx).try_normalize()
    }
}

/// Normals, axis by axis; those not set are 0 and everything is inside.
#[derive(Clone, Debug, Default)]
struct FrustumPlanes([[f32; 4 * MirrorSequence::MOST]; 3]);

impl FrustumPlanes {
    fn set(&mut self, number: usize, normal: Vec3) {
        for axis in 0..3 {
            self.0[axis][number] = normal[axis];
        }
    }

    /// The least height above them of a point, as seen from where they all meet.
    fn least(&self, to: Vec3) -> f32 {
        let [x, y, z] = &self.0;
        let heights: [f32; 4 * MirrorSequence::MOST] = std::array::from_fn(|i| x[i] * to.x + y[i] * to.y + z[i] * to.z);
        let halves: [f32; 4] = std::array::from_fn(|i| if heights[i] < heights[i + 4] { heights[i] } else { heights[i + 4] });
        halves.into_iter().fold(f32::INFINITY, f32::min)
    }
}

/// Unit normals of the planes through a point and the sides of a parallelogram, pointing inwards; none (0) where they do not span one.
fn walls_through(from: DVec3, hull: &[DVec3; 4]) -> [Vec3; 4] {
    let middle = 0.25 * hull.iter().sum::<DVec3>() - from;
    [0, 1, 2, 3].map(|i| {
        let normal = (hull[i] - from).cross(hull[(i + 1) % 4] - from).normalize_or_zero();
        (normal * normal.dot(middle).signum()).as_vec3()
    })
}
