//! Flat and box-like closed shapes. All are closed and wound outwards unless they are called a sheet.

use super::mesh_builder::Mesh;
use super::trig;
use glam::{DVec2, DVec3};

/// Shorthand for a point.
pub fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// The six faces of a cube: outward axis, then the axes of u and of "up" on that face (u × up = outward).
const FACES: [[DVec3; 3]; 6] = [
    [DVec3::X, DVec3::Y, DVec3::Z],
    [DVec3::NEG_X, DVec3::NEG_Y, DVec3::Z],
    [DVec3::Y, DVec3::NEG_X, DVec3::Z],
    [DVec3::NEG_Y, DVec3::X, DVec3::Z],
    [DVec3::Z, DVec3::X, DVec3::Y],
    [DVec3::NEG_Z, DVec3::X, DVec3::NEG_Y],
];

/// An axis-aligned closed box with sharp edges.
pub fn cuboid(min: DVec3, max: DVec3) -> Mesh {
    let (centre, half) = (0.5 * (min + max), 0.5 * (max - min));
    let mut mesh = Mesh::default();
    for [n, u, up] in FACES {
        let (along_u, along_v) = (u * 2.0 * half.dot(u.abs()), up * 2.0 * half.dot(up.abs()));
        let origin = centre + n * half.dot(n.abs()) - 0.5 * along_u - 0.5 * along_v;
        mesh.quad(origin, along_u, along_v, DVec2::new(origin.dot(u), -origin.dot(up)));
    }
    mesh
}

/// A closed box given by its centre in plan, the height of its bottom and its size.
pub fn block(x: f64, y: f64, z: f64, size: [f64; 3]) -> Mesh {
    let half = v(0.5 * size[0], 0.5 * size[1], 0.0);
    cuboid(v(x, y, z) - half, v(x, y, z) + half + v(0.0, 0.0, size[2]))
}

/// A closed box with edges rounded by `radius`, each quarter circle in `steps` steps, and `inner` subdivisions of the flat middle.
pub fn rounded_box(min: DVec3, max: DVec3, radius: f64, steps: usize, inner: usize) -> Mesh {
    let (centre, half) = (0.5 * (min + max), 0.5 * (max - min));
    let r = radius.min(half.min_element() * 0.999);
    let core = half - DVec3::splat(r);
    // Lines of the grid along one axis: dense in the rounded part, at equal angles seen from the edge's centre.
    let lines = |h: f64| -> Vec<f64> {
        let mut side: Vec<f64> = (0..=steps)
            .map(|i| {
                let (s, c) = trig::sin_cos(std::f64::consts::FRAC_PI_4 * i as f64 / steps as f64);
                h + r * s / c
            })
            .collect();
        // A thin side has no flat middle worth dividing.
        let inner = if h > 0.06 { inner } else { 1 };
        let middle = (1..inner).map(|i| h * (2.0 * i as f64 / inner as f64 - 1.0));
        let mut all: Vec<f64> = side.iter().rev().map(|x| -x).chain(middle).collect();
        all.append(&mut side);
        all
    };
    let mut mesh = Mesh::default();
    for [n, u, up] in FACES {
        let (us, vs) = (lines(core.dot(u.abs())), lines(core.dot(up.abs())));
        let base = mesh.positions.len() as u32;
        for &b in &vs {
            for &a in &us {
                let on_cube = n * half.dot(n.abs()) + u * a + up * b;
                let inside = on_cube.clamp(-core, core);
                let normal = (on_cube - inside).normalize();
                mesh.vertex(centre + inside + r * normal, normal, DVec2::new(centre.dot(u) + a, -centre.dot(up) - b));
            }
        }
        let w = us.len() as u32;
        for j in 0..vs.len() as u32 - 1 {
            for i in 0..w - 1 {
                let p = base + j * w + i;
                mesh.triangle(p, p + 1, p + w + 1);
                mesh.triangle(p, p + w + 1, p + w);
            }
        }
    }
    mesh
}

