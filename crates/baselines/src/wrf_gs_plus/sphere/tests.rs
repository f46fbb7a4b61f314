#![allow(clippy::unwrap_used)]

use super::lens::Lens;
use super::loss::{level, loss, of_channels};
use super::raster::draw;
use crate::wrf_gs_plus::Shape;
use corf::device::Planes;
use corf::loss::ssim;
use corf_scene::Rng;
use corf_scene::dataset::FixedArray;

/// An array that is turned and does not stand at the origin.
fn array(azimuths: usize, elevations: usize) -> FixedArray {
    let q = glam::DQuat::from_euler(glam::EulerRot::ZYX, 0.7, 0.2, -0.3);
    FixedArray { position_m: [1.0, -2.0, 0.5], orientation_xyzw: [q.x, q.y, q.z, q.w], azimuths, elevations }
}

/// A round Gaussian at a direction of the array, 5 m away.
fn at(array: &FixedArray, azimuth_deg: f64, elevation_deg: f64, deviation_m: f64) -> Shape<f64> {
    let [x, y, z, w] = array.orientation_xyzw;
    let (a, e) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
    let direction = glam::DVec3::new(e.cos() * a.cos(), e.cos() * a.sin(), e.sin());
    let position = glam::DVec3::from(array.position_m) + glam::DQuat::from_xyzw(x, y, z, w) * (5.0 * direction);
    Shape {
        position: position.to_array(),
        rotation: [1.0, 0.0, 0.0, 0.0],
        log_scale: [deviation_m.ln(); 3],
        dc: [1.0, -0.5, 0.0],
    }
}

fn brightest(lens: &Lens, shape: Shape<f64>) -> (usize, usize) {
    let image = draw(lens, &[shape], &[2.0]).image();
    let best = (0..image.len()).max_by(|a, b| image[*a][0].total_cmp(&image[*b][0])).unwrap();
    (best % lens.columns, best / lens.columns)
}

#[test]
fn a_gaussian_is_seen_where_the_data_set_has_its_direction() {
    let array = array(360, 90);
    let lens = Lens::new(&array, 0.2);
    let directions = array.directions();
    for (column, row) in [(0, 0), (17, 40), (200, 60), (358, 5), (359, 70)] {
        let d = directions[(column, row)];
        let shape = Shape { position: (glam::DVec3::from(array.position_m) + 7.0 * d).to_array(), ..at(&array, 0.0, 0.0, 0.1) };
        assert_eq!(brightest(&lens, shape), (column, row));
    }
    // Below the array nothing is seen, nor within reach of its hand.
    for shape in [at(&array, 20.0, -10.0, 0.05), Shape { position: array.position_m, ..at(&array, 0.0, 0.0, 0.1) }] {
        assert!(draw(&lens, &[shape], &[2.0]).image().iter().all(|c| *c == [0.0; 2]));
    }
}

#[test]
fn azimuth_closes_behind_the_last_column() {
    let array = array(360, 90);
    let lens = Lens::new(&array, 0.2);
    let image = |azimuth_deg: f64| draw(&lens, &[at(&array, azimuth_deg, 30.0, 0.4)], &[2.0]).image();
    // What is seen at the seam is what is seen elsewhere, turned.
    let (seam, elsewhere) = (image(0.5), image(180.5));
    let turned = |i: usize| (i / 360) * 360 + (i % 360 + 180) % 360;
    assert!((0..seam.len()).all(|i| (seam[i][0] - elsewhere[turned(i)][0]).abs() < 1e-9));
    let row = 29 * 360;
    assert!(seam[row][0] > 0.1 && seam[row + 359][0] > 0.1 && seam[row + 180][0] == 0.0);
}

/// Gaussians of all kinds: at the seam, low, high, wide, thin, behind one another.
fn some(array: &FixedArray) -> (Vec<Shape<f64>>, Vec<f64>) {
    let mut rng = Rng::keyed(4, 0, 0);
    let mut shapes: Vec<_> = (0..9)
        .map(|i| {
            let mut s = at(array, [1.0, 359.0, 40.0, 41.0, 43.0, 200.0, 100.0, 300.0, 38.0][i], 4.0 + 9.0 * i as f64, 0.5);
            s.position[0] += 0.2 * rng.normal();
            s.rotation = [0; 4].map(|_| rng.normal());
            s.log_scale = [0; 3].map(|_| 0.5 * rng.normal() - 0.8);
            s.dc = [rng.normal(), rng.normal(), 0.0];
            s
        })
        .collect();
    shapes[5].dc[0] = -4.0;
    let logits = (0..9).map(|i| 0.6 * i as f64 - 2.0).collect();
    (shapes, logits)
}

