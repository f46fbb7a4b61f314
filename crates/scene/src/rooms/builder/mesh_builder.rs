//! Triangles with normals and metric texture coordinates, rigid placements, and named objects made of them.

use super::materials::Mat;
use super::trig;
use glam::{DMat3, DVec2, DVec3};
use std::collections::BTreeMap;

/// A triangle mesh in metres. Texture coordinates are metric too (u right, v down): a material's own scale turns them into glTF's.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Vertex positions.
    pub positions: Vec<DVec3>,
    /// Unit vertex normals.
    pub normals: Vec<DVec3>,
    /// Metric texture coordinates.
    pub uvs_m: Vec<DVec2>,
    /// Counter-clockwise seen from the outside.
    pub triangles: Vec<[u32; 3]>,
}

/// Two corners nearer than this are one when normals are smoothed, metres.
const WELD_M: f64 = 1e-6;
/// A triangle with less area is dropped (a cone's tip, a sphere's pole), m².
const SMALLEST_AREA_M2: f64 = 1e-10;

impl Mesh {
    /// Adds a vertex.
    pub fn vertex(&mut self, position: DVec3, normal: DVec3, uv_m: DVec2) -> u32 {
        self.positions.push(position);
        self.normals.push(normal);
        self.uvs_m.push(uv_m);
        (self.positions.len() - 1) as u32
    }

    /// Adds a triangle unless it has no area.
    pub fn triangle(&mut self, a: u32, b: u32, c: u32) {
        let [p, q, r] = [a, b, c].map(|i| self.positions[i as usize]);
        if (q - p).cross(r - p).length() > 2.0 * SMALLEST_AREA_M2 {
            self.triangles.push([a, b, c]);
        }
    }

    /// A flat parallelogram `origin + s·along_u + t·along_v`, facing `along_u × along_v`; u runs along `along_u`, v against `along_v`.
    pub fn quad(&mut self, origin: DVec3, along_u: DVec3, along_v: DVec3, uv_origin: DVec2) {
        let n = along_u.cross(along_v).normalize();
        let (lu, lv) = (along_u.length(), along_v.length());
        let a = self.vertex(origin, n, uv_origin);
        let b = self.vertex(origin + along_u, n, uv_origin + DVec2::new(lu, 0.0));
        let c = self.vertex(origin + along_u + along_v, n, uv_origin + DVec2::new(lu, -lv));
        let d = self.vertex(origin + along_v, n, uv_origin + DVec2::new(0.0, -lv));
        self.triangle(a, b, c);
        self.triangle(a, c, d);
    }

    /// Appends another mesh.
    pub fn append(&mut self, other: &Mesh) {
        let base = self.positions.len() as u32;
        self.positions.extend_from_slice(&other.positions);
        self.normals.extend_from_slice(&other.normals);
        self.uvs_m.extend_from_slice(&other.uvs_m);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + base)));
    }

    /// The mesh moved by a rigid transform.
    pub fn placed(mut self, frame: &LocalFrame) -> Self {
        self.positions.iter_mut().for_each(|p| *p = frame.point(*p));
        self.normals.iter_mut().for_each(|n| *n = frame.rotation * *n);
        self
    }

    /// The mesh shifted.
    pub fn shifted(self, x: f64, y: f64, z: f64) -> Self {
        self.placed(&LocalFrame::at(x, y, z))
    }

    /// The mesh turned about z by `degrees`, then shifted.
    pub fn turned(self, degrees: f64, x: f64, y: f64, z: f64) -> Self {
        self.placed(&LocalFrame::yaw(degrees, x, y, z))
    }

    /// Texture coordinates turned by a quarter: grain that ran along u runs along v.
    pub fn grain_turned(mut self) -> Self {
        self.uvs_m.iter_mut().for_each(|uv| *uv = DVec2::new(-uv.y, uv.x));
        self
    }

    /// Texture coordinates shifted, so that neighbouring pieces do not repeat each other.
    pub fn grain_shifted(mut self, u: f64, v: f64) -> Self {
        self.uvs_m.iter_mut().for_each(|uv| *uv += DVec2::new(u, v));
        self
    }

    /// Moves every vertex through `f`, then smooths the normals.
    pub fn deformed(mut self, f: impl Fn(DVec3) -> DVec3) -> Self {
        self.positions.iter_mut().for_each(|p| *p = f(*p));
        self.smooth_normals();
        self
    }

    /// Vertex normals from the area-weighted faces that meet in a point, whatever vertices they use.
    pub fn smooth_normals(&mut self) {
        let key = |p: DVec3| [p.x, p.y, p.z].map(|v| (v / WELD_M).round() as i64);
        let mut sums: BTreeMap<[i64; 3], DVec3> = BTreeMap::new();
        for t in &self.triangles {
            let [a, b, c] = t.map(|i| self.positions[i as usize]);
            let n = (b - a).cross(c - a);
            for p in [a, b, c] {
                *sums.entry(key(p)).or_default() += n;
            }
        }
        for (p, n) in self.positions.iter().zip(&mut self.normals) {
            if let Some(sum) = sums.get(&key(*p)) {
                *n = sum.normalize_or(*n);
            }
        }
    }
}

