//! Printed posters, a painting and a notice board.

use super::noise::{fbm, lattice, vein};
use crate::builder::trig;
use crate::draw::{Canvas, Rgb, hex, mix, scale, smoothstep};

fn wave(x: f32) -> f32 {
    trig::sin(f64::from(x * std::f32::consts::TAU)) as f32
}

/// An exhibition poster: concentric arcs behind big type.
pub fn expo() -> Canvas {
    let mut c = Canvas::shaded(448, 640, |_, v| mix(hex(0xf3a712), hex(0xe4572e), v));
    for (i, colour) in [hex(0x29335c), hex(0xf6f0e0), hex(0xa8c686), hex(0x29335c), hex(0xf3a712)].into_iter().enumerate() {
        c.disc(224.0, 300.0, 190.0 - 36.0 * i as f32, colour);
    }
    c.rect(0.0, 300.0, 448.0, 480.0, hex(0x29335c));
    for i in 0..9 {
        let x = 24.0 + 50.0 * i as f32;
        c.polygon(&[[x, 300.0], [x + 25.0, 340.0 - 8.0 * wave(i as f32 * 0.13)], [x + 50.0, 300.0]], hex(0xe4572e));
    }
    c.text_centred("FORMA", 224.0, 440.0, 78.0, 14.0, hex(0xf6f0e0));
    c.text_centred("FURNITURE + SPACE", 224.0, 530.0, 24.0, 4.0, hex(0x29335c));
    c.text_centred("12.09 - 30.11  HALL 4", 224.0, 580.0, 22.0, 3.5, hex(0xf6f0e0));
    c
}

/// A conference poster: interfering rings.
pub fn waves() -> Canvas {
    let mut c = Canvas::shaded(448, 640, |u, v| {
        let ring = |x: f32, y: f32| {
            let (dx, dy) = (u - x, (v - y) * 1.43);
            wave((dx * dx + dy * dy).sqrt() * 17.0)
        };
        let s = ring(0.28, 0.35) + ring(0.74, 0.52);
        mix(hex(0x0b132b), mix(hex(0x1c7c8c), hex(0x6fffe9), (s - 0.6).max(0.0)), smoothstep(-0.4, 1.2, s))
    });
    c.rect(28.0, 40.0, 420.0, 150.0, hex(0x0b132b));
    c.text("60 GHZ DAYS", 46.0, 108.0, 46.0, 8.0, hex(0xf4f9f9));
    c.text("FIELDS IN ROOMS", 48.0, 138.0, 17.0, 3.0, hex(0x6fffe9));
    c.rect(28.0, 560.0, 250.0, 606.0, hex(0xff5964));
    c.text("REGISTER NOW", 44.0, 593.0, 22.0, 4.0, hex(0xffffff));
    c
}

/// A yearly report: bars, a curve, a pie of rings.
pub fn chart() -> Canvas {
    let (ink, red, blue): (Rgb, Rgb, Rgb) = (hex(0x22303c), hex(0xd1495b), hex(0x00798c));
    let mut c = Canvas::filled(448, 640, hex(0xf4f1ea));
    c.text("THE YEAR", 34.0, 92.0, 52.0, 10.0, ink);
    c.text("IN NUMBERS", 34.0, 136.0, 24.0, 4.5, red);
    for i in 0..9 {
        let h = 60.0 + 150.0 * lattice(i, 0, 301) + 8.0 * i as f32;
        let x = 38.0 + 42.0 * i as f32;
        c.rect(x, 400.0 - h, x + 27.0, 400.0, if i % 3 == 1 { red } else { blue });
    }
    c.rect(30.0, 400.0, 420.0, 404.0, ink);
    let height = |i: usize| 230.0 - 40.0 * wave(i as f32 / 26.0) - 2.2 * i as f32;
    for i in 0..38 {
        let x = 38.0 + 10.0 * i as f32;
        c.line([x, height(i)], [x + 10.0, height(i + 1)], 5.0, hex(0xedae49));
    }
    for (i, r) in [88.0, 66.0, 44.0].into_iter().enumerate() {
        c.ring(126.0, 524.0, r - 15.0, r, [blue, red, hex(0xedae49)][i]);
        c.rect(126.0, 436.0, 126.0 + 92.0, 524.0 - 22.0 * (2.0 - i as f32), hex(0xf4f1ea));
    }
    for (i, word) in ["+18% VISITS", "42 ROOMS", "7 LABS"].into_iter().enumerate() {
        c.text(word, 246.0, 488.0 + 44.0 * i as f32, 20.0, 3.8, ink);
    }
    c
}

