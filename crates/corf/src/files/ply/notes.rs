//! Comments of a header: how its Gaussians are to be drawn.

use crate::{Antialias, Appearance, RadioTarget};
use corf_scene::keyframe::DbRange;

/// How Gaussians are to be drawn. Programs that draw splats read the first three lines that this becomes (`SplatRenderMode`, `Vertical axis` and
/// `SH degree`, in the spelling of Brush, which splat-transform reads as well); the others are for people.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Notes {
    /// Filter that they were trained with.
    pub antialias: Antialias,
    /// Upward axis of the file's frame.
    pub up: [i8; 3],
    /// Encoding of the RF colours.
    pub radio_target: RadioTarget,
    /// Levels of scalar 0 and 1 of the RF colours, dB.
    pub db_range: DbRange,
    /// Colour behind the RF field.
    pub radio_background: [f32; 3],
    /// What the data set took off positions, metres along the z-up world's axes.
    pub offset_m: Option<[f64; 3]>,
}

/// Spelling of the axis in a header.
const VERTICAL_AXIS: &str = "Vertical axis: ";
/// Spelling of the filter in a header.
const RENDER_MODE: &str = "SplatRenderMode: ";

impl Notes {
    /// Whether opacity is compensated for the pixel's own extent.
    pub fn is_antialiased(&self) -> bool {
        self.antialias != Antialias::Off
    }

    /// Comments on a file whose standard columns hold `appearance`; `radio` says of which modality it is.
    pub(super) fn comments(&self, appearance: &Appearance, radio: bool) -> Vec<String> {
        let [x, y, z] = self.up;
        let h = self.antialias.dilation();
        let (mode, opacity) = match self.is_antialiased() {
            true => ("mip", "multiplied by sqrt(det before / det after)"),
            false => ("default", "left as it is"),
        };
        let mut lines = vec![
            format!("{RENDER_MODE}{mode}"),
            format!("{VERTICAL_AXIS}{x} {y} {z}"),
            format!("SH degree: {}", appearance.sh_degree),
            format!("corf filter: {h} px^2 added to the diagonal of the projected covariance, opacity {opacity}"),
        ];
        if let Some([x, y, z]) = self.offset_m {
            lines.push(format!(
                "corf offset: {x} {y} {z} m along the axes of the z-up world was taken off the original positions"
            ));
        }
        if radio {
            lines.extend(self.radio(""));
        }
        lines
    }

    /// Comments on the RF colours, of columns that begin with `prefix`.
    pub(super) fn radio(&self, prefix: &str) -> [String; 2] {
        let DbRange { min_db, max_db } = self.db_range;
        let channels = &self.radio_background[..self.radio_target.channels()];
        let background: Vec<String> = channels.iter().map(f32::to_string).collect();
        let encoding = match self.radio_target {
            RadioTarget::Jet => "Jet colour",
            RadioTarget::Db => "one channel, 0 to 1",
        };
        [
            format!("corf colour of {prefix}f_dc: {encoding} of 10 log10 of power, {min_db} to {max_db} dB"),
            format!("corf background of {prefix}f_dc: {}", background.join(" ")),
        ]
    }
}

/// The direction that a header's comments say is up. `None` where they say nothing.
pub(super) fn up<'a>(comments: impl Iterator<Item = &'a str>) -> Option<[f32; 3]> {
    let axis = |c: &str| {
        let text = c.trim().to_lowercase();
        let rest = text.strip_prefix(VERTICAL_AXIS.trim_end().to_lowercase().as_str())?.trim().to_owned();
        let numbers: Vec<f32> =
            rest.split([' ', ',']).filter(|w| !w.is_empty()).map(str::parse).collect::<Result<_, _>>().ok()?;
        <[f32; 3]>::try_from(numbers.as_slice()).ok()
    };
    comments.filter_map(axis).last()
}

/// The filter that a header's comments name: whether it is one that compensates opacity. `None` where they say nothing.
pub(super) fn antialiased<'a>(comments: impl Iterator<Item = &'a str>) -> Option<bool> {
    let mode = |c: &str| match c.trim().to_lowercase().strip_prefix(&RENDER_MODE.to_lowercase()).map(str::trim) {
        Some("mip") => Some(true),
        Some("default") => Some(false),
        _ => None,
    };
    comments.filter_map(mode).last()
}
