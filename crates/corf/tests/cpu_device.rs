//! The CPU device: what holds of every device, and bytes that do not depend on the number of threads.

#![allow(clippy::unwrap_used)]

#[macro_use]
mod suite;

use corf::{
    CpuDevice, Device, Gaussians, OptimizerConfig, RasterConfig, Result,
    device::{Step, StepReport},
};
use suite::{Opened, Tested, light, metric_rates, step, training_view, wall};

impl Tested for CpuDevice {
    fn gradients_of(&mut self, step: &Step) -> Result<(StepReport, Gaussians)> {
        self.gradients(step)
    }
}

fn open(optimizer: OptimizerConfig, raster: RasterConfig, g: &Gaussians) -> Result<Opened> {
    Ok(Box::new(CpuDevice::new(optimizer, raster, g)?))
}

suite_on!(open, cfg_attr(any(), ignore));

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let run = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let mut d = CpuDevice::new(metric_rates(), RasterConfig::default(), &wall(1500, 3, 2)).unwrap();
            d.upload(&training_view(3, 4), 2).unwrap();
            let steps: Vec<Step> = (0..12).map(|i| step(i % 2)).collect();
            let report = d.train(&steps).unwrap();
            let image = d.render(&light([0.0; 3])).unwrap().light.unwrap().color;
            (report, d.gaussians().unwrap(), image)
        })
    };
    let one = run(1);
    assert!(one.0.visible > 500);
    assert_eq!(one, run(2));
    assert_eq!(one, run(3));
}
