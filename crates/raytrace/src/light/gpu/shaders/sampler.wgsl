// sampler.rs: Owen-scrambled Sobol' pairs with the processor's keys.

struct Draws {
    seed: vec2<u32>,
    index: u32,
}

const STAGE_PIXEL = vec2(0x11617u, 0u);

// The sample points of an item (pixel number, lattice point) of a frame, whose key the host has mixed.
fn draws_of(frame: vec2<u32>, item: vec2<u32>) -> Draws {
    var state = rng_keyed(frame, STAGE_PIXEL, item);
    return Draws(rng_next(&state), 0u);
}

fn scramble(value: u32, seed: u32) -> u32 {
    var x = value + seed;
    x ^= x * 0x3d20adeau;
    x *= (seed >> 16u) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

fn second_dimension(value: u32) -> u32 {
    var v = value;
    v ^= (v >> 1u) & 0x55555555u;
    v ^= (v >> 2u) & 0x33333333u;
    v ^= (v >> 4u) & 0x0f0f0f0fu;
    v ^= (v >> 8u) & 0x00ff00ffu;
    return v ^ (v >> 16u);
}

fn unit(bits: u32) -> f32 {
    return f32(bits >> 8u) * (1.0 / 16777216.0);
}

fn pair(draws: Draws, dimension: u32) -> vec2<f32> {
    let key = mix64(vec2(draws.seed.x, draws.seed.y ^ dimension));
    let shuffled = reverseBits(scramble(reverseBits(draws.index), key.x));
    let x = scramble(shuffled, key.y);
    let y = scramble(second_dimension(shuffled), ((key.x >> 16u) | (key.y << 16u)) ^ 0x9e3779b9u);
    return vec2(unit(reverseBits(x)), unit(reverseBits(y)));
}
