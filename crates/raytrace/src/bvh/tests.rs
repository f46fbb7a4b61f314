//! The hierarchy against brute force, and against leaks.

use super::traverse::Choice;
use super::*;
use corf_scene::Rng;
use corf_scene::model::Triangle;
use proptest::prelude::*;

fn scene_of(triangles: &[[Vec3; 3]]) -> Scene {
    Scene {
        positions: triangles.iter().flatten().copied().collect(),
        triangles: (0..triangles.len() as u32)
            .map(|i| Triangle { vertices: [3 * i, 3 * i + 1, 3 * i + 2], material: 0, object: 0 })
            .collect(),
        ..Scene::default()
    }
}

fn point(rng: &mut Rng, scale: f32) -> Vec3 {
    Vec3::new(rng.uniform() - 0.5, rng.uniform() - 0.5, rng.uniform() - 0.5) * (2.0 * scale)
}

/// Random triangles of many sizes, some flat in an axis, some degenerate.
fn soup(rng: &mut Rng, n: usize) -> Vec<[Vec3; 3]> {
    (0..n)
        .map(|i| {
            let centre = point(rng, 10.0);
            let size = 10f32.powf(rng.uniform() * 3.0 - 2.0);
            let mut t = [0; 3].map(|_| centre + point(rng, size));
            match i % 7 {
                0 => t.iter_mut().for_each(|p| p.z = centre.z),
                1 => t.iter_mut().for_each(|p| p.x = centre.x),
                2 if i % 5 == 0 => t[2] = t[1],
                _ => {}
            }
            t
        })
        .collect()
}

/// Möller–Trumbore in f64: (t, how far inside the triangle, the smallest of the three weights).
fn brute(triangle: &[Vec3; 3], ray: &Ray) -> Option<(f64, f64)> {
    let [a, b, c] = triangle.map(Vec3::as_dvec3);
    let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let (e1, e2) = (b - a, c - a);
    let p = d.cross(e2);
    let determinant = e1.dot(p);
    if determinant.abs() < 1e-14 {
        return None;
    }
    let s = o - a;
    let (u, q) = (s.dot(p) / determinant, s.cross(e1));
    let v = d.dot(q) / determinant;
    Some((e2.dot(q) / determinant, u.min(v).min(1.0 - u - v)))
}

/// Hits nearer than this to an edge (in barycentric weight) may be decided either way by f32 rounding.
const EDGE_DOUBT: f64 = 1e-4;
/// Relative error of `t` in f32 for well-conditioned triangles; slivers seen edge-on are worse and are given way by the check itself.
const T_TOLERANCE: f64 = 2e-4;