/// A rotation and a shift: `world = rotation · local + translation`.
#[derive(Clone, Copy, Debug)]
pub struct LocalFrame {
    /// Orthonormal, determinant +1.
    pub rotation: DMat3,
    /// Metres.
    pub translation: DVec3,
}

impl LocalFrame {
    /// A shift.
    pub fn at(x: f64, y: f64, z: f64) -> Self {
        Self { rotation: DMat3::IDENTITY, translation: DVec3::new(x, y, z) }
    }

    /// A turn about z by `degrees` (counter-clockwise seen from above), then a shift.
    pub fn yaw(degrees: f64, x: f64, y: f64, z: f64) -> Self {
        let (s, c) = trig::sin_cos(degrees.to_radians());
        Self {
            rotation: DMat3::from_cols(DVec3::new(c, s, 0.0), DVec3::new(-s, c, 0.0), DVec3::Z),
            translation: DVec3::new(x, y, z),
        }
    }

    /// A turn about z that takes x to the direction `d`, then a shift in plan.
    pub fn along(d: DVec2, origin: DVec2) -> Self {
        let d = d.normalize();
        let rotation = DMat3::from_cols(d.extend(0.0), d.perp().extend(0.0), DVec3::Z);
        Self { rotation, translation: origin.extend(0.0) }
    }

    /// A turn about x by `degrees`, about the origin.
    pub fn tilt(degrees: f64) -> Self {
        let (s, c) = trig::sin_cos(degrees.to_radians());
        Self { rotation: DMat3::from_cols(DVec3::X, DVec3::new(0.0, c, s), DVec3::new(0.0, -s, c)), translation: DVec3::ZERO }
    }

    /// A turn about y by `degrees` (x towards −z), then a shift: a door leaf in wall coordinates on its hinge.
    pub fn swing(degrees: f64, x: f64, z: f64) -> Self {
        let (s, c) = trig::sin_cos(degrees.to_radians());
        Self {
            rotation: DMat3::from_cols(DVec3::new(c, 0.0, -s), DVec3::Y, DVec3::new(s, 0.0, c)),
            translation: DVec3::new(x, 0.0, z),
        }
    }

    /// This frame's local axes at the given wall: local x to the right seen from the room, local y up the wall, local z into the room.
    pub fn on_wall(inward: DVec3, origin: DVec3) -> Self {
        Self { rotation: DMat3::from_cols(DVec3::Z.cross(inward), DVec3::Z, inward), translation: origin }
    }

    /// Maps a point.
    pub fn point(&self, p: DVec3) -> DVec3 {
        self.rotation * p + self.translation
    }
}

/// A named thing: meshes grouped by material, in its own frame until it is placed.
#[derive(Clone, Debug)]
pub struct BuiltObject {
    /// Node name in the file.
    pub name: String,
    /// One mesh a material, in order of first use.
    pub parts: Vec<(Mat, Mesh)>,
}

impl BuiltObject {
    /// Nothing yet.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), parts: Vec::new() }
    }

    /// Adds a piece.
    pub fn add(&mut self, material: Mat, mesh: Mesh) -> &mut Self {
        match self.parts.iter_mut().find(|(m, _)| *m == material) {
            Some((_, whole)) => whole.append(&mesh),
            None => self.parts.push((material, mesh)),
        }
        self
    }

    /// Adds a piece and hands the object on.
    pub fn with(mut self, material: Mat, mesh: Mesh) -> Self {
        self.add(material, mesh);
        self
    }

    /// The object moved as a whole.
    pub fn placed(mut self, frame: &LocalFrame) -> Self {
        self.parts = self.parts.into_iter().map(|(m, mesh)| (m, mesh.placed(frame))).collect();
        self
    }

    /// The object under another name, turned about z and shifted.
    pub fn copy(&self, name: impl Into<String>, degrees: f64, x: f64, y: f64, z: f64) -> Self {
        Self { name: name.into(), parts: self.parts.clone() }.placed(&LocalFrame::yaw(degrees, x, y, z))
    }
}
