//! Survey of the field on the GPU: of a rendering of millions of pixels, only the values asked for are read back.

use super::{
    GpuDevice,
    capacity::BufferCapacity,
    frame::{Extent, FAILED, Leaves, STATE_WORDS},
    params::{self, Params, Uniforms},
    shaders::Fixed,
};
use crate::{
    Result,
    device::{PruneDecision, Shown, Survey, SurveyRequest},
    gaussians::logit,
    images::laplacian_of_gaussian,
};
use corf_gpu::{Context, Kernel, Scratch};
use rayon::prelude::*;

/// Numbers of a question before the weights of its smoothing.
const HEAD: usize = 5;
/// Gaussians judged in one word, two bits each.
const JUDGED_A_WORD: usize = 16;
/// Threads of a workgroup.
const GROUP: usize = 256;

/// The kernels of a survey and their memory.
pub(crate) struct Surveyor {
    down: Kernel,
    along: Kernel,
    laplacian: Kernel,
    answer: Kernel,
    judge: Kernel,
    /// Planes of the smoothed image; the first ends as the norm of its Laplacian.
    planes: [Scratch; 2],
    question: Scratch,
    places: Scratch,
    answers: Scratch,
    judged: Scratch,
}

impl Surveyor {
    pub fn new(context: &Context, fixed: &Fixed) -> Result<Self> {
        let scratch = |label| Scratch::new(context, label);
        let [down, along, laplacian, answer, judge] = Kernel::all(
            context,
            [
                ("smooth down", include_str!("shaders/smooth_down.wgsl")),
                ("smooth along", include_str!("shaders/smooth_along.wgsl")),
                ("Laplacian", include_str!("shaders/laplacian.wgsl")),
                ("answer", include_str!("shaders/answer.wgsl")),
                ("judge", include_str!("shaders/judge.wgsl")),
            ]
            .map(|(label, body)| (label, fixed.survey(body))),
        )?;
        Ok(Self {
            down,
            along,
            laplacian,
            answer,
            judge,
            planes: [scratch("smoothed")?, scratch("smoothed down")?],
            question: scratch("question")?,
            places: scratch("pixels asked about")?,
            answers: scratch("answers")?,
            judged: scratch("judgements")?,
        })
    }

    fn reserve(&mut self, context: &Context, pixels: usize, asked: usize, gaussians: usize, weights: usize) -> Result<()> {
        for plane in &mut self.planes {
            plane.reserve(context, if weights > 0 { pixels } else { 0 }, 12)?;
        }
        self.question.reserve(context, HEAD + weights, 4)?;
        self.places.reserve(context, asked, 4)?;
        self.answers.reserve(context, asked, 16)?;
        self.judged.reserve(context, gaussians.div_ceil(JUDGED_A_WORD), 4)?;
        Ok(())
    }
}

