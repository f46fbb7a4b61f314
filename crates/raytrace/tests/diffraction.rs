//! Diffraction against exact solutions and the truths that any diffracted field obeys.

#![allow(clippy::unwrap_used)]

use corf_raytrace::Bvh;
use corf_raytrace::radio::{Antenna, Complex, DiffractionModel, Path, Polarization, RadioSettings, RadioTracer, Search};
use corf_scene::model::{LightMaterial, Material, Object, Permittivity, RadioMaterial, Scattering, Scene, Triangle};
use glam::{DVec3, Vec3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Conductivity of the tests' conductor, S/m: |1 + r_TE| and |1 − r_TM| stay below 1e-6.
const CONDUCTOR_S_PER_M: f64 = 1e16;

fn slab(name: &str, relative_permittivity: f64, conductivity_s_per_m: f64) -> Material {
    let radio = RadioMaterial {
        id: name.into(),
        permittivity: Permittivity::Constant { relative_permittivity, conductivity_s_per_m },
        thickness_m: 0.1,
        scattering: Scattering::default(),
    };
    Material { name: name.into(), light: LightMaterial::default(), radio: Some(radio) }
}

fn conductor() -> Material {
    slab("conductor", 1.0, CONDUCTOR_S_PER_M)
}

/// Adds an object of quads with shared corners.
fn add_quads(scene: &mut Scene, name: &str, material: u32, quads: &[[Vec3; 4]]) {
    let object = scene.objects.len() as u32;
    scene.objects.push(Object { name: name.into() });
    for quad in quads {
        let first = scene.positions.len() as u32;
        scene.positions.extend(quad);
        scene.normals.extend([Vec3::Z; 4]);
        scene.uvs.extend([[0.0; 2]; 4]);
        for t in [[0, 1, 2], [0, 2, 3]] {
            scene.triangles.push(Triangle { vertices: t.map(|v: u32| first + v), material, object });
        }
    }
}

/// The six sides of a box.
fn box_quads(min: Vec3, max: Vec3) -> Vec<[Vec3; 4]> {
    let mut quads = Vec::new();
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for at in [min[axis], max[axis]] {
            quads.push([[min[u], min[v]], [max[u], min[v]], [max[u], max[v]], [min[u], max[v]]].map(|[a, b]| {
                let mut p = Vec3::ZERO;
                (p[axis], p[u], p[v]) = (at, a, b);
                p
            }));
        }
    }
    quads
}

fn scene_of(material: Material, quads: &[[Vec3; 4]]) -> Scene {
    let mut scene = Scene { name: "test".into(), materials: vec![material], ..Scene::default() };
    add_quads(&mut scene, "body", 0, quads);
    scene
}

/// The half-plane y = 0, x > 0; its edge is the z axis.
fn half_plane(material: Material) -> Scene {
    let (x, z) = (60.0, 30.0);
    let quad = [Vec3::new(0.0, 0.0, -z), Vec3::new(x, 0.0, -z), Vec3::new(x, 0.0, z), Vec3::new(0.0, 0.0, z)];
    scene_of(material, &[quad])
}

fn settings() -> RadioSettings {
    RadioSettings {
        max_interactions: 1,
        transmission: false,
        diffraction: true,
        edge_diffraction: true,
        search: Search::Exhaustive,
        ..RadioSettings::default()
    }
}

/// Point of the plane z = 0 at an azimuth about the z axis.
fn polar(radius_m: f64, azimuth_rad: f64) -> DVec3 {
    DVec3::new(radius_m * azimuth_rad.cos(), radius_m * azimuth_rad.sin(), 0.0)
}

/// Whether a path comes by the z axis or has no edge at all.
fn by_the_axis(path: &Path) -> bool {
    path.interactions.iter().all(|i| i.kind.letter() != 'X' || i.vertex.x.hypot(i.vertex.y) < 1e-9)
}

/// Total scalar field: E_z for polarisation 0, H_z (in units of E) for 1; for horizontal rays θ̂ is −ẑ and φ̂ of the arrival is the
/// negative of that of propagation.
fn total(paths: &[Path], polarization: usize, frequency_hz: f64) -> Complex {
    let sign = [1.0, -1.0][polarization];
    paths.iter().filter(|p| by_the_axis(p)).fold(Complex::ZERO, |sum, p| {
        let phase = -TAU * (frequency_hz * p.delay_s).fract();
        sum + p.transfer[polarization][polarization] * Complex::new(0.0, phase).exp() * sign
    })
}

