//! Matching of keyframes on a GPU: the kernels of `depth::matching` and `depth::triangulate`, a workgroup a pixel.
//!
//! It has the adapter opened for itself: what it asks is answered beside training instead of behind the steps that were handed over before, and
//! threads wait for their own answer alone. A view's images are sent once and stay as long as the view is somebody's neighbour, within the memory
//! that keyframes may take; a question copies those that it needs side by side, and only answers are read back.

mod views;

use super::keyframe_cache::Budget;
use crate::{
    Result,
    config::DepthConfig,
    depth::{
        Found, GreyView, HeldView, Matcher, Neighbour, Start,
        matching::{FINEST_STEP_PX, RADIUS, least_segment_px},
        patch::{FULL, LEAST_CONTRAST},
        triangulate,
    },
};
use bytemuck::Zeroable;
use corf_gpu::{AdapterOptions, Context, GROUP_NUMBER, Kernel, Scratch, Timestamps, UNIFORM_STRIDE, record};
use std::sync::{Arc, Mutex, PoisonError};
use views::{Gathered, Level, ViewRow};

/// Pixels of a submission: some milliseconds on a large card, so that one a hundred times slower ends it before a desktop's watchdog does.
const PIXELS_AT_ONCE: usize = 1 << 16;
/// Most inverse depths that a pixel is compared at, and most neighbours, as configurations bound them.
const MOST_GUIDED: usize = 256;
const MOST_SWEPT: usize = 1024;
const MOST_NEIGHBOURS: usize = 32;
/// Threads of a workgroup: a neighbour each; two for each neighbour.
const GUIDED_THREADS: usize = MOST_NEIGHBOURS;
const SWEEP_THREADS: usize = 2 * MOST_NEIGHBOURS;
/// Times that a step is halved at most: from an image's longest side to a fraction of a pixel.
const MOST_HALVINGS: usize = 32;

record! {
    /// Constants of a dispatch.
    struct Job {
        /// Its first pixel among all, and how many it has.
        first: u32,
        count: u32,
        neighbours: u32,
        /// Inverse depths that a pixel is compared at.
        candidates: u32,
        /// Half range of the search, relative to the guess.
        range: f32,
        shortest_px: f32,
        min_zncc: f32,
        cost_ratio: f32,
        /// Least inverse depth of the sweep and the step from one to the next, 1/m.
        far: f32,
        step: f32,
        padding: [f32; 2],
    }
}

record! {
    /// A pixel (column, row) to be matched, its inverse depth and the change of that per pixel.
    struct StartRow {
        pixel: [u32; 2],
        slope: [f32; 2],
        guess: f32,
        padding: f32,
    }
}

/// WGSL of a kernel.
fn source(threads: usize, most_candidates: usize, main: &str) -> String {
    let constants = format!(
        "const THREADS = {threads}u;\nconst MOST_CANDIDATES = {most_candidates}u;\nconst RADIUS = {RADIUS}u;\nconst SIDE = {}u;\nconst AREA = {}u;\n\
         const LEAST_DEVIATION = {:?};\nconst ALL_COUNT = {}u;\nconst FINEST_STEP_PX = {FINEST_STEP_PX:?};\nconst MOST_HALVINGS = {MOST_HALVINGS}u;\n\
         const HALVINGS = {}u;\nconst PEAK_STEPS = {:?};\nconst UNIQUENESS = {:?};\nconst LEFT_RIGHT_PX = {:?};\nconst NO_LEAST = {:?};\n",
        2 * RADIUS + 1,
        (2 * RADIUS + 1).pow(2),
        LEAST_CONTRAST * FULL,
        views::ALL_COUNT,
        triangulate::HALVINGS,
        triangulate::PEAK_STEPS as f32,
        triangulate::UNIQUENESS,
        triangulate::LEFT_RIGHT_PX,
        f32::MIN,
    );
    let records = views::declarations() + &Job::declaration() + &StartRow::declaration();
    constants + &records + GROUP_NUMBER + include_str!("shaders/views.wgsl") + include_str!("shaders/patch.wgsl") + main
}