impl GpuDevice {
    pub(super) fn run_survey(&mut self, request: &SurveyRequest<'_>) -> Result<Survey> {
        let Some(mut params) = self.frame([Some((request.view, [0.0; 3])), None], true) else { return Ok(Survey::default()) };
        let camera = &request.view.camera;
        let (n, pixels, asked) = (self.store.len(), params.pixel_total as usize, request.pixels.len());
        let weights = request.sigma_px.map(laplacian_of_gaussian::kernel).unwrap_or_default();
        self.surveyor.reserve(&self.context, pixels, asked, n, weights.len())?;
        let rule = &request.prune;
        let largest_px = rule.image_fraction * camera.width.max(camera.height) as f32;
        let mut question = vec![
            weights.len() as f32,
            logit(rule.opacity),
            f32::from(u8::from(rule.both_modalities)),
            // σ / z beyond which a Gaussian is oversized.
            largest_px / (camera.fx * camera.fy).sqrt() as f32,
            // Exact: images have at most 2^24 pixels.
            asked as f32,
        ];
        question.extend(&weights);
        let places: Vec<u32> = request.pixels.iter().map(|(x, y)| (y * camera.width + x) as u32).collect();
        self.context.fill(&self.surveyor.question.buffer, 0, &question);
        self.context.queue.write_buffer(&self.surveyor.places.buffer, 0, bytemuck::cast_slice(&places));
        let mut extent = Extent { gaussians: n, ..Extent::default() };
        extent.include(&params, &self.shapes);
        let mut room = BufferCapacity::guess(n, self.least_room, extent.most(&self.context, &self.shapes[0]));
        loop {
            self.memory.reserve(&self.context, &self.shapes[0], &extent, room)?;
            params.set_room(self.memory.room);
            self.submit_survey(&params, asked, !weights.is_empty())?;
            let s = &self.surveyor;
            let words = n.div_ceil(JUDGED_A_WORD);
            let sources = [(&self.memory.state, STATE_WORDS), (&s.answers.buffer, 4 * asked), (&s.judged.buffer, words)];
            let read = self.context.read::<u32>("looking at the field", &sources)?;
            if read[0][FAILED] != 0 {
                room = BufferCapacity::asked(&read[0], extent.most(&self.context, &self.shapes[0]));
                continue;
            }
            let shown = |a: &[u32; 4]| Shown {
                structure: f32::from_bits(a[0]),
                inverse_depth: f32::from_bits(a[1]),
                transmittance: f32::from_bits(a[2]),
                main_contributor: a[3],
            };
            let judged = |i: usize| {
                let bits = read[2][i / JUDGED_A_WORD] >> (2 * (i % JUDGED_A_WORD));
                PruneDecision { faint: bits & 1 != 0, oversized: bits & 2 != 0 }
            };
            return Ok(Survey {
                shown: read[1].as_chunks().0.iter().map(shown).collect(),
                judged: (0..n).into_par_iter().with_min_len(1 << 14).map(judged).collect(),
            });
        }
    }

    fn submit_survey(&self, params: &Params, asked: usize, structure: bool) -> Result<()> {
        let (context, m, s, n) = (&self.context, &self.memory, &self.surveyor, self.store.len());
        let uniforms = Uniforms::new(context, std::iter::once(params))?;
        m.reset(context, n);
        let forward = self.forward.bind(context, &uniforms.buffer, self.store.values(), m, Leaves::MainContributors)?;
        let (uniform, question, image) = (&uniforms.buffer, &s.question.buffer, &m.image.buffer);
        let [smoothed, down] = [&s.planes[0].buffer, &s.planes[1].buffer];
        let bind = |kernel: &Kernel, buffers: &[&wgpu::Buffer]| kernel.bind(context, params::SIZE, buffers);
        let smoothing = [
            bind(&s.down, &[uniform, question, image, down])?,
            bind(&s.along, &[uniform, question, down, smoothed])?,
            bind(&s.laplacian, &[uniform, question, smoothed, down])?,
        ];
        let (transmittance, main) = (&m.transmittance.buffer, &m.main_contributor.buffer);
        let answer =
            bind(&s.answer, &[uniform, question, &s.places.buffer, down, image, transmittance, main, &s.answers.buffer])?;
        let judge = bind(&s.judge, &[uniform, question, &self.store.core.value.buffer, &s.judged.buffer])?;
        let groups = |threads: usize| threads.div_ceil(GROUP) as u32;
        let pixels = params.pixel_total as usize;
        let mut encoder = context.encoder();
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            forward.record(&mut pass, params, 0, n, m, &mut |_| {});
            if structure {
                for (kernel, threads) in smoothing.iter().zip([3 * pixels, 3 * pixels, pixels]) {
                    kernel.run(&mut pass, 0, groups(threads));
                }
            }
            if asked > 0 {
                answer.run(&mut pass, 0, groups(asked));
            }
            judge.run(&mut pass, 0, groups(n.div_ceil(JUDGED_A_WORD)));
        }
        context.submit(encoder);
        Ok(context.check("looking at the field")?)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use crate::{
        Device, Gaussians, OptimizerConfig, RasterConfig,
        device::{
            PruneDecision, PruneRule, RenderRequest, Survey, SurveyRequest, View,
            gpu::{GpuDevice, GpuOptions},
        },
    };
    use corf_gpu::AdapterOptions;
    use corf_scene::{Pinhole, Rigid3, Rng};