/// ∫_{−a}^∞ e^{−jτ²}dτ by Simpson's rule up to 0 and the known value from there.
fn fresnel_from(minus_a: f64) -> Complex {
    let f = |t: f64| Complex::new(0.0, -t * t).exp();
    let n = 40_000;
    let h = -minus_a / n as f64;
    let mut sum = f(minus_a) + f(0.0);
    for i in 1..n {
        sum = sum + f(minus_a + h * i as f64) * if i % 2 == 1 { 4.0 } else { 2.0 };
    }
    sum * (h / 3.0) + Complex::new(0.0, -FRAC_PI_4).exp() * (0.5 * PI.sqrt())
}

/// Sommerfeld's exact field behind and before a conducting half-plane for a plane wave of unit amplitude at the edge.
fn sommerfeld(wavenumber: f64, rho: f64, phi: f64, phi_in: f64, hard: bool) -> Complex {
    let wave = |angle: f64| {
        let a = (2.0 * wavenumber * rho).sqrt() * (0.5 * angle).cos();
        let carrier = Complex::new(0.0, wavenumber * rho * angle.cos()).exp();
        carrier * fresnel_from(-a) * (Complex::new(0.0, FRAC_PI_4).exp() * (1.0 / PI.sqrt()))
    };
    let reflected = wave(phi + phi_in);
    wave(phi - phi_in) + if hard { reflected } else { -reflected }
}

/// A source at 1e7 m is plane to a phase of kρ²/2s′ = 6e-5 at 1 m, twice with the reflected wave; the conductor, Simpson's rule and f64 delays leave
/// less.
const PLANE_WAVE: f64 = 2e-4;

#[test]
fn a_conducting_half_plane_has_the_exact_field() {
    let scene = half_plane(conductor());
    let tracer = RadioTracer::without_bvh(&scene, settings()).unwrap();
    let (frequency_hz, wavelength_m) = (tracer.settings().frequency_hz, tracer.settings().wavelength_m());
    let source_m = 1e7;
    for phi_in in [0.4, 1.1, 2.3] {
        let tx = polar(source_m, phi_in);
        let transmitter = tracer.transmitter(tx).unwrap();
        let amplitude = wavelength_m / (4.0 * PI * source_m);
        let at_edge = Complex::new(0.0, -TAU * (frequency_hz * source_m / 299_792_458.0).fract()).exp() * amplitude;
        for rho in [0.02, 0.3, 1.0] {
            for step in 0..40 {
                let phi = 0.03 + (TAU - 0.06) * step as f64 / 39.0;
                let paths = transmitter.paths(polar(rho, phi)).unwrap();
                for (polarization, hard) in [(0, false), (1, true)] {
                    let found = total(&paths, polarization, frequency_hz) / at_edge;
                    let exact = sommerfeld(TAU / wavelength_m, rho, phi, phi_in, hard);
                    assert!(
                        (found - exact).norm() < PLANE_WAVE,
                        "phi' {phi_in}, rho {rho}, phi {phi}, hard {hard}: {found:?} {exact:?}"
                    );
                }
            }
        }
    }
}

/// Step over a boundary, radians; a continuous field changes by about k·L·step over it.
const STEP_RAD: f64 = 1e-7;
/// The field's own change over a step at 3 m is 1e-3 of it; a boundary that is not compensated jumps by some tenths.
const CONTINUOUS: f64 = 5e-3;

#[test]
fn the_field_is_continuous_across_shadow_and_reflection_boundaries() {
    // A long bar, x > 0 and y < 0, whose edge is the z axis.
    let bar = box_quads(Vec3::new(0.0, -20.0, -40.0), Vec3::new(20.0, 0.0, 40.0));
    for material in [conductor(), slab("wood", 1.99, 0.378), slab("glass", 6.31, 0.867)] {
        let scene = scene_of(material, &bar);
        let tracer = RadioTracer::without_bvh(&scene, settings()).unwrap();
        let frequency_hz = tracer.settings().frequency_hz;
        // Azimuths from the top face y = 0; the other face is at 3π/2. One source lights the top alone, the other both faces.
        for (phi_in, boundaries) in [(1.0, vec![PI - 1.0, PI + 1.0]), (2.2, vec![PI - 2.2, 3.0 * PI - PI - 2.2])] {
            let transmitter = tracer.transmitter(polar(5.0, phi_in)).unwrap();
            for boundary in boundaries {
                for height in [0.0, 1.7] {
                    let field = |phi: f64| {
                        let paths = transmitter.paths(polar(3.0, phi) + DVec3::Z * height).unwrap();
                        assert!(paths.iter().any(|p| p.types() == "X"));
                        let kinds = paths.iter().filter(|p| by_the_axis(p)).count();
                        ([0, 1].map(|polarization| total(&paths, polarization, frequency_hz)), kinds)
                    };
                    let ((before, n), (after, m)) = (field(boundary - STEP_RAD), field(boundary + STEP_RAD));
                    assert_ne!(n, m, "no path ends at {boundary}");
                    for i in 0..2 {
                        let scale = tracer.settings().wavelength_m() / (4.0 * PI * 8.0);
                        assert!((before[i] - after[i]).norm() < CONTINUOUS * scale, "{boundary} {:?} {:?}", before[i], after[i]);
                    }
                }
            }
        }
    }
}

