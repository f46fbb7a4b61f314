//! The preview of a new scene file: its plan with walls, free floor, loop and transmitter, and a view from the pose that sees farthest.

use super::free_space::FreeSpace;
use corf_raytrace::bvh::Bvh;
use corf_raytrace::light::{LightFrame, LightSettings, LightTracer, develop_frame};
use corf_raytrace::radio::coverage::CoveragePlane;
use corf_scene::draw::{Canvas, PictureFormat, Rgb, TextAnchor, clip, hex, metre_axes, text};
use corf_scene::trajectory::{self, TrajectoryConfig, TrajectoryPose};
use corf_scene::{Pinhole, Raster, Result, Rigid3, color};
use glam::{DVec2, DVec3, Vec3};

/// Pixels of the plan at most, on either side.
const PLAN_PIXELS: f64 = 640.0;
/// Margins around it: left, top, right, bottom, pixels.
const MARGIN: [f32; 4] = [64.0, 56.0, 28.0, 64.0];
/// The view.
const VIEW: [usize; 2] = [480, 360];
/// Paths a pixel of it.
const SAMPLES: u32 = 16;
/// Middle grey of its exposure.
const MIDDLE_GREY: f64 = 0.24;
/// Height of capitals, pixels.
const CAP: f32 = 11.0;
const INK: Rgb = hex(0x1a1a1a);
const PAPER: Rgb = hex(0xffffff);
const FREE: Rgb = hex(0xdff0df);
const WAY: Rgb = hex(0x1f6fb4);
const SIGHT: Rgb = hex(0xd98a00);
const TRANSMITTER: Rgb = hex(0xe8303a);

/// The picture's bytes, PNG.
///
/// # Errors
/// A way that no pose can be placed on.
pub fn draw(space: &FreeSpace<'_>, bvh: &Bvh, way: &TrajectoryConfig, tx: DVec3) -> Result<Vec<u8>> {
    let scene = space.scene();
    let poses = trajectory::generate(way, 240)?;
    let sight_m = |pose: &&TrajectoryPose| space.sight_m(&pose.world_from_camera);
    let seen_from = poses.iter().step_by(8).max_by(|a, b| sight_m(a).total_cmp(&sight_m(b))).unwrap_or(&poses[0]);
    let view = view(space, bvh, &seen_from.world_from_camera);
    // What is drawn: the free floor and the walls about it.
    let (mut min, mut max) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    space.free_cells().for_each(|p| (min, max) = (min.min(p), max.max(p)));
    let border_m = (0.08 * (max - min).max_element()).max(0.6);
    (min, max) = ((min - border_m).min(tx.truncate()), (max + border_m).max(tx.truncate()));
    let size = max - min;
    let per_metre = PLAN_PIXELS / size.max_element();
    let (width, height) = ((size.x * per_metre) as f32, (size.y * per_metre) as f32);
    let [left, top, right, bottom] = MARGIN;
    let rows = (top + height + bottom).max(top + VIEW[1] as f32 + bottom);
    let view_left = left + width + right + 20.0;
    let columns = view_left + VIEW[0] as f32 + right;
    let mut canvas = Canvas::filled(columns as usize, rows as usize, PAPER);
    let pixel = |p: DVec2| {
        let at = (p - min) * per_metre;
        [left + at.x as f32, top + height - at.y as f32]
    };
    let half = (0.5 * space.cell_m * per_metre) as f32 + 0.5;
    for cell in space.free_cells() {
        let [x, y] = pixel(cell);
        canvas.rect(x - half, y - half, x + half, y + half, FREE);
    }
    // At the sensor's height in ink, and near the floor, where tables and benches are cut, paler.
    for (z, colour) in [(space.floor_m + 0.35 * space.height_m, hex(0xa8a8a8)), (space.sensor_m(), INK)] {
        let corner = min.extend(z);
        let plane =
            CoveragePlane::new(corner, max.extend(z).with_y(min.y), max.extend(z).with_x(min.x), size.max_element() / 100.0)?;
        for [a, b] in plane.cut(scene) {
            if let Some([a, b]) = clip(a, b, size) {
                canvas.line(pixel(a + min), pixel(b + min), 1.6, colour);
            }
        }
    }
    let places: Vec<DVec2> = poses.iter().map(|pose| pose.world_from_camera.translation.truncate()).collect();
    for (a, b) in places.iter().zip(places.iter().cycle().skip(1)) {
        canvas.line(pixel(*a), pixel(*b), 2.6, WAY);
    }
    for (i, waypoint) in way.waypoints_m.iter().enumerate() {
        let [x, y] = pixel(DVec2::from_array(*waypoint));
        canvas.disc(x, y, if i == 0 { 7.0 } else { 4.0 }, WAY);
    }
    // Which way round: an arrow head at the first pose.
    let ahead = (places[4] - places[0]).normalize_or_zero();
    let [x, y] = pixel(places[4]);
    let (along, across) = ([ahead.x as f32, -ahead.y as f32], [ahead.y as f32, ahead.x as f32]);
    let head = |a: f32, b: f32| [x + along[0] * a + across[0] * b, y + along[1] * a + across[1] * b];
    canvas.polygon(&[head(14.0, 0.0), head(-4.0, 7.0), head(-4.0, -7.0)], WAY);
    let at = &seen_from.world_from_camera;
    let [x, y] = pixel(at.translation.truncate());
    for side in [-1.0, 1.0] {
        let edge = (at.rotation * DVec3::new(side, 0.0, 1.0)).truncate().normalize_or_zero();
        canvas.line([x, y], [x + 34.0 * edge.x as f32, y - 34.0 * edge.y as f32], 1.6, SIGHT);
    }
    canvas.disc(x, y, 5.5, SIGHT);
    let [x, y] = pixel(tx.truncate());
    canvas.disc(x, y, 9.0, INK);
    canvas.disc(x, y, 7.0, TRANSMITTER);
    canvas.disc(x, y, 2.5, PAPER);
    let on_left = x + 60.0 > left + width;
    let anchor = if on_left { TextAnchor::Right } else { TextAnchor::Left };
    text(&mut canvas, "TX", [if on_left { x - 13.0 } else { x + 13.0 }, y + 5.0], anchor, CAP, TRANSMITTER);
    metre_axes(&mut canvas, [left, top, left + width, top + height], min, per_metre, ["X m", "Y m"], (CAP, INK));
    text(&mut canvas, &format!("CUT AT z = {:.2} m", space.sensor_m()), [left, top - 22.0], TextAnchor::Left, CAP, INK);
    paste(&mut canvas, [columns.floor(), rows.floor()], &view, [view_left as usize, top as usize]);
    text(&mut canvas, "VIEW FROM THE LOOP", [view_left, top - 22.0], TextAnchor::Left, CAP, INK);
    let legend = top + VIEW[1] as f32 + 28.0;
    for (i, (colour, words)) in [
        (FREE, "FREE FLOOR"),
        (WAY, "LOOP, DOTS ARE WAYPOINTS"),
        (TRANSMITTER, "TRANSMITTER, A GUESS"),
        (SIGHT, "WHERE THE VIEW IS FROM"),
    ]
    .iter()
    .enumerate()
    {
        let (x, legend) = (view_left + [0.0, 210.0][i % 2], legend + 22.0 * (i / 2) as f32);
        canvas.rect(x, legend - CAP, x + 14.0, legend, *colour);
        text(&mut canvas, words, [x + 20.0, legend], TextAnchor::Left, 0.85 * CAP, INK);
    }
    Ok(canvas.encode(PictureFormat::Png))
}

