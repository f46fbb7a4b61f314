//! Coverage: the noncoherent path gain of transmitters on the cells of a plane.

use super::{Arrival, DiffuseField, RadioSettings, Solids, Transmitter, WorldExtent};
use corf_scene::{Error, Raster, Result, Scene};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// More cells than this are more likely a mistaken unit.
const MAX_CELLS: usize = 16_000_000;

/// A rectangle of square cells. Row 0 is the top of the picture: the largest v.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CoveragePlane {
    /// World position of the corner of smallest u and v, metres.
    pub corner: DVec3,
    /// Unit direction of the columns.
    pub along_u: DVec3,
    /// Unit direction against the rows.
    pub along_v: DVec3,
    /// Side of a cell, metres.
    pub cell_m: f64,
    /// Cells along u.
    pub columns: usize,
    /// Cells along v.
    pub rows: usize,
}

impl CoveragePlane {
    /// The rectangle with a corner, a second one along its u side and a third one along its v side; sides are rounded up to whole cells.
    ///
    /// # Errors
    /// Sides that are not perpendicular or have no length, a cell size that is not positive, too many cells.
    pub fn new(corner: DVec3, end_u: DVec3, end_v: DVec3, cell_m: f64) -> Result<Self> {
        let fault = |what: String, help: &str| Err(Error::invalid("coverage plane", what, help));
        let (u, v) = (end_u - corner, end_v - corner);
        if !(corner.is_finite() && u.is_finite() && v.is_finite() && u.length() > 0.0 && v.length() > 0.0) {
            return fault(
                format!("{corner}, {end_u}, {end_v} span no rectangle"),
                "give a corner and the ends of its two sides, in metres",
            );
        }
        if u.normalize().dot(v.normalize()).abs() > 1e-6 {
            return fault(
                format!("its sides {u} and {v} are not perpendicular"),
                "give the ends of two sides that meet at a right angle",
            );
        }
        if !(cell_m.is_finite() && cell_m > 0.0) {
            return fault(format!("cells of {cell_m} m"), "give a cell size above 0 in metres, e.g. 0.25");
        }
        // A side that is a whole number of cells but for rounding has that number.
        let cells = |length: f64| ((length / cell_m - 1e-6).ceil()).max(1.0);
        let (columns, rows) = (cells(u.length()), cells(v.length()));
        if columns * rows > MAX_CELLS as f64 {
            return fault(format!("{columns} x {rows} cells of {cell_m} m"), "give larger cells: at most 16 million are mapped");
        }
        let (along_u, along_v) = (u.normalize(), v.normalize());
        Ok(Self { corner, along_u, along_v, cell_m, columns: columns as usize, rows: rows as usize })
    }

    /// The scene's whole ground plan at a height; u is east (+x), v is north (+y).
    ///
    /// # Errors
    /// A height outside of the scene, a scene without triangles, and as [`CoveragePlane::new`].
    pub fn horizontal(scene: &Scene, height_m: f64, cell_m: f64) -> Result<Self> {
        let Some(bounds) = scene.bounds() else {
            return Err(Error::invalid(scene.name.as_str(), "there is no triangle", "give a scene with triangle meshes"));
        };
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        if !(min.z..=max.z).contains(&height_m) {
            return Err(Error::invalid(
                "coverage plane",
                format!("height {height_m} m lies outside of {}", scene.name),
                format!("it reaches from {:.2} m to {:.2} m; any other rectangle is one of --plane", min.z, max.z),
            ));
        }
        let corner = DVec3::new(min.x, min.y, height_m);
        Self::new(corner, corner.with_x(max.x), corner.with_y(max.y), cell_m)
    }

    /// World position of a cell's centre.
    pub fn centre(&self, column: usize, row: usize) -> DVec3 {
        let (u, v) = ((column as f64 + 0.5) * self.cell_m, ((self.rows - 1 - row) as f64 + 0.5) * self.cell_m);
        self.corner + self.along_u * u + self.along_v * v
    }

    /// A world point in plane coordinates (u, v), metres from the corner, projected along the normal.
    pub fn project(&self, point: DVec3) -> DVec2 {
        let from_corner = point - self.corner;
        DVec2::new(from_corner.dot(self.along_u), from_corner.dot(self.along_v))
    }

