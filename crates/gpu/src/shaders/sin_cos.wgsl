// π/2 in three parts, each with trailing zeros so that their products with a count of quarter turns are exact.
const QUARTER_A = 1.5703125;
const QUARTER_B = 0.000483751296997070312;
const QUARTER_C = 7.54978995489188e-8;

// (sin x, cos x), right to a few units in the last place for |x| up to some thousands: the built-in functions need not be, nor agree between adapters.
fn sin_cos(x: f32) -> vec2<f32> {
    let turns = round(x * 0.6366197723675814);
    var r = fma(-turns, QUARTER_A, x);
    r = fma(-turns, QUARTER_B, r);
    r = fma(-turns, QUARTER_C, r);
    let q = r * r;
    // Taylor series on |r| ≤ π/4: the first term left out is below 2e-9 and 3e-8.
    let s = r + r * q * (-1.0 / 6.0 + q * (1.0 / 120.0 + q * (-1.0 / 5040.0 + q / 362880.0)));
    let c = 1.0 + q * (-0.5 + q * (1.0 / 24.0 + q * (-1.0 / 720.0 + q / 40320.0)));
    switch i32(turns) & 3 {
        case 0: { return vec2(s, c); }
        case 1: { return vec2(c, -s); }
        case 2: { return vec2(-s, -c); }
        default: { return vec2(-c, s); }
    }
}

