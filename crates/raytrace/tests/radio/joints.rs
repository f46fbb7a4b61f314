//! Joints of surfaces: a path that bounces at a joint has the same interactions as the paths beside it.

use crate::rooms::{add_box, empty, material, settings, total};
use corf_raytrace::Bvh;
use corf_raytrace::radio::{Path, RadioSettings, RadioTracer, Search};
use corf_scene::Rng;
use corf_scene::model::{Object, Scene, Triangle};
use glam::{DVec3, Vec3};

/// Powers of paths between ends moved by a tenth of a micrometre differ by less than this: slabs have fringes, and in a corner the order of
/// two bounces is another on another side.
const MOVED: f64 = 1e-4;

/// Adds a rectangle `corner + [0, 1]·u + [0, 1]·v`, to the object of this name or a new one.
fn add_sheet(scene: &mut Scene, name: &str, material: u32, corner: Vec3, u: Vec3, v: Vec3) {
    let object = scene.objects.iter().position(|o| o.name == name).unwrap_or_else(|| {
        scene.objects.push(Object { name: name.into() });
        scene.objects.len() - 1
    }) as u32;
    let first = scene.positions.len() as u32;
    scene.positions.extend([corner, corner + u, corner + u + v, corner + v]);
    scene.normals.extend([Vec3::Z; 4]);
    scene.uvs.extend([[0.0; 2]; 4]);
    let triangle = |t: [u32; 3]| Triangle { vertices: t.map(|v| first + v), material, object };
    scene.triangles.extend([[0, 1, 2], [0, 2, 3]].map(triangle));
}

/// Materials and objects of a room's sheets.
#[derive(Clone, Copy, Debug)]
struct Kind {
    /// Material of partitions: 0 metal, 1 glass.
    partition: u32,
    /// All sheets are one object.
    merged: bool,
    /// Partitions go on through the floor and the ceiling.
    through: bool,
    /// The floor is laid in tiles of one metre.
    tiled: bool,
}

/// A room of 6 × 4 × 3 m with partitions on the grid of metres from wall to wall.
fn partitioned(seed: u64, kind: Kind) -> Scene {
    let mut rng = Rng::keyed(41, 7, seed);
    let mut scene = Scene { materials: vec![material("metal", "metal", 0.01), material("glass", "glass", 0.006)], ..empty() };
    let (x, y, z) = (Vec3::X * 6.0, Vec3::Y * 4.0, Vec3::Z * 3.0);
    let name = |name: &str| if kind.merged { "room".to_string() } else { name.to_string() };
    if kind.tiled {
        for i in 0..24 {
            let corner = Vec3::new((i % 6) as f32, (i / 6) as f32, 0.0);
            add_sheet(&mut scene, &name(&format!("tile{i}")), 0, corner, Vec3::X, Vec3::Y);
        }
    } else {
        add_sheet(&mut scene, &name("floor"), 0, Vec3::ZERO, x, y);
    }
    add_sheet(&mut scene, &name("ceiling"), 0, z, x, y);
    for (i, at) in [Vec3::ZERO, y].into_iter().enumerate() {
        add_sheet(&mut scene, &name(&format!("side{i}")), 0, at, x, z);
    }
    for (i, at) in [Vec3::ZERO, x].into_iter().enumerate() {
        add_sheet(&mut scene, &name(&format!("end{i}")), 0, at, y, z);
    }
    let (low, rise) = if kind.through { (-Vec3::Z, Vec3::Z * 5.0) } else { (Vec3::ZERO, z) };
    for i in 0..2 {
        let at = 1.0 + (rng.uniform_f64() * 5.0).floor() as f32;
        if rng.uniform_f64() < 0.7 {
            add_sheet(&mut scene, &name(&format!("part{i}")), kind.partition, low + Vec3::X * at, y, rise);
        } else {
            add_sheet(&mut scene, &name(&format!("part{i}")), kind.partition, low + Vec3::Y * at.min(3.0), x, rise);
        }
    }
    scene
}

/// Signatures of paths: types and vertices, in steps of a tenth of a millimetre, sorted.
fn signatures(paths: &[Path]) -> Vec<String> {
    let mut all: Vec<String> = paths
        .iter()
        .map(|p| {
            let mut vertices: Vec<String> = p
                .interactions
                .iter()
                .map(|i| {
                    // No coordinate of these rooms lies half way between two numbers.
                    let v = (i.vertex / 1e-4 + 0.321).round();
                    format!("{}({:.0},{:.0},{:.0})", i.kind.letter(), v.x, v.y, v.z)
                })
                .collect();
            vertices.sort();
            vertices.join(" ")
        })
        .collect();
    all.sort();
    all
}

