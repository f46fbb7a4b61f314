//! Views rendered together: memory, passes, and pixels that wait for tiles of cached light.

use super::super::renderer::no_cache;
use super::super::sampler::frame_seed;
use super::super::{LightSampling, LightView};
use super::lattices::Lattices;
use super::pace::Pace;
use super::params::{MOST_VIEWS, Params, Viewpoint, halves};
use super::{CachedKernels, GROUP, GpuLight, SUMS_WORDS, State};
use corf_gpu::{Bound, Context};
use corf_scene::{Error, Pinhole, Result};
use std::time::Instant;

/// Words of `work` in front of everything else, and what they say (`film.wgsl`).
pub(super) const WORK_HEAD: u32 = 80;
const WANTED: usize = 2;
pub(super) const NOT_FINITE: usize = 3;
const COUNTS: usize = 16;
/// Doublings of paths that there are counts of.
const MOST_LEVELS: u32 = 31;
/// Tiles that are asked for whose numbers are read back with the head.
const WANTED_AT_ONCE: u32 = 16_384;
/// Bytes of a pixel while it is rendered, and of all at most.
const PIXEL_BYTES: u64 = 4 * (SUMS_WORDS as u64 + 3 + 3);
const MOST_BYTES: u64 = 5 << 28;

/// Memory of images that are rendered together, and the kernels bound to it.
pub(super) struct Frame {
    size: [usize; 2],
    /// Images that there is room for.
    views: usize,
    pub sums: wgpu::Buffer,
    pub work: wgpu::Buffer,
    pub picture: wgpu::Buffer,
    render_paths: Bound,
    select: Bound,
    /// With how often the pages had moved when it was bound.
    render_view: Option<(u32, Bound)>,
    centre: Bound,
    pub develop: Bound,
}

/// Items in a list that are to be given paths.
struct Items {
    /// 0 all pixels, else that list.
    list: u32,
    count: u32,
    /// Parts of it, one behind the other: how many items, and paths of each at most. What is behind them is like the last.
    parts: Vec<(u32, u32)>,
}

/// Images of a camera's size that are rendered together at most.
pub(super) fn together(context: &Context, camera: &Pinhole) -> usize {
    let pixels = (camera.width * camera.height).max(1) as u64;
    let bound = context.largest_buffer() / (4 * SUMS_WORDS as u64 * pixels);
    (bound.min(MOST_BYTES / (PIXEL_BYTES * pixels)) as usize).clamp(1, MOST_VIEWS)
}

/// Pixels in whole blocks of 8×8.
fn places([width, height]: [usize; 2]) -> u32 {
    (width.div_ceil(8) * height.div_ceil(8)) as u32 * GROUP
}

impl<'a> GpuLight<'a> {
    /// Memory of images of a size, with `tiles` of cached light.
    fn make_frame(&self, size: [usize; 2], views: usize, tiles: u32) -> Result<Frame> {
        let pixels = (size[0] * size[1] * views) as u64;
        let sums = self.context.storage("a view's pixels", 4 * SUMS_WORDS as u64 * pixels)?;
        let work = self.context.storage("a view's lists", 4 * (u64::from(WORK_HEAD + tiles) + 3 * pixels))?;
        let picture = self.context.storage("a view's image", 12 * pixels)?;
        Ok(Frame {
            size,
            views,
            render_paths: self.bind(&self.kernels.render_paths, &[&sums, &work])?,
            select: self.bind(&self.kernels.select, &[&sums, &work])?,
            render_view: None,
            centre: self.bind(&self.kernels.centre, &[&sums, &work])?,
            develop: self.bind(&self.kernels.develop, &[&sums, &work, &picture])?,
            sums,
            work,
            picture,
        })
    }

