//! Shapes of revolution, swept tubes and leaves.

use super::mesh_builder::Mesh;
use super::shapes::v;
use super::trig;
use glam::{DVec2, DVec3};

/// Two profile segments that meet at less than about 40° share a smooth normal.
const CREASE_COSINE: f64 = 0.77;

/// A surface of revolution about z from a profile `(radius, z)` that runs from the bottom up along the outside; closed where the profile
/// starts and ends on the axis. Each ring has `segments` vertices plus one for the texture's seam.
pub fn lathe(profile: &[[f64; 2]], segments: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let legs: Vec<DVec2> = profile.windows(2).map(|w| DVec2::from(w[1]) - DVec2::from(w[0])).collect();
    // The outward normal of a leg that runs up along the outside: (dz, −dr).
    let normals: Vec<DVec2> = legs.iter().map(|d| DVec2::new(d.y, -d.x).normalize()).collect();
    let widest = profile.iter().fold(0.0_f64, |m, p| m.max(p[0]));
    let circumference = std::f64::consts::TAU * widest;
    let smooth = |i: usize, j: Option<usize>| -> DVec2 {
        match j.and_then(|j| normals.get(j)) {
            Some(other) if normals[i].dot(*other) > CREASE_COSINE => (normals[i] + *other).normalize(),
            _ => normals[i],
        }
    };
    let mut run = 0.0;
    for leg in 0..legs.len() {
        let ends = [
            (profile[leg], smooth(leg, leg.checked_sub(1)), run),
            (profile[leg + 1], smooth(leg, Some(leg + 1)), run + legs[leg].length()),
        ];
        run += legs[leg].length();
        let base = mesh.positions.len() as u32;
        for i in 0..=segments {
            let turn = i as f64 / segments as f64;
            // The seam's two copies must coincide to the bit.
            let (c, s) = trig::on_circle(if i == segments { 0.0 } else { turn });
            for ([r, z], n, along) in ends {
                let flat = legs[leg].y.abs() < 1e-9;
                let uv = if flat { DVec2::new(r * c, -r * s) } else { DVec2::new(turn * circumference, -along) };
                mesh.vertex(v(r * c, r * s, z), v(n.x * c, n.x * s, n.y), uv);
            }
        }
        for i in 0..segments as u32 {
            let (a, b) = (base + 2 * i, base + 2 * i + 2);
            mesh.triangle(a, b, b + 1);
            mesh.triangle(a, b + 1, a + 1);
        }
    }
    mesh
}

/// A closed upright cylinder.
pub fn cylinder(radius: f64, z0: f64, z1: f64, segments: usize) -> Mesh {
    lathe(&[[0.0, z0], [radius, z0], [radius, z1], [0.0, z1]], segments)
}

/// A closed disc with a rounded rim: table tops, seats, bases.
pub fn disc(radius: f64, z0: f64, z1: f64, segments: usize) -> Mesh {
    let b = (0.35 * (z1 - z0)).min(0.5 * radius);
    let c = 0.3 * b;
    lathe(
        &[
            [0.0, z0],
            [radius - b, z0],
            [radius - c, z0 + c],
            [radius, z0 + b],
            [radius, z1 - b],
            [radius - c, z1 - c],
            [radius - b, z1],
            [0.0, z1],
        ],
        segments,
    )
}

/// A ball.
pub fn sphere(centre: DVec3, radius: f64, segments: usize) -> Mesh {
    let rows = (segments / 2).max(4);
    let profile: Vec<[f64; 2]> = (0..=rows)
        .map(|i| {
            let (s, c) = trig::sin_cos(std::f64::consts::PI * i as f64 / rows as f64);
            [if i == 0 || i == rows { 0.0 } else { radius * s }, -radius * c]
        })
        .collect();
    lathe(&profile, segments).shifted(centre.x, centre.y, centre.z)
}

