//! Paths: mirrors, slabs, antennas.

use crate::rooms::{add_box, empty, material, random_room, room, settings};
use corf_raytrace::Bvh;
use corf_raytrace::radio::{
    Antenna, AntennaArray, AntennaPattern, Complex, Path, PlanarArray, Polarization, RadioSettings, RadioTracer, SPEED_OF_LIGHT,
    Search,
};
use corf_scene::model::{Material, Object, Permittivity, Scene, Triangle};
use glam::{DMat3, DVec3, Vec3};

/// Rounding of λ/(4πL) and of mirrored coordinates in f64.
const ROUNDING: f64 = 1e-12;

#[test]
fn free_space_follows_friis() {
    let scene = empty();
    let tracer = RadioTracer::without_bvh(&scene, RadioSettings::default()).unwrap();
    let mut previous = f64::INFINITY;
    for d in [1.0, 2.0, 4.0, 8.0] {
        let paths = tracer.paths(DVec3::ZERO, DVec3::new(d, 0.0, 0.0)).unwrap();
        assert_eq!(paths.len(), 1);
        let expected = SPEED_OF_LIGHT / 60e9 / (4.0 * std::f64::consts::PI * d);
        assert!((paths[0].a.re / expected - 1.0).abs() < ROUNDING && paths[0].a.im == 0.0);
        assert!((paths[0].delay_s * SPEED_OF_LIGHT - d).abs() < ROUNDING);
        if previous.is_finite() {
            // Doubling the distance costs 20·log10(2) dB.
            assert!((previous - 10.0 * paths[0].power().log10() - 20.0 * 2f64.log10()).abs() < 1e-9);
        }
        previous = 10.0 * paths[0].power().log10();
    }
}

#[test]
fn a_bounce_is_as_long_as_the_way_to_the_image_source() {
    let scene = room();
    let bvh = Bvh::build(&scene);
    let tracer = RadioTracer::new(&scene, &bvh, RadioSettings { transmission: false, ..settings(Search::Exhaustive) }).unwrap();
    let (tx, rx) = (DVec3::new(1.0, 1.5, 2.0), DVec3::new(1.5, 4.0, 1.0));
    let paths = tracer.paths(tx, rx).unwrap();
    let named = |name: &str| {
        paths
            .iter()
            .find(|p| p.types() == "S" && scene.objects[p.interactions[0].object as usize].name == name)
            .unwrap_or_else(|| panic!("{name}"))
    };
    for (name, image) in [
        ("room_zmin", DVec3::new(1.0, 1.5, -2.0)),
        ("room_zmax", DVec3::new(1.0, 1.5, 4.0)),
        ("room_xmin", DVec3::new(-1.0, 1.5, 2.0)),
        ("room_ymax", DVec3::new(1.0, 8.5, 2.0)),
    ] {
        let path = named(name);
        assert!((path.length_m - image.distance(rx)).abs() < ROUNDING * 10.0, "{name}");
        assert!((path.arrival - (image - rx).normalize()).length() < ROUNDING * 10.0);
    }
}

#[test]
fn exchanging_transmitter_and_receiver_changes_no_path_gain() {
    let scene = room();
    let bvh = Bvh::build(&scene);
    let tracer = RadioTracer::new(&scene, &bvh, settings(Search::Auto { rays: 0 })).unwrap();
    let (a, b) = (DVec3::new(1.0, 1.5, 2.0), DVec3::new(4.7, 3.9, 1.1));
    let (there, back) = (tracer.paths(a, b).unwrap(), tracer.paths(b, a).unwrap());
    assert!(there.len() > 40, "{}", there.len());
    assert_eq!(there.len(), back.len());
    for path in &there {
        let reversed: String = path.types().chars().rev().collect();
        let twin = back
            .iter()
            .find(|p| {
                p.types() == reversed
                    && p.interactions.iter().rev().zip(&path.interactions).all(|(p, q)| p.vertex.distance(q.vertex) < 1e-9)
            })
            .unwrap_or_else(|| panic!("no twin of {}", path.types()));
        assert!((twin.a.norm() / path.a.norm() - 1.0).abs() < 1e-9, "{} {:?} {:?}", path.types(), path.a, twin.a);
    }
}

