// Both modalities of one grid: one list, one exp(−σ) a pixel and splat; their own opacity, colour, transmittance and end.
var<workgroup> batch_rf: array<vec4<f32>, BATCH>;   // r, g, b, o·ρ of the RF field

fn load_both(slot: u32, owner: u32, corner: vec2<u32>) {
    load(slot, splats[owner], corner);
    let rf = splats[params.gaussians + owner];
    batch_rf[slot] = vec4(rf.color.rgb, rf.place.z);
}