/// A metro map.
pub fn map() -> Canvas {
    let mut c = Canvas::filled(448, 640, hex(0xeef2f3));
    let lines: [(Rgb, &[[f32; 2]]); 5] = [
        (hex(0xd7263d), &[[30.0, 190.0], [150.0, 190.0], [260.0, 300.0], [260.0, 600.0]]),
        (hex(0x1b998b), &[[60.0, 600.0], [60.0, 420.0], [200.0, 280.0], [420.0, 280.0]]),
        (hex(0x2e86ab), &[[420.0, 150.0], [330.0, 150.0], [150.0, 330.0], [150.0, 560.0], [420.0, 560.0]]),
        (hex(0xf46036), &[[30.0, 330.0], [330.0, 330.0], [400.0, 400.0], [400.0, 610.0]]),
        (hex(0x6a4c93), &[[330.0, 140.0], [330.0, 470.0], [200.0, 600.0]]),
    ];
    for (colour, path) in lines {
        for pair in path.windows(2) {
            c.line(pair[0], pair[1], 11.0, colour);
        }
        for pair in path.windows(2) {
            for k in 0..3 {
                let t = k as f32 / 3.0;
                let p = [pair[0][0] + t * (pair[1][0] - pair[0][0]), pair[0][1] + t * (pair[1][1] - pair[0][1])];
                c.disc(p[0], p[1], 9.0, hex(0x22223b));
                c.disc(p[0], p[1], 5.5, hex(0xffffff));
            }
        }
    }
    c.rect(0.0, 0.0, 448.0, 104.0, hex(0x22223b));
    c.text("CITY LINES", 30.0, 74.0, 50.0, 9.0, hex(0xf2e9e4));
    c
}

/// An abstract grid of quarter circles.
pub fn grid() -> Canvas {
    let palette = [hex(0x264653), hex(0x2a9d8f), hex(0xe9c46a), hex(0xf4a261), hex(0xe76f51), hex(0xf5efe0)];
    let mut c = Canvas::filled(448, 640, hex(0xf5efe0));
    for j in 0..8i64 {
        for i in 0..6i64 {
            let pick = |s| palette[(lattice(i, j, s) * 5.999) as usize];
            let (x, y, s) = (20.0 + 68.0 * i as f32, 20.0 + 68.0 * j as f32, 66.0);
            c.rect(x, y, x + s, y + s, pick(311));
            let (cx, cy) = [(x, y), (x + s, y), (x, y + s), (x + s, y + s)][(lattice(i, j, 312) * 3.999) as usize];
            let colour = pick(313);
            c.fill([x, y, x + s, y + s], colour, |px, py| {
                let d = ((px - cx) * (px - cx) + (py - cy) * (py - cy)).sqrt() - s;
                d.max(x - px).max(px - x - s).max(y - py).max(py - y - s)
            });
        }
    }
    c.text("MODERN", 24.0, 624.0, 42.0, 8.0, hex(0x264653));
    c.text("ART", 300.0, 624.0, 42.0, 8.0, hex(0xe76f51));
    c
}

