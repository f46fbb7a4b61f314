// corf_scene::Rng, draw for draw.

const GOLDEN = vec2(0x7f4a7c15u, 0x9e3779b9u);

// The state of the stream of a seed, a stage and an item.
fn rng_keyed(seed: vec2<u32>, stage: vec2<u32>, item: vec2<u32>) -> vec2<u32> {
    let staged = sum64(mix64(seed ^ GOLDEN), product64(stage, vec2(0xde82ef95u, 0xd1342543u)));
    return mix64(sum64(mix64(staged), item));
}

fn rng_next(state: ptr<function, vec2<u32>>) -> vec2<u32> {
    *state = sum64(*state, GOLDEN);
    return mix64(*state);
}

// The state after so many draws.
fn rng_ahead(state: vec2<u32>, draws: u32) -> vec2<u32> {
    return sum64(state, product64(GOLDEN, vec2(draws, 0u)));
}

fn rng_uniform(state: ptr<function, vec2<u32>>) -> f32 {
    return f32(rng_next(state).y >> 8u) * (1.0 / 16777216.0);
}

// In [0, n).
fn rng_below(state: ptr<function, vec2<u32>>, n: u32) -> u32 {
    let bits = rng_next(state);
    return sum64(product32(bits.y, n), vec2(product32(bits.x, n).y, 0u)).y;
}
