//! The GPU device: hand-written WGSL through wgpu (Vulkan, Metal, DirectX 12).
//!
//! A step is one run of kernels without a look back at the host: projection of all Gaussians for both modalities (`project`), exact
//! tile lists of both images in one list of (Gaussian, tile) pairs, ordered by depth within each tile (`frame`), one blend over both
//! images' tiles, the loss with its gradient, the blend backwards into one record per pair, and the sums of each visible Gaussian's
//! records with the projection's gradient and sparse Adam (`train`). Counts stay on the device; a step that finds no room for its pairs
//! changes nothing, and it and those after it are run again with more room.
//!
//! No floating-point atomics: every sum has a fixed order, and a result has the same bytes each time on the same adapter and driver.
//! Between adapters, and against the CPU device, results differ by rounding (exp2, sqrt and division are not correctly rounded).

mod capacity;
mod clock;
pub mod deformed;
mod dense;
mod density;
mod frame;
mod keyframe_cache;
mod matching;
mod options;
mod params;
mod pyramid;
mod radio_images;
mod readback;
mod render;
mod shaders;
mod store;
mod survey;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
mod train;
mod training;
mod work;

use super::{
    DenseStep, Device, DeviceState, Duplicate, Modality, Outline, PackedView, Packer, Planes, RenderRequest, Rendering,
    ScreenGradient, Step, StepReport, Survey, SurveyRequest, TrainingTimes, TrainingView, ViewId, check_channels,
};
use crate::{Appearance, AppearanceRates, Error, Gaussians, OptimizerConfig, RasterConfig, Result, depth::Matcher};
use clock::Clock;
use corf_gpu::{AdapterOptions, Context, Reading, Scratch};
use corf_scene::{Pinhole, Rigid3};
use deformed::StandIns;
use frame::{Forward, Memory};
use keyframe_cache::{KeyframeCache, StoredView};
use matching::GpuMatcher;
use pyramid::Packed;
use shaders::Fixed;
use std::sync::{Arc, OnceLock};
use store::Store;
use survey::Surveyor;
use train::{Batch, Counts};
use training::Training;

pub use options::GpuOptions;
pub use train::{GpuStageTimes, STAGES};
pub use work::StageWork;

/// Renders and trains on a GPU.
pub struct GpuDevice {
    optimizer: OptimizerConfig,
    raster: RasterConfig,
    store: Store,
    /// Buffers by shape of tiles: the usual one, and one for some steps.
    shapes: Vec<Fixed>,
    /// Whether two images with one camera are blended in one pass.
    fuse: bool,
    least_room: usize,
    forward: Forward,
    training: Training,
    surveyor: Surveyor,
    memory: Memory,
    keyframe_cache: KeyframeCache,
    /// Of each Gaussian: the sum of its gradients on the screen, their number, and the dense step that saw it last.
    marks: Scratch,
    /// Number of Gaussians whose marks are held; none where they are to be cleared first.
    marked: Option<usize>,
    /// Dense steps so far.
    dense_steps: u32,
    /// Gaussians that stand in the place of those held; made when there are some.
    stand_ins: Option<StandIns>,
    clock: Clock,
    timing: bool,
    last: Counts,
    /// Error of steps that were begun and came to nothing: what is held is not what was asked for, and every call from then on says so.
    failed: Option<Error>,
    /// Steps that nobody has waited for.
    begun: Option<(Batch, Reading<u32>)>,
    /// What matches keyframes, once that is asked for, and the adapter it is opened on.
    matcher: OnceLock<Arc<GpuMatcher>>,
    adapter: AdapterOptions,
    /// Last, for what is made of it to be dropped before.
    context: Arc<Context>,
}