#[test]
fn conducting_edges_are_reciprocal() {
    for scene in
        [half_plane(conductor()), scene_of(conductor(), &box_quads(Vec3::new(0.0, -2.0, -4.0), Vec3::new(2.0, 0.0, 4.0)))]
    {
        let tracer = RadioTracer::without_bvh(&scene, settings()).unwrap();
        let (a, b) = (DVec3::new(1.2, 1.5, 0.7), DVec3::new(-0.8, -1.9, -1.1));
        let (there, back) = (tracer.paths(a, b).unwrap(), tracer.paths(b, a).unwrap());
        assert!(there.iter().any(|p| p.types() == "X") && there.len() == back.len());
        for (p, q) in there.iter().zip(&back) {
            // φ̂ of a direction is minus that of its reverse: the off-diagonal entries change sign when both ends are exchanged once.
            for i in 0..2 {
                for j in 0..2 {
                    assert!((p.transfer[i][j] - q.transfer[j][i]).norm() < 1e-6 * p.a.norm(), "{} {p:?} {q:?}", p.types());
                }
            }
        }
    }
}

/// ITU-R P.526's approximation of the knife edge is good to about this, dB; a conducting screen departs from it off grazing.
const KNIFE_EDGE_DB: f64 = 0.4;

#[test]
fn a_screen_at_grazing_angles_is_the_knife_edge_of_p526() {
    let scene = half_plane(conductor());
    let tracer = RadioTracer::without_bvh(&scene, settings()).unwrap();
    let wavelength_m = tracer.settings().wavelength_m();
    let (d1, d2) = (20.0f64, 15.0f64);
    for v in [-0.5, 0.0, 0.5, 1.0, 2.0] {
        // Both ends h below the edge's level would see it at v = h·√(2(d₁ + d₂)/(λd₁d₂)).
        let h: f64 = v / (2.0 * (d1 + d2) / (wavelength_m * d1 * d2)).sqrt();
        let (tx, rx) = (DVec3::new(h, d1, 0.0), DVec3::new(h, -d2, 0.0));
        let paths = tracer.paths(tx, rx).unwrap();
        let free = wavelength_m / (4.0 * PI * tx.distance(rx));
        let loss_db = -20.0 * (total(&paths, 0, tracer.settings().frequency_hz).norm() / free).log10();
        let shifted: f64 = v - 0.1;
        let p526_db = 6.9 + 20.0 * ((shifted * shifted + 1.0).sqrt() + shifted).log10();
        assert!((loss_db - p526_db).abs() < KNIFE_EDGE_DB, "v = {v}: {loss_db:.2} dB, P.526 {p526_db:.2} dB");
    }
}

#[test]
fn a_box_has_twelve_wedges_and_a_room_diffracts_nothing() {
    let quads = box_quads(Vec3::ZERO, Vec3::new(2.0, 1.0, 0.5));
    let closed = scene_of(conductor(), &quads);
    let tracer = RadioTracer::without_bvh(&closed, settings()).unwrap();
    assert_eq!(tracer.wedges().len(), 12);
    assert!(tracer.wedges().iter().all(|w| (w.exterior_angle_rad - 1.5 * PI).abs() < 1e-12 && !w.is_screen()));
    // From inside all edges are concave.
    let inside = tracer.paths(DVec3::new(0.3, 0.3, 0.2), DVec3::new(1.7, 0.8, 0.3)).unwrap();
    assert!(inside.len() == 7 && inside.iter().all(|p| !p.types().contains('X')));
    // Without its lid four of the wedges are gone and four open edges there instead.
    let open = scene_of(conductor(), &quads[..5]);
    let count = |edge_diffraction: bool| {
        let settings = RadioSettings { edge_diffraction, ..settings() };
        RadioTracer::without_bvh(&open, settings).unwrap().wedges().len()
    };
    assert_eq!((count(false), count(true)), (8, 12));
    // Diffraction off: no edges at all.
    let off = RadioSettings { diffraction: false, ..settings() };
    assert!(RadioTracer::without_bvh(&closed, off).unwrap().wedges().is_empty());
}