/// Half a wavelength of aperture at 5 m: the curvature d²/(2R) a plane wave leaves out, as a phase, stays below this, radians.
const PLANE_WAVE_PHASE_RAD: f64 = 2e-3;

#[test]
fn array_elements_see_the_phase_of_their_own_way() {
    // Against paths traced to the elements' own positions: h_rt = a·exp(−j2π(L_rt − L)/λ).
    let scene = room();
    let tracer = RadioTracer::without_bvh(&scene, RadioSettings { max_interactions: 1, ..settings(Search::Exhaustive) }).unwrap();
    let wavelength_m = tracer.settings().wavelength_m();
    let turned = |yaw: f64, pitch: f64| Antenna {
        polarization: Polarization::VH,
        world_from_antenna: DMat3::from_rotation_z(yaw) * DMat3::from_rotation_y(pitch),
        ..Antenna::default()
    };
    let tx_array =
        AntennaArray { element: turned(0.4, 0.2), grid: PlanarArray { rows: 1, columns: 2, spacing_wavelengths: [0.5, 0.5] } };
    let rx_array =
        AntennaArray { element: turned(-2.0, -0.3), grid: PlanarArray { rows: 3, columns: 2, spacing_wavelengths: [0.5, 0.5] } };
    let (tx, rx) = (DVec3::new(1.0, 3.0, 2.3), DVec3::new(5.0, 1.0, 1.4));
    let centre = tracer.paths(tx, rx).unwrap();
    assert!(centre.len() >= 4, "{}", centre.len());
    let place = |array: &AntennaArray, i: usize| array.element.world_from_antenna * array.grid.positions()[i] * wavelength_m;
    for path in &centre {
        let h = path.array_response(&tx_array, &rx_array);
        assert_eq!(h.len(), tx_array.ports() * rx_array.ports());
        for (r, t) in [(0, 0), (2, 1), (5, 0)] {
            let own = tracer.paths(tx + place(&tx_array, t), rx + place(&rx_array, r)).unwrap();
            let same = |p: &&Path| {
                p.types() == path.types() && p.interactions.iter().zip(&path.interactions).all(|(p, q)| p.object == q.object)
            };
            let own = own.iter().find(same).unwrap();
            for (rx_port, tx_port) in [(0, 0), (1, 0), (1, 1)] {
                let a = path.coefficient(&tx_array.element, tx_port, &rx_array.element, rx_port);
                let phase = -std::f64::consts::TAU * (own.length_m - path.length_m) / wavelength_m;
                let expected = a * Complex::new(0.0, phase).exp();
                let found = h[(rx_port * 6 + r) * tx_array.ports() + tx_port * 2 + t];
                assert!((found - expected).norm() <= PLANE_WAVE_PHASE_RAD * a.norm(), "{} {found:?} {expected:?}", path.types());
            }
        }
    }
}

#[test]
fn the_transfer_of_a_path_is_the_transpose_of_its_reverse() {
    // θ̂ and φ̂ of an end are those of one direction, whether the path leaves there or arrives.
    let scene = random_room(5, 2);
    let tracer = RadioTracer::without_bvh(&scene, RadioSettings { max_interactions: 3, ..settings(Search::Exhaustive) }).unwrap();
    let (a, b) = (DVec3::new(0.4, 0.6, 2.2), DVec3::new(5.2, 4.3, 0.9));
    let (there, back) = (tracer.paths(a, b).unwrap(), tracer.paths(b, a).unwrap());
    assert_eq!(there.len(), back.len());
    for path in &there {
        let reversed = |p: &&Path| {
            p.interactions.len() == path.interactions.len()
                && p.interactions
                    .iter()
                    .rev()
                    .zip(&path.interactions)
                    .all(|(p, q)| p.kind == q.kind && p.vertex.distance(q.vertex) < 1e-9)
        };
        let twin = back.iter().find(reversed).unwrap();
        let scale = path.transfer.iter().flatten().fold(0.0f64, |m, t| m.max(t.norm()));
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            assert!((path.transfer[i][j] - twin.transfer[j][i]).norm() < 1e-9 * scale, "{} {i}{j}", path.types());
        }
    }
}