    /// Makes memory for as many images of a camera together as there is any for; how many that is.
    pub(super) fn reserve_frame(&self, state: &mut State<'a>, camera: &Pinhole) -> Result<usize> {
        let tiles = state.lattices.as_ref().map_or(0, Lattices::slot_count);
        let mut views = together(&self.context, camera);
        loop {
            // What is there goes before what is new comes.
            state.frame = None;
            match self.make_frame([camera.width, camera.height], views, tiles) {
                Ok(frame) => {
                    state.frame = Some(frame);
                    return Ok(views);
                }
                Err(error) if views == 1 => return Err(error),
                Err(_) => views /= 2,
            }
        }
    }

    /// Settings of some views.
    fn view_params(&self, camera: &Pinhole, views: &[LightView], sampling: &LightSampling, tiles: u32) -> Params {
        let mut common = Params {
            width: camera.width as u32,
            height: camera.height as u32,
            focal: [camera.fx as f32, camera.fy as f32],
            centre: [camera.cx as f32, camera.cy as f32],
            views: views.len() as u32,
            lists_at: WORK_HEAD + tiles,
            list_size: (camera.width * camera.height * views.len()) as u32,
            gain: 1.0,
            ..self.params
        };
        let seed = match sampling {
            LightSampling::Path(s) => s.seed,
            LightSampling::Cached(s) => s.seed,
        };
        for (viewpoint, view) in common.viewpoints.iter_mut().zip(views) {
            let axis = |axis: glam::DVec3| view.world_from_camera.transform_vector(axis).as_vec3().to_array();
            let [frame_low, frame_high] = halves(frame_seed(seed, view.key));
            *viewpoint = Viewpoint {
                x_axis: axis(glam::DVec3::X),
                frame_low,
                y_axis: axis(glam::DVec3::Y),
                frame_high,
                z_axis: axis(glam::DVec3::Z),
                origin: view.world_from_camera.translation.as_vec3().to_array(),
                ..Viewpoint::default()
            };
        }
        match sampling {
            LightSampling::Path(s) => Params {
                seed: halves(seed),
                background: s.background,
                samples: s.samples_per_pixel.max(1),
                max_bounces: s.max_bounces,
                roulette_after: s.roulette_after,
                next_event: u32::from(s.next_event_estimation && !self.tracer.emitters.is_empty()),
                ..common
            },
            LightSampling::Cached(s) => {
                let base = s.samples_per_pixel.max(1);
                let levels = (0..base.leading_zeros().min(MOST_LEVELS)).find(|level| base << level >= s.most_samples);
                let levels = levels.unwrap_or(base.leading_zeros());
                Params {
                    seed: halves(seed),
                    gain: s.exposure_ev.exp2(),
                    base,
                    most: s.most_samples.min(base << levels.min(base.leading_zeros())),
                    levels,
                    variance: s.error * s.error,
                    ..common
                }
            }
        }
    }