/// Sheets laid of panels, cut at T-junctions and with hairline gaps, diffract like the sheet of one quad: their seams are no edges, and the
/// edge that they share goes on through them.
#[test]
fn seams_of_panels_are_no_edges() {
    let panel =
        |y: [f32; 2], z: [f32; 2]| [[y[0], z[1]], [y[0], z[0]], [y[1], z[0]], [y[1], z[1]]].map(|[y, z]| Vec3::new(0.0, y, z));
    let gain = |panels: &[[Vec3; 4]], objects: bool| {
        let mut scene = Scene { name: "sheet".into(), materials: vec![conductor()], ..Scene::default() };
        match objects {
            true => panels.iter().enumerate().for_each(|(i, quad)| add_quads(&mut scene, &format!("panel{i}"), 0, &[*quad])),
            false => add_quads(&mut scene, "sheet", 0, panels),
        }
        let tracer = RadioTracer::without_bvh(&scene, settings()).unwrap();
        // The second pair's point on the edge is where the sheets' seams begin, at z = 0.
        [(-0.3, -0.3), (0.5, -0.5)].map(|(below, above)| {
            let paths = tracer.paths(DVec3::new(-5.0, 0.1, below), DVec3::new(5.0, 0.5, above)).unwrap();
            total(&paths, 0, tracer.settings().frequency_hz).norm()
        })
    };
    let one = gain(&[panel([-20.0, 0.0], [-20.0, 20.0])], false);
    let rows = [[-20.0, -10.0], [-10.0, 0.0], [0.0, 10.0], [10.0, 20.0]];
    let tiles: Vec<[Vec3; 4]> =
        (0..16).map(|i| panel([-20.0 + 5.0 * (i % 4) as f32, -15.0 + 5.0 * (i % 4) as f32], rows[i / 4])).collect();
    let junction = [panel([-20.0, 0.0], [0.0, 20.0]), panel([-20.0, -10.0], [-20.0, 0.0]), panel([-10.0, 0.0], [-20.0, 0.0])];
    let gap = [panel([-20.0, 0.0], [-1.0, 20.0]), panel([-20.0, 0.0], [-20.0, -1.00001])];
    let overlap = [panel([-20.0, 0.0], [-1.01, 20.0]), panel([-20.0, 0.0], [-20.0, -1.0]), panel([-9.0, 0.0], [-3.0, 5.0])];
    let whole = panel([-20.0, 0.0], [-20.0, 20.0]);
    let poster = [whole, panel([-2.0, -1.0], [-1.0, 1.0]), panel([-3.0, 0.0], [-0.7, 0.4])];
    for (panels, objects, rounding) in [
        (&tiles[..], true, 1e-9),
        (&tiles[..], false, 1e-9),
        (&junction, true, 1e-9),
        (&junction, false, 1e-9),
        (&gap, true, 1e-4),
        // By a centimetre, and by a half of one within the other; a smaller one within, and one flush with the edge.
        (&overlap, true, 1e-9),
        (&overlap, false, 1e-9),
        (&poster, true, 1e-9),
        (&poster, false, 1e-9),
    ] {
        for (found, expected) in gain(panels, objects).into_iter().zip(one) {
            assert!((found / expected - 1.0).abs() < rounding, "{} panels, {objects}: {found:e}, {expected:e}", panels.len());
        }
    }
}

/// Sheets of the plane x = 0 by their corners (y, z), one object each, and the material of each.
fn sheets(pieces: &[(Vec<[f64; 2]>, u32)]) -> Scene {
    let materials = vec![conductor(), slab("glass", 6.31, 0.867)];
    let mut scene = Scene { name: "sheets".into(), materials, ..Scene::default() };
    for (i, (corners, material)) in pieces.iter().enumerate() {
        let object = i as u32;
        scene.objects.push(Object { name: format!("piece{i}") });
        let first = scene.positions.len() as u32;
        scene.positions.extend(corners.iter().map(|[y, z]| Vec3::new(0.0, *y as f32, *z as f32)));
        scene.normals.extend(corners.iter().map(|_| Vec3::X));
        scene.uvs.extend(corners.iter().map(|_| [0.0; 2]));
        for k in 2..corners.len() as u32 {
            let vertices = [first, first + k - 1, first + k];
            scene.triangles.push(Triangle { vertices, material: *material, object });
        }
    }
    scene
}

