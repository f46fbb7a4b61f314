//! Files for other tools in each modality's folder: COLMAP text, transforms.json, split lists.

use super::header::{DatasetHeader, SplitLists, to_json};
use super::layout;
use crate::trajectory::TrajectoryPose;
use crate::{Pinhole, Raster, Result, Rng, io};
use glam::{DQuat, DVec3};
use serde_json::json;
use std::fmt::Write as _;
use std::path::Path;

/// A point with a colour, to seed other tools with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColoredPoint {
    /// World position, metres.
    pub position: DVec3,
    /// Red, green and blue, encoded as in sRGB.
    pub color: [u8; 3],
}

/// A point, and where a keyframe saw it.
pub(super) struct SeenPoint {
    point: ColoredPoint,
    /// Index of the keyframe, and the image position, pixels; none of a point that came without.
    seen: Option<(usize, [f64; 2])>,
}

/// `optical`, `rf` or `rf-tutorial`: a folder other tools open directly.
pub(super) struct Modality {
    pub root: &'static str,
    pub camera: Pinhole,
}

impl Modality {
    /// The folders that a dataset has.
    pub fn all(header: &DatasetHeader) -> Vec<Self> {
        let mut list = Vec::new();
        if header.modalities.light {
            list.push(Self { root: "optical", camera: header.light_camera });
        }
        if header.modalities.radio {
            list.push(Self { root: "rf", camera: header.radio_camera });
        }
        if header.tutorial_range.is_some() {
            list.push(Self { root: layout::TUTORIAL_ROOT, camera: header.radio_camera });
        }
        list
    }
}

/// Points sampled over all training keyframes: enough to start a splat, few enough to read in no time.
const POINTS: usize = 20_000;
/// Random stream of the point samples.
const STAGE_POINTS: u64 = 0x706f_696e_7473;

/// Surface points seen by the training keyframes, coloured by image and by RF image, in this order, and those that are `known` besides.
pub(super) fn sample_points(
    dir: &Path,
    header: &DatasetHeader,
    train: &[usize],
    radio_images: &[Raster<[u8; 3]>],
    known: &[ColoredPoint],
) -> Result<[Vec<SeenPoint>; 2]> {
    let (light, radio) = (&header.light_camera, &header.radio_camera);
    let mut points = [Vec::new(), Vec::new()];
    // A dataset of one keyframe has no training ones; its own depth is all there is.
    let frames: &[usize] = if train.is_empty() { &[0] } else { train };
    for &index in frames {
        let path = dir.join(layout::depth(index));
        if !path.exists() {
            continue;
        }
        let (depth, image) = (io::read_exr_f32(&path)?, io::read_png(dir.join(layout::image(index)))?);
        let mask = Some(dir.join(layout::mask(index))).filter(|path| path.exists()).map(io::read_mask).transpose()?;
        let pose = header.poses[index].world_from_camera;
        let mut rng = Rng::keyed(header.seed, STAGE_POINTS, index as u64);
        for _ in 0..POINTS.div_ceil(frames.len()) {
            let (x, y) = (rng.below(light.width), rng.below(light.height));
            let z = f64::from(depth[(x, y)]);
            if !(z > 0.0 && z.is_finite()) || mask.as_ref().is_some_and(|mask| !mask[(x, y)]) {
                continue;
            }
            let in_camera = light.unproject(x as f64 + 0.5, y as f64 + 0.5) * z;
            let position = pose.transform_point(in_camera);
            let at = [x as f64 + 0.5, y as f64 + 0.5];
            points[0].push(SeenPoint { point: ColoredPoint { position, color: image[(x, y)] }, seen: Some((index, at)) });
            if let (Some(p), Some(radio_image)) = (radio.project(in_camera), radio_images.get(index))
                && (0.0..radio.width as f64).contains(&p.x)
                && (0.0..radio.height as f64).contains(&p.y)
            {
                let point = ColoredPoint { position, color: radio_image[(p.x as usize, p.y as usize)] };
                points[1].push(SeenPoint { point, seen: Some((index, p.to_array())) });
            }
        }
    }
    for list in &mut points {
        list.extend(known.iter().map(|point| SeenPoint { point: *point, seen: None }));
        if list.is_empty() {
            // Readers insist on one point: the camera centres' mean says at least where the scene is.
            let mean = header.poses.iter().map(|p| p.world_from_camera.translation).sum::<DVec3>() / header.poses.len() as f64;
            list.push(SeenPoint { point: ColoredPoint { position: mean, color: [128; 3] }, seen: None });
        }
    }
    Ok(points)
}

/// The text files of one modality: path below its root, content.
pub(super) fn files(
    modality: &Modality,
    poses: &[TrajectoryPose],
    split: &SplitLists,
    points: &[SeenPoint],
    offset_m: Option<[f64; 3]>,
) -> Result<Vec<(&'static str, String)>> {
    let stems = |list: &[usize]| list.iter().map(|i| layout::stem(*i) + "\n").collect::<String>();
    Ok(vec![
        ("sparse/0/cameras.txt", cameras_txt(&modality.camera)),
        ("sparse/0/images.txt", images_txt(poses, points, offset_m)),
        ("sparse/0/points3D.txt", points_txt(poses.len(), points)),
        // Without it nerfbaselines cannot choose between the model and transforms.json.
        ("nb-info.json", "{\"loader\": \"colmap\"}\n".to_owned()),
        ("transforms.json", transforms_json(&modality.camera, poses, [&split.train, &split.test], None)?),
        ("train_index.txt", stems(&split.train)),
        ("test_index.txt", stems(&split.test)),
    ])
}

