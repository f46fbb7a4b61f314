//! Procedural textures of the office: carpet tiles, vinyl, wall tiles, a written whiteboard, a screen full of text, door signs.

use super::noise::{fbm, lattice};
use crate::draw::{Canvas, Rgb, hex, mix, scale, smoothstep};

/// Distance to the nearest joint of an `n` × `n` tiling, in tiles, and the tile's indices.
fn tile(u: f32, v: f32, n: f32) -> (f32, i64, i64) {
    let (x, y) = (u * n, v * n);
    let edge = |t: f32| (t - t.floor()).min(1.0 - (t - t.floor()));
    (edge(x).min(edge(y)), x.floor() as i64, y.floor() as i64)
}

/// Loop-pile carpet tiles, 4 × 4, each laid a quarter turn from its neighbours, with streaks in three greys and a blue thread.
pub fn carpet_tiles() -> Canvas {
    Canvas::shaded(768, 768, |u, v| {
        let (edge, i, j) = tile(u, v, 4.0);
        let (along, across) = if (i + j) % 2 == 0 { (u, v) } else { (v, u) };
        let streak = lattice((across * 160.0) as i64, (along * 4.0) as i64 + 7 * i, 501);
        let part = lattice((across * 160.0) as i64, (along * 40.0) as i64, 502);
        let loops = lattice((u * 384.0) as i64, (v * 384.0) as i64, 503);
        let base = mix(hex(0x4b5158), hex(0x868c92), 0.25 + 0.5 * streak * part + 0.22 * fbm(u, v, 6, 6, 4, 504));
        let coloured = if streak > 0.9 && part > 0.35 { mix(base, hex(0x3f7f9c), 0.7) } else { base };
        let shade = (0.93 + 0.1 * lattice(i, j, 505)) * (0.8 + 0.34 * loops);
        scale(coloured, shade * (1.0 - 0.22 * (1.0 - smoothstep(0.002, 0.012, edge))))
    })
}

/// Speckled sheet vinyl.
pub fn vinyl() -> Canvas {
    let mut canvas = Canvas::shaded(768, 768, |u, v| {
        let cloud = fbm(u, v, 5, 5, 5, 511);
        scale(mix(hex(0xa8aca6), hex(0xc9cac3), 0.5 + 0.5 * cloud), 0.98)
    });
    for k in 0..3400 {
        let at = |s| lattice(k, 0, s);
        let colour = [hex(0x6e7672), hex(0xeceae2), hex(0x8b7a63), hex(0x9fb0b4)][(at(512) * 3.999) as usize];
        canvas.disc(at(513) * 768.0, at(514) * 768.0, 0.6 + 2.0 * at(515) * at(515), colour);
    }
    canvas
}

/// Glazed tiles of 15 cm behind a worktop, each of its own blue-green.
pub fn wall_tiles() -> Canvas {
    Canvas::shaded(512, 512, |u, v| {
        let (edge, i, j) = tile(u, v, 4.0);
        let glaze = mix(hex(0x7fa8a3), hex(0xc4d8cf), lattice(i, j, 521) + 0.15 * fbm(u, v, 8, 8, 3, 522));
        mix(glaze, hex(0xe7e4dc), 1.0 - smoothstep(0.015, 0.03, edge))
    })
}