/// A rectangle of sides `size` about `centre`, turned by an angle.
fn rectangle(centre: [f64; 2], size: [f64; 2], turn_rad: f64) -> Vec<[f64; 2]> {
    let (sin, cos) = turn_rad.sin_cos();
    [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]
        .map(|[u, v]| [u * size[0], v * size[1]])
        .map(|[u, v]| [centre[0] + cos * u - sin * v, centre[1] + sin * u + cos * v])
        .to_vec()
}

/// Length of all edges that diffract, metres, by the list of all triangles and by the hierarchy.
fn edges_m(scene: &Scene) -> f64 {
    let length = |tracer: RadioTracer<'_>| tracer.wedges().iter().flat_map(|w| &w.spans).map(|[u, v]| v - u).sum::<f64>();
    let bvh = Bvh::build(scene);
    let [one, other] =
        [RadioTracer::without_bvh(scene, settings()), RadioTracer::new(scene, &bvh, settings())].map(|t| length(t.unwrap()));
    assert!((one - other).abs() < 1e-9, "{one} {other}");
    one
}

/// float32 corners at some metres, over a dozen edges.
const PERIMETER_M: f64 = 2e-5;

#[test]
fn the_edge_of_sheets_in_one_plane_is_the_border_of_them_all() {
    let star = 16.0 * (2.0 - 2f64.sqrt());
    let at_45 = FRAC_PI_4;
    // Outer and inner border of a frame of four bars that lie on each other at its corners.
    let frame: Vec<Vec<[f64; 2]>> = [-1.5, 1.5]
        .into_iter()
        .flat_map(|c| [rectangle([c, 0.0], [1.0, 4.0], 0.0), rectangle([0.0, c], [4.0, 1.0], 0.0)])
        .collect();
    type Case = (&'static str, Vec<Vec<[f64; 2]>>, f64);
    let cases: Vec<Case> = vec![
        ("one", vec![rectangle([0.0; 2], [3.0, 2.0], 0.3)], 10.0),
        ("twice", vec![rectangle([0.0; 2], [3.0, 2.0], 0.3); 2], 10.0),
        ("inset", vec![rectangle([0.0; 2], [3.0, 2.0], 0.3), rectangle([0.2, 0.1], [1.0, 0.5], 0.7)], 10.0),
        ("flush", vec![rectangle([0.0; 2], [3.0, 2.0], 0.0), rectangle([-1.0, 0.0], [1.0, 1.0], 0.0)], 10.0),
        ("overlap", vec![rectangle([0.0; 2], [2.0, 2.0], 0.0), rectangle([1.5, 0.5], [2.0, 2.0], 0.0)], 8.0 + 8.0 - 4.0),
        ("cross", vec![rectangle([0.0; 2], [4.0, 1.0], 0.4), rectangle([0.0; 2], [1.0, 3.0], 0.4)], 14.0),
        ("star", vec![rectangle([0.0; 2], [2.0, 2.0], 0.0), rectangle([0.0; 2], [2.0, 2.0], at_45)], star),
        ("frame", frame, 16.0 + 8.0),
        ("beside", vec![rectangle([0.0; 2], [2.0, 4.0], 0.0), rectangle([2.0, 0.5], [2.0, 1.0], 0.0)], 12.0 + 6.0 - 2.0),
        ("corners", vec![rectangle([0.0; 2], [2.0, 2.0], 0.0), rectangle([2.0, 2.0], [2.0, 2.0], 0.0)], 16.0),
        ("apart", vec![rectangle([0.0; 2], [2.0, 2.0], 0.0), rectangle([2.001, 0.0], [2.0, 2.0], 0.0)], 16.0),
        ("chain", (0..4).map(|i| rectangle([f64::from(i) * 0.9, 0.0], [1.0, 1.0], 0.0)).collect(), 2.0 * (3.0 * 0.9 + 1.0) + 2.0),
    ];
    for (name, pieces, expected) in cases {
        for (turned, glass) in [(false, 0), (true, 0), (false, 1), (true, 1)] {
            // Every second piece wound the other way, and its diagonal elsewhere; of another material.
            let of_piece = |(i, corners): (usize, &Vec<[f64; 2]>)| {
                let mut corners = corners.clone();
                if turned && i % 2 == 1 {
                    corners.reverse();
                    corners.rotate_left(1);
                }
                (corners, if i % 2 == 1 { glass } else { 0 })
            };
            let mut scene = sheets(&pieces.iter().enumerate().map(of_piece).collect::<Vec<_>>());
            let found = edges_m(&scene);
            assert!((found - expected).abs() < PERIMETER_M, "{name}, {turned}, {glass}: {found} m, not {expected} m");
            // As one object, and so as one face where it is of one material.
            scene.triangles.iter_mut().for_each(|t| t.object = 0);
            let found = edges_m(&scene);
            assert!((found - expected).abs() < PERIMETER_M, "{name} as one object, {turned}, {glass}: {found} m");
            // Out of the plane by as much as float32 leaves at ten metres, in one piece.
            if let Some(last) = scene.positions.last_mut() {
                last.x += 2e-6;
            }
            let found = edges_m(&scene);
            assert!((found - expected).abs() < PERIMETER_M, "{name} bent, {turned}, {glass}: {found} m");
        }
    }
}

/// A sheet of many small pieces, on another of many: more triangles than are tried one by one.
#[test]
fn the_edge_of_many_pieces_is_the_border_of_them_all() {
    let tiles = |n: i32, size: f64, at: [f64; 2], turn_rad: f64| {
        let (sin, cos) = turn_rad.sin_cos();
        (0..n * n).map(move |i| {
            let [u, v] = [f64::from(i % n) + 0.5, f64::from(i / n) + 0.5].map(|k| k * size - 0.5 * size * f64::from(n));
            (rectangle([at[0] + cos * u - sin * v, at[1] + sin * u + cos * v], [size, size], turn_rad), 0)
        })
    };
    let laid_over = |at, turn_rad| sheets(&tiles(6, 0.5, [0.0; 2], 0.0).chain(tiles(7, 0.3, at, turn_rad)).collect::<Vec<_>>());
    // Within, whichever way it is turned, and over a side by 0.6 m.
    for (at, turn_rad, expected) in [([0.0; 2], 0.0, 12.0), ([0.02, -0.01], 0.6, 12.0), ([1.05, 0.0], 0.0, 12.0 + 1.2)] {
        let found = edges_m(&laid_over(at, turn_rad));
        assert!((found - expected).abs() < PERIMETER_M, "{at:?}, {turn_rad}: {found} m, not {expected} m");
    }
}

/// A plate that goes on from a box's top takes that edge from it, as far as it lies there; what lies on the top takes nothing.
#[test]
fn a_sheet_level_with_a_face_goes_on_from_it() {
    let solid_m = |extra: &[[f32; 4]]| {
        let mut scene = scene_of(conductor(), &box_quads(Vec3::new(-1.0, -1.0, 0.0), Vec3::ONE));
        for [x0, x1, y0, y1] in extra {
            let quad = [[*x0, *y0], [*x1, *y0], [*x1, *y1], [*x0, *y1]].map(|[x, y]| Vec3::new(x, y, 1.0));
            add_quads(&mut scene, "plate", 0, &[quad]);
        }
        let tracer = RadioTracer::without_bvh(&scene, settings()).unwrap();
        let solid = tracer.wedges().iter().filter(|w| !w.is_screen());
        solid.flat_map(|w| &w.spans).map(|[u, v]| v - u).sum::<f64>()
    };
    let whole = solid_m(&[]);
    assert!((whole - 20.0).abs() < PERIMETER_M, "{whole}");
    for (plate, expected) in [([-0.5, 0.5, -0.5, 0.5], 20.0), ([0.5, 1.5, -0.25, 0.75], 19.0), ([1.0, 2.0, -3.0, 3.0], 18.0)] {
        let found = solid_m(&[plate]);
        assert!((found - expected).abs() < PERIMETER_M, "{plate:?}: {found}");
    }
}

/// A box of six objects diffracts like one of one mesh.
#[test]
fn a_box_of_six_objects_has_the_edges_of_one() {
    let quads = box_quads(Vec3::new(-0.5, -1.0, 0.0), Vec3::new(0.5, 1.0, 2.0));
    let mut of_objects = Scene { name: "six".into(), materials: vec![conductor()], ..Scene::default() };
    quads.iter().enumerate().for_each(|(i, quad)| add_quads(&mut of_objects, &format!("side{i}"), 0, &[*quad]));
    let of_one = scene_of(conductor(), &quads);
    let (tx, rx) = (DVec3::new(-2.0, 0.2, 1.3), DVec3::new(0.2, 1.8, 1.1));
    let [six, one] = [of_objects, of_one].map(|scene| {
        let tracer = RadioTracer::without_bvh(&scene, settings()).unwrap();
        assert_eq!(tracer.wedges().iter().filter(|wedge| !wedge.is_screen()).count(), 12);
        tracer.paths(tx, rx).unwrap().iter().map(|path| (path.types(), path.a)).collect::<Vec<_>>()
    });
    assert!(one.iter().filter(|(types, _)| types == "X").count() >= 1, "{one:?}");
    assert_eq!(six, one);
}

/// A crate on the floor of a room.
fn furnished(material: Material) -> Scene {
    let mut scene = Scene { name: "furnished".into(), materials: vec![slab("wall", 2.73, 0.398), material], ..Scene::default() };
    for (i, quad) in box_quads(Vec3::ZERO, Vec3::new(6.0, 5.0, 3.0)).into_iter().enumerate() {
        add_quads(&mut scene, &format!("wall{i}"), 0, &[quad]);
    }
    add_quads(&mut scene, "crate", 1, &box_quads(Vec3::new(2.0, 2.0, 0.0), Vec3::new(3.0, 3.0, 1.5)));
    add_quads(&mut scene, "shelf", 1, &box_quads(Vec3::new(4.0, 0.5, 1.0), Vec3::new(5.0, 0.75, 2.5)));
    scene
}

#[test]
fn edges_flush_with_the_floor_do_not_diffract() {
    let scene = furnished(conductor());
    let tracer = RadioTracer::without_bvh(&scene, settings()).unwrap();
    let paths = tracer.paths(DVec3::new(1.0, 1.1, 1.2), DVec3::new(4.2, 3.9, 0.8)).unwrap();
    let edges: Vec<DVec3> =
        paths.iter().flat_map(|p| &p.interactions).filter(|i| i.kind.letter() == 'X').map(|i| i.vertex).collect();
    assert!(!edges.is_empty() && edges.iter().all(|v| v.z > 0.0), "{edges:?}");
}

#[test]
fn the_lattice_finds_the_diffracted_paths_of_the_exhaustive_search() {
    let scene = furnished(slab("wood", 1.99, 0.378));
    let bvh = Bvh::build(&scene);
    let deep = RadioSettings { max_interactions: 3, transmission: true, edge_diffraction: false, ..settings() };
    let oracle = RadioTracer::without_bvh(&scene, deep).unwrap();
    let lattice = RadioSettings { search: Search::Lattice { rays: 200_000 }, ..deep };
    let lattice = RadioTracer::new(&scene, &bvh, lattice).unwrap();
    let (tx, rx) = (DVec3::new(1.0, 1.1, 1.2), DVec3::new(4.2, 3.9, 0.8));
    let (all, found) = (oracle.paths(tx, rx).unwrap(), lattice.paths(tx, rx).unwrap());
    let diffracted = |paths: &[Path]| paths.iter().filter(|p| p.types().contains('X')).map(Path::power).sum::<f64>();
    assert!(all.iter().filter(|p| p.types().contains('X')).count() > 50);
    assert!(all.iter().any(|p| p.types() == "SXS"));
    // Exact where it finds a path, and what it misses is seen through slivers.
    assert!(found.iter().all(|p| all.contains(p)));
    assert!((diffracted(&found) / diffracted(&all) - 1.0).abs() < 1e-3, "{:e} of {:e}", diffracted(&found), diffracted(&all));
}

#[test]
fn the_shadow_alone_on_request() {
    let scene = half_plane(conductor());
    let only = RadioSettings { diffraction_lit_region: false, ..settings() };
    let tracer = RadioTracer::without_bvh(&scene, only).unwrap();
    let transmitter = tracer.transmitter(polar(4.0, FRAC_PI_2)).unwrap();
    let has_edge = |phi: f64| transmitter.paths(polar(2.0, phi)).unwrap().iter().any(|p| p.types() == "X" && by_the_axis(p));
    assert!(!has_edge(PI) && !has_edge(1.49 * PI) && has_edge(1.51 * PI));
}

/// float32 Fresnel and phase arithmetic at 60 GHz, relative to a path's strongest entry.
const SIONNA_FLOAT32: f64 = 3e-4;

#[test]
fn sionnas_model_gives_sionnas_numbers() {
    // sionna-rt 2.2.0, a crate of ITU wood 4 cm thick, VH to VH: per diffracted path its vertex and a[rx port][tx port].
    type Expected = ([f64; 3], [[[f64; 2]; 2]; 2]);
    let shadow: &[Expected] = &[
        (
            [0.0, 0.75, 0.762_417_9],
            [
                [[9.873_183_4e-6, -8.070_549_5e-6], [-7.473_450e-9, 8.111_792e-9]],
                [[-7.473_455e-9, 8.111_797e-9], [-9.781_346_3e-6, 7.962_880_8e-6]],
            ],
        ),
        (
            [1.0, 0.0, 0.736_068_0],
            [
                [[2.825_758_0e-7, -2.854_593_2e-7], [3.218_844e-9, -3.289_804e-9]],
                [[3.218_843e-9, -3.289_804e-9], [-2.549_336_7e-7, 2.538_332_4e-7]],
            ],
        ),
    ];
    let lit: &[Expected] = &[
        (
            [0.0, 0.0, 1.096_652_7],
            [
                [[-1.685_330_2e-5, 5.777_184_0e-6], [6.675_884e-7, -2.181_536e-7]],
                [[6.675_885e-7, -2.181_536e-7], [6.410_996_3e-6, -1.805_853_2e-6]],
            ],
        ),
        (
            [0.284_441_8, 0.0, 1.5],
            [
                [[3.086_289_6e-7, -2.830_458_6e-7], [7.569_628_9e-7, -7.503_992_9e-7]],
                [[1.125_739_5e-6, -1.172_925_6e-6], [-5.294_346_0e-7, 5.360_342_4e-7]],
            ],
        ),
        (
            [0.160_688_0, 0.0, 0.0],
            [
                [[2.536_167_5e-7, -2.578_307_8e-7], [-6.458_090e-8, 6.300_276e-8]],
                [[-1.242_227_5e-7, 1.317_254_7e-7], [-2.318_791_3e-7, 2.327_834_4e-7]],
            ],
        ),
        (
            [1.0, 0.0, 1.162_092_8],
            [
                [[-2.774_888_1e-6, 2.824_079_3e-6], [3.911_415e-8, -3.960_932e-8]],
                [[3.911_413e-8, -3.960_929e-8], [2.227_536_9e-6, -2.203_695_4e-6]],
            ],
        ),
    ];
    let mut wood = slab("wood", 1.99, 0.378_373_2);
    if let Some(radio) = &mut wood.radio {
        radio.thickness_m = 0.04;
    }
    let scene = scene_of(wood, &box_quads(Vec3::ZERO, Vec3::new(1.0, 0.75, 1.5)));
    let sionna = RadioSettings { diffraction_model: DiffractionModel::Sionna, edge_diffraction: false, ..settings() };
    let tracer = RadioTracer::without_bvh(&scene, sionna).unwrap();
    let transmitter = tracer.transmitter(DVec3::new(-1.25, -0.5, 1.0)).unwrap();
    let dual = Antenna { polarization: Polarization::VH, ..Antenna::default() };
    for (rx, expected) in [([1.5, 2.0, 0.5], shadow), ([2.0, -0.75, 1.25], lit)] {
        let paths = transmitter.paths(DVec3::from_array(rx)).unwrap();
        let diffracted: Vec<&Path> = paths.iter().filter(|p| p.types() == "X").collect();
        assert_eq!(diffracted.len(), expected.len());
        for (vertex, a) in expected {
            let near = |p: &&&Path| p.interactions[0].vertex.distance(DVec3::from_array(*vertex)) < 1e-4;
            let path = diffracted.iter().find(near).unwrap();
            let scale = a.iter().flatten().map(|[re, im]| re.hypot(*im)).fold(0.0, f64::max);
            for (r, row) in a.iter().enumerate() {
                for (t, [re, im]) in row.iter().enumerate() {
                    let found = path.coefficient(&dual, t, &dual, r);
                    let off = (found - Complex::new(*re, *im)).norm() / scale;
                    assert!(off < SIONNA_FLOAT32, "{vertex:?} {r}{t}: {found:?}, off by {off:.1e}");
                }
            }
        }
    }
}
