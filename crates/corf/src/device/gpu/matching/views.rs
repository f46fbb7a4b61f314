//! Views in device memory: as they are kept, and as rows that kernels read.

use super::super::keyframe_cache::{Budget, Lease};
use crate::{
    Result,
    depth::{GreyImage, GreyView, HeldView, Neighbour},
};
use corf_gpu::{Context, record};
use corf_scene::Pinhole;
use glam::{Mat3, Vec3};
use std::sync::Arc;

/// Place of the table of pixels that do not count, of an image of which all do.
pub(super) const ALL_COUNT: u32 = u32::MAX;

record! {
    /// A rotation's columns, and a translation.
    pub(super) struct PoseRow {
        x_axis: [f32; 3],
        padding_x: u32,
        y_axis: [f32; 3],
        padding_y: u32,
        z_axis: [f32; 3],
        padding_z: u32,
        translation: [f32; 3],
        padding: u32,
    }
}

record! {
    /// An image: its camera, and where its pairs and its table are among all words.
    pub(super) struct ImageRow {
        focal: [f32; 2],
        centre: [f32; 2],
        size: [u32; 2],
        at: u32,
        left_out_at: u32,
    }
}

record! {
    /// A view: the poses that take points of the reference into it, and back. The first is the reference itself.
    pub(super) struct ViewRow {
        there: PoseRow,
        back: PoseRow,
        image: ImageRow,
    }
}

/// The records in WGSL.
pub(super) fn declarations() -> String {
    PoseRow::declaration() + &ImageRow::declaration() + &ViewRow::declaration()
}

impl PoseRow {
    fn new((rotation, translation): (Mat3, Vec3)) -> Self {
        let [x_axis, y_axis, z_axis] = [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(|axis| axis.to_array());
        Self { x_axis, y_axis, z_axis, translation: translation.to_array(), ..Self::default() }
    }
}

/// Which of a view's two images is matched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Level {
    Fine,
    Coarse,
}

impl Level {
    fn of(self, view: &GreyView) -> (&GreyImage, &Pinhole) {
        match self {
            Self::Fine => (&view.fine, &view.fine_camera),
            Self::Coarse => (&view.coarse, &view.coarse_camera),
        }
    }

    /// Words of an image.
    fn words(self, view: &GreyView) -> usize {
        let (image, _) = self.of(view);
        image.pairs().len() + image.left_out().len()
    }
}

/// A view's images in memory of their own: the fine one's words, then the coarse one's.
struct HeldImages {
    buffer: wgpu::Buffer,
    _lease: Lease,
    /// Last, for what is made of it to be dropped before.
    context: Arc<Context>,
}

/// Keeps a view's images on the device, if the budget has room for them.
pub(super) fn hold(context: &Arc<Context>, budget: &Arc<Budget>, view: &GreyView) -> Result<Option<HeldView>> {
    let bytes = 4 * (Level::Fine.words(view) + Level::Coarse.words(view)) as u64;
    if bytes > context.largest_buffer() {
        return Ok(None);
    }
    let Some(lease) = budget.take(bytes) else { return Ok(None) };
    let buffer = context.storage("grey images", bytes)?;
    let mut at = 0;
    for level in [Level::Fine, Level::Coarse] {
        let (image, _) = level.of(view);
        for words in [image.pairs(), image.left_out()] {
            context.fill(&buffer, 4 * at as u64, words);
            at += words.len();
        }
    }
    context.check("keeping a view")?;
    Ok(Some(HeldView::new(HeldImages { buffer, _lease: lease, context: context.clone() })))
}

/// The views of one question, the reference first: their rows, and the words that they need.
pub(super) struct Gathered<'a> {
    pub rows: Vec<ViewRow>,
    /// Words of all, with those that a patch at the last image's border may look at beyond it.
    pub words: usize,
    level: Level,
    views: Vec<&'a GreyView>,
}

impl<'a> Gathered<'a> {
    pub fn new(reference: &'a GreyView, neighbours: &[Neighbour<'a>], level: Level) -> Self {
        let still = PoseRow::new((Mat3::IDENTITY, Vec3::ZERO));
        let (mut rows, mut views, mut words) = (vec![], vec![], 0);
        let mut push = |view: &'a GreyView, there: PoseRow, back: PoseRow| {
            let (image, camera) = level.of(view);
            let left_out_at = if image.all_count() { ALL_COUNT } else { (words + image.pairs().len()) as u32 };
            let image = ImageRow {
                focal: [camera.fx as f32, camera.fy as f32],
                centre: [camera.cx as f32, camera.cy as f32],
                size: [image.width() as u32, image.height() as u32],
                at: words as u32,
                left_out_at,
            };
            rows.push(ViewRow { there, back, image });
            views.push(view);
            words += level.words(view);
        };
        push(reference, still, still);
        for neighbour in neighbours {
            let back = Neighbour::new(neighbour.view, reference).neighbour_from_reference();
            push(neighbour.view, PoseRow::new(neighbour.neighbour_from_reference()), PoseRow::new(back));
        }
        let widest = rows.iter().map(|row| row.image.size[0] as usize).max().unwrap_or(0);
        Self { rows, words: words + widest + 2, level, views }
    }

    /// Brings the words to where kernels read them: copies of what is on the device, the rest from here.
    pub fn bring(&self, context: &Context, encoder: &mut wgpu::CommandEncoder, target: &wgpu::Buffer) {
        for (view, row) in self.views.iter().zip(&self.rows) {
            let at = 4 * u64::from(row.image.at);
            let words = self.level.words(view);
            let held = view.held.as_ref().and_then(|held| held.content::<HeldImages>());
            match held.filter(|held| std::ptr::eq(&*held.context, context)) {
                Some(held) => {
                    let from = if self.level == Level::Fine { 0 } else { 4 * Level::Fine.words(view) as u64 };
                    encoder.copy_buffer_to_buffer(&held.buffer, from, target, at, 4 * words as u64);
                }
                None => {
                    let (image, _) = self.level.of(view);
                    context.fill(target, at, image.pairs());
                    context.fill(target, at + 4 * image.pairs().len() as u64, image.left_out());
                }
            }
        }
    }
}
