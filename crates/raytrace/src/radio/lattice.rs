//! The Fibonacci lattice: directions spread evenly over the sphere.

use glam::DVec3;

/// Direction `i` of `count`, each standing for 4π/count steradians.
pub fn fibonacci(i: usize, count: usize) -> DVec3 {
    let golden_angle = std::f64::consts::PI * (3.0 - 5.0f64.sqrt());
    let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
    let radius = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = (golden_angle * i as f64).rem_euclid(std::f64::consts::TAU).sin_cos();
    DVec3::new(radius * cos, radius * sin, z)
}
