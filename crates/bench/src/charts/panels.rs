//! Figures of pictures: panels side by side, each with axes in degrees, a colour bar with its unit, and its peaks.

use super::{Anchor, AxesFrame, Colour, DIM, INK, Plot, Scale, Stroke, Svg, WHITE, picture_uri, png_uri, text_width};
use crate::metrics::peaks::Peak;
use anyhow::{Context, Result};
use corf_raytrace::spectrum::Grid;
use corf_scene::Raster;

/// Size of the title, and of what explains it.
const TITLE: f64 = 18.0;
const NOTE: f64 = 12.0;
/// Space left and right of them.
const EDGE: f64 = 14.0;
/// Space over a picture, for its name.
const OVER: f64 = 26.0;
/// Space left of a picture, for its axis.
const LEFT: f64 = 66.0;
/// Space right of a picture, without and with a colour bar.
const RIGHT: [f64; 2] = [26.0, 102.0];
/// Space under a picture, for its axis.
const UNDER: f64 = 56.0;
/// Height of a line about a peak.
const LINE: f64 = 17.0;
/// Width of a picture, where it stands alone and where it does not.
const WIDTH: [f64; 2] = [600.0, 360.0];
/// Points of a line of equal elevation.
const POINTS: usize = 48;
/// The lines of the grid over a picture.
const GRATICULE: Stroke = Stroke { colour: [205, 208, 214], width: 0.5, dash: Some(3.0) };

/// The colours of a panel's values.
pub struct Bar {
    /// The colour of a share of the scale, from 0 at its lower end to 1.
    pub colour: Box<dyn Fn(f64) -> Colour>,
    /// The values.
    pub values: Scale,
    /// Their unit.
    pub unit: String,
}

/// A picture of directions.
pub struct Panel<'a> {
    /// What it shows.
    pub name: String,
    /// The picture, on the pixels of `grid` or fewer.
    pub picture: Raster<Colour>,
    /// Where its pixels look.
    pub grid: Grid,
    /// What its colours mean; none of a photograph.
    pub bar: Option<Bar>,
    /// Peaks that are marked.
    pub peaks: &'a [Peak],
}

/// The axes of a picture of directions, in degrees of the array's azimuth and elevation, and its width over its height. On a pinhole's picture
/// azimuth depends on the column alone; elevations are those at the left edge, from where lines lead through the picture.
fn axes(grid: &Grid) -> Result<(Scale, Scale, f64)> {
    Ok(match grid {
        Grid::Sphere(sphere) => {
            (Scale::degrees(-180.0, 180.0)?.falling(), Scale::degrees(-90.0, 90.0)?, sphere.width as f64 / sphere.height as f64)
        }
        Grid::Pinhole(camera) => {
            let (width, height) = (camera.width as f64, camera.height as f64);
            let left = (camera.cx / camera.fx).atan();
            let right = -((width - camera.cx) / camera.fx).atan();
            let elevation = |v: f64| ((camera.cy - v) / camera.fy * left.cos()).atan().to_degrees();
            let x = Scale::tangent(right.to_degrees(), left.to_degrees())?.falling();
            (x, Scale::tangent(elevation(height), elevation(0.0))?, (width / camera.fx) / (height / camera.fy))
        }
    })
}

/// Lines of equal azimuth and of equal elevation through a picture.
fn graticule(plot: &mut Plot<'_>, grid: &Grid) {
    let ([x, y], frame) = (plot.scales(), plot.frame());
    let ([low, high], [right, left]) = (y.ends(), x.ends());
    for (azimuth, _) in x.ticks(frame.x_ticks()) {
        plot.line([(azimuth, low), (azimuth, high)], GRATICULE);
    }
    for (elevation, _) in y.ticks(frame.y_ticks()) {
        let at = |i: usize| right + (left - right) * i as f64 / POINTS as f64;
        let points = (0..=POINTS).map(at).map(|azimuth| match grid {
            Grid::Sphere(_) => (azimuth, elevation),
            // The elevation that the left edge has at this height.
            Grid::Pinhole(_) => {
                let share = left.to_radians().cos() / azimuth.to_radians().cos();
                (azimuth, (elevation.to_radians().tan() * share).atan().to_degrees())
            }
        });
        plot.line(points.filter(|(_, y)| (low..=high).contains(y)), GRATICULE);
    }
}