/// Moves one number of the Gaussians or of their opacities' logits.
type Change<'c> = &'c dyn Fn(f64, &mut Vec<Shape<f64>>, &mut Vec<f64>);

#[test]
fn gradients_are_those_of_finite_differences() {
    const H: f64 = 1e-6;
    let array = array(48, 14);
    let lens = Lens::new(&array, 0.2);
    let (shapes, logits) = some(&array);
    let mut rng = Rng::keyed(5, 0, 0);
    let weights: Vec<[f64; 2]> = (0..48 * 14).map(|_| [rng.normal(), rng.normal()]).collect();
    let value = |shapes: &[Shape<f64>], logits: &[f64]| -> f64 {
        draw(&lens, shapes, logits).image().iter().zip(&weights).map(|(c, w)| c[0] * w[0] + c[1] * w[1]).sum()
    };
    let drawing = draw(&lens, &shapes, &logits);
    let gradient = drawing.gradient(&drawing.image(), &weights);
    let mut checked = 0;
    let mut hold = |what: &str, own: f64, change: Change<'_>| {
        let [up, down] = [H, -H].map(|h| {
            let (mut s, mut l) = (shapes.clone(), logits.clone());
            change(h, &mut s, &mut l);
            value(&s, &l)
        });
        let expected = (up - down) / (2.0 * H);
        assert!((own - expected).abs() < 1e-5 * (1.0 + expected.abs()), "{what}: {own} against {expected}");
        checked += usize::from(expected.abs() > 1e-3);
    };
    for (i, g) in gradient.iter().enumerate() {
        let (g, logit, _) = g.unwrap();
        for k in 0..3 {
            hold(&format!("position {i} {k}"), g.position[k], &move |h, s, _| s[i].position[k] += h);
            hold(&format!("scale {i} {k}"), g.log_scale[k], &move |h, s, _| s[i].log_scale[k] += h);
            hold(&format!("colour {i} {k}"), g.dc[k], &move |h, s, _| s[i].dc[k] += h);
        }
        for k in 0..4 {
            hold(&format!("rotation {i} {k}"), g.rotation[k], &move |h, s, _| s[i].rotation[k] += h);
        }
        hold(&format!("opacity {i}"), logit, &move |h, _, l| l[i] += h);
    }
    assert!(checked > 90, "{checked} of 126 say something");
}

#[test]
fn the_loss_has_its_gradient_and_the_metrics_ssim() {
    const H: f64 = 1e-6;
    let (columns, rows) = (30, 14);
    let mut rng = Rng::keyed(6, 0, 0);
    let image: Vec<[f64; 2]> = (0..columns * rows).map(|_| [0; 2].map(|_| 1.1 * rng.uniform_f64())).collect();
    let target: Vec<f64> = (0..columns * rows).map(|_| rng.uniform_f64()).collect();
    let levels = |image: &[[f64; 2]]| image.iter().map(|c| level(*c)).collect::<Vec<_>>();
    let value = |image: &[[f64; 2]]| loss(&levels(image), &target, columns, 0.2).0;
    let (_, of_levels) = loss(&levels(&image), &target, columns, 0.2);
    for i in (0..image.len()).step_by(7) {
        let own = of_channels(image[i], of_levels[i]);
        for c in 0..2 {
            let [up, down] = [H, -H].map(|h| {
                let mut image = image.clone();
                image[i][c] += h;
                value(&image)
            });
            let expected = (up - down) / (2.0 * H);
            assert!((own[c] - expected).abs() < 1e-8, "{i} {c}: {} against {expected}", own[c]);
        }
    }
    assert_eq!(of_channels([0.0f64; 2], 1.0), [0.0; 2]);
    let planes = |v: &[f64]| Planes { width: columns, height: rows, channels: 1, pixels: v.iter().map(|v| *v as f32).collect() };
    let [a, b] = [levels(&image).iter().map(|v| v.min(1.0)).collect::<Vec<_>>(), target.clone()];
    let own = 1.0 - loss(&a, &b, columns, 1.0).0;
    assert!((own - ssim(&planes(&a), &planes(&b), None)).abs() < 1e-6, "{own}");
}
