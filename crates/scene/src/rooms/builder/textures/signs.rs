//! Screens, signs, a clock, printed fronts, book spines and the street outside.

use super::noise::{fbm, lattice};
use crate::builder::trig;
use crate::draw::{Canvas, Rgb, hex, mix, scale, smoothstep};

/// The information screen at the lifts.
pub fn screen_welcome() -> Canvas {
    let mut c = Canvas::shaded(768, 432, |u, v| {
        let band = smoothstep(0.0, 0.9, v + 0.25 * fbm(u, v, 3, 2, 4, 401));
        mix(hex(0x0a3d62), hex(0x38ada9), band)
    });
    for i in 0..14 {
        let x = 430.0 + 26.0 * i as f32;
        let h = 60.0 + 190.0 * lattice(i, 0, 402);
        c.rect(x, 432.0 - h, x + 20.0, 432.0, scale(hex(0x79bdcf), 0.7 + 0.3 * lattice(i, 1, 402)));
    }
    c.text("WELCOME", 44.0, 150.0, 78.0, 13.0, hex(0xffffff));
    c.text("RECEPTION >", 46.0, 226.0, 34.0, 5.0, hex(0xf8efba));
    c.text("LABS 2 - 7", 46.0, 284.0, 34.0, 5.0, hex(0xf8efba));
    c.text("CAFE  L3", 46.0, 342.0, 34.0, 5.0, hex(0xf8efba));
    c.rect(44.0, 172.0, 380.0, 176.0, hex(0xffffff));
    c
}

/// The schedule screen.
pub fn screen_schedule() -> Canvas {
    let mut c = Canvas::filled(768, 432, hex(0x101820));
    c.rect(0.0, 0.0, 768.0, 64.0, hex(0xf2aa4c));
    c.text("TODAY", 30.0, 49.0, 34.0, 6.0, hex(0x101820));
    c.text("14:20", 620.0, 49.0, 34.0, 6.0, hex(0x101820));
    for (row, (time, what, room)) in [
        ("09:00", "OPENING", "A 101"),
        ("10:30", "ANTENNAS", "B 207"),
        ("12:00", "LUNCH", "CAFE"),
        ("13:15", "RENDERING", "A 104"),
        ("15:00", "POSTERS", "FOYER"),
        ("17:30", "CLOSING", "A 101"),
    ]
    .into_iter()
    .enumerate()
    {
        let y = 116.0 + 56.0 * row as f32;
        if row % 2 == 0 {
            c.rect(16.0, y - 40.0, 752.0, y + 14.0, hex(0x1f2d3a));
        }
        c.text(time, 34.0, y, 26.0, 4.5, hex(0xf2aa4c));
        c.text(what, 220.0, y, 26.0, 4.5, hex(0xf4f7f8));
        c.text(room, 590.0, y, 26.0, 4.5, hex(0x8fd3c8));
    }
    c
}

/// A desk monitor: a form and a plot.
pub fn screen_desk() -> Canvas {
    let mut c = Canvas::filled(384, 216, hex(0xe8edf2));
    c.rect(0.0, 0.0, 384.0, 22.0, hex(0x34495e));
    c.rect(0.0, 22.0, 80.0, 216.0, hex(0xcfd8e0));
    for i in 0..7 {
        c.rect(12.0, 36.0 + 24.0 * i as f32, 66.0, 44.0 + 24.0 * i as f32, hex(0x7f8c9a));
        c.rect(96.0, 36.0 + 12.0 * i as f32, 120.0 + 110.0 * lattice(i, 0, 411), 41.0 + 12.0 * i as f32, hex(0x96a3b0));
    }
    for i in 0..12 {
        let h = 20.0 + 60.0 * lattice(i, 1, 411);
        c.rect(
            100.0 + 22.0 * i as f32,
            205.0 - h,
            116.0 + 22.0 * i as f32,
            205.0,
            [hex(0x2980b9), hex(0xe67e22)][i as usize % 2],
        );
    }
    c
}

/// A clock face at ten past ten.
pub fn clock() -> Canvas {
    let mut c = Canvas::filled(256, 256, hex(0xf7f5ef));
    let at = |turn: f64, r: f32| {
        let (x, y) = trig::on_circle(0.25 - turn);
        [128.0 + r * x as f32, 128.0 - r * y as f32]
    };
    for i in 0..60 {
        let turn = f64::from(i) / 60.0;
        let (from, width) = if i % 5 == 0 { (92.0, 6.0) } else { (104.0, 2.0) };
        c.line(at(turn, from), at(turn, 112.0), width, hex(0x20242a));
    }
    c.line(at(0.5 + 10.167 / 12.0, 14.0), at(10.167 / 12.0, 62.0), 9.0, hex(0x20242a));
    c.line(at(0.5 + 1.0 / 6.0, 18.0), at(1.0 / 6.0, 94.0), 6.0, hex(0x20242a));
    c.line(at(0.5 + 0.6, 24.0), at(0.6, 100.0), 2.5, hex(0xc0392b));
    c.disc(128.0, 128.0, 8.0, hex(0xc0392b));
    c
}

