//! WRF-GS+ against the f64 oracle: the gradient of the complete loss, through rasteriser, deformation and network, by central differences.
//!
//! Of what a trainer does, the first moments after its first step are looked at: a tenth of the gradient. Scenes keep away from the jumps and kinks
//! of blending and loss, as those of `gradients.rs` do.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

#[allow(dead_code)]
#[path = "../../corf/tests/reference/mod.rs"]
mod reference;

use corf::device::{DenseStep, Planes, Step, TrainingView, ViewId};
use corf::{Antialias, Gaussians, RadioTarget};
use corf_baselines::wrf_gs_plus::{
    Deformation, DeformedStep, Offsets, Shape, WrfGsPlusConfig, WrfGsPlusCpuTrainer, WrfGsPlusModel, WrfGsPlusTrainer,
};
use corf_scene::{Pinhole, Rigid3, Rng};
use glam::DVec3;
use rayon::prelude::*;
use reference::Field;

/// Smallest distance of a weight from a threshold: far more than what a difference step or f32 rounding moves it.
const MARGIN: f64 = 2e-6;
/// Step of the central differences in f64.
const STEP: f64 = 1e-6;
/// Gradients, relative to the largest of their class: f32 sums through a rasteriser and a network.
const TOLERANCE: f64 = 5e-5;
const BACKGROUND: [f32; 3] = [0.1, 0.3, 0.6];
const COUNT: usize = 24;

struct Scenario {
    config: WrfGsPlusConfig,
    gaussians: Gaussians,
    parameters: Vec<f32>,
    view: TrainingView,
    step: DeformedStep,
}

fn scenario(seed: u64, radio_target: RadioTarget, move_positions: bool) -> Scenario {
    let mut rng = Rng::keyed(seed, 1, 0);
    let channels = radio_target.channels();
    let config = WrfGsPlusConfig {
        radio_target,
        move_positions,
        layers: 3,
        width: 12,
        skip: 1,
        position_frequencies: 3,
        receiver_frequencies: 2,
        receiver_width: 8,
        receiver_features: 5,
        near_m: 0.1,
        ..WrfGsPlusConfig::default()
    };
    let mut gaussians = config.empty_field();
    for _ in 0..COUNT {
        let z = 2.0 + rng.uniform() * 3.0;
        gaussians.position.push([(rng.uniform() - 0.5) * 2.6 * z, (rng.uniform() - 0.5) * 1.9 * z, z]);
        gaussians.rotation.push([0; 4].map(|_| rng.normal() as f32));
        gaussians.log_scale.push([0; 3].map(|_| -1.6 + rng.uniform()));
        gaussians.light.opacity_logit.push(0.0);
        gaussians.light.sh.extend([0.0; 3]);
        gaussians.radio.opacity_logit.push(rng.uniform() * 4.0 - 1.5);
        gaussians.radio.sh.extend((0..channels).map(|_| (rng.uniform() - 0.5) * 0.8));
    }
    let pose = Rigid3::looking_at(DVec3::new(0.3, -0.2, 0.1), DVec3::new(0.1, 0.1, 3.0), DVec3::new(0.2, -1.0, 0.1));
    let radio_camera = Pinhole { width: 17, height: 13, fx: 8.0, fy: 9.0, cx: 9.1, cy: 6.2 };
    let value = |rng: &mut Rng| if rng.uniform() < 0.5 { rng.uniform() * 0.04 } else { 1.0 - rng.uniform() * 0.04 };
    let view = TrainingView {
        world_from_camera: pose,
        light: Planes { width: 1, height: 1, channels: 3, pixels: vec![0.0; 3] },
        light_camera: Pinhole { width: 1, height: 1, ..radio_camera },
        radio: Planes { width: 17, height: 13, channels, pixels: (0..17 * 13 * channels).map(|_| value(&mut rng)).collect() },
        radio_camera,
        inverse_depth: None,
        mask: None,
    };
    let step = Step {
        view: ViewId(0),
        levels: [0; 2],
        light_weight: 0.0,
        radio_weight: 1.0,
        depth_weight: 0.0,
        train_geometry: true,
        light_background: [0.0; 3],
        radio_background: BACKGROUND,
    };
    let dense = DenseStep { step, number: 1, position_rate_m: 1e-4, degree: 0, screen_gradients: true };
    let step = DeformedStep { dense, receiver_m: pose.translation.as_vec3().to_array(), network_rate: 1e-3 };
    // Heads a fifth of what they are drawn as: a step in which Gaussians lie about as they did.
    let mut parameters: Vec<f32> = WrfGsPlusModel::new(&config).network.initial(seed);
    let model = WrfGsPlusModel::new(&config);
    for head in model.heads() {
        let corf_baselines::mlp::LayerInput::Layer(l) = head else { unreachable!() };
        let layer = &model.network.layers()[l];
        parameters[layer.weights().start..layer.bias().end].iter_mut().for_each(|p| *p *= 0.2);
    }
    Scenario { config, gaussians, parameters, view, step }
}

