// Which tiles an ellipse reaches. Counting and emitting use this one function on the same stored numbers, and every product that is
// added to something is an explicit fma: compilers are left no freedom by which the two could disagree.

// Farther than this from the image nothing is drawn; keeps conversions to integers exact.
const FAR = 1e6;

struct Reach {
    mean: vec2<f32>,
    determinant: f32,
    q: vec3<f32>,
    tau: f32,
    half_size: vec2<f32>,
    slope: f32,
    inverse_a: f32,
    // Height, relative to the mean, at which the ellipse reaches farthest to the right; to the left it is the opposite.
    rightmost: f32,
    // First and last row of tiles; empty if the last is smaller.
    rows: vec2<i32>,
}

// First and last of `count` tiles with a pixel centre in [low, high]; the centres of tile t span [t·size + ½, (t+1)·size − ½].
fn span(low: f32, high: f32, size: f32, count: u32) -> vec2<i32> {
    let first = i32(ceil((low + 0.5) * (1.0 / size))) - 1;
    let last = i32(floor((high - 0.5) * (1.0 / size)));
    return vec2(max(first, 0), min(last, i32(count) - 1));
}

// The determinant of Q is given: of a thin ellipse it would be lost in the rounding of Q.
fn reach_of(tiles: vec2<u32>, mean: vec2<f32>, q: vec3<f32>, determinant: f32, tau: f32) -> Reach {
    var r: Reach;
    r.rows = vec2(0, -1);
    r.determinant = determinant;
    if (!(tau > 0.0 && r.determinant > 0.0)) { return r; }
    r.mean = mean;
    r.q = q;
    r.tau = tau;
    // S = Q⁻¹: half extents sqrt(2 τ S_xx), sqrt(2 τ S_yy).
    r.half_size = sqrt(2.0 * tau * (vec2(q.z, q.x) / r.determinant));
    // Written so that NaN leaves.
    if (!(abs(mean.x) < FAR && abs(mean.y) < FAR && r.half_size.x < FAR && r.half_size.y < FAR)) { return r; }
    r.inverse_a = 1.0 / q.x;
    r.slope = -q.y * r.inverse_a;
    r.rightmost = -q.y / q.z * r.half_size.x;
    r.rows = span(mean.y - r.half_size.y, mean.y + r.half_size.y, f32(TILE_HEIGHT), tiles.y);
    return r;
}

// First and last tile of a row of tiles.
fn columns_of(r: Reach, tiles: vec2<u32>, row: i32) -> vec2<i32> {
    // The ellipse between the first and the last pixel row of the tiles is convex: it meets a tile if its extent in x does.
    let top = fma(f32(row), f32(TILE_HEIGHT), 0.5) - r.mean.y;
    let low = max(top, -r.half_size.y);
    let high = min(top + (f32(TILE_HEIGHT) - 1.0), r.half_size.y);
    let right_at = min(max(r.rightmost, low), high);
    let left_at = min(max(-r.rightmost, low), high);
    // At height y the border lies at x = −(b/a) y ± sqrt(2τ a − det y²) / a.
    let bound = 2.0 * r.tau * r.q.x;
    let right_root = sqrt(max(fma(-(r.determinant * right_at), right_at, bound), 0.0));
    let left_root = sqrt(max(fma(-(r.determinant * left_at), left_at, bound), 0.0));
    let right = fma(r.slope, right_at, right_root * r.inverse_a);
    let left = fma(r.slope, left_at, -(left_root * r.inverse_a));
    return span(r.mean.x + left, r.mean.x + right, f32(TILE_WIDTH), tiles.x);
}

