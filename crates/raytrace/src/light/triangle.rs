//! Triangles as emitters have them: seen from a point, and cut into patches.

use glam::{DVec3, Vec2, Vec3};

/// A direction drawn evenly over the triangle that three corners span as seen from the origin, and its solid angle (Arvo 1995, *Stratified
/// Sampling of Spherical Triangles*); `None` where it has none.
pub(super) fn spherical_triangle(corners: [Vec3; 3], u: [f32; 2]) -> Option<(Vec3, f32)> {
    let [a, b, c] = corners.map(|p| p.as_dvec3().normalize_or_zero());
    let between = |n: DVec3, m: DVec3| n.normalize_or_zero().dot(m.normalize_or_zero()).clamp(-1.0, 1.0).acos();
    let (ab, bc, ca) = (a.cross(b), b.cross(c), c.cross(a));
    let (alpha, beta, gamma) = (between(ab, -ca), between(bc, -ab), between(ca, -bc));
    let solid_angle = alpha + beta + gamma - std::f64::consts::PI;
    if !(solid_angle > 1e-9 && alpha.sin() > 1e-9) {
        return None;
    }
    let part = f64::from(u[0]) * solid_angle;
    let (s, t) = (part - alpha).sin_cos();
    let (cos_alpha, sin_alpha) = (alpha.cos(), alpha.sin());
    let (p, q) = (t - cos_alpha, s + sin_alpha * a.dot(b));
    let cos_side = (((q * t - p * s) * cos_alpha - q) / ((q * s + p * t) * sin_alpha)).clamp(-1.0, 1.0);
    let across = |v: DVec3, axis: DVec3| (v - axis * v.dot(axis)).normalize_or_zero();
    let c_part = a * cos_side + across(c, a) * (1.0 - cos_side * cos_side).max(0.0).sqrt();
    let z = 1.0 - f64::from(u[1]) * (1.0 - c_part.dot(b));
    let direction = b * z + across(c_part, b) * (1.0 - z * z).max(0.0).sqrt();
    let direction = direction.as_vec3();
    (direction.is_finite() && direction != Vec3::ZERO).then_some((direction, solid_angle as f32))
}

/// `½ Σ θₖ Γₖ` over the edges of a triangle clipped to the half-space `n·x > 0`; corners relative to the viewpoint.
pub(super) fn polygon_vector(corners: [Vec3; 3], n: Vec3) -> Vec3 {
    let heights = corners.map(|c| c.dot(n));
    let mut polygon = [Vec3::ZERO; 4];
    let mut count = 0;
    for k in 0..3 {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        let (ha, hb) = (heights[k], heights[(k + 1) % 3]);
        if ha > 0.0 {
            polygon[count] = a;
            count += 1;
        }
        if (ha > 0.0) != (hb > 0.0) {
            polygon[count] = a + (b - a) * (ha / (ha - hb));
            count += 1;
        }
    }
    let mut sum = Vec3::ZERO;
    for k in 0..count {
        let (a, b) = (polygon[k], polygon[(k + 1) % count]);
        let cross = a.cross(b);
        let sin = cross.length();
        if sin > 0.0 {
            sum += cross * (sin.atan2(a.dot(b)) / sin);
        }
    }
    sum * 0.5
}

/// The patches of a triangle whose edges are divided into `parts`: `parts²` congruent triangles as corners in barycentric coordinates
/// (of the second and third vertex), row by row along the first coordinate.
pub(super) fn patches(parts: u32) -> impl Iterator<Item = [Vec2; 3]> {
    let at = move |i: u32, j: u32| Vec2::new(i as f32, j as f32) / parts as f32;
    (0..parts).flat_map(move |i| {
        (0..2 * (parts - i) - 1).map(move |k| {
            let j = k / 2;
            if k % 2 == 0 { [at(i, j), at(i + 1, j), at(i, j + 1)] } else { [at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)] }
        })
    })
}

/// The number of the patch that holds a point.
pub(super) fn patch_index(parts: u32, u: f32, v: f32) -> usize {
    let (x, y) = (u.clamp(0.0, 1.0) * parts as f32, v.clamp(0.0, 1.0) * parts as f32);
    let i = (x as u32).min(parts - 1);
    let j = (y as u32).min(parts - 1 - i);
    let turned = (x - i as f32) + (y - j as f32) > 1.0 && i + j + 1 < parts;
    // Row i begins after Σ (2(parts − k) − 1), k < i.
    (2 * parts * i - i * i + 2 * j + u32::from(turned)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    #[test]
    fn a_triangle_close_by_is_sampled_by_its_solid_angle_and_known_in_closed_form() {
        let mut rng = Rng::keyed(4, 1, 1);
        let mut draw = || Vec3::new(rng.uniform(), rng.uniform(), rng.uniform()) * 2.0 - 1.0;
        for _ in 0..40 {
            let corners = [draw(), draw(), draw() + Vec3::new(0.0, 0.0, 0.4)];
            let n = draw().normalize();
            // ∫ l dω over what is above the plane: by points drawn evenly over the solid angle, and by the closed form.
            let (mut sum, mut solid_angle) = (Vec3::ZERO, 0.0);
            const POINTS: u32 = 40_000;
            for k in 0..POINTS {
                let u = [(k as f32 * 0.754_877_7).fract(), (k as f32 * 0.569_840_3).fract()];
                let Some((l, omega)) = spherical_triangle(corners, u) else { continue };
                solid_angle = omega;
                assert!((l.length() - 1.0).abs() < 1e-4);
                if l.dot(n) > 0.0 {
                    sum += l * (omega / POINTS as f32);
                }
            }
            let mut exact = polygon_vector(corners, n);
            if exact.dot(sum) < 0.0 {
                exact = -exact;
            }
            // Of the triangle's 40 000 points, one in a hundred lies near the plane's edge.
            assert!((sum - exact).length() < 0.003 * solid_angle + 1e-4, "{sum} by points, {exact} exactly, of {solid_angle} sr");
        }
    }

    #[test]
    fn patches_tile_a_triangle_and_are_found_again() {
        let mut rng = Rng::keyed(1, 1, 1);
        for parts in [1, 2, 3, 7, 16] {
            let all: Vec<[Vec2; 3]> = patches(parts).collect();
            assert_eq!(all.len() as u32, parts * parts);
            let area: f32 = all.iter().map(|[a, b, c]| 0.5 * (b - a).perp_dot(c - a)).sum();
            assert!((area - 0.5).abs() < 1e-5, "{area}");
            for (i, [a, b, c]) in all.iter().enumerate() {
                for _ in 0..20 {
                    let root = rng.uniform().sqrt();
                    // Away from the edges, where rounding may decide for the neighbour.
                    let (x, y) = (0.01 + 0.97 * rng.uniform() * root, 0.01 + 0.97 * (1.0 - root));
                    let p = *a * (1.0 - x - y) + *b * x + *c * y;
                    assert_eq!(patch_index(parts, p.x, p.y), i, "{parts} {p}");
                }
            }
        }
    }
}
