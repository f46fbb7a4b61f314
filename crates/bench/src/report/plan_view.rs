//! The room from above, put together from what the keyframes saw, with transmitter and trajectory.

use super::Report;
use crate::charts::png_uri;
use anyhow::Result;
use corf_scene::words::counted;
use corf_scene::{Light, Raster};
use glam::DVec3;
use std::fmt::Write;

/// Side of a cell of the plan, metres.
const CELL_M: f64 = 0.05;
/// Space around what was seen, metres.
const MARGIN_M: f64 = 0.4;
/// Nothing farther than this from the trajectory's own box is drawn: a street seen through a window is not the room.
const REACH_M: f64 = 4.6;
/// Nothing above this share of the seen height is drawn: the ceiling would hide the room.
const CUT_SHARE: f64 = 0.8;
/// SVG units per metre.
const UNITS_PER_M: f64 = 40.0;

struct Plan {
    picture: Raster<[u8; 3]>,
    min: DVec3,
    max: DVec3,
}

/// Back-projects every second pixel of every second keyframe that has depth; the highest point below the cut wins a cell.
fn look_down(report: &Report<'_>) -> Result<Option<Plan>> {
    let camera = report.dataset.light_camera();
    let mut points: Vec<(DVec3, [u8; 3])> = Vec::new();
    for index in (0..report.dataset.len()).step_by(2) {
        let keyframe = report.dataset.keyframe(index)?;
        let Some(Light { image, depth_m: Some(depth), .. }) = &keyframe.light else { continue };
        let step = (camera.width / 192).max(1);
        for y in (0..camera.height).step_by(step) {
            for x in (0..camera.width).step_by(step) {
                let z = f64::from(depth[(x, y)]);
                if z.is_finite() && z > 0.0 {
                    let p = keyframe.world_from_camera.transform_point(camera.unproject(x as f64 + 0.5, y as f64 + 0.5) * z);
                    points.push((p, image[(x, y)]));
                }
            }
        }
    }
    if points.is_empty() {
        return Ok(None);
    }
    let (mut min, mut max) = extent(&points);
    let positions = || report.dataset.poses().iter().map(|p| p.world_from_camera.translation);
    let reach = DVec3::new(REACH_M, REACH_M, f64::INFINITY);
    min = min.max(positions().fold(DVec3::INFINITY, DVec3::min) - reach);
    max = max.min(positions().fold(DVec3::NEG_INFINITY, DVec3::max) + reach);
    let cut_m = min.z + CUT_SHARE * (max.z - min.z);
    let (min, max) = (min - DVec3::splat(MARGIN_M), max + DVec3::splat(MARGIN_M));
    let (width, height) = (((max.x - min.x) / CELL_M).ceil() as usize, ((max.y - min.y) / CELL_M).ceil() as usize);
    let mut top = Raster::filled(width, height, f64::NEG_INFINITY);
    let mut picture = Raster::filled(width, height, [236u8, 239, 243]);
    for (p, colour) in points.into_iter().filter(|(p, _)| p.z < cut_m) {
        if !(min.x..max.x).contains(&p.x) || !(min.y..max.y).contains(&p.y) {
            continue;
        }
        let at = (((p.x - min.x) / CELL_M) as usize, ((max.y - p.y) / CELL_M) as usize);
        if at.0 < width && at.1 < height && p.z > top[at] {
            top[at] = p.z;
            picture[at] = colour;
        }
    }
    Ok(Some(Plan { picture, min, max }))
}

/// The box that holds all but the farthest thousandth of the points on every side: what lies behind a window is not the room.
fn extent(points: &[(DVec3, [u8; 3])]) -> (DVec3, DVec3) {
    let side = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|(p, _)| p[axis]).collect();
        values.sort_by(f64::total_cmp);
        let skip = values.len() / 1000;
        (values[skip], values[values.len() - 1 - skip])
    };
    let [x, y, z] = [0, 1, 2].map(side);
    (DVec3::new(x.0, y.0, z.0), DVec3::new(x.1, y.1, z.1))
}

/// The plan as an inline SVG with its legend.
pub(super) fn figure(report: &Report<'_>) -> Result<String> {
    let poses = report.dataset.poses();
    let Some(plan) = look_down(report)? else {
        return Ok("<p class=\"note\">The dataset has no depth, so no plan is drawn.</p>".to_owned());
    };
    let to_svg = |p: DVec3| ((p.x - plan.min.x) * UNITS_PER_M, (plan.max.y - p.y) * UNITS_PER_M);
    let (width, height) = ((plan.max.x - plan.min.x) * UNITS_PER_M, (plan.max.y - plan.min.y) * UNITS_PER_M);
    let mut svg = format!(
        "<svg viewBox=\"0 0 {width:.0} {height:.0}\" font-family=\"sans-serif\" font-size=\"15\"><image href=\"{}\" width=\"{width:.0}\" \
         height=\"{height:.0}\" preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\"/>",
        png_uri(&plan.picture)?
    );
    let track: Vec<String> =
        poses.iter().map(|p| to_svg(p.world_from_camera.translation)).map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
    write!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"#0a5ad0\" stroke-width=\"2.5\" opacity=\".8\"/>",
        track.join(" ")
    )?;
    let held_out = &report.split.held_out;
    for (i, pose) in poses.iter().map(|p| &p.world_from_camera).enumerate() {
        let (x, y) = to_svg(pose.translation);
        let ahead = to_svg(pose.translation + 0.35 * pose.rotation.z_axis);
        let colour = if held_out.contains(&i) { "#e8590c" } else { "#0a5ad0" };
        write!(
            svg,
            "<line x1=\"{x:.1}\" y1=\"{y:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"{colour}\" stroke-width=\"2\"/>",
            ahead.0, ahead.1
        )?;
        write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4.5\" fill=\"{colour}\" stroke=\"#fff\"/>")?;
    }
    if let Some(tx) = report.transmitter_m {
        let (x, y) = to_svg(DVec3::from_array(tx));
        write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"9\" fill=\"#c2255c\" stroke=\"#fff\" stroke-width=\"2\"/>")?;
        write!(
            svg,
            "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"#c2255c\" stroke=\"#fff\" stroke-width=\"3\" paint-order=\"stroke\">TX</text>",
            x + 13.0,
            y + 5.0
        )?;
    }
    let metre = UNITS_PER_M * 2.0;
    write!(
        svg,
        "<path d=\"M20 {0:.0}h{metre:.0}\" stroke=\"#1b2330\" stroke-width=\"3\"/><text x=\"20\" y=\"{1:.0}\" stroke=\"#fff\" stroke-width=\"3\" paint-order=\"stroke\">2 m</text></svg>",
        height - 18.0,
        height - 26.0
    )?;
    let trained = report.split.train.len();
    let transmitter =
        report.transmitter_m.map_or(String::new(), |t| format!("Transmitter at ({:.2}, {:.2}, {:.2}) m. ", t[0], t[1], t[2]));
    Ok(format!(
        "<div class=\"plan\"><figure>{svg}</figure><p class=\"note\">{transmitter}{} (blue), {} held out \
         (orange); the ticks point where the platform looks. The plan is put together from the keyframes' own images and depths, \
         the ceiling cut away; x to the right, y up.</p></div>",
        counted(trained, "training keyframe"),
        held_out.len()
    ))
}
