//! Columns of other programs: those that change what a Gaussian is.

use super::SingleModality;
use super::table::Table;
use crate::Result;

/// Mip-Splatting's column: the standard deviation of a 3D filter that is not yet part of scales and opacities, metres.
pub(super) const FILTER: &str = "filter_3D";

/// Columns (or beginnings of numbered ones) whose Gaussians are not ours, what they are, and what to give instead.
const OTHERS: [(&str, &str); 12] = [
    ("t", MOVING),
    ("scale_t", MOVING),
    ("rot_r_", MOVING),
    ("trbf_center", MOVING),
    ("trbf_scale", MOVING),
    ("motion_", MOVING),
    ("omega_", MOVING),
    ("f_offset_", "anchors of Scaffold-GS, whose Gaussians a network makes"),
    ("f_anchor_feat_", "anchors of Scaffold-GS, whose Gaussians a network makes"),
    ("beta", "kernels of Beta Splatting, which are no Gaussians"),
    ("nu_degree", "Student's t kernels, which are no Gaussians"),
    ("shape", "generalised exponentials, which are no Gaussians"),
];
const MOVING: &str = "Gaussians that change with time";

/// Refuses a file whose columns say that its rows are no Gaussians as ours are.
pub(super) fn check_columns(table: &Table) -> Result<()> {
    for name in table.names() {
        let is = |(begin, _): &&(&str, &str)| match begin.strip_suffix('_') {
            Some(_) => name.strip_prefix(begin).is_some_and(|rest| rest.parse::<u32>().is_ok()),
            None => name == *begin,
        };
        if let Some((_, what)) = OTHERS.iter().find(is) {
            return Err(
                table.invalid(format!("the column `{name}` is of {what}"), "give 3D Gaussians of a scene that stands still")
            );
        }
        let filters = ["filter_3d", "filter3d", "filter"];
        if name != FILTER && filters.contains(&name.to_lowercase().as_str()) {
            let what = format!(
                "the column `{name}` is no name of a 3D filter that is known: whether it is to be applied cannot be told"
            );
            return Err(table.invalid(what, "fuse it into scales and opacities, or call it `filter_3D` if it is Mip-Splatting's"));
        }
    }
    Ok(())
}

/// Applies a 3D filter as Mip-Splatting does when it draws (Yu et al. 2024): each Gaussian is convolved with one of standard deviation f, and keeps its
/// integral. Scales become √(s² + f²), and the opacity is multiplied by √(∏ s² / ∏ (s² + f²)).
pub(super) fn apply_filter(table: &Table, field: &mut SingleModality) -> Result<()> {
    if !table.has(FILTER) {
        return Ok(());
    }
    let filters = table.rows([FILTER])?;
    let gaussians = field.log_scale.iter_mut().zip(&mut field.appearance.opacity_logit);
    for (i, ((log_scale, opacity_logit), [filter])) in gaussians.zip(filters).enumerate() {
        if filter < 0.0 {
            return Err(table.invalid(format!("vertex {i}: {FILTER} is {filter}"), "a standard deviation is at least 0, metres"));
        }
        if filter == 0.0 {
            continue;
        }
        // ln √(s² + f²) − ln s = ½ ln(1 + (f/s)²).
        let grown = log_scale.map(|ln| 0.5 * (2.0 * (f64::from(filter).ln() - f64::from(ln))).exp().ln_1p());
        let scales = [0, 1, 2].map(|k| (f64::from(log_scale[k]) + grown[k]) as f32);
        // With o = 1/(1 + e^−x) and a share of e^−g, the logit of o·e^−g is −ln(e^(g − x) + e^g − 1).
        let sum: f64 = grown.iter().sum();
        let logit = -((sum - f64::from(*opacity_logit)).exp() + sum.exp_m1()).ln() as f32;
        if !logit.is_finite() || scales.iter().any(|v| !v.is_finite()) {
            let what = format!("vertex {i}: {FILTER} of {filter} over scales of e^{log_scale:?} m leaves no number");
            return Err(table.invalid(what, "scales are natural logarithms of metres, the filter is metres"));
        }
        (*log_scale, *opacity_logit) = (scales, logit);
    }
    Ok(())
}

/// Names of the columns that nothing was made of. Normals, which the reference implementation writes as zeros, are none.
pub(super) fn unread(table: &Table) -> Vec<String> {
    let numbered = |name: &str, begin: &str| name.strip_prefix(begin).is_some_and(|n| n.parse::<u32>().is_ok());
    let read = |name: &str| {
        ["x", "y", "z", "nx", "ny", "nz", "opacity", FILTER].contains(&name)
            || ["f_dc_", "f_rest_", "scale_", "rot_"].iter().any(|begin| numbered(name, begin))
    };
    table.names().filter(|name| !read(name)).map(str::to_owned).collect()
}