    /// Sums of a few hundred f32 products of order 1 in another order.
    const STRUCTURE_TOLERANCE: f32 = 3e-6;

    #[test]
    fn an_answer_is_what_the_rendering_and_the_gaussians_say() {
        let options = GpuOptions::on(AdapterOptions { software: true, poison: Some(0x7fc0_0000), ..AdapterOptions::default() });
        if corf_gpu::adapter_name(&options.adapter).is_none() {
            assert!(std::env::var_os("CORF_REQUIRE_GPU").is_none_or(|v| v != "1"), "no adapter");
            println!("skipped: no adapter");
            return;
        }
        let mut rng = Rng::keyed(3, 0, 0);
        let mut g = Gaussians::empty(3, 1);
        for i in 0..1003 {
            // Some lie behind, beside or before the camera; some are large, some faint.
            g.position.push(
                [0; 2]
                    .map(|_| (rng.uniform() - 0.5) * 6.0)
                    .into_iter()
                    .chain([3.0 * rng.uniform() - 0.5])
                    .collect::<Vec<_>>()
                    .try_into()
                    .unwrap(),
            );
            g.rotation.push([1.0, 0.2, 0.0, 0.1]);
            g.log_scale.push([0; 3].map(|_| if i % 20 == 0 { 0.8 * rng.uniform() } else { -3.0 + rng.uniform() }));
            for a in [&mut g.light, &mut g.radio] {
                a.opacity_logit.push(6.0 * rng.uniform() - 4.0);
                a.sh.extend((0..a.stride()).map(|_| 3.0 * rng.uniform() - 1.5));
            }
        }
        let mut device = GpuDevice::new(&options, OptimizerConfig::default(), RasterConfig::default(), &g).unwrap();
        let camera = Pinhole::from_horizontal_fov(61, 43, 80.0);
        let view = View { camera, world_from_camera: Rigid3::IDENTITY };
        let pixels: Vec<(usize, usize)> = (0..61 * 43).step_by(3).map(|i| (i % 61, i / 61)).collect();
        for (both_modalities, sigma_px) in [(true, Some(1.1)), (false, None)] {
            let prune = PruneRule { opacity: 0.3, both_modalities, image_fraction: 0.3 };
            let request = SurveyRequest { view, sigma_px, pixels: &pixels, prune };
            let found = device.survey(&request).unwrap();
            let wanted = RenderRequest { light: Some((view, [0.0; 3])), radio: None, main_contributor: true };
            let truth = Survey::of(&device.render(&wanted).unwrap(), &device.outlines().unwrap(), &request);
            assert_eq!((found.shown.len(), found.judged.len()), (pixels.len(), 1003));
            for (a, b) in found.shown.iter().zip(&truth.shown) {
                assert!((a.structure - b.structure).abs() < STRUCTURE_TOLERANCE, "{} {}", a.structure, b.structure);
                let rest = |s: &crate::device::Shown| (s.inverse_depth, s.transmittance, s.main_contributor);
                assert_eq!(rest(a), rest(b));
            }
            let most = truth.shown.iter().fold(0.0, |m: f32, s| m.max(s.structure));
            assert!((most > 1e-3) == sigma_px.is_some(), "{most}");
            let all = |f: fn(&PruneDecision) -> bool| truth.judged.iter().filter(|j| f(j)).count();
            let counts = [all(|j| j.faint), all(|j| j.oversized)];
            assert!(counts[0] > 50 && (3..100).contains(&counts[1]), "{counts:?}");
            assert!(found.judged == truth.judged, "no Gaussian of this draw lies on a threshold");
        }
    }
}
