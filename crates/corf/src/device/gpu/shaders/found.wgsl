// What an image says about a Gaussian: dL/dcolour, dL/d(1/z); dL/d(oρ), Σ dL/dσ (dx², dx dy, dy²); Σ dL/dσ (dx, dy), 1 if it is seen.
struct Found { a: vec4<f32>, b: vec4<f32>, c: vec4<f32> }
