//! Completeness of the path search: against every sequence of faces, and where rays alone find little.

use crate::rooms::{add_box, material, random_room, room, settings, total};
use corf_raytrace::Bvh;
use corf_raytrace::radio::{Path, RadioSettings, RadioTracer, Search};
use corf_scene::Rng;
use corf_scene::model::Scene;
use glam::{DVec3, Vec3};

#[test]
fn the_lattice_and_the_hierarchy_find_what_the_exhaustive_search_finds() {
    let scene = room();
    let bvh = Bvh::build(&scene);
    let oracle = RadioTracer::without_bvh(&scene, settings(Search::Exhaustive)).unwrap();
    let lattice = RadioTracer::new(&scene, &bvh, settings(Search::Lattice { rays: 400_000 })).unwrap();
    let tx = DVec3::new(1.0, 1.5, 2.0);
    let (oracle, lattice) = (oracle.transmitter(tx).unwrap(), lattice.transmitter(tx).unwrap());
    assert!(lattice.candidate_count() < oracle.candidate_count());
    for i in 0..12 {
        let mut rng = Rng::keyed(21, 0, i);
        let rx = DVec3::new(0.2 + 5.6 * rng.uniform_f64(), 0.2 + 4.6 * rng.uniform_f64(), 1.4 + 1.4 * rng.uniform_f64());
        let (all, found) = (oracle.paths(rx).unwrap(), lattice.paths(rx).unwrap());
        // What a lattice misses are chains through slivers seen from the transmitter under less than its spacing.
        assert!((total(&found) / total(&all) - 1.0).abs() < 1e-9, "power at {rx}: {} of {}", total(&found), total(&all));
        assert_eq!(all, found, "{rx}");
    }
}

#[test]
fn what_a_narrow_mirror_shows_by_way_of_a_large_one_is_found() {
    // A bar under the ceiling, which mirrors a strip of light onto the ceiling and on to slats: of the ceiling the strip is a thousandth.
    let mut scene =
        Scene { materials: vec![material("walls", "concrete", 0.2), material("metal", "metal", 0.01)], ..Scene::default() };
    add_box(&mut scene, "room", 0, Vec3::ZERO, Vec3::new(9.0, 9.0, 3.0));
    add_box(&mut scene, "bar", 1, Vec3::new(4.0, 7.5, 2.955), Vec3::new(5.2, 7.52, 2.985));
    for i in 0..16 {
        let y = 1.0 + 0.4 * i as f32;
        add_box(&mut scene, &format!("slat{i}"), 1, Vec3::new(0.1, y, 0.2), Vec3::new(0.13, y + 0.1, 2.8));
    }
    let bvh = Bvh::build(&scene);
    let oracle = RadioTracer::new(&scene, &bvh, settings(Search::Exhaustive)).unwrap();
    let lattice = RadioTracer::new(&scene, &bvh, settings(Search::Lattice { rays: 40_000 })).unwrap();
    let tx = DVec3::new(8.4, 3.1, 1.9);
    let (oracle, lattice) = (oracle.transmitter(tx).unwrap(), lattice.transmitter(tx).unwrap());
    let by_the_bar =
        |path: &Path| path.interactions.len() == 3 && scene.objects[path.interactions[0].object as usize].name.starts_with("bar");
    let mut narrow = 0;
    for i in 0..40 {
        // Along the light by a point of the bar, the ceiling and, where there is one, a slat.
        let mut rng = Rng::keyed(23, 0, i);
        let mut at = DVec3::new(4.0 + 0.6 * rng.uniform_f64(), 7.5, 2.955 + 0.03 * rng.uniform_f64());
        let mut direction = (at - tx) * DVec3::new(1.0, -1.0, 1.0);
        at += direction * ((3.0 - at.z) / direction.z);
        direction.z = -direction.z;
        at += direction * ((0.13 - at.x) / direction.x);
        let rx = at + direction * DVec3::new(-1.0, 1.0, 1.0) * (0.1 + 0.1 * rng.uniform_f64());
        let (all, found) = (oracle.paths(rx).unwrap(), lattice.paths(rx).unwrap());
        for path in all.iter().filter(|p| by_the_bar(p)) {
            assert!(found.contains(path), "{rx}: {path:?}");
            narrow += 1;
        }
    }
    assert!(narrow > 3, "{narrow}");
}