/// Signatures that are more frequent in `a` than in `b`.
fn only(a: &[String], b: &[String]) -> Vec<String> {
    let count = |list: &[String], s: &String| list.iter().filter(|other| *other == s).count();
    a.iter().filter(|s| count(a, s) > count(b, s)).cloned().collect()
}

/// A point moved by up to a tenth of a micrometre along each axis.
fn moved(point: DVec3, rng: &mut Rng) -> DVec3 {
    point + (DVec3::from_array([0; 3].map(|_| rng.uniform_f64())) - 0.5) * 2e-7
}

#[test]
fn ends_in_line_with_joints_see_what_ends_beside_them_see() {
    let (mut compared, mut wrong) = (0, Vec::new());
    for seed in 0..400 {
        let kind = Kind { partition: (seed % 2) as u32, merged: seed % 3 == 0, through: seed % 4 == 1, tiled: seed % 5 == 2 };
        let scene = partitioned(seed, kind);
        let traced = RadioSettings { max_interactions: 3, ..settings(Search::Exhaustive) };
        let bvh = Bvh::build(&scene);
        let tracer = RadioTracer::new(&scene, &bvh, traced).unwrap();
        let mut rng = Rng::keyed(43, 9, seed);
        // Half a metre off the grid and on diagonals: bounces fall on joints of every kind.
        let mut place = |levels: f64| {
            let mut at = |count: f64| (rng.uniform_f64() * count).floor() + 0.5;
            DVec3::new(at(6.0), at(4.0), at(levels))
        };
        let (tx, rx) = (place(3.0), place(3.0));
        if tx == rx {
            continue;
        }
        let mut shift = Rng::keyed(47, 1, seed);
        let exactly = tracer.paths(tx, rx).unwrap();
        let beside = tracer.paths(moved(tx, &mut shift), moved(rx, &mut shift)).unwrap();
        let change = (total(&exactly) - total(&beside)).abs();
        // Exchanging the ends changes nothing, at joints either: neighbours are looked for on one side of a line, whichever way it is run through.
        let back = tracer.paths(rx, tx).unwrap();
        assert_eq!(signatures(&back), signatures(&exactly), "seed {seed}: {rx} to {tx}");
        if change > MOVED * total(&beside) || exactly.len() != beside.len() {
            let (a, b) = (signatures(&exactly), signatures(&beside));
            wrong.push(format!(
                "seed {seed} {kind:?} {tx} {rx} {}\n  exactly {:#?}\n  beside {:#?}",
                change / total(&beside),
                only(&a, &b),
                only(&b, &a)
            ));
        }
        compared += exactly.len();
    }
    assert!(wrong.is_empty(), "{} of 400 rooms:\n{}", wrong.len(), wrong.join("\n"));
    assert!(compared > 5_000, "{compared}");
}

/// Partitions that end in the open and crates: what grazes an edge may be there or not. What all ends around have is there, and nothing that
/// none of them has.
#[test]
fn nothing_is_seen_that_no_end_beside_sees() {
    let mut compared = 0;
    for seed in 0..80 {
        let mut rng = Rng::keyed(53, 2, seed);
        let mut scene = Scene { materials: vec![material("metal", "metal", 0.01), material("glass", "glass", 0.006)], ..empty() };
        add_box(&mut scene, "room", 0, Vec3::ZERO, Vec3::new(6.0, 4.0, 3.0));
        let mut whole = |from: f64, to: f64| (from + (rng.uniform_f64() * (to - from + 1.0)).floor()) as f32;
        for i in 0..2u32 {
            let (corner, height) = (Vec3::new(whole(1.0, 5.0), whole(0.0, 2.0), 0.0), Vec3::Z * whole(1.0, 3.0));
            let along = if i == 0 { Vec3::Y * 2.0 } else { Vec3::X };
            add_sheet(&mut scene, &format!("screen{i}"), seed as u32 % 2, corner, along, height);
        }
        let low = Vec3::new(whole(1.0, 4.0), whole(1.0, 2.0), 0.0);
        add_box(&mut scene, "crate", (seed as u32 / 2) % 2, low, low + Vec3::ONE);
        let mut place = || DVec3::new(f64::from(whole(0.0, 5.0)), f64::from(whole(0.0, 3.0)), f64::from(whole(0.0, 2.0))) + 0.5;
        let (tx, rx) = (place(), place());
        let solid = |p: DVec3| (p - low.as_dvec3()).cmpgt(DVec3::ZERO).all() && (p - low.as_dvec3()).cmplt(DVec3::ONE).all();
        if tx == rx || solid(tx) || solid(rx) {
            continue;
        }
        let bvh = Bvh::build(&scene);
        let tracer =
            RadioTracer::new(&scene, &bvh, RadioSettings { max_interactions: 3, ..settings(Search::Exhaustive) }).unwrap();
        let exactly = signatures(&tracer.paths(tx, rx).unwrap());
        let mut shift = Rng::keyed(59, 1, seed);
        let around: Vec<Vec<String>> =
            (0..100).map(|_| signatures(&tracer.paths(moved(tx, &mut shift), moved(rx, &mut shift)).unwrap())).collect();
        let phantoms: Vec<String> =
            around.iter().map(|beside| only(&exactly, beside)).reduce(|a, b| intersection(&a, &b)).unwrap();
        let lost: Vec<String> = around.iter().map(|beside| only(beside, &exactly)).reduce(|a, b| intersection(&a, &b)).unwrap();
        assert!(phantoms.is_empty() && lost.is_empty(), "seed {seed} {tx} {rx}: phantoms {phantoms:#?}, lost {lost:#?}");
        compared += exactly.len();
    }
    assert!(compared > 800, "{compared}");
}