/// A lit exit sign: a door, an arrow, a word.
pub fn exit() -> Canvas {
    let (green, white): (Rgb, Rgb) = (hex(0x0f9d58), hex(0xf4fff8));
    let mut c = Canvas::filled(256, 128, green);
    c.text("EXIT", 104.0, 86.0, 46.0, 9.0, white);
    c.rect(22.0, 22.0, 70.0, 108.0, white);
    c.rect(30.0, 30.0, 62.0, 108.0, green);
    c.line([40.0, 70.0], [88.0, 70.0], 8.0, white);
    c.line([74.0, 56.0], [88.0, 70.0], 8.0, white);
    c.line([74.0, 84.0], [88.0, 70.0], 8.0, white);
    c
}

/// The front of a vending machine: shelves of packets behind glass, a keypad, a slot.
pub fn vending() -> Canvas {
    let mut c = Canvas::shaded(448, 896, |u, v| mix(hex(0xb3202c), hex(0x7d1420), v + 0.2 * u));
    c.text("FRESH", 60.0, 92.0, 58.0, 11.0, hex(0xffffff));
    c.text("+COLD", 250.0, 92.0, 30.0, 6.0, hex(0xffd166));
    c.rect(28.0, 120.0, 330.0, 700.0, hex(0x1a1d22));
    let goods = [hex(0x06d6a0), hex(0xffd166), hex(0xef476f), hex(0x118ab2), hex(0xf4f1de), hex(0x8ac926), hex(0xff924c)];
    for row in 0..6 {
        let y = 210.0 + 93.0 * row as f32;
        c.rect(34.0, y, 324.0, y + 8.0, hex(0x9aa3ab));
        for k in 0..6i64 {
            let (x, colour) = (40.0 + 48.0 * k as f32, goods[(lattice(k, row, 421) * 6.999) as usize]);
            let h = 46.0 + 22.0 * lattice(k, row, 422);
            c.rect(x, y - h, x + 38.0, y, colour);
            c.rect(x, y - 0.62 * h, x + 38.0, y - 0.36 * h, mix(colour, hex(0xffffff), 0.75));
            c.disc(x + 19.0, y - 0.5 * h, 0.12 * h, scale(colour, 0.5));
            c.rect(x + 10.0, y + 1.0, x + 28.0, y + 7.0, hex(0xffffff));
        }
    }
    c.rect(350.0, 240.0, 426.0, 300.0, hex(0x0b3d2e));
    c.text("1.50", 362.0, 280.0, 20.0, 3.5, hex(0x7bed9f));
    for k in 0..12 {
        let (x, y) = (352.0 + 26.0 * (k % 3) as f32, 320.0 + 30.0 * (k / 3) as f32);
        c.rect(x, y, x + 21.0, y + 23.0, hex(0xd9dde1));
    }
    c.rect(376.0, 470.0, 400.0, 474.0, hex(0x111111));
    c.rect(60.0, 760.0, 300.0, 850.0, hex(0x14161a));
    c.rect(72.0, 772.0, 288.0, 838.0, hex(0x2c3138));
    c
}

/// The floor indicator over a lift.
pub fn lift() -> Canvas {
    let mut c = Canvas::filled(192, 96, hex(0x0c0f12));
    c.text("3", 110.0, 76.0, 56.0, 9.0, hex(0xff7f3f));
    c.polygon(&[[30.0, 70.0], [54.0, 26.0], [78.0, 70.0]], hex(0xff7f3f));
    c
}

/// Key caps.
pub fn keyboard() -> Canvas {
    let mut c = Canvas::filled(256, 96, hex(0x23262b));
    for row in 0..5 {
        for k in 0..15 {
            let x = 6.0 + 16.4 * k as f32;
            let y = 6.0 + 17.4 * row as f32;
            c.rect(x, y, x + 14.0, y + 14.5, hex(0x454a52));
            c.line([x + 5.0, y + 6.0], [x + 8.0, y + 6.0], 2.0, hex(0xd8dde3));
        }
    }
    c
}

/// Columns of the spine atlas: one book each.
pub const SPINES: usize = 32;

