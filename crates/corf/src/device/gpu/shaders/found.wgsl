// What an image says about a Gaussian: dL/dcolour, dL/d(1/z); dL/d(oρ), Σ dL/dσ (dx², dx dy, dy²); Σ dL/dσ (dx, dy), 1 if it is seen.
struct Found { a: vec4<f32>, b: vec4<f32>, c: vec4<f32> }
// Of this, what the ellipse is stepped by.
struct OfEllipse { a: vec4<f32>, b: vec4<f32> }

fn of_ellipse(f: Found) -> OfEllipse { return OfEllipse(vec4(f.a.w, f.c.xyz), f.b); }
fn found_from(e: OfEllipse) -> Found { return Found(vec4(0.0, 0.0, 0.0, e.a.x), e.b, vec4(e.a.yzw, 0.0)); }
