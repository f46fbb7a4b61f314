use super::*;
use crate::files::ply::SingleModality;
use crate::{Appearance, gaussians::harmonics};
use corf_scene::Rng;
use flate2::read::GzDecoder;
use glam::{DMat3, DQuat, DVec3};
use std::io::Read;

fn random(n: usize, channels: usize, degree: usize) -> SingleModality {
    let mut rng = Rng::keyed(3, 4, 5);
    let mut draw = |n: usize, wide: f32| (0..n).map(|_| wide * (2.0 * rng.uniform() - 1.0)).collect::<Vec<f32>>();
    let mut appearance = Appearance::empty(channels, degree);
    appearance.opacity_logit = draw(n, 4.0);
    appearance.sh = draw(n * appearance.stride(), 0.9);
    let triples = |v: Vec<f32>| v.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect::<Vec<_>>();
    SingleModality {
        position: triples(draw(3 * n, 9.0)),
        rotation: draw(4 * n, 1.0).chunks_exact(4).map(|c| [c[0], c[1], c[2], c[3]]).collect(),
        log_scale: triples(draw(3 * n, 3.0)).into_iter().map(|s| s.map(|v| v - 3.0)).collect(),
        appearance,
    }
}

fn covariance(f: &SingleModality, i: usize) -> DMat3 {
    let [w, x, y, z] = f.rotation[i].map(f64::from);
    let r = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
    let s = DMat3::from_diagonal(DVec3::from_array(f.log_scale[i].map(|v| f64::from(v).exp().powi(2))));
    r * s * r.transpose()
}

fn colour(f: &SingleModality, i: usize, direction: DVec3) -> Vec<f64> {
    let (a, y) = (&f.appearance, harmonics::basis_of::<16>(direction.as_vec3().to_array()));
    let own = &a.sh[i * a.stride()..(i + 1) * a.stride()];
    (0..a.channels).map(|c| (0..a.coefficients()).map(|k| f64::from(own[k * a.channels + c] * y[k])).sum()).collect()
}

#[test]
fn a_turned_field_looks_the_same_from_a_turned_side() {
    // Numbers of order 1 in single precision, sixteen of them summed.
    const TOLERANCE: f64 = 1e-5;
    let mut rng = Rng::keyed(6, 7, 8);
    for (degree, frame) in [(3, Frame::YUp), (3, Frame::YDown), (1, Frame::YUp), (0, Frame::YDown)] {
        let (field, rotation) = (random(7, 3, degree), frame.file_from_world());
        assert!((rotation.determinant() - 1.0).abs() < 1e-12);
        assert_eq!(rotation * DVec3::Z, DVec3::from_array(frame.up().map(f64::from)));
        let out = turned(&field, frame);
        for i in 0..7 {
            let position = DVec3::from_array(field.position[i].map(f64::from));
            assert!((rotation * position - DVec3::from_array(out.position[i].map(f64::from))).length() < TOLERANCE);
            let difference = rotation * covariance(&field, i) * rotation.transpose() - covariance(&out, i);
            assert!(difference.to_cols_array().iter().all(|v| v.abs() < TOLERANCE), "{difference}");
            let d = DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize();
            for (a, b) in colour(&field, i, d).iter().zip(colour(&out, i, rotation * d)) {
                assert!((a - b).abs() < TOLERANCE, "{a} {b}");
            }
        }
        assert_eq!((out.log_scale, out.appearance.opacity_logit), (field.log_scale, field.appearance.opacity_logit));
    }
    let field = random(3, 1, 2);
    assert_eq!(turned(&field, Frame::World), field);
}

#[test]
fn padding_and_grey_change_no_colour() {
    let field = random(4, 1, 1);
    let wide = field.padded(3).in_three_channels();
    assert_eq!((wide.appearance.channels, wide.appearance.sh_degree, wide.appearance.sh.len()), (3, 3, 4 * 48));
    for (i, d) in [(0, DVec3::X), (3, DVec3::new(0.6, 0.0, -0.8))] {
        assert_eq!(colour(&wide, i, d), vec![colour(&field, i, d)[0]; 3]);
    }
    assert_eq!(wide.padded(1), wide, "nothing is taken away");
}

#[test]
fn splat_records_hold_what_the_layout_says() {
    let mut field = random(5, 3, 2);
    let stride = field.appearance.stride();
    field.appearance.sh[stride] = 9.0;
    let bytes = encode_splat(&field);
    assert_eq!(bytes.len(), 5 * 32);
    for (i, record) in bytes.chunks_exact(32).enumerate() {
        let float = |k: usize| f32::from_le_bytes(record[4 * k..4 * k + 4].try_into().unwrap());
        assert_eq!([float(0), float(1), float(2)], field.position[i]);
        assert_eq!([float(3), float(4), float(5)], field.log_scale[i].map(f32::exp));
        let alpha = crate::gaussians::sigmoid(field.appearance.opacity_logit[i]);
        assert!((f32::from(record[27]) / 255.0 - alpha).abs() <= 0.5001 / 255.0);
        let q = normalised(field.rotation[i]);
        // A unit is 128 steps, and the last of them is missing.
        assert!((0..4).all(|k| ((f32::from(record[28 + k]) - 128.0) / 128.0 - q[k]).abs() <= 1.0001 / 128.0));
    }
    let green = 0.5 + 0.282_094_8 * field.appearance.sh[2 * stride + 1];
    assert!((f32::from(bytes[2 * 32 + 25]) / 255.0 - green).abs() <= 0.5001 / 255.0);
    assert_eq!(bytes[32 + 24], 255, "a colour beyond 1 ends there");
}