/// Signatures that are in both lists.
fn intersection(a: &[String], b: &[String]) -> Vec<String> {
    a.iter().filter(|s| b.contains(s)).cloned().collect()
}

/// Sheets that lie on each other: one slab of one object and material, two of two, whichever diagonals they are cut along. That is what
/// `corf scene validate` says of them.
#[test]
fn copies_of_a_sheet_are_as_many_slabs_as_validation_says() {
    for cut in [false, true] {
        for (object, material, expected) in [("pane", 0, "R"), ("pane", 1, "RR"), ("other", 0, "RR")] {
            let materials = vec![self::material("left", "glass", 0.006), self::material("right", "glass", 0.006)];
            let mut scene = Scene { materials, ..empty() };
            let (corner, u, v) = (Vec3::new(0.0, -1.0, 0.0), Vec3::Y * 2.0, Vec3::Z * 3.0);
            add_sheet(&mut scene, "pane", 0, corner, u, v);
            // From another corner, the other diagonal.
            let (corner, u, v) = if cut { (corner + u, v, -u) } else { (corner, u, v) };
            add_sheet(&mut scene, object, material, corner, u, v);
            let tracer = RadioTracer::without_bvh(&scene, settings(Search::Exhaustive)).unwrap();
            let types = tracer.paths(DVec3::new(-1.0, 0.1, 1.0), DVec3::new(1.0, 0.2, 1.3)).unwrap()[0].types();
            assert_eq!(types, expected, "{cut} {object} {material}");
            let found = corf_scene::overlaps::overlaps(&scene);
            assert!(found.len() == 1 && found[0].one_slab == (expected == "R"), "{found:?}");
        }
    }
}

/// Every triangle cut in four, each piece of it an object of its own.
fn cut_up(scene: &Scene) -> Scene {
    let mut cut = Scene {
        positions: Vec::new(),
        normals: Vec::new(),
        uvs: Vec::new(),
        triangles: Vec::new(),
        objects: Vec::new(),
        ..scene.clone()
    };
    for (i, triangle) in scene.triangles.iter().enumerate() {
        let [a, b, c] = scene.corners(i);
        let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(p, q)| p.midpoint(q));
        for piece in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            let (first, object) = (cut.positions.len() as u32, cut.objects.len() as u32);
            cut.objects.push(Object { name: format!("piece{object}") });
            cut.positions.extend(piece);
            cut.normals.extend([Vec3::Z; 3]);
            cut.uvs.extend([[0.0; 2]; 3]);
            cut.triangles.push(Triangle { vertices: [first, first + 1, first + 2], material: triangle.material, object });
        }
    }
    cut
}

#[test]
fn cutting_faces_up_into_objects_changes_no_gain() {
    for seed in 0..3 {
        let whole = crate::rooms::random_room(seed, 2);
        let cut = cut_up(&whole);
        let (tx, rx) = (DVec3::new(0.4, 0.6, 2.2), DVec3::new(5.2, 4.3, 0.9));
        let traced = RadioSettings { max_interactions: 2, diffraction: true, ..settings(Search::Auto { rays: 200_000 }) };
        let [whole, cut] = [whole, cut].map(|scene| {
            let bvh = Bvh::build(&scene);
            let tracer = RadioTracer::new(&scene, &bvh, traced).unwrap();
            tracer.paths(tx, rx).unwrap()
        });
        assert!(whole.iter().any(|path| path.types().contains('X')));
        assert_eq!(signatures(&whole), signatures(&cut), "seed {seed}");
        // Objects' panels are gathered into planes one by one: to the rounding of their corners.
        assert!((total(&whole) / total(&cut) - 1.0).abs() < 1e-6, "seed {seed}");
    }
}