    /// The lines along which the plane cuts the scene's triangles, in plane coordinates.
    pub fn cut(&self, scene: &Scene) -> Vec<[DVec2; 2]> {
        let normal = self.along_u.cross(self.along_v);
        let segment = |i: usize| {
            let corners = scene.corners_f64(i);
            let heights = corners.map(|p| (p - self.corner).dot(normal));
            let mut ends = Vec::with_capacity(2);
            for k in 0..3 {
                let (a, b) = (k, (k + 1) % 3);
                if (heights[a] < 0.0) != (heights[b] < 0.0) {
                    ends.push(self.project(corners[a].lerp(corners[b], heights[a] / (heights[a] - heights[b]))));
                }
            }
            (ends.len() == 2).then(|| [ends[0], ends[1]])
        };
        (0..scene.triangles.len()).filter_map(segment).collect()
    }
}

/// The power of all paths at the centre of every cell ([`super::Path::received`]), linear, relative to 1 W transmitted; not a number where a
/// closed body parts the cell from the transmitter, and where its centre lies on a surface. `progress` is told the rows done after each of
/// them, and may end the work.
///
/// # Errors
/// Errors of the tracer or of `progress`.
pub fn coverage<E: From<Error>>(
    transmitter: &Transmitter<'_, '_>,
    diffuse: Option<&DiffuseField<'_, '_>>,
    solids: &Solids,
    plane: &CoveragePlane,
    mut progress: impl FnMut(usize) -> Result<(), E>,
) -> Result<Raster<f32>, E> {
    let tx = transmitter.position();
    let RadioSettings { tx_antenna, rx_antenna, .. } = transmitter.tracer.settings();
    let gain = |rx: DVec3| -> Result<f32> {
        // A place where nothing can be received, a surface or the transmitter's own, is a cell without a value.
        let tracer = transmitter.tracer;
        let unfit =
            || tracer.check_receiver(tx, rx).is_err() || diffuse.is_some() && tracer.check_in_the_open("receiver", rx).is_err();
        if solids.parting(tx, rx).is_some() || unfit() {
            return Ok(f32::NAN);
        }
        let paths: f64 = transmitter.paths(rx)?.iter().map(|path| path.received(tx_antenna, rx_antenna)).sum();
        let scattered: f64 = match diffuse {
            Some(field) => field.gather(rx, rx_antenna, &WorldExtent::Sphere)?.iter().map(|a: &Arrival| a.power).sum(),
            None => 0.0,
        };
        Ok((paths + scattered) as f32)
    };
    let mut cells = Vec::with_capacity(plane.columns * plane.rows);
    for row in 0..plane.rows {
        let line: Result<Vec<f32>> = (0..plane.columns).into_par_iter().map(|column| gain(plane.centre(column, row))).collect();
        cells.extend(line?);
        progress(row + 1)?;
    }
    Ok(Raster::from_vec(plane.columns, plane.rows, cells))
}

/// Best-server map of several transmitters' coverage maps of one plane: the largest gain of every cell, and the index of the map that has
/// it (the first of equals): −1 where none is above 0. Not a number where no map has a value.
pub fn strongest(maps: &[Raster<f32>]) -> (Raster<f32>, Raster<f32>) {
    let (columns, rows) = maps.first().map_or((0, 0), |map| (map.width(), map.height()));
    let cell = |i: usize| {
        let values = maps.iter().map(|map| map.pixels()[i]).enumerate().filter(|(_, gain)| !gain.is_nan());
        values.fold((f32::NAN, f32::NAN), |(most, of), (number, gain)| match gain {
            gain if gain > most || most.is_nan() => (gain, if gain > 0.0 { number as f32 } else { -1.0 }),
            _ => (most, of),
        })
    };
    let (gain, of) = (0..columns * rows).map(cell).unzip();
    (Raster::from_vec(columns, rows, gain), Raster::from_vec(columns, rows, of))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_strongest_transmitter_of_a_cell_is_the_first_with_most_gain() {
        const NAN: f32 = f32::NAN;
        let maps = [[3.0, 1.0, 2.0, 0.0, NAN, NAN], [1.0, 4.0, 2.0, 0.0, 5.0, NAN]].map(|m| Raster::from_vec(3, 2, m.to_vec()));
        let (gain, of) = strongest(&maps);
        assert_eq!((gain.width(), gain.height(), of.width()), (3, 2, 3));
        assert_eq!(gain.pixels()[..5], [3.0, 4.0, 2.0, 0.0, 5.0]);
        assert_eq!(of.pixels()[..5], [0.0, 1.0, 0.0, -1.0, 1.0]);
        assert!(gain.pixels()[5].is_nan() && of.pixels()[5].is_nan());
    }
}