/// The arrays of an `.spz` file as its format defines them: header, positions, opacities, colours, ln scales, quaternions w, x, y, z, harmonics.
fn decode(bytes: &[u8]) -> (Vec<u8>, SingleModality) {
    let mut data = vec![];
    GzDecoder::new(bytes).read_to_end(&mut data).unwrap();
    let (header, body) = data.split_at(16);
    let n = u32::from_le_bytes(header[8..12].try_into().unwrap()) as usize;
    let higher = 3 * ((usize::from(header[12]) + 1).pow(2) - 1);
    assert_eq!(body.len(), n * (9 + 1 + 3 + 3 + 4 + higher));
    let (position, rest) = body.split_at(9 * n);
    let (alpha, rest) = rest.split_at(n);
    let (color, rest) = rest.split_at(3 * n);
    let (scale, rest) = rest.split_at(3 * n);
    let (rotation, harmonics) = rest.split_at(4 * n);
    let fixed = |b: &[u8]| (i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8) as f32 / (1 << header[13]) as f32;
    let triples = |v: Vec<f32>| v.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect::<Vec<_>>();
    let unpack = |b: &[u8]| {
        let word = u32::from_le_bytes(b.try_into().unwrap());
        let (missing, mut q, mut shift) = ((word >> 30) as usize, [0.0_f32; 4], 20);
        for i in (0..4).filter(|i| *i != missing) {
            let part = word >> shift & 1023;
            q[i] = (part & 511) as f32 / 511.0 * 0.5_f32.sqrt() * if part > 511 { -1.0 } else { 1.0 };
            shift -= 10;
        }
        q[missing] = (1.0 - q.iter().map(|v| v * v).sum::<f32>()).max(0.0).sqrt();
        [q[3], q[0], q[1], q[2]]
    };
    let mut appearance = Appearance::empty(3, usize::from(header[12]));
    appearance.opacity_logit = alpha.iter().map(|b| crate::gaussians::logit(f32::from(*b) / 255.0)).collect();
    for i in 0..n {
        appearance.sh.extend(color[3 * i..3 * i + 3].iter().map(|b| (f32::from(*b) / 255.0 - 0.5) / 0.15));
        appearance.sh.extend(harmonics[higher * i..higher * (i + 1)].iter().map(|b| (f32::from(*b) - 128.0) / 128.0));
    }
    let field = SingleModality {
        position: triples(position.chunks_exact(3).map(fixed).collect()),
        rotation: rotation.chunks_exact(4).map(unpack).collect(),
        log_scale: triples(scale.iter().map(|b| f32::from(*b) / 16.0 - 10.0).collect()),
        appearance,
    };
    (header.to_vec(), field)
}

#[test]
fn spz_comes_back_within_half_a_step_of_everything() {
    let field = random(40, 3, 3);
    let (bytes, clamped) = encode_spz(&field, true).unwrap();
    assert_eq!(clamped, SpzClamped::default());
    assert!(bytes == encode_spz(&field, true).unwrap().0, "the same bytes");
    let (header, back) = decode(&bytes);
    assert_eq!(&header[..8], b"NGSP\x03\0\0\0");
    assert_eq!(header[12..], [3, 12, 1, 0]);
    let near = |a: f32, b: f32, step: f32| assert!((a - b).abs() <= 0.501 * step, "{a} {b} {step}");
    for i in 0..40 {
        (0..3).for_each(|k| near(back.position[i][k], field.position[i][k], 1.0 / 4096.0));
        (0..3).for_each(|k| near(back.log_scale[i][k], field.log_scale[i][k], 1.0 / 16.0));
        let opacity = |f: &SingleModality| crate::gaussians::sigmoid(f.appearance.opacity_logit[i]);
        near(opacity(&back), opacity(&field), 1.0 / 255.0);
        let (a, b) = (normalised(back.rotation[i]), normalised(field.rotation[i]));
        let cosine = (0..4).map(|k| a[k] * b[k]).sum::<f32>().abs();
        // Three components, each at most half a step of 1.4e-3 off.
        assert!(cosine > 1.0 - 3e-6, "{cosine}");
    }
    for (k, (a, b)) in back.appearance.sh.iter().zip(&field.appearance.sh).enumerate() {
        near(*a, *b, if k % 48 < 3 { 1.0 / (255.0 * 0.15) } else { 1.0 / 128.0 });
    }
    assert_eq!(decode(&encode_spz(&field, false).unwrap().0).0[14], 0);
}

#[test]
fn what_spz_cannot_hold_is_counted_or_refused() {
    let mut field = random(4, 3, 1);
    field.appearance.sh[0] = -4.0;
    field.appearance.sh[3] = 1.5;
    field.log_scale[2] = [-12.0, 0.0, 7.0];
    let (bytes, clamped) = encode_spz(&field, false).unwrap();
    assert_eq!(clamped, SpzClamped { colors: 1, scales: 2, harmonics: 1 });
    assert_eq!(decode(&bytes).1.log_scale[2][0], -10.0);
    field.position[0][1] = -40_000.0;
    let (header, back) = decode(&encode_spz(&field, false).unwrap().0);
    assert_eq!((header[13], back.position[0][1]), (7, -40_000.0));
    field.position[0][1] = 9e6;
    assert!(encode_spz(&field, false).unwrap_err().to_string().contains("24 bits"));
}
