// What `blended` says, in one page. All of it is asked for before any of it is needed, so that the waits for memory coincide.
fn blend_PAGE(head: u32, numbers: vec4<u32>, shares: vec4<f32>) -> Blend {
    let at = vec4(head + 1u) + 3u * numbers;
    let bits = PAGE[head].xy;
    let x0 = bitcast<vec4<f32>>(PAGE[at.x]);
    let y0 = bitcast<vec4<f32>>(PAGE[at.x + 1u]);
    let z0 = bitcast<vec4<f32>>(PAGE[at.x + 2u]);
    let x1 = bitcast<vec4<f32>>(PAGE[at.y]);
    let y1 = bitcast<vec4<f32>>(PAGE[at.y + 1u]);
    let z1 = bitcast<vec4<f32>>(PAGE[at.y + 2u]);
    let x2 = bitcast<vec4<f32>>(PAGE[at.z]);
    let y2 = bitcast<vec4<f32>>(PAGE[at.z + 1u]);
    let z2 = bitcast<vec4<f32>>(PAGE[at.z + 2u]);
    let x3 = bitcast<vec4<f32>>(PAGE[at.w]);
    let y3 = bitcast<vec4<f32>>(PAGE[at.w + 1u]);
    let z3 = bitcast<vec4<f32>>(PAGE[at.w + 2u]);
    let w = shares * vec4(x0.w, x1.w, x2.w, x3.w);
    let x = x0.xyz * w.x + x1.xyz * w.y + x2.xyz * w.z + x3.xyz * w.w;
    let y = y0.xyz * w.x + y1.xyz * w.y + y2.xyz * w.z + y3.xyz * w.w;
    let z = z0.xyz * w.x + z1.xyz * w.y + z2.xyz * w.z + z3.xyz * w.w;
    return Blend(Received(x, y, z), w.x + w.y + w.z + w.w, bits);
}