/// Working memory of one question.
struct Workspace {
    views: Scratch,
    words: Scratch,
    starts: Scratch,
    found: Scratch,
    clock: Option<Timestamps>,
}

impl Workspace {
    fn new(context: &Context) -> Result<Self> {
        Ok(Self {
            views: Scratch::new(context, "views that are matched")?,
            words: Scratch::new(context, "images that are matched")?,
            starts: Scratch::new(context, "pixels that are matched")?,
            found: Scratch::new(context, "depths that are matched")?,
            clock: context.timestamps.then(|| Timestamps::new(context, 2)).transpose()?,
        })
    }
}

/// Matches on a GPU.
pub(super) struct GpuMatcher {
    guided: Kernel,
    sweep: Kernel,
    budget: Arc<Budget>,
    /// Working memory that nobody uses at present: as many as there were questions at once.
    idle: Mutex<Vec<Workspace>>,
    /// Last, for what is made of it to be dropped before.
    context: Arc<Context>,
}

impl GpuMatcher {
    /// Opens the adapter; views are kept within `budget`.
    ///
    /// # Errors
    /// Those of [`Context::open`].
    pub(super) fn new(options: &AdapterOptions, budget: Arc<Budget>) -> Result<Self> {
        let context = Arc::new(Context::open(&AdapterOptions { timestamps: true, ..*options })?);
        let sources = [
            ("guided matching", source(GUIDED_THREADS, MOST_GUIDED, include_str!("shaders/guided.wgsl"))),
            ("sweep", source(SWEEP_THREADS, MOST_SWEPT, include_str!("shaders/sweep.wgsl"))),
        ];
        let [guided, sweep] = Kernel::all(&context, sources)?;
        Ok(Self { guided, sweep, budget, idle: Mutex::default(), context })
    }

    /// Memory that it has taken, bytes, where the device counts it.
    pub(super) fn memory_bytes(&self) -> Option<u64> {
        self.context.device.generate_allocator_report().map(|r| r.total_allocated_bytes)
    }

    /// Runs a kernel over pixels; what it finds of each.
    fn ask(&self, kernel: &Kernel, views: &Gathered<'_>, starts: &[StartRow], job: Job) -> Result<Found<Option<f32>>> {
        if starts.is_empty() || job.neighbours == 0 {
            return Ok(Found::here(vec![None; starts.len()]));
        }
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let taken = idle().pop();
        let mut workspace = taken.map_or_else(|| Workspace::new(&self.context), Ok)?;
        let found = self.ask_in(&mut workspace, kernel, views, starts, job)?;
        idle().push(workspace);
        Ok(found)
    }

