// 64-bit integers as vec2(low, high): they are optional in WGSL, and the processor's random numbers are made of them.

fn product32(a: u32, b: u32) -> vec2<u32> {
    let a0 = a & 0xffffu;
    let a1 = a >> 16u;
    let b0 = b & 0xffffu;
    let b1 = b >> 16u;
    let low = a0 * b0;
    let left = a1 * b0;
    let right = a0 * b1;
    let middle = (low >> 16u) + (left & 0xffffu) + (right & 0xffffu);
    return vec2((low & 0xffffu) | (middle << 16u), a1 * b1 + (left >> 16u) + (right >> 16u) + (middle >> 16u));
}

fn product64(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let low = product32(a.x, b.x);
    return vec2(low.x, low.y + a.x * b.y + a.y * b.x);
}

fn sum64(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let low = a.x + b.x;
    return vec2(low, a.y + b.y + u32(low < a.x));
}

// By 1 to 31 bits.
fn shifted64(a: vec2<u32>, bits: u32) -> vec2<u32> {
    return vec2((a.x >> bits) | (a.y << (32u - bits)), a.y >> bits);
}

// SplitMix64's finaliser.
fn mix64(value: vec2<u32>) -> vec2<u32> {
    var z = value;
    z = product64(z ^ shifted64(z, 30u), vec2(0x1ce4e5b9u, 0xbf58476du));
    z = product64(z ^ shifted64(z, 27u), vec2(0x133111ebu, 0x94d049bbu));
    return z ^ shifted64(z, 31u);
}