/// What a camera sees from a pose: in the scene's light, or by a lamp at the camera where there is none.
fn view(space: &FreeSpace<'_>, bvh: &Bvh, world_from_camera: &Rigid3) -> Raster<[u8; 3]> {
    let camera = Pinhole::from_horizontal_fov(VIEW[0], VIEW[1], 90.0);
    let tracer = LightTracer::new(space.scene(), bvh);
    let settings = LightSettings { samples_per_pixel: SAMPLES, max_bounces: 4, ..LightSettings::default() };
    let frame = tracer.render(&camera, world_from_camera, &settings, 0);
    let luminance = |p: &[f32; 3]| f64::from(0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2]);
    let lit: Vec<f64> = frame.radiance.pixels().iter().map(luminance).filter(|l| *l > 0.0).map(f64::ln).collect();
    if lit.len() * 10 < VIEW[0] * VIEW[1] {
        return by_headlamp(&frame, world_from_camera);
    }
    let mean = (lit.iter().sum::<f64>() / lit.len() as f64).exp();
    without_specks(&develop_frame(&frame, (MIDDLE_GREY / mean).log2() as f32))
}

/// Each pixel the middle one of its neighbourhood by brightness: few paths leave specks.
fn without_specks(picture: &Raster<[u8; 3]>) -> Raster<[u8; 3]> {
    let (width, height) = (picture.width(), picture.height());
    Raster::from_fn(width, height, |x, y| {
        let near = |at: usize, most: usize| at.saturating_sub(1)..(at + 2).min(most);
        let mut around: Vec<[u8; 3]> = near(y, height).flat_map(|v| near(x, width).map(move |u| picture[(u, v)])).collect();
        around.sort_by_key(|[r, g, b]| 2 * u32::from(*r) + 5 * u32::from(*g) + u32::from(*b));
        around[around.len() / 2]
    })
}

/// Surfaces in their own colours, brighter where they face the camera.
fn by_headlamp(frame: &LightFrame, world_from_camera: &Rigid3) -> Raster<[u8; 3]> {
    let ahead = (world_from_camera.rotation * DVec3::Z).as_vec3();
    Raster::from_fn(VIEW[0], VIEW[1], |x, y| {
        let facing = 0.25 + 0.75 * Vec3::from_array(frame.normal[(x, y)]).dot(ahead).abs();
        frame.albedo[(x, y)].map(|v| color::quantize8(color::srgb_from_linear(v * facing)))
    })
}

fn paste(canvas: &mut Canvas, size: [f32; 2], picture: &Raster<[u8; 3]>, [left, top]: [usize; 2]) {
    canvas.recolour(|u, v, colour| {
        let (x, y) = ((u * size[0]) as usize, (v * size[1]) as usize);
        let inside = x >= left && y >= top && x < left + picture.width() && y < top + picture.height();
        if inside { picture[(x - left, y - top)].map(|v| f32::from(v) / 255.0) } else { colour }
    });
}
