//! The quadrature that the gathering is measured by.

use super::*;

#[test]
fn quadrature_finds_the_outlines_of_shadows() {
    // A board on a shelf, taller than the lamp and longer than the shelf: beyond it all is dark.
    let edge = 0.1;
    let mut scene = Scene {
        materials: vec![
            material("wood", 0.04, scatters(0.7, ScatteringPattern::Directive { alpha_r: 3 })),
            material("metal", 0.01, scatters(0.0, ScatteringPattern::Lambertian)),
        ],
        ..Scene::default()
    };
    quad(&mut scene, 0, Vec3::new(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y);
    quad(&mut scene, 1, Vec3::new(edge as f32, -3.0, 0.0), Vec3::Y * 6.0, Vec3::Z * 4.0);
    let tracer = RadioTracer::without_bvh(&scene, settings(1)).unwrap();
    let (tx, rx) = (DVec3::new(-0.2, -0.1, 0.5), DVec3::new(-2.0, 0.2, 0.7));
    let slab = tracer.geometry().slabs[0].clone().unwrap();
    let n = 400;
    let mut expected = 0.0;
    for i in 0..n * n {
        let p = DVec3::new((0.5 + (i % n) as f64) / n as f64 * (0.5 + edge) - 0.5, (0.5 + (i / n) as f64) / n as f64 - 0.5, 0.0);
        let (k, out) = ((p - tx).normalize(), (rx - p).normalize());
        let received = scattered(&slab, k, antenna::theta_hat(k), DVec3::Z, out);
        expected += received / (tx.distance_squared(p) * rx.distance_squared(p));
    }
    expected *= (SPEED_OF_LIGHT / 60e9 / (4.0 * std::f64::consts::PI) / n as f64).powi(2) * (0.5 + edge);
    let field = DiffuseField::new(&tracer, tx, &DiffuseSettings { photons: 0, ..sampling() }).unwrap();
    let found = field.by_quadrature(rx).unwrap().straight.remove(0);
    assert!((found[0] / expected - 1.0).abs() < 1e-4 && found[1] == 0.0, "{found:?} {expected:e}");
}

#[test]
fn quadrature_and_gathering_agree_by_object() {
    let mut scene = room(material("plasterboard", 0.013, scatters(0.5, ScatteringPattern::Lambertian)), Vec3::new(5.0, 4.0, 3.0));
    // A leaning plank, a shelf, and a thin bar that shades both.
    quad(&mut scene, 0, Vec3::new(2.0, 1.5, 0.1), Vec3::new(0.6, 0.3, 0.0), Vec3::new(-0.1, 0.2, 1.5));
    quad(&mut scene, 0, Vec3::new(3.2, 2.1, 1.0), Vec3::X * 0.9, Vec3::Y * 0.4);
    quad(&mut scene, 0, Vec3::new(1.5, 1.4, 1.9), Vec3::new(2.5, 0.7, 0.1), Vec3::Z * 0.05);
    let tracer = RadioTracer::without_bvh(&scene, RadioSettings { transmission: false, ..settings(2) }).unwrap();
    let (tx, rx) = (DVec3::new(0.7, 0.6, 2.6), DVec3::new(4.1, 0.9, 1.3));
    let field = DiffuseField::new(&tracer, tx, &DiffuseSettings { directions: 1_000_000, photons: 0, ..sampling() }).unwrap();
    let found = field.by_quadrature(rx).unwrap();
    let contributions = field.contributions(rx).unwrap();
    for (mirrored_before, found, tolerance) in [(false, &found.straight[0], 4e-3), (true, &found.mirrored, 1e-2)] {
        let mut compared = 0;
        for (object, found) in found.iter().enumerate() {
            let belongs = |c: &Contribution| c.object as usize == object && c.mirrored_before == mirrored_before && c.after == 0;
            let gathered: f64 = contributions.iter().filter(|(_, c)| belongs(c)).map(|(_, c)| c.power).sum();
            assert!(
                (found - gathered).abs() <= tolerance * gathered,
                "object {object}, {mirrored_before}: {found:e} {gathered:e}"
            );
            compared += usize::from(gathered > 0.0);
        }
        assert!(compared >= 8, "{compared}");
    }
}