/// Book spines side by side, top of the book at v = 0.
pub fn books() -> Canvas {
    let cloth =
        [0x8c2f39, 0x1d3557, 0x2a6f5e, 0xd9b44a, 0x4a4e69, 0xb5651d, 0xe8e0d0, 0x22223b, 0x6b8f71, 0x9d4edd, 0xc8553d, 0x3d5a80];
    let mut c = Canvas::filled(1024, 384, hex(0x000000));
    for k in 0..SPINES as i64 {
        let r = |s| lattice(k, 0, s);
        let base = scale(hex(cloth[(r(431) * 11.999) as usize]), 0.8 + 0.35 * r(432));
        let ink = if base[0] + base[1] + base[2] > 1.5 { hex(0x2b2118) } else { hex(0xe9d8a6) };
        let x = 32.0 * k as f32;
        c.rect(x, 0.0, x + 32.0, 384.0, base);
        for band in 0..(1 + (r(433) * 3.0) as i64) {
            let y = 20.0 + 330.0 * lattice(k, band, 434);
            c.rect(x, y, x + 32.0, y + 4.0 + 14.0 * lattice(k, band, 435), mix(base, ink, 0.75));
        }
        // A title that runs down the spine: bars the size of words.
        let mut y = 60.0 + 60.0 * r(436);
        while y < 300.0 {
            let word = 18.0 + 46.0 * lattice(k, y as i64, 437);
            c.rect(x + 12.0, y, x + 21.0, (y + word).min(320.0), ink);
            y += word + 12.0;
        }
        c.rect(x, 0.0, x + 1.5, 384.0, scale(base, 0.6));
        c.rect(x + 30.5, 0.0, x + 32.0, 384.0, scale(base, 0.6));
    }
    c.recolour(|u, v, p| scale(p, 0.93 + 0.1 * lattice((u * 1024.0) as i64, (v * 384.0) as i64, 438)));
    c
}

/// The street outside: sky with clouds, façades, trees, a pavement. Fills the backdrop once.
pub fn street() -> Canvas {
    let mut c = Canvas::shaded(1280, 512, |u, v| {
        let sky = mix(hex(0x8fbce6), hex(0xe3eef5), v * 1.7);
        mix(sky, hex(0xffffff), smoothstep(0.05, 0.55, fbm(u, v, 5, 4, 6, 441)))
    });
    let mut x = -20.0;
    let mut k = 0;
    while x < 1280.0 {
        let r = |s| lattice(k, 0, s);
        let (w, top) = (90.0 + 130.0 * r(442), 70.0 + 190.0 * r(443));
        let face =
            scale([hex(0xc9b8a3), hex(0x9aa5ad), hex(0xb98a6e), hex(0xd8d2c6), hex(0x8797a3)][(r(444) * 4.999) as usize], 0.95);
        c.rect(x, top, x + w, 420.0, face);
        c.rect(x, top, x + w, top + 6.0, scale(face, 0.8));
        let (nx, ny) = ((w / 24.0) as i64, ((410.0 - top) / 30.0) as i64);
        for j in 0..ny {
            for i in 0..nx {
                let (px, py) = (x + 9.0 + (w - 12.0) / nx as f32 * i as f32, top + 16.0 + 30.0 * j as f32);
                let pane = mix(hex(0x4f6475), hex(0xb9d3e6), lattice(i + 40 * k, j, 445));
                c.rect(px, py, px + 12.0, py + 18.0, pane);
                c.rect(px, py + 18.0, px + 12.0, py + 20.0, scale(face, 1.1));
            }
        }
        x += w;
        k += 1;
    }
    c.rect(0.0, 420.0, 1280.0, 452.0, hex(0x77797c));
    c.rect(0.0, 452.0, 1280.0, 512.0, hex(0xb5b0a7));
    for i in 0..27 {
        c.rect(48.0 * i as f32, 434.0, 48.0 * i as f32 + 22.0, 437.0, hex(0xe7e4da));
    }
    for k in 0..15i64 {
        let r = |s| lattice(k, 3, s);
        let (x, y) = (40.0 + 84.0 * k as f32 + 26.0 * r(451), 300.0 + 50.0 * r(452));
        c.rect(x - 3.0, y, x + 4.0, 425.0, hex(0x54402f));
        for b in 0..60 {
            let q = |s| lattice(k * 64 + b, 5, s);
            let (dx, dy) = (2.0 * q(453) - 1.0, 2.0 * q(454) - 1.0);
            if dx * dx + dy * dy < 1.0 {
                let green = mix(hex(0x3b5636), hex(0x8c9f68), 0.55 * q(455) + 0.35 * (0.5 - 0.5 * dy));
                c.disc(x + 40.0 * dx, y - 12.0 + 44.0 * dy, 6.0 + 8.0 * q(456), green);
            }
        }
    }
    c
}
