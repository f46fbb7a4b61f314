//! The devices against the f64 oracle: images, losses, and every class of gradient by central differences of the complete loss.
//!
//! The blending rule has jumps (weights below 1/255 are skipped, a pixel ends below T = 1e-4), the loss has kinks (L1 where render and
//! target agree, colours clamped at 0). A difference quotient across one of them is meaningless, and f32 and f64 may stand on different
//! sides of it. The scenes are therefore chosen so that no pixel lies near one (`MARGIN`, asserted), with targets well away from the
//! render. What happens at the clamps is tested separately, where it can be stated exactly.

#![allow(clippy::unwrap_used, clippy::print_stdout, clippy::print_stderr)]

mod reference;

use corf::{
    Antialias, Appearance, CpuDevice, Device, Gaussians, OptimizerConfig, RasterConfig,
    device::{DenseStep, InverseDepth, Planes, RenderRequest, Step, StepReport, TrainingView, View, ViewId},
};
use corf_scene::{Pinhole, Raster, Rigid3, Rng};
use glam::DVec3;
use rayon::prelude::*;
use reference::{CLASS_NAMES, Field};

/// Smallest distance of a weight from a threshold: a hundred times what a difference step or f32 rounding moves it.
const MARGIN: f64 = 2e-6;
/// Step of the central differences in f64: rounding 1e-16/1e-6, truncation (1e-6)².
const STEP: f64 = 1e-6;
/// Rendered colours: a few dozen f32 roundings of numbers near 1, exp2 at 2e-7.
const IMAGE_TOLERANCE: f64 = 3e-6;
/// Gradients, relative to the largest of their class: sums of some hundred f32 products; 2e-6 is what is seen.
const GRADIENT_TOLERANCE: f64 = 2e-5;

const LIGHT_BACKGROUND: [f32; 3] = [0.9, 0.2, 0.4];
const RADIO_BACKGROUND: [f32; 3] = [0.1, 0.3, 0.6];

fn appearance(rng: &mut Rng, n: usize, channels: usize, degree: usize) -> Appearance {
    let mut a = Appearance::empty(channels, degree);
    for _ in 0..n {
        a.opacity_logit.push(rng.uniform() * 4.0 - 1.5);
        for k in 0..a.coefficients() {
            // Bases up to 1.5 on the sphere: 16 of them at ±0.04 keep colours off their clamp at 0.
            let size = if k == 0 { 0.8 } else { 0.08 };
            a.sh.extend((0..channels).map(|_| (rng.uniform() - 0.5) * size));
        }
    }
    a
}

fn random_field(seed: u64, n: usize, radio_channels: usize, degree: usize) -> Gaussians {
    let mut rng = Rng::keyed(seed, 0, 0);
    let mut g = Gaussians::empty(radio_channels, degree);
    for _ in 0..n {
        let z = 2.0 + rng.uniform() * 3.0;
        // Some centres lie outside the images, where J is clamped.
        g.position.push([(rng.uniform() - 0.5) * 2.6 * z, (rng.uniform() - 0.5) * 1.9 * z, z]);
        g.rotation.push([0; 4].map(|_| rng.normal() as f32));
        g.log_scale.push([0; 3].map(|_| -2.6 + rng.uniform() * 2.0));
    }
    g.light = appearance(&mut rng, n, 3, degree);
    g.radio = appearance(&mut rng, n, radio_channels, degree);
    g
}

fn noise(rng: &mut Rng, width: usize, height: usize, channels: usize) -> Planes {
    // Renders lie in about [0.2, 0.9]; a target near 0 or 1 keeps away from the kink of L1.
    let pixels = (0..width * height * channels)
        .map(|_| if rng.uniform() < 0.5 { rng.uniform() * 0.04 } else { 1.0 - rng.uniform() * 0.04 });
    Planes { width, height, channels, pixels: pixels.collect() }
}

/// A device that can be asked for gradients.
trait Differentiable: Device {
    fn differentiate(&mut self, step: &Step) -> corf::Result<(StepReport, Gaussians)>;
}