#[test]
fn ports_and_patterns_weigh_a_path_as_their_fields_do() {
    let scene = empty();
    let tracer = RadioTracer::without_bvh(&scene, RadioSettings::default()).unwrap();
    let (tx, rx) = (DVec3::new(0.3, -0.2, 1.0), DVec3::new(4.0, 2.5, 2.1));
    let path = &tracer.paths(tx, rx).unwrap()[0];
    let free = SPEED_OF_LIGHT / 60e9 / (4.0 * std::f64::consts::PI * tx.distance(rx));
    let antenna =
        |pattern, polarization, turn: DMat3| Antenna { pattern, polarization, world_from_antenna: turn, ..Antenna::default() };
    let level = |polarization| antenna(AntennaPattern::Iso, polarization, DMat3::IDENTITY);
    // V and H do not mix in free space; the rows of slanted pairs carry the power of both.
    let (v, h) = (level(Polarization::V), level(Polarization::H));
    assert!((path.coefficient(&v, 0, &v, 0).norm() / free - 1.0).abs() < ROUNDING);
    assert!((path.coefficient(&h, 0, &h, 0).norm() / free - 1.0).abs() < ROUNDING);
    assert!(path.coefficient(&v, 0, &h, 0).norm() < ROUNDING * free && path.coefficient(&h, 0, &v, 0).norm() < ROUNDING * free);
    for polarization in [Polarization::VH, Polarization::Cross] {
        let dual = level(polarization);
        for port in 0..2 {
            let received: f64 = (0..2).map(|p| path.coefficient(&dual, port, &dual, p).norm_squared()).sum();
            assert!((received / (free * free) - 1.0).abs() < ROUNDING);
        }
    }
    // A turned element: the pattern's amplitude towards the other end, in its own frame.
    let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_y(-0.4) * DMat3::from_rotation_x(0.3);
    for pattern in [AntennaPattern::Dipole, AntennaPattern::Tr38901] {
        let dual = antenna(pattern, Polarization::VH, turn);
        let power: f64 = (0..2)
            .map(|p| path.coefficient(&dual, p, &v, 0).norm_squared() + path.coefficient(&dual, p, &h, 0).norm_squared())
            .sum();
        let local = turn.transpose() * (rx - tx).normalize();
        let expected = 2.0 * corf_raytrace::radio::antenna::amplitude(pattern, local).powi(2);
        assert!((power / (free * free) / expected - 1.0).abs() < 1e-9, "{pattern:?}");
    }
    // A dipole along the line between the ends radiates nothing there.
    let along = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::Z);
    let up = tracer.paths(DVec3::ZERO, DVec3::Z).unwrap();
    assert!(up[0].coefficient(&antenna(AntennaPattern::Dipole, Polarization::V, along), 0, &v, 0).norm() < 1e-15);
}

#[test]
fn a_bounce_where_two_faces_meet_is_one_path() {
    let quad = |scene: &mut Scene, name: &str, corners: [[f32; 3]; 4]| {
        let (object, first) = (scene.objects.len() as u32, scene.positions.len() as u32);
        scene.objects.push(Object { name: name.into() });
        scene.positions.extend(corners.map(Vec3::from));
        scene.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| Triangle {
            vertices: t.map(|v| first + v),
            material: 0,
            object,
        }));
    };
    // Two floor tiles that share the line x = 1, and the diagonal of a tile through the origin of its own.
    let mut tiles = empty();
    tiles.materials = vec![material("tile", "concrete", 0.1)];
    quad(&mut tiles, "left", [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]);
    quad(&mut tiles, "right", [[1.0, -1.0, 0.0], [3.0, -1.0, 0.0], [3.0, 1.0, 0.0], [1.0, 1.0, 0.0]]);
    let tracer = RadioTracer::without_bvh(&tiles, RadioSettings::default()).unwrap();
    for (tx, rx) in [((0.5, 0.25, 1.0), (1.5, -0.25, 1.0)), ((-0.5, -0.5, 1.0), (0.5, 0.5, 1.0))] {
        let types: Vec<String> = tracer.paths(tx.into(), rx.into()).unwrap().iter().map(Path::types).collect();
        assert_eq!(types, ["", "S"]);
    }
    // Straight back into a corner: wall then floor and floor then wall are one way.
    let mut corner = empty();
    corner.materials = vec![material("wall", "concrete", 0.1)];
    quad(&mut corner, "floor", [[0.0, -2.0, 0.0], [4.0, -2.0, 0.0], [4.0, 2.0, 0.0], [0.0, 2.0, 0.0]]);
    quad(&mut corner, "wall", [[0.0, -2.0, 0.0], [0.0, 2.0, 0.0], [0.0, 2.0, 4.0], [0.0, -2.0, 4.0]]);
    let tracer = RadioTracer::without_bvh(&corner, RadioSettings::default()).unwrap();
    let paths = tracer.paths(DVec3::new(1.0, -0.5, 1.0), DVec3::new(2.0, 0.5, 2.0)).unwrap();
    assert_eq!(paths.iter().filter(|p| p.types() == "SS").count(), 1, "{paths:?}");
}