fn check_against_brute_force(triangles: &[[Vec3; 3]], bvh: &Bvh, ray: &Ray) {
    let hit = bvh.intersect(ray);
    let clear = |t: f64| t > f64::from(ray.t_min) + 1e-3 && t < f64::from(ray.t_max) - 1e-3;
    let certain = triangles
        .iter()
        .filter_map(|t| brute(t, ray))
        .filter(|(t, inside)| clear(*t) && *inside > EDGE_DOUBT)
        .map(|(t, _)| t)
        .fold(f64::INFINITY, f64::min);
    match hit {
        None => assert!(certain.is_infinite(), "missed a hit at {certain} of {ray:?}"),
        Some(hit) => {
            let t = f64::from(hit.t);
            assert!(t <= certain * (1.0 + T_TOLERANCE), "{t} is behind {certain}");
            let corners = triangles[hit.triangle as usize].map(Vec3::as_dvec3);
            let there = (ray.origin + ray.direction * hit.t).as_dvec3();
            let weights =
                corners[0] * f64::from(1.0 - hit.u - hit.v) + corners[1] * f64::from(hit.u) + corners[2] * f64::from(hit.v);
            assert!((there - weights).length() < 1e-3 * (1.0 + t), "the hit is not on its triangle: {there} {weights}");
        }
    }
    assert_eq!(bvh.occluded(ray), hit.is_some());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn agrees_with_brute_force(seed in any::<u64>(), n in 1usize..300) {
        let mut rng = Rng::keyed(seed, 1, 0);
        let triangles = soup(&mut rng, n);
        let bvh = Bvh::build(&scene_of(&triangles));
        for i in 0..60 {
            let origin = point(&mut rng, 12.0);
            let mut direction = point(&mut rng, 1.0);
            if i % 4 == 0 {
                direction = [Vec3::X, Vec3::NEG_Y, Vec3::Z, Vec3::new(0.0, 1.0, -1.0)][(i / 4) % 4];
            }
            let mut ray = Ray { origin, direction: direction.normalize(), t_min: 0.0, t_max: f32::INFINITY };
            if i % 3 == 0 {
                ray.t_max = rng.uniform() * 15.0;
            }
            check_against_brute_force(&triangles, &bvh, &ray);
        }
    }

    #[test]
    fn candidates_hold_every_triangle_the_segment_touches(seed in any::<u64>(), n in 1usize..300) {
        let mut rng = Rng::keyed(seed, 2, 0);
        let triangles = soup(&mut rng, n);
        let bvh = Bvh::build(&scene_of(&triangles));
        for _ in 0..40 {
            let (a, b) = (point(&mut rng, 12.0), point(&mut rng, 12.0));
            let ray = Ray::segment(a, b);
            let mut seen = vec![0; n];
            let flow = bvh.visit_candidates(a.as_dvec3(), (b - a).as_dvec3(), 1.0, |t| {
                seen[t as usize] += 1;
                ControlFlow::Continue(())
            });
            prop_assert!(flow.is_continue());
            prop_assert!(seen.iter().all(|s| *s <= 1));
            for (i, t) in triangles.iter().enumerate() {
                if brute(t, &ray).is_some_and(|(t, inside)| (0.0..=1.0).contains(&t) && inside >= 0.0) {
                    prop_assert!(seen[i] == 1, "triangle {i} was not visited");
                }
            }
        }
    }

    #[test]
    fn both_kernels_return_the_same_bits(seed in any::<u64>(), n in 1usize..200) {
        let mut rng = Rng::keyed(seed, 3, 0);
        let bvh = Bvh::build(&scene_of(&soup(&mut rng, n)));
        let portable = Bvh { kernel: Choice::Portable, ..bvh.clone() };
        for _ in 0..60 {
            let ray = Ray::new(point(&mut rng, 12.0), point(&mut rng, 1.0));
            let bits = |h: Option<Hit>| h.map(|h| (h.t.to_bits(), h.u.to_bits(), h.v.to_bits(), h.triangle));
            prop_assert_eq!(bits(bvh.intersect(&ray)), bits(portable.intersect(&ray)));
            prop_assert_eq!(bvh.occluded(&ray), portable.occluded(&ray));
            // From behind the origin to before the hit: sorted entries of both signs, and nothing that ends the search.
            let t_max = bvh.intersect(&ray).map_or(3.0, |hit| 0.9 * hit.t);
            let ray = Ray { t_min: -12.0 * rng.uniform(), t_max, ..ray };
            prop_assert_eq!(bits(bvh.intersect(&ray)), bits(portable.intersect(&ray)));
            prop_assert_eq!(bits(bvh.intersect_where(&ray, |h| h.triangle % 2 == 0)), bits(portable.intersect_where(&ray, |h| h.triangle % 2 == 0)));
            prop_assert_eq!(bvh.occluded(&ray), portable.occluded(&ray));
        }
    }

    #[test]
    fn the_closest_hit_is_the_least_of_every_triangle_alone(seed in any::<u64>(), n in 1usize..400) {
        let mut rng = Rng::keyed(seed, 4, 0);
        let triangles = soup(&mut rng, n);
        let bvh = Bvh::build(&scene_of(&triangles));
        let alone: Vec<Bvh> = triangles.iter().map(|t| Bvh::build(&scene_of(&[*t]))).collect();
        for _ in 0..40 {
            let ray = Ray { t_min: -6.0 * rng.uniform(), ..Ray::new(point(&mut rng, 12.0), point(&mut rng, 1.0)) };
            let least = alone.iter().filter_map(|b| b.intersect(&ray)).map(|h| h.t).min_by(f32::total_cmp);
            // The test of a triangle is the same wherever it lies in the tree, so the tree must find these very bits.
            prop_assert_eq!(bvh.intersect(&ray).map(|h| h.t), least);
            prop_assert_eq!(bvh.occluded(&ray), least.is_some());
        }
    }
}