#[test]
fn what_two_large_mirrors_show_of_a_small_one_is_found() {
    // Studs of 2 cm all over the room: rays that leave the transmitter 3° apart meet hardly one, less so mirrored twice.
    let mut scene =
        Scene { materials: vec![material("walls", "concrete", 0.2), material("metal", "metal", 0.01)], ..Scene::default() };
    add_box(&mut scene, "room", 0, Vec3::ZERO, Vec3::new(9.0, 8.0, 3.0));
    let studs: Vec<DVec3> = (0..30)
        .map(|i| {
            let mut rng = Rng::keyed(25, 0, i);
            DVec3::new(1.0 + 7.0 * rng.uniform_f64(), 1.0 + 6.0 * rng.uniform_f64(), 0.3 + 2.4 * rng.uniform_f64())
        })
        .collect();
    for (i, at) in studs.iter().enumerate() {
        add_box(&mut scene, &format!("stud{i}"), 1, (*at - 0.01).as_vec3(), (*at + 0.01).as_vec3());
    }
    let bvh = Bvh::build(&scene);
    let lattice = RadioTracer::new(&scene, &bvh, settings(Search::Lattice { rays: 4_000 })).unwrap();
    let oracle = RadioTracer::new(&scene, &bvh, settings(Search::Exhaustive)).unwrap();
    let tx = DVec3::new(7.9, 3.1, 1.9);
    let (oracle, lattice) = (oracle.transmitter(tx).unwrap(), lattice.transmitter(tx).unwrap());
    let mut small = 0;
    for at in studs {
        // By the ceiling, the wall at y = 8 and the stud's side towards it.
        let image = DVec3::new(tx.x, 16.0 - tx.y, 6.0 - tx.z);
        let lit = at + DVec3::Y * 0.01;
        let direction = (lit - image).normalize() * DVec3::new(1.0, -1.0, 1.0);
        let rx = lit + direction * 0.4;
        let (all, found) = (oracle.paths(rx).unwrap(), lattice.paths(rx).unwrap());
        for path in all.iter().filter(|p| p.interactions.len() == 3 && p.interactions[2].vertex.distance(lit) < 1e-6) {
            assert!(found.contains(path), "{rx}: {path:?}");
            small += 1;
        }
    }
    assert!(small >= 20, "{small}");
}

#[test]
fn beams_lose_no_chain_and_the_hierarchy_no_path() {
    // The oracle tries every sequence of faces and every triangle.
    for (seed, boxes, max_interactions) in [(0, 1, 4), (1, 1, 4), (2, 2, 4), (3, 0, 5), (4, 1, 5)] {
        let scene = random_room(seed, boxes);
        let bvh = Bvh::build(&scene);
        let setup = |search| RadioSettings { max_interactions, ..settings(search) };
        let oracle = RadioTracer::without_bvh(&scene, setup(Search::Exhaustive)).unwrap();
        let fast = RadioTracer::new(&scene, &bvh, setup(Search::Auto { rays: 0 })).unwrap();
        let mut rng = Rng::keyed(78, 0, seed);
        let mut place =
            || DVec3::new(5.8 * rng.uniform_f64() + 0.1, 4.8 * rng.uniform_f64() + 0.1, 2.8 * rng.uniform_f64() + 0.1);
        let tx = place();
        let (oracle, fast) = (oracle.transmitter(tx).unwrap(), fast.transmitter(tx).unwrap());
        assert!(fast.candidate_count() < oracle.candidate_count());
        for _ in 0..2 {
            let rx = place();
            let (all, found) = (oracle.paths(rx).unwrap(), fast.paths(rx).unwrap());
            assert!(all.iter().any(|p| p.interactions.len() == max_interactions));
            assert_eq!(all, found, "room {seed}, {tx} to {rx}");
        }
    }
}