/// A chain of two faces that meet at an edge that sticks out is no way, though both bounces fall on the edge: no way beside it is one. Receivers
/// exactly across a box and a hair off that have the same paths.
#[test]
fn nothing_bounces_around_an_edge() {
    let mut scene = empty();
    scene.materials = vec![material("crate", "metal", 0.01)];
    add_box(&mut scene, "crate", 0, Vec3::new(-0.5, -1.0, 0.0), Vec3::new(0.5, 1.0, 2.0));
    let tracer = RadioTracer::without_bvh(&scene, RadioSettings::default()).unwrap();
    let types = |tx: DVec3, rx: DVec3| tracer.paths(tx, rx).unwrap().iter().map(Path::types).collect::<Vec<_>>();
    for at in [DVec3::new(-2.0, 1.2, 1.0), DVec3::new(-2.0, 1.7, 2.6)] {
        let across = at.with_x(2.0);
        let exactly = types(at, across);
        for (dy, dz) in [(1e-6, 1e-6), (1e-6, -1e-6), (-1e-6, 1e-6), (-1e-6, -1e-6)] {
            assert_eq!(exactly, types(at, across + DVec3::new(0.0, dy, dz)), "{at} {dy} {dz}");
        }
    }
}

/// A way through the joint of two panels side by side goes through one of them; through two that lie on each other through both.
#[test]
fn a_joint_of_panels_is_one_slab() {
    let panels = |second: [f32; 2]| {
        let mut scene = empty();
        scene.materials = vec![material("left", "glass", 0.006), material("right", "glass", 0.006)];
        for (i, [from, to]) in [[-2.0, 0.0], second].into_iter().enumerate() {
            let first = scene.positions.len() as u32;
            scene.objects.push(Object { name: format!("panel {i}") });
            scene.positions.extend([[from, 0.0], [to, 0.0], [to, 3.0], [from, 3.0]].map(|[y, z]| Vec3::new(0.0, y, z)));
            let triangle = |t: [u32; 3]| Triangle { vertices: t.map(|v| first + v), material: i as u32, object: i as u32 };
            scene.triangles.extend([[0, 1, 2], [0, 2, 3]].map(triangle));
        }
        let tracer = RadioTracer::without_bvh(&scene, RadioSettings { max_interactions: 2, ..RadioSettings::default() }).unwrap();
        [0.0, -0.1].map(|y| tracer.paths(DVec3::new(-1.0, y, 1.0), DVec3::new(1.0, y, 1.0)).unwrap().remove(0))
    };
    let [joint, beside] = panels([0.0, 2.0]);
    assert_eq!((joint.types(), beside.types()), ("R".into(), "R".into()));
    assert!((joint.a - beside.a).norm() < 1e-12 * beside.a.norm());
    assert_eq!(panels([-1.0, 2.0])[0].types(), "RR");
}