/// A closed box whose faces are grids of triangles with jittered inner vertices, away from the origin so that rounding shows.
fn closed_box(cells: usize, offset: Vec3) -> (Vec<[Vec3; 3]>, Vec<Vec3>) {
    let half = Vec3::new(3.3, 2.7, 1.9);
    let mut rng = Rng::keyed(5, 5, 5);
    let (mut triangles, mut aims) = (Vec::new(), Vec::new());
    for face in 0..6 {
        let (axis, sign) = (face / 2, if face % 2 == 0 { 1.0 } else { -1.0 });
        let grid: Vec<Vec3> = (0..(cells + 1) * (cells + 1))
            .map(|i| {
                let (a, b) = (i % (cells + 1), i / (cells + 1));
                let inner = |k: usize| if k == 0 || k == cells { 0.0 } else { 0.6f32 };
                let coordinate = |k: usize, jitter: f32| 2.0 * (k as f32 + jitter) / cells as f32 - 1.0;
                // Rims stay on a regular grid, shared by the neighbouring faces; the inside is jittered.
                let move_both = inner(a).min(inner(b));
                let mut p = Vec3::ZERO;
                p[axis] = sign;
                p[(axis + 1) % 3] = coordinate(a, (rng.uniform() - 0.5) * move_both);
                p[(axis + 2) % 3] = coordinate(b, (rng.uniform() - 0.5) * move_both);
                offset + p * half
            })
            .collect();
        for b in 0..cells {
            for a in 0..cells {
                let at = |i, j| grid[(b + j) * (cells + 1) + a + i];
                for t in [[at(0, 0), at(1, 0), at(1, 1)], [at(0, 0), at(1, 1), at(0, 1)]] {
                    for k in 0..3 {
                        aims.push(t[k]);
                        aims.push(t[k].lerp(t[(k + 1) % 3], rng.uniform()));
                    }
                    triangles.push(t);
                }
            }
        }
    }
    (triangles, aims)
}

#[test]
fn no_ray_leaks_through_shared_edges_and_corners() {
    const RAYS: usize = 400_000;
    for offset in [Vec3::ZERO, Vec3::new(11.3, -7.9, 1.7)] {
        let (triangles, aims) = closed_box(9, offset);
        let bvh = Bvh::build(&scene_of(&triangles));
        let portable = Bvh { kernel: Choice::Portable, ..bvh.clone() };
        let mut rng = Rng::keyed(1, 2, 3);
        let mut leaks = 0;
        for i in 0..RAYS {
            let mut origin = offset + point(&mut rng, 1.8);
            let aim = aims[rng.below(aims.len())];
            if i % 5 == 0 {
                // Along an axis: the aimed edge lies in the ray's own slab plane.
                let axis = i % 3;
                (origin[(axis + 1) % 3], origin[(axis + 2) % 3]) = (aim[(axis + 1) % 3], aim[(axis + 2) % 3]);
            }
            let bvh = if i % 8 == 7 { &portable } else { &bvh };
            let direction = aim - origin;
            if direction.length() < 1e-3 || (origin - offset).abs().cmpge(Vec3::new(3.29, 2.69, 1.89)).any() {
                continue;
            }
            leaks += usize::from(bvh.intersect(&Ray::new(origin, direction)).is_none());
        }
        assert_eq!(leaks, 0, "of {RAYS} rays at {offset}");
    }
}

