//! Multiple importance sampling (Veach and Guibas 1995): how a point is shared between the receiver's directions and the transmitter's rays.

use crate::radio::geometry::face::Face;
use glam::DVec3;

/// cosθ/r² of a point of a face seen from elsewhere, 1/m², with the sign of the side that is seen.
pub fn density(plane: &Face, from: DVec3, point: DVec3) -> f64 {
    let distance2 = from.distance_squared(point);
    plane.distance(from) / (distance2 * distance2.sqrt())
}

/// The transmitter's share of a point that its rays meet `density_ratio` = p_t/p_r times as densely as the receiver's; the receiver's is
/// what is missing to 1. None up to equal densities: most points are the receiver's alone, and need no shadow rays.
pub fn mis_weight(density_ratio: f64) -> f64 {
    let more = (density_ratio - 1.0).max(0.0);
    if more.is_finite() { more * more / (1.0 + more * more) } else { 1.0 }
}