impl GpuDevice {
    /// A device that holds `initial`, whose channels and harmonic degrees all later Gaussians share.
    ///
    /// # Errors
    /// No adapter that will do, one that lacks memory or bindings, a constant out of range, harmonics above degree 3, an appearance of
    /// other than 3 (or, for RF, 1) channels.
    pub fn new(options: &GpuOptions, optimizer: OptimizerConfig, raster: RasterConfig, initial: &Gaussians) -> Result<Self> {
        options.validate()?;
        optimizer.validate()?;
        raster.validate()?;
        let context = Arc::new(Context::open(&options.adapter)?);
        let mut store = Store::new(&context, initial)?;
        store.append(&context, initial)?;
        let (batch, harmonics) = (options.batch, store.harmonics);
        let shuffles = context.subgroups.is_some_and(|(min, _)| min >= batch);
        let fixed = |tile: &[u32; 2]| Fixed { antialias: raster.antialias, harmonics, tile: *tile, batch, shuffles };
        let shapes: Vec<Fixed> = options.tiles().iter().map(fixed).collect();
        let (forward, (training, surveyor)) = rayon::join(
            || Forward::new(&context, &shapes, options.segments),
            || rayon::join(|| Training::new(&context, &shapes), || Surveyor::new(&context, &shapes[0])),
        );
        let (forward, training, surveyor) = (forward?, training?, surveyor?);
        let memory = Memory::new(&context)?;
        let marks = Scratch::new(&context, "marks of Gaussians")?;
        Ok(Self {
            marks,
            marked: None,
            dense_steps: 0,
            stand_ins: None,
            timing: context.timestamps,
            matcher: OnceLock::new(),
            adapter: options.adapter,
            context,
            optimizer,
            raster,
            store,
            shapes,
            fuse: options.fused,
            least_room: options.least_room,
            forward,
            training,
            surveyor,
            memory,
            keyframe_cache: KeyframeCache::new(options.keyframe_bytes),
            clock: Clock::default(),
            last: Counts::default(),
            failed: None,
            begun: None,
        })
    }

    /// The adapter: its name and the driver's.
    pub fn adapter(&self) -> String {
        let info = &self.context.info;
        let driver = [info.driver.as_str(), info.driver_info.as_str()].join(" ");
        format!("{} ({:?}, {})", info.name, info.backend, driver.trim())
    }

    /// Whether the adapter computes on the processor.
    pub fn is_software(&self) -> bool {
        self.context.is_software()
    }

    /// Capacity for (Gaussian, tile) pairs of one frame; grows when a frame has more.
    pub fn pair_capacity(&self) -> usize {
        self.memory.room.pairs
    }

    /// Bytes of device memory that keyframes take, and bytes of keyframes that have come back from main memory for want of more.
    pub fn keyframe_bytes(&self) -> [u64; 2] {
        [self.keyframe_cache.taken_bytes(), self.keyframe_cache.brought_bytes()]
    }

    /// Waits for what was begun.
    fn ready(&mut self) -> Result<()> {
        self.settle().map(|_| ())
    }
}

impl Device for GpuDevice {
    fn name(&self) -> String {
        format!("gpu ({})", self.context.info.name)
    }

    fn upload(&mut self, view: &TrainingView, levels: u32) -> Result<ViewId> {
        self.ready()?;
        check_channels(view, self.store.harmonics.map(|h| h.channels))?;
        let packed = Packed::new(view, levels, self.raster.antialias)?;
        Ok(ViewId(self.keyframe_cache.push(StoredView::new(packed, &self.context, &self.keyframe_cache.budget)?)))
    }

    fn packer(&self) -> Option<Packer> {
        let (antialias, channels) = (self.raster.antialias, self.store.harmonics.map(|h| h.channels));
        let (context, budget) = (self.context.clone(), self.keyframe_cache.budget.clone());
        Some(Arc::new(move |view, levels| {
            check_channels(view, channels)?;
            // On its way before it is asked for, if there is room: only its number is left to be given.
            Ok(PackedView::new(StoredView::new(Packed::new(view, levels, antialias)?, &context, &budget)?))
        }))
    }

    fn upload_packed(&mut self, view: PackedView) -> Result<ViewId> {
        self.ready()?;
        let foreign = || self.lacks("packed views of other devices", "upload what its own packer has built");
        Ok(ViewId(self.keyframe_cache.push(view.unwrap_as().ok_or_else(foreign)?)))
    }

    fn matcher(&self) -> Result<Option<Arc<dyn Matcher>>> {
        let matcher = match self.matcher.get() {
            Some(matcher) => matcher.clone(),
            None => {
                let made = Arc::new(GpuMatcher::new(&self.adapter, self.keyframe_cache.budget.clone())?);
                self.matcher.get_or_init(|| made).clone()
            }
        };
        Ok(Some(matcher))
    }