    /// Renders some views, no more than [`together`] says, into the frame; returns that and the settings it took.
    pub(super) fn views<'s>(
        &self,
        state: &'s mut State<'a>,
        camera: &Pinhole,
        views: &[LightView],
        sampling: &LightSampling,
    ) -> Result<(&'s Frame, Params)> {
        let start = Instant::now();
        let size = [camera.width, camera.height];
        let tiles = state.lattices.as_ref().map_or(0, Lattices::slot_count);
        let params = self.view_params(camera, views, sampling, tiles);
        if state.frame.as_ref().is_none_or(|frame| frame.size != size || frame.views < views.len()) {
            // What is there goes before what is new comes.
            state.frame = None;
            state.frame = Some(self.make_frame(size, views.len(), tiles)?);
        }
        let State { frame: Some(frame), lattices, pace } = state else { unreachable!("made above") };
        let places = places(size) * views.len() as u32;
        let mut encoder = self.context.encoder();
        encoder.clear_buffer(&frame.sums, 0, None);
        encoder.clear_buffer(&frame.work, 0, Some(4 * u64::from(WORK_HEAD)));
        self.context.submit(encoder);
        match sampling {
            LightSampling::Path(_) => {
                let step = (pace.paths / places).max(1);
                let mut samples = 0;
                while samples < params.samples {
                    samples = params.samples.min(samples.saturating_add(step));
                    let items = Items { list: 0, count: places, parts: vec![(places, step)] };
                    self.paths("gpu: paths", &frame.render_paths, pace, &Params { samples, ..params }, &items);
                }
            }
            LightSampling::Cached(_) => {
                let Some(lattices) = lattices else { return Err(no_cache()) };
                self.cached_views(frame, lattices, pace, &params, places)?;
            }
        }
        let mut commands = self.commands("gpu: depth");
        commands.over(&frame.centre, &params, places);
        commands.submit();
        self.context.check("rendering light")?;
        self.read_stamps()?;
        self.clock.stages.add("rendering", start.elapsed().as_secs_f64());
        Ok((frame, params))
    }

    /// Runs a kernel that gives items paths, in dispatches of as many as the pace allows.
    fn paths(&self, what: &'static str, bound: &Bound, pace: &Pace, params: &Params, items: &Items) {
        let mut first = 0;
        // The part that `first` lies in, and where it ends.
        let (mut part, mut end) = (0, 0);
        while first < items.count {
            let (mut count, mut paths) = (0, 0u64);
            while first + count < items.count {
                while part < items.parts.len() && end <= first + count {
                    end += items.parts[part].0;
                    part += 1;
                }
                let each = u64::from(items.parts.get(part.max(1) - 1).map_or(1, |(_, paths)| *paths).max(1));
                let until = if end > first + count { end.min(items.count) } else { items.count };
                let rest = until - (first + count);
                let room = u64::from(pace.paths).saturating_sub(paths) / each;
                let taken = u64::from(rest).min(room) as u32;
                (count, paths) = (count + taken, paths + u64::from(taken) * each);
                if taken < rest {
                    break;
                }
            }
            // Whole workgroups, one at least.
            let left = items.count - first;
            let count = if count < left { (count / GROUP).max(1) * GROUP } else { count }.min(left);
            let mut commands = self.commands(what);
            commands.run(bound, &Params { list: items.list, first, count, ..*params }, count.div_ceil(GROUP));
            commands.submit();
            first += count;
        }
    }

    /// Paths of every pixel, then more of them where they disagree.
    fn cached_views(
        &self,
        frame: &mut Frame,
        lattices: &mut Lattices<'a>,
        pace: &mut Pace,
        params: &Params,
        places: u32,
    ) -> Result<()> {
        let base = Params { samples: params.base, ..*params };
        let all = Items { list: 0, count: places, parts: vec![(places, params.base)] };
        self.until_filled("gpu: first paths", frame, lattices, pace, &base, all)?;
        if params.levels == 0 {
            return Ok(());
        }
        let mut commands = self.commands("gpu: choosing");
        commands.over(&frame.select, &base, places);
        commands.over(&frame.select, &Params { list: 1, ..base }, places);
        commands.submit();
        let (head, _) = self.head(frame, 0)?;
        let each = |level: u32| (head[COUNTS + level as usize], (params.base << level) - params.base);
        let parts: Vec<(u32, u32)> = (1..=params.levels).rev().map(each).filter(|(count, _)| *count > 0).collect();
        let count = parts.iter().map(|(count, _)| count).sum();
        let more = Items { list: 1, count, parts };
        self.until_filled("gpu: more paths", frame, lattices, pace, &Params { samples: 0, ..*params }, more)
    }

    /// Gives items paths; those that lack tiles are gone on with once these are filled.
    fn until_filled(
        &self,
        what: &'static str,
        frame: &mut Frame,
        lattices: &mut Lattices<'a>,
        pace: &mut Pace,
        params: &Params,
        mut items: Items,
    ) -> Result<()> {
        let most = items.parts.iter().map(|(_, paths)| *paths).max().unwrap_or(1);
        let mut is_first = true;
        while items.count > 0 {
            let other = usize::from(items.list == 1);
            self.clear_length(frame, other);
            if frame.render_view.as_ref().is_none_or(|(moves, _)| *moves != lattices.moves) {
                let Some(CachedKernels { render_view: kernel, .. }) = &self.kernels.cached else { return Err(no_cache()) };
                let buffers = [vec![&frame.sums, &frame.work], lattices.for_renderer()].concat();
                frame.render_view = Some((lattices.moves, self.bind(kernel, &buffers)?));
            }
            let Some((_, render)) = &frame.render_view else { return Err(no_cache()) };
            let start = Instant::now();
            self.paths(what, render, pace, params, &items);
            let (head, mut wanted) = self.head(frame, WANTED_AT_ONCE)?;
            if is_first {
                let paths = items.parts.iter().map(|(count, paths)| u64::from(*count) * u64::from(*paths)).sum();
                pace.learn(paths, start.elapsed().as_secs_f64());
            }
            is_first = false;
            let count = head[WANTED] as usize;
            if count == 0 && head[other] > 0 {
                let what = format!("{} pixels wait for cached light that is not filled", head[other]);
                return Err(Error::invalid(format!("gpu ({})", self.context.info.name), what, "choose --device cpu"));
            }
            if count > 0 {
                if count > wanted.len() {
                    wanted = self.head(frame, count as u32)?.1;
                }
                wanted.truncate(count);
                self.clear_length(frame, WANTED);
                let start = Instant::now();
                lattices.fill(self, pace, params, wanted)?;
                self.clock.stages.add("asking for tiles", start.elapsed().as_secs_f64());
            }
            self.read_stamps()?;
            items = Items { list: other as u32 + 1, count: head[other], parts: vec![(head[other], most)] };
        }
        Ok(())
    }

    /// Reads the device's timestamps where that is worth a wait.
    fn read_stamps(&self) -> Result<()> {
        let is_due = self.clock.passes() >= super::clock::WORTH_READING;
        if is_due { self.clock.stages.time("waiting", || self.clock.collect(&self.context)) } else { Ok(()) }
    }

    /// Sets a word of the head of `work` to zero.
    fn clear_length(&self, frame: &Frame, word: usize) {
        let mut encoder = self.context.encoder();
        encoder.clear_buffer(&frame.work, 4 * word as u64, Some(4));
        self.context.submit(encoder);
    }

    /// The head of `work`, and the numbers of so many tiles behind it, as far as there are any.
    fn head(&self, frame: &Frame, tiles: u32) -> Result<(Vec<u32>, Vec<u32>)> {
        let words = (u64::from(WORK_HEAD) + u64::from(tiles)).min(frame.work.size() / 4) as usize;
        let read = || self.context.read::<u32>("rendering light", &[(&frame.work, words)]);
        let mut head = self.clock.stages.time("waiting", read)?.remove(0);
        let tiles = head.split_off(WORK_HEAD as usize);
        Ok((head, tiles))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::gpu::pace::FEWEST_PATHS;

    #[test]
    fn dispatches_grow_where_they_are_short_and_shrink_where_they_are_long() {
        let mut pace = Pace::default();
        pace.learn(100, 1e-9);
        assert_eq!(pace.paths, FEWEST_PATHS, "too few paths to say anything");
        pace.learn(8 << 20, 0.01);
        assert_eq!(pace.paths, 2 * FEWEST_PATHS, "never more than twice as many");
        (0..20).for_each(|_| pace.learn(100 << 20, 0.4));
        assert_eq!(pace.paths, 50 << 20, "a fifth of a second");
        assert_eq!(pace.scaled(1000), 12_500);
        pace.learn(1 << 30, 1e4);
        assert_eq!(pace.paths, FEWEST_PATHS);
    }
}