/// A closed surface around `centre`: rings of vertices at random distances, joined by triangles of every shape, and points to aim at
/// on its edges and corners.
fn crumpled_ball(rng: &mut Rng, centre: Vec3, rings: usize) -> (Vec<[Vec3; 3]>, Vec<Vec3>) {
    let around = 2 * rings;
    let mut vertex = |ring: usize, step: usize| {
        let inner = if ring == 0 || ring == rings { 0.0 } else { 0.45 };
        let mut jitter = || inner * (rng.uniform() - 0.5);
        let theta = std::f32::consts::PI * (ring as f32 + jitter()) / rings as f32;
        let phi = std::f32::consts::TAU * (step as f32 + jitter()) / around as f32;
        centre + Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()) * (2.0 + jitter())
    };
    let mut grid: Vec<Vec<Vec3>> = (0..=rings).map(|ring| (0..around).map(|step| vertex(ring, step)).collect()).collect();
    // The poles are one point each.
    for ring in [0, rings] {
        let pole = grid[ring][0];
        grid[ring].fill(pole);
    }
    let (mut triangles, mut aims) = (Vec::new(), Vec::new());
    for ring in 0..rings {
        for step in 0..around {
            let next = (step + 1) % around;
            let [a, b, c, d] = [grid[ring][step], grid[ring + 1][step], grid[ring + 1][next], grid[ring][next]];
            for t in [[a, b, c], [a, c, d]] {
                if t[0] == t[1] || t[1] == t[2] || t[2] == t[0] {
                    continue;
                }
                for k in 0..3 {
                    aims.extend([t[k], t[k].lerp(t[(k + 1) % 3], rng.uniform())]);
                }
                triangles.push(t);
            }
        }
    }
    (triangles, aims)
}

#[test]
fn no_ray_from_inside_leaves_a_crumpled_ball_through_an_edge_or_a_corner() {
    let mut rng = Rng::keyed(8, 8, 8);
    for (rings, centre) in [(6, Vec3::ZERO), (25, Vec3::new(31.7, -19.3, 2.9)), (60, Vec3::new(-140.3, 77.7, 0.1))] {
        let (triangles, aims) = crumpled_ball(&mut rng, centre, rings);
        let bvh = Bvh::build(&scene_of(&triangles));
        let portable = Bvh { kernel: Choice::Portable, ..bvh.clone() };
        for i in 0..120_000 {
            let origin = centre + point(&mut rng, 0.5);
            let ray = Ray::new(origin, aims[rng.below(aims.len())] - origin);
            let tree = if i % 4 == 3 { &portable } else { &bvh };
            assert!(tree.intersect(&ray).is_some() && tree.occluded(&ray), "{rings} rings: {ray:?}");
        }
    }
}

#[test]
fn t_min_and_t_max_are_exclusive_and_refused_hits_are_skipped() {
    let quad = |z: f32| [Vec3::new(-1.0, -1.0, z), Vec3::new(3.0, -1.0, z), Vec3::new(-1.0, 3.0, z)];
    let bvh = Bvh::build(&scene_of(&[quad(1.0), quad(2.0), quad(3.0)]));
    let ray = |t_min, t_max| Ray { origin: Vec3::ZERO, direction: Vec3::Z, t_min, t_max };
    assert_eq!(bvh.intersect(&ray(0.0, 9.0)).unwrap().triangle, 0);
    assert_eq!(bvh.intersect(&ray(1.0, 9.0)).unwrap().triangle, 1);
    assert_eq!(bvh.intersect(&ray(1.0, 2.0)), None);
    assert_eq!(bvh.intersect_where(&ray(0.0, 9.0), |h| h.triangle == 2).unwrap().triangle, 2);
    assert!(!bvh.occluded_where(&ray(0.0, 9.0), |_| false));
}