impl Differentiable for CpuDevice {
    fn differentiate(&mut self, step: &Step) -> corf::Result<(StepReport, Gaussians)> {
        self.gradients(step)
    }
}

#[cfg(feature = "gpu")]
impl Differentiable for corf::device::gpu::GpuDevice {
    fn differentiate(&mut self, step: &Step) -> corf::Result<(StepReport, Gaussians)> {
        self.gradients(step)
    }
}

/// A GPU device on any adapter, or none and a line that says so; a failure under `CORF_REQUIRE_GPU=1`.
#[cfg(feature = "gpu")]
fn gpu(raster: RasterConfig, gaussians: &Gaussians) -> Option<corf::device::gpu::GpuDevice> {
    use corf::device::gpu::{GpuDevice, GpuOptions};
    let options = GpuOptions::on(corf_gpu::testing::OPTIONS);
    if corf_gpu::adapter_name(&options.adapter).is_some() {
        return Some(GpuDevice::new(&options, OptimizerConfig::default(), raster, gaussians).unwrap());
    }
    assert!(std::env::var_os("CORF_REQUIRE_GPU").is_none_or(|v| v != "1"), "no adapter");
    println!("skipped on the GPU: no adapter");
    None
}

struct Scenario {
    gaussians: Gaussians,
    view: TrainingView,
    step: Step,
    antialias: Antialias,
}

fn scenario(seed: u64, radio_channels: usize, degree: usize, antialias: Antialias) -> Scenario {
    let mut rng = Rng::keyed(seed, 1, 0);
    let eye = DVec3::new(0.3, -0.2, 0.1);
    let pose = Rigid3::looking_at(eye, DVec3::new(0.1, 0.1, 3.0), DVec3::new(0.2, -1.0, 0.1));
    // Neither a multiple of the tile, and principal points off the middle.
    let light_camera = Pinhole { width: 27, height: 18, fx: 14.0, fy: 15.0, cx: 12.2, cy: 9.7 };
    let radio_camera = Pinhole { width: 17, height: 13, fx: 8.0, fy: 9.0, cx: 9.1, cy: 6.2 };
    let gaussians = random_field(seed, 24, radio_channels, degree);
    // The GPU keeps depths in half precision: these are numbers of it, so that both devices and the oracle have the same.
    let half = |v: f32| (1024.0 * v).round() / 1024.0;
    let inverse_depth = InverseDepth {
        // Rendered inverse depths are below 1/2; these are not.
        value: Raster::from_fn(27, 18, |_, _| half(0.7 + 0.2 * rng.uniform())),
        confidence: Raster::from_fn(27, 18, |_, _| if rng.uniform() < 0.3 { 0.0 } else { half(rng.uniform()) }),
    };
    let view = TrainingView {
        world_from_camera: pose,
        light: noise(&mut rng, 27, 18, 3),
        light_camera,
        radio: noise(&mut rng, 17, 13, radio_channels),
        radio_camera,
        inverse_depth: Some(inverse_depth),
        mask: None,
    };
    let step = Step {
        view: ViewId(0),
        levels: [0; 2],
        light_weight: 1.0,
        radio_weight: 0.7,
        depth_weight: 0.6,
        train_geometry: true,
        light_background: LIGHT_BACKGROUND,
        radio_background: RADIO_BACKGROUND,
    };
    Scenario { gaussians, view, step, antialias }
}