/// A stuffed cushion: a rounded box whose large faces swell by `swell` metres along z (thin axis up).
pub fn cushion(min: DVec3, max: DVec3, radius: f64, swell: f64) -> Mesh {
    let (centre, half) = (0.5 * (min + max), 0.5 * (max - min));
    rounded_box(min, max, radius, 1, 4).deformed(|p| {
        let q = (p - centre) / half;
        let bulge = (1.0 - q.x * q.x) * (1.0 - q.y * q.y);
        p + v(0.0, 0.0, swell * bulge * q.z)
    })
}

/// A flat sheet `origin + s·along_u + t·along_v`, facing `along_u × along_v`, texture coordinates from its own corner.
pub fn sheet(origin: DVec3, along_u: DVec3, along_v: DVec3) -> Mesh {
    let mut mesh = Mesh::default();
    mesh.quad(origin, along_u, along_v, DVec2::new(0.0, along_v.length()));
    mesh
}

/// A sheet whose texture fills it exactly once (for materials of texture size 1 × 1).
pub fn picture(origin: DVec3, along_u: DVec3, along_v: DVec3) -> Mesh {
    let mut mesh = sheet(origin, along_u, along_v);
    let size = DVec2::new(along_u.length(), along_v.length());
    mesh.uvs_m.iter_mut().for_each(|uv| *uv /= size);
    mesh
}

/// A closed box whose front (+z) carries the texture exactly once (for materials of texture size 1 × 1): prints, screens, rugs.
pub fn printed_box(min: DVec3, max: DVec3) -> Mesh {
    let mut mesh = cuboid(min, max);
    for (corner, uv) in [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]].into_iter().enumerate() {
        // FACES[4] is +z; four vertices a face.
        mesh.uvs_m[16 + corner] = DVec2::from(uv);
    }
    mesh
}

/// A frame of four closed bars around an opening of `width` × `height` in the x–y plane, lower left corner at the origin; the bars are
/// `bar` wide, outside the opening, and reach from `z0` to `z1`.
pub fn frame_bars(width: f64, height: f64, bar: f64, z0: f64, z1: f64) -> Mesh {
    let mut mesh = cuboid(v(-bar, -bar, z0), v(0.0, height + bar, z1));
    mesh.append(&cuboid(v(width, -bar, z0), v(width + bar, height + bar, z1)));
    mesh.append(&cuboid(v(0.0, -bar, z0), v(width, 0.0, z1)));
    mesh.append(&cuboid(v(0.0, height, z0), v(width, height + bar, z1)));
    mesh
}

/// A sheet of `width` × `height` in the x–y plane facing +z with rectangular holes `[x0, y0, x1, y1]`, cut along the holes' edges.
pub fn sheet_with_holes(width: f64, height: f64, holes: &[[f64; 4]]) -> Mesh {
    let lines = |size: f64, a: usize, b: usize| -> Vec<f64> {
        let mut all: Vec<f64> = [0.0, size].into_iter().chain(holes.iter().flat_map(|h| [h[a], h[b]])).collect();
        all.sort_by(f64::total_cmp);
        all.dedup_by(|x, y| (*x - *y).abs() < 1e-9);
        all
    };
    let (xs, ys) = (lines(width, 0, 2), lines(height, 1, 3));
    let mut mesh = Mesh::default();
    for x in xs.windows(2) {
        for y in ys.windows(2) {
            let (cx, cy) = (0.5 * (x[0] + x[1]), 0.5 * (y[0] + y[1]));
            if !holes.iter().any(|h| h[0] < cx && cx < h[2] && h[1] < cy && cy < h[3]) {
                mesh.quad(v(x[0], y[0], 0.0), v(x[1] - x[0], 0.0, 0.0), v(0.0, y[1] - y[0], 0.0), DVec2::new(x[0], -y[0]));
            }
        }
    }
    mesh
}