#[test]
fn empty_and_non_finite_scenes_are_never_hit() {
    let nothing = Bvh::build(&Scene::default());
    assert_eq!(nothing.intersect(&Ray::new(Vec3::ZERO, Vec3::X)), None);
    assert!(!nothing.occluded(&Ray::new(Vec3::ZERO, Vec3::X)));
    let broken = Bvh::build(&scene_of(&[[Vec3::splat(f32::NAN), Vec3::X, Vec3::Y]]));
    assert_eq!(broken.intersect(&Ray::new(Vec3::splat(0.2), Vec3::NEG_Z)), None);
}

#[test]
fn sizes_whose_areas_overflow_or_vanish_in_f32_build_a_whole_tree() {
    let mut rng = Rng::keyed(7, 7, 7);
    for scale in [1e-30f32, 1e-18, 1e18, 1e25, 1e37] {
        let n = 500;
        let triangles: Vec<[Vec3; 3]> = (0..n).map(|_| [0; 3].map(|_| point(&mut rng, scale))).collect();
        let bvh = Bvh::build(&scene_of(&triangles));
        let mut seen = vec![0; n];
        bvh.visit_box(DVec3::splat(-4.0 * f64::from(scale)), DVec3::splat(4.0 * f64::from(scale)), |t| seen[t as usize] += 1);
        assert!(seen.iter().all(|s| *s == 1), "at {scale}");
    }
}

#[test]
fn a_thousand_coincident_triangles_are_all_visited() {
    let n = 1000;
    let bvh = Bvh::build(&scene_of(&vec![[Vec3::ZERO, Vec3::X, Vec3::Y]; n]));
    let mut seen = 0;
    let _ = bvh.visit_candidates(DVec3::new(0.2, 0.2, 1.0), DVec3::NEG_Z, 2.0, |_| {
        seen += 1;
        ControlFlow::Continue(())
    });
    assert_eq!(seen, n);
    assert!(bvh.occluded(&Ray::new(Vec3::new(0.2, 0.2, 1.0), Vec3::NEG_Z)));
}

#[test]
fn rays_that_are_no_numbers_miss_and_end() {
    let bvh = Bvh::build(&scene_of(&[[Vec3::ZERO, Vec3::X, Vec3::Y], [Vec3::Z, Vec3::ONE, Vec3::Y]]));
    let portable = Bvh { kernel: Choice::Portable, ..bvh.clone() };
    let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, f32::MIN_POSITIVE, -0.0];
    for tree in [&bvh, &portable] {
        for value in odd {
            for axis in 0..3 {
                let (mut origin, mut direction) = (Vec3::new(0.2, 0.2, 5.0), Vec3::NEG_Z);
                for ray in [
                    {
                        origin[axis] = value;
                        Ray::new(origin, Vec3::NEG_Z)
                    },
                    {
                        direction[axis] = value;
                        Ray::new(Vec3::new(0.2, 0.2, 5.0), direction)
                    },
                    Ray { t_min: value, ..Ray::new(Vec3::new(0.2, 0.2, 5.0), Vec3::NEG_Z) },
                    Ray { t_max: value, ..Ray::new(Vec3::new(0.2, 0.2, 5.0), Vec3::NEG_Z) },
                ] {
                    // That these return is what is tested; what is no number hits nothing.
                    let (hit, occluded) = (tree.intersect(&ray), tree.occluded(&ray));
                    let is_finite = ray.origin.is_finite() && ray.direction.is_finite();
                    assert!(is_finite || hit.is_none() && !occluded, "{ray:?}");
                    let mut seen = 0;
                    let _ = tree.visit_candidates(ray.origin.as_dvec3(), ray.direction.as_dvec3(), f64::from(ray.t_max), |_| {
                        seen += 1;
                        ControlFlow::Continue(())
                    });
                    assert!(seen <= 2 && (is_finite || seen == 0), "{ray:?}");
                }
            }
        }
    }
    assert!(bvh.occluded(&Ray::new(Vec3::new(0.2, 0.2, 5.0), Vec3::NEG_Z)));
}