/// Layered hills under a sun.
pub fn hills() -> Canvas {
    let mut c = Canvas::shaded(448, 640, |u, v| {
        let mut colour = mix(hex(0xfde8c9), hex(0xf2a65a), v * 1.2);
        for layer in 0..6i64 {
            let t = layer as f32 / 5.0;
            let ridge = 0.36 + 0.1 * layer as f32 + 0.06 * fbm(u, t, 3 + layer, 7, 5, 321 + layer as u64);
            colour = mix(colour, mix(hex(0x9a8fb0), hex(0x1d2d44), t), smoothstep(ridge, ridge + 0.003, v));
        }
        colour
    });
    c.disc(310.0, 150.0, 46.0, hex(0xfff4dc));
    c.text_centred("WALK MORE", 224.0, 612.0, 44.0, 7.0, hex(0xfde8c9));
    c
}

/// A large abstract painting.
pub fn painting() -> Canvas {
    let mut c = Canvas::shaded(768, 512, |u, v| {
        let flow = fbm(u + 0.3 * fbm(u, v, 3, 3, 4, 331), v + 0.3 * fbm(u, v, 3, 3, 4, 335), 4, 3, 5, 339);
        let base = if flow > 0.0 {
            mix(hex(0xe8d9c0), hex(0x1f6f78), flow * 2.2)
        } else {
            mix(hex(0xe8d9c0), hex(0xc75d3a), -flow * 2.4)
        };
        let gold = vein(u, v, 3, 0.05, 344);
        scale(mix(base, hex(0xcaa24a), gold * 0.8), 0.95 + 0.09 * fbm(u, v, 90, 14, 2, 349))
    });
    c.ring(560.0, 190.0, 84.0, 96.0, hex(0x16262e));
    c
}

/// Cork with pinned sheets.
pub fn notices() -> Canvas {
    let mut c = Canvas::shaded(1024, 512, |u, v| {
        let speck = lattice((u * 512.0) as i64, (v * 256.0) as i64, 351);
        scale(mix(hex(0x9c6f42), hex(0xc89c6a), 0.5 + 0.5 * fbm(u, v, 60, 30, 3, 352)), 0.86 + 0.22 * speck)
    });
    let papers = [hex(0xfdfcf7), hex(0xfff3b0), hex(0xd7ecf5), hex(0xf9d6d5), hex(0xe2f0cb), hex(0xfdfcf7)];
    for k in 0..19i64 {
        let r = |s| lattice(k, 7, s);
        let (w, h) = (90.0 + 60.0 * r(361), 100.0 + 80.0 * r(362));
        let x = 24.0 + (k % 7) as f32 * 141.0 + 22.0 * r(363);
        let y = 16.0 + (k / 7) as f32 * 165.0 + 14.0 * r(364);
        let lean = 10.0 * (r(365) - 0.5);
        c.polygon(
            &[
                [x + 5.0, y + 6.0],
                [x + w + 5.0, y + lean + 6.0],
                [x + w + 5.0 - lean, y + h + lean + 6.0],
                [x + 5.0 - lean, y + h + 6.0],
            ],
            hex(0x6b4a2a),
        );
        c.polygon(
            &[[x, y], [x + w, y + lean], [x + w - lean, y + h + lean], [x - lean, y + h]],
            papers[(r(366) * 5.999) as usize],
        );
        let ink = [hex(0x2b2d42), hex(0xb23a48), hex(0x1d5c63)][(r(367) * 2.999) as usize];
        c.text(
            ["TALK", "ROOM", "SALE", "CHOIR", "YOGA", "LOST"][(r(368) * 5.999) as usize],
            x + 12.0,
            y + 34.0 + 0.2 * lean,
            17.0,
            3.2,
            ink,
        );
        for line in 0..((h - 60.0) / 11.0) as i64 {
            let yy = y + 50.0 + 11.0 * line as f32;
            c.line(
                [x + 12.0, yy],
                [x + 12.0 + (w - 28.0) * (0.5 + 0.5 * lattice(k, line, 369)), yy + 0.5 * lean],
                2.2,
                hex(0x77777f),
            );
        }
        c.disc(x + 0.5 * w, y + 9.0 + 0.5 * lean, 5.5, [hex(0xd62828), hex(0x1d7874), hex(0xf7b801)][(r(370) * 2.999) as usize]);
    }
    c
}