/// COLMAP's `cameras.txt`: `ID PINHOLE W H fx fy cx cy`.
fn cameras_txt(c: &Pinhole) -> String {
    format!(
        "# CAMERA_ID MODEL WIDTH HEIGHT FX FY CX CY\n1 PINHOLE {} {} {} {} {} {}\n",
        c.width, c.height, c.fx, c.fy, c.cx, c.cy
    )
}

/// COLMAP's `images.txt`: `ID qw qx qy qz tx ty tz CAMERA NAME`, camera_from_world, OpenCV axes; then `X Y
/// POINT3D_ID` of the points that were taken in it, or an empty line.
fn images_txt(poses: &[TrajectoryPose], points: &[SeenPoint], offset_m: Option<[f64; 3]>) -> String {
    let mut observed = vec![Vec::new(); poses.len()];
    for (i, point) in points.iter().enumerate() {
        if let Some((index, [x, y])) = point.seen {
            observed[index].push(format!("{x} {y} {}", i + 1));
        }
    }
    let mut text = "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME (camera_from_world), then POINTS2D\n".to_string();
    if let Some([x, y, z]) = offset_m {
        let _ = writeln!(text, "# world: ({x}, {y}, {z}) m was taken off the original positions");
    }
    for p in poses {
        let camera_from_world = p.world_from_camera.inverse();
        let q = DQuat::from_mat3(&camera_from_world.rotation).normalize();
        let t = camera_from_world.translation;
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{} {} {} {} {} {} {} {} 1 {}.png\n{}",
            p.index + 1,
            q.w,
            q.x,
            q.y,
            q.z,
            t.x,
            t.y,
            t.z,
            layout::stem(p.index),
            observed[p.index].join(" ")
        );
    }
    text
}

/// COLMAP's `points3D.txt`: `ID X Y Z R G B ERROR TRACK[]`; a track is the image that the point was taken in and its place in that image's list.
fn points_txt(images: usize, points: &[SeenPoint]) -> String {
    let mut text = "# POINT3D_ID X Y Z R G B ERROR TRACK[] as (IMAGE_ID, POINT2D_IDX)\n".to_string();
    let mut listed = vec![0; images];
    for (i, SeenPoint { point, seen }) in points.iter().enumerate() {
        let ([r, g, b], x) = (point.color, point.position);
        let _ = write!(text, "{} {:.6} {:.6} {:.6} {r} {g} {b} 0", i + 1, x.x, x.y, x.z);
        if let Some((index, _)) = seen {
            let _ = write!(text, " {} {}", index + 1, listed[*index]);
            listed[*index] += 1;
        }
        text.push('\n');
    }
    text
}

/// Files that a transforms.json names beside images.
pub(crate) struct Besides<'a> {
    /// Point cloud.
    pub points: &'a str,
    /// 16-bit depth of a keyframe, millimetres; none without depth.
    pub depth: Option<fn(usize) -> String>,
    /// 8-bit mask of a keyframe; none without masks.
    pub mask: Option<fn(usize) -> String>,
    /// What was taken off the original positions, metres.
    pub offset_m: Option<[f64; 3]>,
}

/// transforms.json: world_from_camera in OpenGL axes (y up, z backward: columns 1 and 2 negated); no `camera_model`, whose names no
/// two readers agree on, and no reorientation of a world that is z-up already.
pub(crate) fn transforms_json(
    c: &Pinhole,
    poses: &[TrajectoryPose],
    [train, test]: [&[usize]; 2],
    besides: Option<&Besides<'_>>,
) -> Result<String> {
    let name = |i: usize| format!("images/{}.png", layout::stem(i));
    let (depth, mask) = (besides.and_then(|b| b.depth), besides.and_then(|b| b.mask));
    let frames: Vec<serde_json::Value> = poses
        .iter()
        .map(|p| {
            let rows = p.world_from_camera.to_rows().map(|[a, b, c, d]| [a, -b, -c, d]);
            let mut frame = json!({ "file_path": name(p.index), "transform_matrix": rows });
            if let Some(depth) = depth {
                frame["depth_file_path"] = json!(depth(p.index));
            }
            if let Some(mask) = mask {
                frame["mask_path"] = json!(mask(p.index));
            }
            frame
        })
        .collect();
    let names = |list: &[usize]| list.iter().map(|i| name(*i)).collect::<Vec<String>>();
    let test = names(test);
    let mut file = json!({
        "w": c.width,
        "h": c.height,
        "fl_x": c.fx,
        "fl_y": c.fy,
        "cx": c.cx,
        "cy": c.cy,
        "orientation_override": "none",
        "frames": frames,
        "train_filenames": names(train),
        "val_filenames": test,
        "test_filenames": test,
    });
    if let Some(besides) = besides {
        file["ply_file_path"] = json!(besides.points);
        if let Some(offset_m) = besides.offset_m {
            file["corf_offset_m"] = json!(offset_m);
        }
    }
    to_json(&file)
}