/// A closed round tube along a polyline, with flat caps.
pub fn tube(path: &[DVec3], radius: f64, segments: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let last = path.len() - 1;
    let leg = |i: usize| (path[i + 1] - path[i]).normalize();
    // At a bend the ring lies in the mitre plane between the two legs.
    let heading = |i: usize| match i {
        0 => leg(0),
        i if i == last => leg(last - 1),
        i => (leg(i - 1) + leg(i)).normalize(),
    };
    let mut side = heading(0).any_orthonormal_vector();
    let mut run = 0.0;
    let ring = segments as u32 + 1;
    for i in 0..=last {
        let d = heading(i);
        side = (side - d * side.dot(d)).normalize();
        let other = d.cross(side);
        if i > 0 {
            run += (path[i] - path[i - 1]).length();
        }
        for k in 0..=segments {
            let (c, s) = trig::on_circle(if k == segments { 0.0 } else { k as f64 / segments as f64 });
            let n = side * c + other * s;
            // The mitre's ring is an ellipse, longer across the bend by 1 / cos(half the turn).
            let turn = if i == 0 || i == last { DVec3::ZERO } else { (leg(i) - leg(i - 1)).normalize_or_zero() };
            let stretch = 1.0 / d.dot(leg(i.min(last - 1))) - 1.0;
            mesh.vertex(
                path[i] + radius * (n + turn * (n.dot(turn) * stretch)),
                n,
                DVec2::new(k as f64 / segments as f64 * std::f64::consts::TAU * radius, -run),
            );
        }
        if i > 0 {
            for k in 0..segments as u32 {
                let a = (i as u32 - 1) * ring + k;
                mesh.triangle(a, a + 1, a + 1 + ring);
                mesh.triangle(a, a + 1 + ring, a + ring);
            }
        }
    }
    for (start, n) in [(0, -heading(0)), (last as u32 * ring, heading(last))] {
        let centre = mesh.vertex(path[if start == 0 { 0 } else { last }], n, DVec2::ZERO);
        let rim: Vec<u32> = (0..segments as u32)
            .map(|k| mesh.vertex(mesh.positions[(start + k) as usize], n, mesh.uvs_m[(start + k) as usize]))
            .collect();
        for k in 0..segments {
            let (a, b) = (rim[k], rim[(k + 1) % segments]);
            if start == 0 { mesh.triangle(centre, b, a) } else { mesh.triangle(centre, a, b) }
        }
    }
    mesh
}

/// A straight closed rod.
pub fn rod(from: DVec3, to: DVec3, radius: f64, segments: usize) -> Mesh {
    tube(&[from, to], radius, segments)
}

/// A leaf: an open sheet that leaves `root` along `direction`, droops, and is `length` × `width`; two quads wide, folded along its rib.
pub fn leaf(root: DVec3, direction: DVec3, length: f64, width: f64, droop: f64, steps: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let flat = direction.with_z(0.0).normalize_or(DVec3::X);
    let across = DVec3::Z.cross(flat).normalize();
    let d = direction.normalize();
    for i in 0..=steps {
        let t = i as f64 / steps as f64;
        // Widest at a third of the length, pointed at the tip, narrow at the stalk.
        let w = width * (0.06 + 0.94 * trig::sin(std::f64::consts::PI * (t * (1.6 - 0.6 * t)).min(1.0))) * 0.5;
        let rib = root + d * (length * t) - DVec3::Z * (droop * length * t * t);
        let fold = DVec3::Z * (0.25 * w);
        for (side, u) in [(1.0, 0.0), (0.0, 0.5), (-1.0, 1.0)] {
            mesh.vertex(
                rib + across * (side * w) + if side == 0.0 { DVec3::ZERO } else { fold },
                DVec3::Z,
                DVec2::new(u, 1.0 - t),
            );
        }
        if i > 0 {
            let a = 3 * (i as u32 - 1);
            for k in [a, a + 1] {
                mesh.triangle(k, k + 1, k + 4);
                mesh.triangle(k, k + 4, k + 3);
            }
        }
    }
    mesh.smooth_normals();
    mesh
}