/// A whiteboard after a meeting: a block diagram, a curve, lists. Fills the board once.
pub fn whiteboard() -> Canvas {
    let (blue, red, green, black): (Rgb, Rgb, Rgb, Rgb) = (hex(0x1f4fa3), hex(0xc22f2f), hex(0x1d7f46), hex(0x25282c));
    let mut c = Canvas::shaded(768, 448, |u, v| scale(hex(0xf6f7f7), 0.985 + 0.02 * fbm(u, v, 3, 2, 4, 531)));
    c.text("SPRINT 12", 40.0, 70.0, 34.0, 5.0, blue);
    c.line([38.0, 84.0], [290.0, 80.0], 4.0, blue);
    for (i, line) in ["FIX THE LINK", "MEASURE 60 GHZ", "ROOM 4.03 : MAP", "CALL PLANNING"].into_iter().enumerate() {
        let y = 128.0 + 42.0 * i as f32;
        c.line([44.0, y - 16.0], [60.0, y - 16.0], 3.0, black);
        c.line([44.0, y], [60.0, y], 3.0, black);
        c.line([44.0, y - 16.0], [44.0, y], 3.0, black);
        c.line([60.0, y - 16.0], [60.0, y], 3.0, black);
        c.text(line, 76.0, y, 19.0, 3.4, black);
        if i != 2 {
            c.line([46.0, y - 9.0], [52.0, y - 2.0], 3.5, green);
            c.line([52.0, y - 2.0], [66.0, y - 22.0], 3.5, green);
        }
    }
    for (x, y, word) in [(430.0, 60.0, "TX"), (580.0, 60.0, "ROOM"), (580.0, 170.0, "RX")] {
        for (a, b) in [([x, y], [x + 110.0, y + 2.0]), ([x + 110.0, y + 2.0], [x + 108.0, y + 60.0])] {
            c.line(a, b, 4.0, red);
        }
        c.line([x + 108.0, y + 60.0], [x + 2.0, y + 58.0], 4.0, red);
        c.line([x + 2.0, y + 58.0], [x, y], 4.0, red);
        c.text(word, x + 16.0, y + 42.0, 24.0, 4.0, black);
    }
    c.line([540.0, 92.0], [580.0, 92.0], 4.0, black);
    c.line([636.0, 122.0], [636.0, 170.0], 4.0, black);
    c.line([410.0, 400.0], [720.0, 402.0], 3.5, black);
    c.line([412.0, 402.0], [410.0, 260.0], 3.5, black);
    let height = |i: i64| 390.0 - 110.0 * (1.0 - (i as f32 / 24.0 - 0.6).powi(2) * 2.4) - 14.0 * lattice(i, 0, 532);
    for i in 0..24 {
        c.line([416.0 + 12.0 * i as f32, height(i)], [428.0 + 12.0 * i as f32, height(i + 1)], 4.0, blue);
    }
    c.text("DO NOT WIPE", 60.0, 400.0, 26.0, 4.5, red);
    c
}

/// A monitor with lines of text in colours on a dark ground, and a column of files.
pub fn screen_code() -> Canvas {
    let mut c = Canvas::filled(384, 216, hex(0x1d2129));
    c.rect(0.0, 0.0, 70.0, 216.0, hex(0x252b35));
    c.rect(0.0, 0.0, 384.0, 14.0, hex(0x3a4150));
    let inks = [hex(0x8fc3e8), hex(0xd7dbe0), hex(0xe0a56b), hex(0x93c47d), hex(0xc792ea)];
    for i in 0..18i64 {
        let y = 22.0 + 10.5 * i as f32;
        c.rect(8.0, y, 18.0 + 40.0 * lattice(i, 0, 541), y + 5.0, hex(0x7c8796));
        let mut x = 82.0 + 14.0 * (lattice(i, 1, 541) * 3.999).floor();
        for k in 0..7 {
            let w = 10.0 + 40.0 * lattice(i, k, 542);
            if x + w > 372.0 || lattice(i, k, 543) > 0.86 {
                break;
            }
            c.rect(x, y, x + w, y + 5.0, inks[(lattice(i, k, 544) * 4.999) as usize]);
            x += w + 6.0;
        }
    }
    c
}

/// A door sign: a number over a word, with a band of colour.
pub fn sign(word: &str, number: &str, colour: Rgb) -> Canvas {
    let mut c = Canvas::filled(256, 256, hex(0xf2f2ee));
    c.rect(0.0, 0.0, 256.0, 52.0, colour);
    c.text_centred(number, 128.0, 150.0, 66.0, 11.0, hex(0x2a2d31));
    c.text_centred(word, 128.0, 214.0, 30.0, 5.0, hex(0x2a2d31));
    c
}
