//! A device's state as named arrays: what checkpoints of reconstructions are made of.
//!
//! `gaussians`, and Adam's `first_moment` and `second_moment` alike, have `position` (n × 3), `rotation` (n × 4), `log_scale` (n × 3), and at light
//! (`optical`) and at 60 GHz (`rf`) `opacity_logit` (n) and the harmonics `sh` (n × channels and coefficients); `position_rate` is one number a Gaussian.

use super::tensors::{Tensor, Tensors};
use crate::{Appearance, Gaussians, Result, device::DeviceState};

/// Names of the parts, in the state's order.
const PARTS: [&str; 3] = ["gaussians", "first_moment", "second_moment"];

/// The arrays of a state.
pub fn tensors(state: &DeviceState) -> Vec<Tensor<'_>> {
    let [first, second] = &state.moments;
    let mut all: Vec<Tensor<'_>> =
        PARTS.into_iter().zip([&state.gaussians, first, second]).flat_map(|(part, g)| gaussians(part, g)).collect();
    all.push(Tensor::new("position_rate", &[state.position_rate.len()], &state.position_rate[..]));
    all
}

fn gaussians<'a>(part: &str, g: &'a Gaussians) -> Vec<Tensor<'a>> {
    let n = g.len();
    let mut all = vec![
        Tensor::new(format!("{part}.position"), &[n, 3], g.position.as_flattened()),
        Tensor::new(format!("{part}.rotation"), &[n, 4], g.rotation.as_flattened()),
        Tensor::new(format!("{part}.log_scale"), &[n, 3], g.log_scale.as_flattened()),
    ];
    for (modality, appearance) in [("optical", &g.light), ("rf", &g.radio)] {
        all.push(Tensor::new(format!("{part}.{modality}.opacity_logit"), &[n], &appearance.opacity_logit[..]));
        all.push(Tensor::new(format!("{part}.{modality}.sh"), &[n, appearance.stride()], &appearance.sh[..]));
    }
    all
}

/// The state of `n` Gaussians in a file; `like` is a field of their channels and degrees.
///
/// # Errors
/// Arrays that are missing or of other sizes.
pub fn read(file: &Tensors, n: usize, like: &Gaussians) -> Result<DeviceState> {
    let gaussians = |part: &str| -> Result<Gaussians> {
        let appearance = |modality: &str, like: &Appearance| -> Result<Appearance> {
            let opacity_logit = file.numbers(&format!("{part}.{modality}.opacity_logit"), &[n])?;
            let sh = file.numbers(&format!("{part}.{modality}.sh"), &[n, like.stride()])?;
            Ok(Appearance { opacity_logit, sh, ..like.clone() })
        };
        Ok(Gaussians {
            position: file.groups(&format!("{part}.position"), n)?,
            rotation: file.groups(&format!("{part}.rotation"), n)?,
            log_scale: file.groups(&format!("{part}.log_scale"), n)?,
            light: appearance("optical", &like.light)?,
            radio: appearance("rf", &like.radio)?,
        })
    };
    let [held, first, second] = PARTS.map(gaussians);
    let position_rate = file.numbers("position_rate", &[n])?;
    Ok(DeviceState { gaussians: held?, moments: [first?, second?], position_rate })
}