    fn ask_in(
        &self,
        workspace: &mut Workspace,
        kernel: &Kernel,
        views: &Gathered<'_>,
        starts: &[StartRow],
        job: Job,
    ) -> Result<Found<Option<f32>>> {
        const DOING: &str = "matching";
        let context = &*self.context;
        let Workspace { views: rows, words, starts: places, found, clock } = workspace;
        let pieces = starts.len().div_ceil(PIXELS_AT_ONCE);
        let jobs = context.buffer("questions of matching", UNIFORM_STRIDE * pieces as u64, wgpu::BufferUsages::UNIFORM)?;
        rows.reserve(context, views.rows.len(), size_of::<ViewRow>())?;
        words.reserve(context, views.words, 4)?;
        places.reserve(context, starts.len(), size_of::<StartRow>())?;
        found.reserve(context, starts.len(), 4)?;
        context.fill(&rows.buffer, 0, &views.rows);
        context.fill(&places.buffer, 0, starts);
        let job_of = |piece: usize| {
            let first = piece * PIXELS_AT_ONCE;
            let count = (starts.len() - first).min(PIXELS_AT_ONCE);
            Job { first: first as u32, count: count as u32, ..job }
        };
        let buffers = [&jobs, &rows.buffer, &words.buffer, &places.buffer, &found.buffer];
        let bound = kernel.bind(context, size_of::<Job>() as u64, &buffers)?;
        for piece in 0..pieces {
            context.fill(&jobs, UNIFORM_STRIDE * piece as u64, &[job_of(piece)]);
        }
        for piece in 0..pieces {
            let mut encoder = context.encoder();
            if piece == 0 {
                views.bring(context, &mut encoder, &words.buffer);
            }
            let timestamp_writes = clock.as_ref().map(|clock| wgpu::ComputePassTimestampWrites {
                query_set: clock.queries(),
                beginning_of_pass_write_index: (piece == 0).then_some(0),
                end_of_pass_write_index: (piece + 1 == pieces).then_some(1),
            });
            let timestamp_writes = timestamp_writes.filter(|_| piece == 0 || piece + 1 == pieces);
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(DOING), timestamp_writes });
                bound.run(&mut pass, (UNIFORM_STRIDE * piece as u64) as u32, job_of(piece).count);
            }
            if let (Some(clock), true) = (&*clock, piece + 1 == pieces) {
                clock.resolve(&mut encoder, 2);
            }
            context.submit(encoder);
        }
        let read = context.read::<f32>(DOING, &[(&found.buffer, starts.len())])?;
        let stamps = clock.as_ref().map(|clock| clock.read(context, 2)).transpose()?;
        let device_s = stamps.map_or(0.0, |s| Timestamps::seconds(context, s[0], s[1]));
        // An inverse depth is positive.
        let depths = read.into_iter().flatten().map(|w| (w > 0.0).then_some(w)).collect();
        Ok(Found { depths, device_s })
    }
}

impl Matcher for GpuMatcher {
    fn hold(&self, view: &GreyView) -> Result<Option<HeldView>> {
        views::hold(&self.context, &self.budget, view)
    }

    fn guided(
        &self,
        reference: &GreyView,
        neighbours: &[Neighbour<'_>],
        starts: &[Start],
        range: f64,
        config: &DepthConfig,
    ) -> Result<Found<Option<f32>>> {
        let views = Gathered::new(reference, neighbours, Level::Fine);
        let row = |s: &Start| StartRow {
            pixel: [s.x as u32, s.y as u32],
            slope: s.slope.to_array(),
            guess: s.guess,
            ..StartRow::zeroed()
        };
        let job = Job {
            neighbours: neighbours.len() as u32,
            candidates: config.match_candidates as u32,
            range: range as f32,
            shortest_px: least_segment_px(config, reference.fine_camera.width),
            min_zncc: config.min_zncc,
            cost_ratio: config.cost_ratio as f32,
            ..Job::zeroed()
        };
        self.ask(&self.guided, &views, &starts.iter().map(row).collect::<Vec<_>>(), job)
    }

    fn sweep(
        &self,
        reference: &GreyView,
        neighbours: &[Neighbour<'_>],
        pixels: &[(usize, usize)],
        config: &DepthConfig,
    ) -> Result<Found<Option<f32>>> {
        let views = Gathered::new(reference, neighbours, Level::Coarse);
        let row = |&(x, y): &(usize, usize)| StartRow { pixel: [x as u32, y as u32], ..StartRow::zeroed() };
        let (far, step) = triangulate::range(config);
        let job = Job {
            neighbours: neighbours.len() as u32,
            candidates: config.sweep_candidates as u32,
            min_zncc: config.min_zncc,
            far,
            step,
            ..Job::zeroed()
        };
        self.ask(&self.sweep, &views, &pixels.iter().map(row).collect::<Vec<_>>(), job)
    }
}

#[cfg(test)]
mod tests;