/// Parameters of a Gaussian as the oracle differentiates them: position, quaternion, ln scale, colours.
const CLASSES: [(&str, std::ops::Range<usize>); 4] =
    [("position", 0..3), ("rotation", 3..7), ("scale", 7..10), ("signal", 10..13)];

fn shapes(g: &Gaussians) -> Vec<Shape<f64>> {
    let wide = |v: &[f32]| -> Vec<f64> { v.iter().map(|v| f64::from(*v)).collect() };
    (0..g.len())
        .map(|i| {
            let mut dc = [0.0; 3];
            let c = g.radio.channels;
            dc[..c].copy_from_slice(&wide(&g.radio.sh[c * i..c * (i + 1)]));
            Shape {
                position: g.position[i].map(f64::from),
                rotation: g.rotation[i].map(f64::from),
                log_scale: g.log_scale[i].map(f64::from),
                dc,
            }
        })
        .collect()
}

fn number(s: &mut Shape<f64>, k: usize) -> &mut f64 {
    match k {
        0..3 => &mut s.position[k],
        3..7 => &mut s.rotation[k - 3],
        7..10 => &mut s.log_scale[k - 7],
        _ => &mut s.dc[k - 10],
    }
}

impl Scenario {
    fn image(&self, deformed: &[Shape<f64>]) -> reference::Image {
        let mut field = Field::new(&self.gaussians);
        let channels = self.gaussians.radio.channels;
        for (i, s) in deformed.iter().enumerate() {
            field.classes[0][3 * i..3 * i + 3].copy_from_slice(&s.position);
            field.classes[1][4 * i..4 * i + 4].copy_from_slice(&s.rotation);
            field.classes[2][3 * i..3 * i + 3].copy_from_slice(&s.log_scale);
            field.classes[6][channels * i..channels * (i + 1)].copy_from_slice(&s.dc[..channels]);
        }
        let (pose, camera) = (&self.view.world_from_camera, &self.view.radio_camera);
        reference::render(&field, 1, pose, camera, BACKGROUND.map(f64::from), Antialias::Off, 0.1, None)
    }

    fn loss(&self, deformed: &[Shape<f64>]) -> f64 {
        reference::image_loss(&self.image(deformed), &self.view.radio)
    }

