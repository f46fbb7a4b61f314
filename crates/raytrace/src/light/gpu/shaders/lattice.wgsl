// cache/field.rs: light kept at the points of lattices. A slot says what is of a tile: 0 nothing, 1 it is wanted, else 2 more
// than the place of its head in the pages. A head has the bits of the tile's rough cells, and is followed by its points, three
// words of four each: what is received along x, y, z per colour channel; the first of them ends with the point's weight.

const TILE_CELLS = 8u;
const LEAST_SHARE = 1e-4;
const MISSING = 0u;
const FILLED = 2u;
// Direct lattices are read from this level on unless the footprint asks for a coarser one.
const DIRECT_START = 2u;

struct Received {
    x: vec3<f32>,
    y: vec3<f32>,
    z: vec3<f32>,
}

struct Point {
    received: Received,
    weight: f32,
}

// Place of a surface on the charts: the front is side 0.
struct Spot {
    chart: u32,
    side: u32,
    coordinates: vec2<f32>,
}

// The four lattice points around a spot.
struct Corners {
    slot: u32,
    cell: vec2<u32>,
    numbers: vec4<u32>,
    shares: vec4<f32>,
}

// What a lattice says of a spot. `found` is false where its tile is not there.
struct Reading {
    received: Received,
    rough: bool,
    found: bool,
}

// Four points of a tile, weighted: their sum, the sum of the weights, and the bits of the tile's rough cells.
struct Blend {
    sum: Received,
    total: f32,
    bits: vec2<u32>,
}

fn none_received() -> Received {
    return Received(vec3(0.0), vec3(0.0), vec3(0.0));
}

// Light of a colour (radiance × solid angle ÷ π) out of a direction.
fn received_from(direction: vec3<f32>, c: vec3<f32>) -> Received {
    return Received(c * direction.x, c * direction.y, c * direction.z);
}

fn with_scaled(sum: Received, other: Received, share: f32) -> Received {
    return Received(sum.x + other.x * share, sum.y + other.y * share, sum.z + other.z * share);
}

fn received_at(received: Received, n: vec3<f32>) -> vec3<f32> {
    return max(received.x * n.x + received.y * n.y + received.z * n.z, vec3(0.0));
}

fn spot_of(surface: Surface, triangle: u32) -> Spot {
    let index = attributes[triangle].chart;
    let p = surface.position - charts[index].origin;
    let side = u32(dot(surface.geometric_normal, charts[index].normal) < 0.0);
    return Spot(index, side, vec2(dot(p, charts[index].x_axis), dot(p, charts[index].y_axis)));
}

fn corners_of(field: u32, spot: Spot) -> Corners {
    let lattice = lattices[field * params.charts + spot.chart];
    let cells = lattice.yz;
    let at_least = max(cells, vec2(1u));
    let pitch = charts[spot.chart].size / vec2<f32>(at_least);
    let at = max(spot.coordinates / max(pitch, vec2(1e-9)), vec2(0.0));
    let cell = min(vec2<u32>(at), at_least - vec2(1u));
    // Where there are no cells, the one point stands for all.
    let inside = select(min(at - vec2<f32>(cell), vec2(1.0)), vec2(0.0), cells == vec2(0u));
    let tiles = (at_least + vec2(TILE_CELLS - 1u)) / TILE_CELLS;
    let tile = cell / TILE_CELLS;
    let first = tile * TILE_CELLS;
    let points = min(cells - min(first, cells), vec2(TILE_CELLS)) + vec2(1u);
    let here = cell - first;
    let next = min(here + vec2(1u), points - vec2(1u));
    return Corners(
        lattice.x + spot.side * tiles.x * tiles.y + tile.x + tile.y * tiles.x,
        here,
        vec4(here.x, next.x, here.x, next.x) + vec4(here.y, here.y, next.y, next.y) * points.x,
        vec4((1.0 - inside.x) * (1.0 - inside.y), inside.x * (1.0 - inside.y), (1.0 - inside.x) * inside.y, inside.x * inside.y)
            + vec4(LEAST_SHARE),
    );
}

fn point_at(head: u32, number: u32) -> Point {
    let at = head + 1u + 3u * number;
    let x = bitcast<vec4<f32>>(word(at));
    let y = bitcast<vec4<f32>>(word(at + 1u));
    let z = bitcast<vec4<f32>>(word(at + 2u));
    return Point(Received(x.xyz, y.xyz, z.xyz), x.w);
}

fn read_field(field: u32, spot: Spot) -> Reading {
    let corners = corners_of(field, spot);
    let state = slot_state(corners.slot);
    if (state < FILLED) { return Reading(none_received(), false, false); }
    let blend = blended(state - FILLED, corners.numbers, corners.shares);
    let cell = corners.cell.x + corners.cell.y * TILE_CELLS;
    let rough = ((select(blend.bits.x, blend.bits.y, cell >= 32u) >> (cell & 31u)) & 1u) == 1u;
    if (blend.total > 0.0) { return Reading(with_scaled(none_received(), blend.sum, 1.0 / blend.total), rough, true); }
    return Reading(blend.sum, rough, true);
}

// All light of the coarse lattice, which is full.
fn read_coarse(spot: Spot) -> Received {
    return read_field(0u, spot).received;
}