    fn trains_on_the_host(&self) -> bool {
        self.is_software()
    }

    fn memory_bytes(&self) -> Option<u64> {
        let matching = self.matcher.get().map_or(Some(0), |matcher| matcher.memory_bytes())?;
        self.context.device.generate_allocator_report().map(|r| r.total_allocated_bytes + matching)
    }

    fn outlines(&mut self) -> Result<Vec<Outline>> {
        self.ready()?;
        self.store.outlines(&self.context)
    }

    fn state(&mut self) -> Result<DeviceState> {
        self.ready()?;
        self.store.state(&self.context)
    }

    fn restore(&mut self, state: &DeviceState) -> Result<()> {
        self.ready()?;
        self.marked = None;
        self.store.restore(&self.context, state)
    }

    fn take_training_times(&mut self) -> Result<Option<TrainingTimes>> {
        self.ready()?;
        Ok(self.take_times())
    }

    fn len(&self) -> usize {
        self.store.len()
    }

    fn append(&mut self, new: &Gaussians) -> Result<()> {
        self.ready()?;
        self.marked = None;
        self.store.append(&self.context, new)
    }

    fn retain(&mut self, keep: &[bool]) -> Result<()> {
        assert_eq!(keep.len(), self.len(), "one flag per Gaussian");
        self.ready()?;
        self.marked = None;
        self.store.retain(&self.context, keep)
    }

    fn reset_radio(&mut self, radio: &Appearance) -> Result<()> {
        self.ready()?;
        self.store.reset_radio(&self.context, radio)
    }

    fn set_position_rate_m(&mut self, rate_m: f32) {
        self.optimizer.position_rate_m = rate_m;
    }

    fn set_radio_rates(&mut self, rates: AppearanceRates) -> Result<()> {
        let optimizer = OptimizerConfig { radio: rates, ..self.optimizer };
        optimizer.validate()?;
        self.optimizer = optimizer;
        Ok(())
    }

    fn render(&mut self, request: &RenderRequest) -> Result<Rendering> {
        self.ready()?;
        self.render_request(request)
    }

    fn render_radio(
        &mut self,
        camera: &Pinhole,
        poses: &[Rigid3],
        background: [f32; 3],
        take: &mut dyn FnMut(Vec<Planes>) -> Result<()>,
    ) -> Result<()> {
        self.ready()?;
        self.stream_radio(camera, poses, background, take)
    }

    fn survey(&mut self, request: &SurveyRequest<'_>) -> Result<Survey> {
        self.ready()?;
        self.run_survey(request)
    }

    fn train(&mut self, steps: &[Step]) -> Result<StepReport> {
        self.ready()?;
        self.run_steps(steps)
    }

    fn train_dense(&mut self, steps: &[DenseStep]) -> Result<StepReport> {
        self.ready()?;
        self.run_dense_steps(steps)
    }

    fn screen_gradients(&mut self) -> Result<Vec<ScreenGradient>> {
        self.ready()?;
        self.read_screen_gradients()
    }

    fn set_screen_gradients(&mut self, gradients: &[ScreenGradient]) -> Result<()> {
        self.ready()?;
        self.write_screen_gradients(gradients)
    }

    fn duplicate(&mut self, duplicates: &[Duplicate]) -> Result<()> {
        self.ready()?;
        self.marked = None;
        self.store.duplicate(&self.context, duplicates)
    }

    fn cap_opacity(&mut self, modality: Modality, most: f32) -> Result<()> {
        self.ready()?;
        self.store.cap_opacity(&self.context, modality, most)
    }

    fn begin_training(&mut self, steps: &[Step]) -> Result<Option<StepReport>> {
        self.ready()?;
        self.begin_steps(steps).map(|()| None)
    }

    fn end_training(&mut self) -> Result<Option<StepReport>> {
        self.settle()
    }

    fn gaussians(&mut self) -> Result<Gaussians> {
        self.ready()?;
        self.store.to_gaussians(&self.context)
    }
}