    /// Gradients of the network and of the Gaussians, by class, in f64.
    fn truth(&self) -> (Vec<f64>, Vec<Vec<f64>>) {
        let receiver = self.step.receiver_m.map(f64::from);
        let deformation = Deformation::<f64>::new(&self.config, self.parameters.iter().map(|p| f64::from(*p)).collect());
        let base = shapes(&self.gaussians);
        let apply = |d: &Deformation<f64>| d.apply(&base, receiver);
        let deformed = apply(&deformation);
        let as_seen: Vec<Shape<f64>> = deformed.iter().map(|d| d.0).collect();
        let margin = self.image(&as_seen).margin;
        assert!(margin > MARGIN, "within {margin:.1e} of a threshold: choose another seed");
        let of_network = (0..self.parameters.len())
            .into_par_iter()
            .map(|p| {
                let at = |step: f64| {
                    let mut moved = deformation.clone();
                    moved.trained.parameters[p] += step;
                    self.loss(&apply(&moved).iter().map(|d| d.0).collect::<Vec<_>>())
                };
                (at(STEP) - at(-STEP)) / (2.0 * STEP)
            })
            .collect();
        // What the network reads is detached: offsets stay while a Gaussian is moved.
        let offsets: Vec<Offsets<f64>> = deformed.iter().map(|d| d.1).collect();
        let slope = |i: usize, k: usize| {
            let at = |step: f64| {
                let (mut moved, mut all) = (base[i], as_seen.clone());
                *number(&mut moved, k) += step;
                all[i] = deformation.rule.apply(&moved, &offsets[i]);
                self.loss(&all)
            };
            (at(STEP) - at(-STEP)) / (2.0 * STEP)
        };
        let channels = self.gaussians.radio.channels;
        let of_class = |range: &std::ops::Range<usize>| -> Vec<f64> {
            let ks: Vec<usize> = range.clone().filter(|k| *k < 10 + channels).collect();
            (0..COUNT * ks.len()).into_par_iter().map(|n| slope(n / ks.len(), ks[n % ks.len()])).collect()
        };
        (of_network, CLASSES.iter().map(|(_, range)| of_class(range)).collect())
    }

    fn check(&self, name: &str, trainer: &mut dyn WrfGsPlusTrainer, truth: &(Vec<f64>, Vec<Vec<f64>>)) {
        trainer.device().append(&self.gaussians).unwrap();
        trainer.device().upload(&self.view, 1).unwrap();
        let report = trainer.train(std::slice::from_ref(&self.step)).unwrap();
        let receiver = self.step.receiver_m.map(f64::from);
        let deformation = Deformation::<f64>::new(&self.config, self.parameters.iter().map(|p| f64::from(*p)).collect());
        let deformed: Vec<Shape<f64>> = deformation.apply(&shapes(&self.gaussians), receiver).iter().map(|d| d.0).collect();
        let loss = self.loss(&deformed);
        assert!((f64::from(report.radio_loss) - loss).abs() < 1e-5, "{name}: loss {} {loss}", report.radio_loss);
        let compare = |what: &str, found: Vec<f32>, truth: &[f64]| {
            assert_eq!(found.len(), truth.len(), "{what}");
            let size = truth.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
            assert!(size > 0.0, "{what}");
            // Moments begin with a tenth of the gradient.
            let worst = found.iter().zip(truth).map(|(f, t)| (10.0 * f64::from(*f) - t).abs()).fold(0.0, f64::max);
            assert!(worst < TOLERANCE * size, "{name}, {what}: {worst:.1e} of {size:.1e}");
        };
        compare("network", trainer.network().unwrap().moments[0].clone(), &truth.0);
        let m = trainer.device().state().unwrap().moments[0].clone();
        let found = [m.position.as_flattened(), m.rotation.as_flattened(), m.log_scale.as_flattened(), &m.radio.sh];
        for ((found, truth), (what, _)) in found.into_iter().zip(&truth.1).zip(CLASSES) {
            compare(what, found.to_vec(), truth);
        }
    }
}

#[test]
fn the_gradient_of_the_whole_loss_is_that_of_finite_differences() {
    for (seed, radio_target, move_positions) in [(1, RadioTarget::Jet, false), (2, RadioTarget::Db, true)] {
        let scenario = scenario(seed, radio_target, move_positions);
        let truth = scenario.truth();
        let mut cpu = WrfGsPlusCpuTrainer::new(&scenario.config, scenario.parameters.clone()).unwrap();
        scenario.check("cpu", &mut cpu, &truth);
        #[cfg(feature = "gpu")]
        {
            if corf_gpu::adapter_name(&corf_gpu::testing::OPTIONS).is_some() {
                let mut gpu = corf_baselines::wrf_gs_plus::WrfGsPlusGpuTrainer::new(
                    &corf_gpu::testing::OPTIONS,
                    &scenario.config,
                    &scenario.parameters,
                )
                .unwrap();
                scenario.check("gpu", &mut gpu, &truth);
            } else {
                assert!(std::env::var_os("CORF_REQUIRE_GPU").is_none_or(|v| v != "1"), "no adapter");
                println!("skipped on the GPU: no adapter");
            }
        }
    }
}
