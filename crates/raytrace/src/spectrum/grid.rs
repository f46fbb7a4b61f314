//! The directions at which a spectrum is evaluated: the pixels of a pinhole camera or of the whole sphere.

use corf_scene::model::ARRAY_FROM_CAMERA;
use corf_scene::{Equirectangular, Pinhole};
use glam::DVec3;

/// An image of directions. They are given in the camera frame (x right, y down, z forward), whichever the projection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Grid {
    /// A pinhole camera's pixels.
    Pinhole(Pinhole),
    /// All directions; azimuth and elevation are those of the array that looks along the camera's axis.
    Sphere(Equirectangular),
}

impl From<&Pinhole> for Grid {
    fn from(camera: &Pinhole) -> Self {
        Self::Pinhole(*camera)
    }
}

impl From<&Equirectangular> for Grid {
    fn from(sphere: &Equirectangular) -> Self {
        Self::Sphere(*sphere)
    }
}

impl From<&Grid> for Grid {
    fn from(grid: &Grid) -> Self {
        *grid
    }
}

impl Grid {
    /// Pixels in a row.
    pub fn width(&self) -> usize {
        match self {
            Self::Pinhole(camera) => camera.width,
            Self::Sphere(sphere) => sphere.width,
        }
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        match self {
            Self::Pinhole(camera) => camera.height,
            Self::Sphere(sphere) => sphere.height,
        }
    }

    /// The unit direction of every pixel's centre, camera frame, row-major.
    pub fn directions(&self) -> Vec<DVec3> {
        let camera_from_array = ARRAY_FROM_CAMERA.rotation.transpose();
        let direction = |x, y| match self {
            Self::Pinhole(camera) => camera.pixel_direction(x, y),
            Self::Sphere(sphere) => camera_from_array * sphere.pixel_direction(x, y),
        };
        (0..self.width() * self.height()).map(|i| direction(i % self.width(), i / self.width())).collect()
    }

    /// The solid angle of pixel `(x, y)`, steradians.
    pub fn pixel_solid_angle_sr(&self, x: usize, y: usize) -> f64 {
        match self {
            Self::Pinhole(camera) => camera.pixel_solid_angle_sr(x, y),
            Self::Sphere(sphere) => sphere.pixel_solid_angle_sr(y),
        }
    }

    /// Whether a direction of the camera frame falls inside the image.
    pub fn contains(&self, direction: DVec3) -> bool {
        match self {
            Self::Pinhole(camera) => camera
                .project(direction)
                .is_some_and(|p| p.x >= 0.0 && p.y >= 0.0 && p.x < camera.width as f64 && p.y < camera.height as f64),
            Self::Sphere(_) => true,
        }
    }
}