/// The rings of a picture's peaks, each with its number.
fn mark(svg: &mut Svg, frame: AxesFrame, peaks: &[Peak]) {
    for (number, peak) in peaks.iter().enumerate() {
        let at = (frame.left + peak.x * (frame.right - frame.left), frame.top + peak.y * (frame.bottom - frame.top));
        svg.circle(at, 8.5, INK, false);
        svg.circle(at, 7.0, WHITE, false);
        let side = if at.0 + 30.0 > frame.right { -17.0 } else { 17.0 };
        svg.rectangle([(at.0 + side - 6.0, at.1 - 8.0), (at.0 + side + 6.0, at.1 + 8.0)], INK, 0.65);
        svg.text((at.0 + side, at.1), &(number + 1).to_string(), 12.0, WHITE, Anchor::Middle);
    }
}

/// A peak in words.
fn words(number: usize, peak: &Peak) -> String {
    format!("{}: azimuth {:.1}°, elevation {:.1}°, {:.1} dB", number + 1, peak.azimuth_deg, peak.elevation_deg, peak.db)
        .replace('-', "−")
}

/// A text in lines that are no wider than `width` pixels; a longer word has a line for itself.
fn lines(text: &str, size: f64, width: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut().filter(|line| text_width(&format!("{line} {word}"), size) <= width) {
            Some(line) => *line += &format!(" {word}"),
            None => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Width of a panel with its axis and its bar.
fn width_of(panel: &Panel<'_>, picture: f64) -> f64 {
    LEFT + picture + RIGHT[usize::from(panel.bar.is_some())]
}

/// A figure of rows of panels under a title; `line` explains it, if it is not empty.
///
/// # Errors
/// Pictures without pixels, or of directions that no axis holds.
pub fn figure(title: &str, line: &str, rows: &[Vec<Panel<'_>>]) -> Result<String> {
    let alone = rows.iter().all(|row| row.len() == 1);
    let picture = WIDTH[usize::from(!alone)];
    // Pictures stand under each other, so a column is as wide as the widest of its panels.
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width_of_column =
        |column: usize| rows.iter().filter_map(|row| row.get(column)).map(|p| width_of(p, picture)).fold(0.0, f64::max);
    let widths: Vec<f64> = (0..columns).map(width_of_column).collect();
    let width = widths.iter().sum::<f64>().ceil();
    let mut svg = Svg::new(width as u32, 0);
    let mut top = 20.0;
    for line in lines(title, TITLE, width - 2.0 * EDGE) {
        svg.text((EDGE, top), &line, TITLE, INK, Anchor::Start);
        top += 22.0;
    }
    for line in lines(line, NOTE, width - 2.0 * EDGE) {
        svg.text((EDGE, top), &line, NOTE, DIM, Anchor::Start);
        top += LINE;
    }
    for row in rows {
        let (mut from, mut end) = (0.0, top);
        for (panel, width) in row.iter().zip(&widths) {
            let bottom =
                draw(&mut svg, panel, (from, top), picture).with_context(|| format!("cannot draw \"{}\"", panel.name))?;
            (from, end) = (from + width, f64::max(end, bottom));
        }
        top = end;
    }
    svg.set_height((top + 6.0).ceil() as u32);
    Ok(svg.finish())
}

/// Draws a panel at a place; returns the height at which it ends.
fn draw(svg: &mut Svg, panel: &Panel<'_>, (from, top): (f64, f64), width: f64) -> Result<f64> {
    let (x, y, aspect) = axes(&panel.grid)?;
    let top = top + OVER;
    let frame = AxesFrame { left: from + LEFT, top, right: from + LEFT + width, bottom: top + (width / aspect).round() };
    // What is read off by its colours is kept as it is.
    let uri = if panel.bar.is_some() { png_uri(&panel.picture)? } else { picture_uri(&panel.picture)? };
    svg.text((0.5 * (frame.left + frame.right), top - 11.0), &panel.name, 13.0, INK, Anchor::Middle);
    let mut plot = Plot::new(svg, frame, x, y);
    plot.image(&uri);
    graticule(&mut plot, &panel.grid);
    plot.x_axis("azimuth, °", false);
    plot.y_axis(if matches!(panel.grid, Grid::Sphere(_)) { "elevation, °" } else { "elevation along the lines, °" }, false);
    if let Some(bar) = &panel.bar {
        plot.colour_bar(&bar.colour, bar.values, &bar.unit);
    }
    mark(svg, frame, panel.peaks);
    for (number, peak) in panel.peaks.iter().enumerate() {
        svg.text((frame.left, frame.bottom + UNDER + LINE * number as f64), &words(number, peak), 12.0, INK, Anchor::Start);
    }
    Ok(frame.bottom + UNDER + LINE * panel.peaks.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::{Equirectangular, Pinhole};
    use glam::DVec3;

    #[test]
    fn a_direction_stands_where_its_pixel_is() {
        // Square pixels or not, the axis in the middle or not.
        for camera in [
            Pinhole::from_horizontal_fov(300, 200, 90.0),
            Pinhole { width: 320, height: 200, fx: 250.0, fy: 230.0, cx: 130.0, cy: 120.0 },
        ] {
            let (x, y, aspect) = axes(&Grid::Pinhole(camera)).unwrap();
            assert!((aspect - camera.width as f64 * camera.fy / (camera.height as f64 * camera.fx)).abs() < 1e-12);
            let left = (camera.cx / camera.fx).atan();
            for (u, v) in [(10.0, 20.0), (150.0, 100.0), (290.0, 190.0)] {
                let ray: DVec3 = camera.unproject(u, v);
                let azimuth = (-ray.x).atan2(ray.z);
                let elevation = (-ray.y).atan2(ray.x.hypot(ray.z));
                assert!((x.share(azimuth.to_degrees()) - u / camera.width as f64).abs() < 1e-9);
                // As the lines of equal elevation lead it to the left edge.
                let at_left = (elevation.tan() * left.cos() / azimuth.cos()).atan();
                assert!((y.share(at_left.to_degrees()) - (1.0 - v / camera.height as f64)).abs() < 1e-9);
            }
        }
        let (x, y, aspect) = axes(&Grid::Sphere(Equirectangular { width: 72, height: 36 })).unwrap();
        assert_eq!((x.share(90.0), y.share(-45.0), aspect), (0.25, 0.25, 2.0));
    }

    #[test]
    fn long_texts_are_broken_and_no_word_is_lost() {
        let text = "At (7, 4, 1.6) m, from a transmitter: 47 paths and 133706 diffuse arrivals";
        let broken = lines(text, 12.0, 200.0);
        assert!(broken.len() > 2 && broken.iter().all(|line| text_width(line, 12.0) <= 200.0), "{broken:?}");
        assert_eq!(broken.join(" "), text);
        assert!(lines("", 12.0, 200.0).is_empty() && lines("word", 12.0, 1.0) == ["word"]);
    }

    #[test]
    fn a_figure_has_axes_a_bar_its_peaks_and_a_title_and_nothing_is_cut() {
        let camera = Pinhole::from_horizontal_fov(30, 20, 90.0);
        let peaks = [Peak { x: 0.25, y: 0.5, azimuth_deg: 26.57, elevation_deg: -3.0, db: -52.34 }];
        let panel = |name: &str, bar: bool| Panel {
            name: name.to_owned(),
            picture: Raster::filled(30, 20, [9, 9, 9]),
            grid: Grid::Pinhole(camera),
            bar: bar.then(|| Bar {
                colour: Box::new(|t| [(255.0 * t) as u8, 0, 0]),
                values: Scale::linear(-60.0, 0.0).unwrap(),
                unit: "dB".to_owned(),
            }),
            peaks: if bar { &peaks } else { &[] },
        };
        let rows = [vec![panel("image <a>", false), panel("spectrum", true)], vec![panel("lower", true)]];
        let svg = figure("Keyframe 9 & more", "a line", &rows).unwrap();
        for text in [
            "Keyframe 9 &amp; more",
            "a line",
            "image &lt;a&gt;",
            "azimuth, °",
            "elevation along the lines, °",
            "dB",
            "40",
            "-20",
        ] {
            assert!(svg.contains(&format!(">{text}</text>")), "{text}: {svg}");
        }
        assert!(svg.contains(">1: azimuth 26.6°, elevation −3.0°, −52.3 dB</text>"), "{svg}");
        assert_eq!((svg.matches("<image ").count(), svg.matches("<circle").count()), (3, 4));
        // The ring stands at a quarter of the second picture.
        let number = |text: &str| text.split('"').next().unwrap().parse::<f64>().unwrap();
        let attribute = |tag: &str, name: &str| number(tag.split(&format!(" {name}=\"")).nth(1).unwrap());
        let images: Vec<&str> = svg.split("<image ").skip(1).collect();
        let ring = svg.split("<circle").nth(1).unwrap();
        assert!((attribute(ring, "cx") - attribute(images[1], "x") - 0.25 * attribute(images[1], "width")).abs() < 0.11);
        // No text is below the foot or right of the edge.
        let (width, height) = (number(svg.split("width=\"").nth(1).unwrap()), number(svg.split("height=\"").nth(1).unwrap()));
        for text in svg.split("<text ").skip(1) {
            assert!(
                number(text.split("x=\"").nth(1).unwrap()) < width && number(text.split("y=\"").nth(1).unwrap()) < height - 3.0
            );
        }
    }
}
