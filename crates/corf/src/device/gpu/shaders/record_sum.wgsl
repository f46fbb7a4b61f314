// A Gaussian's records of one image, summed, by the names that they have in `cpu/blend.rs`; and whether it is seen there, 1 or 0.
struct RecordSum {
    color: vec3<f32>,      // dL/dcolour
    inverse_z: f32,        // dL/d(1/z)
    moments: vec3<f32>,    // Σ dL/dσ (dx², dx dy, dy²), d = mean − pixel
    opacity: f32,          // dL/d(oρ)
    first: vec2<f32>,      // Σ dL/dσ (dx, dy)
    seen: f32,
}
// Of this, what the ellipse is stepped by: two words of four.
struct EllipseSum { moments: vec3<f32>, opacity: f32, first: vec2<f32>, inverse_z: f32, seen: f32 }

fn ellipse_sum(r: RecordSum) -> EllipseSum { return EllipseSum(r.moments, r.opacity, r.first, r.inverse_z, r.seen); }