#[test]
fn places_on_surfaces_are_refused_and_places_in_their_planes_are_not() {
    let scene = room();
    let tracer = RadioTracer::without_bvh(&scene, RadioSettings::default()).unwrap();
    let free = DVec3::new(1.0, 1.5, 2.0);
    let on_the_box = DVec3::new(2.75, 1.5, 1.25);
    for error in [tracer.paths(on_the_box, free).unwrap_err(), tracer.paths(free, on_the_box).unwrap_err()] {
        assert!(error.to_string().contains("box_zmax"), "{error}");
    }
    // At the height of the box's top but beside it: the top reflects nothing, the rest does.
    let level = tracer.paths(DVec3::new(1.0, 3.0, 1.25), DVec3::new(1.5, 4.0, 1.0)).unwrap();
    assert!(level.len() > 10 && level.iter().all(|p| p.a.norm().is_finite() && p.length_m.is_finite()));
    // Half a millimetre before a wall: the bounce is there and finite, the direct way is hardly shorter.
    let near = tracer.paths(DVec3::new(5e-4, 1.5, 2.0), free).unwrap();
    assert!((near[1].length_m - near[0].length_m).abs() < 2e-3 && near[1].types() == "S");
}

#[test]
fn more_than_64_triangles_take_the_hierarchy_and_change_nothing() {
    let mut scene = room();
    for i in 0..5 {
        let at = Vec3::new(0.5 + i as f32, 4.2, 0.0);
        add_box(&mut scene, &format!("crate{i}"), 1, at, at + Vec3::new(0.4, 0.4, 0.7));
    }
    let bvh = Bvh::build(&scene);
    let setup = RadioSettings { max_interactions: 2, ..settings(Search::Exhaustive) };
    let (brute, fast) = (RadioTracer::without_bvh(&scene, setup).unwrap(), RadioTracer::new(&scene, &bvh, setup).unwrap());
    let (tx, rx) = (DVec3::new(1.0, 1.5, 2.0), DVec3::new(4.7, 3.9, 1.1));
    assert_eq!(brute.paths(tx, rx).unwrap(), fast.paths(tx, rx).unwrap());
}

#[test]
fn a_thin_lossless_screen_takes_nothing_and_a_metal_one_everything() {
    let screen = |material: Material| {
        let mut scene = empty();
        scene.materials = vec![material];
        scene.objects = vec![Object { name: "screen".into() }];
        scene.positions = vec![Vec3::new(2.0, -9.0, -9.0), Vec3::new(2.0, 9.0, -9.0), Vec3::new(2.0, 0.0, 9.0)];
        scene.triangles = vec![Triangle { vertices: [0, 1, 2], material: 0, object: 0 }];
        scene
    };
    let mut film = material("film", "glass", 1e-9);
    if let Some(radio) = &mut film.radio {
        radio.permittivity = Permittivity::Constant { relative_permittivity: 2.0, conductivity_s_per_m: 0.0 };
    }
    let (tx, rx) = (DVec3::ZERO, DVec3::new(5.0, 0.0, 0.0));
    let film = screen(film);
    let paths = RadioTracer::without_bvh(&film, RadioSettings::default()).unwrap().paths(tx, rx).unwrap();
    assert_eq!((paths.len(), paths[0].types().as_str()), (1, "R"));
    let free = SPEED_OF_LIGHT / 60e9 / (4.0 * std::f64::consts::PI * 5.0);
    assert!((paths[0].a.norm() / free - 1.0).abs() < 1e-6);
    let metal = screen(material("metal", "metal", 0.001));
    assert!(RadioTracer::without_bvh(&metal, RadioSettings::default()).unwrap().paths(tx, rx).unwrap().is_empty());
}

#[test]
fn errors_say_what_is_wrong() {
    let mut scene = room();
    let tracer = RadioTracer::without_bvh(&scene, RadioSettings::default()).unwrap();
    let p = DVec3::ONE;
    assert!(tracer.paths(p, p).unwrap_err().to_string().contains("coincides"));
    assert!(tracer.paths(p, DVec3::NAN).is_err());
    scene.materials[1].radio = None;
    let message = RadioTracer::without_bvh(&scene, RadioSettings::default()).err().unwrap().to_string();
    assert!(message.contains("box") && message.contains("radio_materials"), "{message}");
    let deep = RadioSettings { max_interactions: 6, ..RadioSettings::default() };
    assert!(RadioTracer::without_bvh(&empty(), deep).err().unwrap().to_string().contains("max_interactions"));
}