impl Scenario {
    /// The devices there are, with their names.
    fn devices(&self) -> Vec<(&'static str, Box<dyn Differentiable>)> {
        let raster = RasterConfig { antialias: self.antialias, ..RasterConfig::default() };
        let cpu = CpuDevice::new(OptimizerConfig::default(), raster, &self.gaussians).unwrap();
        let mut devices: Vec<(&'static str, Box<dyn Differentiable>)> = vec![("cpu", Box::new(cpu))];
        #[cfg(feature = "gpu")]
        devices.extend(gpu(raster, &self.gaussians).map(|d| ("gpu", Box::new(d) as Box<dyn Differentiable>)));
        for (_, device) in &mut devices {
            assert_eq!(device.upload(&self.view, 1).unwrap(), ViewId(0));
        }
        devices
    }

    /// The scenario with a mask that leaves out a block at the border and scattered pixels.
    fn masked(mut self) -> Self {
        let (w, h) = (self.view.light.width, self.view.light.height);
        self.view.mask = Some(Raster::from_fn(w, h, |x, y| (x < 18 || y < 9) && (5 * x + 3 * y) % 11 != 0));
        self
    }

    fn render(&self, field: &Field, g: usize, rho: Option<&[f64]>) -> reference::Image {
        let (camera, background) = [(self.view.light_camera, LIGHT_BACKGROUND), (self.view.radio_camera, RADIO_BACKGROUND)][g];
        let near = f64::from(RasterConfig::default().near_m);
        reference::render(field, g, &self.view.world_from_camera, &camera, background.map(f64::from), self.antialias, near, rho)
    }

    /// The complete loss; antialias factors are held if given.
    fn loss(&self, field: &Field, rho: Option<&[Vec<f64>; 2]>) -> f64 {
        let mut loss = 0.0;
        if self.step.light_weight > 0.0 {
            let mut image = self.render(field, 0, rho.map(|r| &r[0][..]));
            let mut depth = self.view.inverse_depth.clone().unwrap();
            let mask = self.view.mask.iter().flat_map(|m| m.pixels().iter().enumerate());
            for (i, _) in mask.filter(|(_, counts)| !**counts) {
                let target = &self.view.light.pixels[3 * i..3 * i + 3];
                image.color[3 * i..3 * i + 3].iter_mut().zip(target).for_each(|(x, y)| *x = f64::from(*y));
                depth.confidence.pixels_mut()[i] = 0.0;
            }
            loss += f64::from(self.step.light_weight) * reference::image_loss(&image, &self.view.light);
            loss += f64::from(self.step.depth_weight) * reference::depth_loss(&image, &depth.value, &depth.confidence);
        }
        if self.step.radio_weight > 0.0 {
            let image = self.render(field, 1, rho.map(|r| &r[1][..]));
            loss += f64::from(self.step.radio_weight) * reference::image_loss(&image, &self.view.radio);
        }
        loss
    }

    fn assert_far_from_thresholds(&self, field: &Field) {
        for g in 0..2 {
            let margin = self.render(field, g, None).margin;
            assert!(margin > MARGIN, "modality {g} comes within {margin:.1e} of a threshold: choose another seed");
        }
    }

    /// The device's norms of dL/d(projected mean) in device coordinates against central differences, of the one modality that is trained.
    fn check_screen_gradients(&self, name: &str) {
        let field = Field::new(&self.gaussians);
        self.assert_far_from_thresholds(&field);
        let camera = if self.step.radio_weight > 0.0 { self.view.radio_camera } else { self.view.light_camera };
        let norms: Vec<f64> = (0..field.len())
            .into_par_iter()
            .map(|i| {
                let slope = |axis: usize, size: usize| {
                    let side = |sign: f64| {
                        let mut moved = field.clone();
                        moved.shift[i][axis] += sign * STEP;
                        self.loss(&moved, None)
                    };
                    // An image is two device coordinates wide and high.
                    (side(1.0) - side(-1.0)) / (2.0 * STEP) * 0.5 * size as f64
                };
                slope(0, camera.width).hypot(slope(1, camera.height))
            })
            .collect();
        let largest = norms.iter().copied().fold(0.0, f64::max);
        for (device, mut d) in self.devices() {
            let step = DenseStep { step: self.step, number: 1, position_rate_m: 0.0, degree: 3, screen_gradients: true };
            d.train_dense(&[step]).unwrap();
            let found = d.screen_gradients().unwrap();
            for (i, (ours, truth)) in found.iter().zip(&norms).enumerate() {
                // One may reach a tile and no pixel's centre.
                assert!(ours.steps == 1 || *truth == 0.0, "{name} on {device}: Gaussian {i}, {ours:?}, {truth:.2e}");
                let error = (f64::from(ours.mean()) - truth).abs();
                assert!(error <= GRADIENT_TOLERANCE * largest, "{name} on {device}: Gaussian {i}, {ours:?} against {truth:.6e}");
            }
            assert!(found.iter().filter(|g| g.steps == 1).count() > 10);
        }
    }

    /// Every `stride[class]`-th parameter of every class against central differences.
    fn check(&self, name: &str) {
        let field = Field::new(&self.gaussians);
        self.assert_far_from_thresholds(&field);
        let rho = (self.antialias == Antialias::Detached).then(|| [0, 1].map(|g| self.render(&field, g, None).rho));
        let truth = self.loss(&field, None);
        let gradients: Vec<(&str, Field)> = self
            .devices()
            .into_iter()
            .map(|(device, mut d)| {
                let (report, gradient) = d.differentiate(&self.step).unwrap();
                let total = f64::from(
                    self.step.light_weight * report.light_loss
                        + self.step.radio_weight * report.radio_loss
                        + self.step.depth_weight * report.depth_loss,
                );
                assert!((total - truth).abs() < 1e-5, "{name} on {device}: loss {total} against {truth}");
                (device, Field::new(&gradient))
            })
            .collect();
        for class in 0..7 {
            // Harmonics are many and alike: one in seven, which meets every coefficient and channel.
            let stride = if class < 5 { 1 } else { 7 };
            let indices: Vec<usize> = (0..field.classes[class].len()).step_by(stride).collect();
            let numeric: Vec<f64> = indices
                .par_iter()
                .map(|&i| {
                    let side = |sign: f64| {
                        let mut moved = field.clone();
                        moved.classes[class][i] += sign * STEP;
                        self.loss(&moved, rho.as_ref())
                    };
                    (side(1.0) - side(-1.0)) / (2.0 * STEP)
                })
                .collect();
            let largest = numeric.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            let rendered = match class {
                3 | 5 => self.step.light_weight > 0.0,
                4 | 6 => self.step.radio_weight > 0.0,
                _ => true,
            };
            assert_eq!(largest > 1e-5, rendered, "{name}: {} has gradients up to {largest:.1e}", CLASS_NAMES[class]);
            for (device, gradient) in &gradients {
                for (&i, n) in indices.iter().zip(&numeric) {
                    let a = gradient.classes[class][i];
                    assert!(
                        (a - n).abs() <= GRADIENT_TOLERANCE * largest,
                        "{name} on {device}: {} {i}: analytic {a:.6e}, differences {n:.6e}, largest {largest:.2e}",
                        CLASS_NAMES[class]
                    );
                }
                let errors = indices.iter().zip(&numeric).map(|(&i, n)| (gradient.classes[class][i] - n).abs());
                println!(
                    "{name} on {device}: {:16} largest {largest:.2e}, worst error {:.1e} of it",
                    CLASS_NAMES[class],
                    errors.fold(0.0_f64, f64::max) / largest.max(1e-300)
                );
            }
        }
    }
}

/// Seeds for which no pixel is near a threshold.
const SEEDS: [u64; 2] = [1, 2];
const NEEDLE_SEED: u64 = 1;

#[test]
fn images_agree_with_the_oracle() {
    for (radio_channels, antialias) in [(3, Antialias::On), (1, Antialias::Off)] {
        let s = scenario(SEEDS[0], radio_channels, 3, antialias);
        let field = Field::new(&s.gaussians);
        s.assert_far_from_thresholds(&field);
        let view = |camera| View { camera, world_from_camera: s.view.world_from_camera };
        let request = RenderRequest {
            light: Some((view(s.view.light_camera), LIGHT_BACKGROUND)),
            radio: Some((view(s.view.radio_camera), RADIO_BACKGROUND)),
            main_contributor: true,
        };
        for (device, mut d) in s.devices() {
            let rendering = d.render(&request).unwrap();
            for (g, layer) in [rendering.light.unwrap(), rendering.radio.unwrap()].iter().enumerate() {
                let truth = s.render(&field, g, None);
                let compare = |what: &str, ours: &[f32], truth: &[f64]| {
                    assert_eq!(ours.len(), truth.len());
                    for (i, (a, b)) in ours.iter().zip(truth).enumerate() {
                        assert!((f64::from(*a) - b).abs() < IMAGE_TOLERANCE, "{what} of modality {g} on {device}, {i}: {a} {b}");
                    }
                };
                compare("colour", &layer.color.pixels, &truth.color);
                compare("inverse depth", layer.inverse_depth.pixels(), &truth.inverse_depth);
                compare("transmittance", layer.transmittance.pixels(), &truth.transmittance);
                assert!(
                    truth.transmittance.iter().any(|t| *t < 0.3) && truth.transmittance.iter().any(|t| *t > 0.5),
                    "a varied scene"
                );
            }
        }
    }
}

#[test]
fn gradients_of_both_modalities_with_depth_and_antialiasing() {
    scenario(SEEDS[0], 3, 3, Antialias::On).check("coupled, Jet, antialias on");
}

/// Needles a hundred times as long as wide, thinner than a pixel: ρ is what their opacity is made of.
#[test]
fn gradients_of_needles() {
    let mut s = scenario(NEEDLE_SEED, 3, 1, Antialias::On);
    s.gaussians.log_scale.iter_mut().for_each(|s| *s = [s[0] + 1.0, s[1] - 3.0, s[2] - 3.0]);
    for a in [&mut s.gaussians.light, &mut s.gaussians.radio] {
        a.opacity_logit.iter_mut().for_each(|o| *o += 2.0);
    }
    s.check("needles");
}

#[test]
fn gradients_with_the_antialias_factor_detached() {
    scenario(SEEDS[0], 1, 1, Antialias::Detached).check("coupled, dB, antialias detached");
}

#[test]
fn gradients_without_antialiasing() {
    scenario(SEEDS[1], 1, 2, Antialias::Off).check("coupled, dB, antialias off");
}

#[test]
fn gradients_where_pixels_do_not_count() {
    scenario(SEEDS[0], 3, 1, Antialias::On).masked().check("coupled, Jet, masked");
    let mut s = scenario(SEEDS[1], 1, 2, Antialias::Off).masked();
    s.step.radio_weight = 0.0;
    s.check("optical alone, masked");
}

/// Nothing is learnt of an image of which nothing counts, and no number of it becomes infinite.
#[test]
fn an_image_of_which_nothing_counts_has_no_gradient() {
    let mut s = scenario(SEEDS[0], 3, 1, Antialias::On);
    s.view.mask = Some(Raster::filled(27, 18, false));
    s.step.radio_weight = 0.0;
    for (device, mut d) in s.devices() {
        let (report, gradient) = d.differentiate(&s.step).unwrap();
        assert!(report.light_loss.abs() < 1e-6 && report.depth_loss == 0.0, "{device}: {report:?}");
        assert!(report.visible > 10);
        for (name, class) in CLASS_NAMES.iter().zip(&Field::new(&gradient).classes) {
            assert!(class.iter().all(|v| *v == 0.0), "{name} on {device}: {class:?}");
        }
    }
}

#[test]
fn gradients_of_one_modality_alone() {
    let mut s = scenario(SEEDS[1], 3, 0, Antialias::On);
    s.step.radio_weight = 0.0;
    s.check("optical alone");
    s.step.radio_weight = 0.7;
    s.step.light_weight = 0.0;
    s.step.depth_weight = 0.0;
    s.check("RF alone");
}

#[test]
fn screen_gradients_are_those_of_the_projected_means() {
    let mut s = scenario(SEEDS[1], 3, 1, Antialias::Off);
    (s.step.radio_weight, s.step.depth_weight) = (0.0, 0.0);
    s.check_screen_gradients("light");
    (s.step.radio_weight, s.step.light_weight) = (0.7, 0.0);
    s.check_screen_gradients("RF");
}
