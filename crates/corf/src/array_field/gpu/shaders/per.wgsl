// A share of a total; nothing where there is none that f32 holds.
fn per(part: f32, total: f32) -> f32 {
    const LEAST = 1.1754944e-38;
    if (total < LEAST) { return 0.0; }
    return part / total;
}
