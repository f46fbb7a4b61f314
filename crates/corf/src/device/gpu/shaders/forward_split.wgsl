// As the blend with a thread a pixel, but SEGMENTS threads share a pixel: each takes a bucket of a batch as if nothing stood before it,
// and what they find is put one behind the other. A long list takes a fraction of the time; for small images, whose tiles are few.
const BATCH = SEGMENTS * BUCKET;
const SPLIT_THREADS = SEGMENTS * AREA;
var<workgroup> batch_place: array<vec4<f32>, BATCH>;
var<workgroup> batch_power: array<vec3<f32>, BATCH>;
var<workgroup> batch_color: array<vec3<f32>, BATCH>;
var<workgroup> batch_radio: array<vec4<f32>, RADIO_BATCH>;
// What each bucket does to a pixel.
var<workgroup> parts: array<f32, (HEAD_NUMBERS + TAIL_NUMBERS + 1u) * SPLIT_THREADS>;
var<workgroup> open: atomic<u32>;
var<workgroup> any_open: u32;

fn show(p: Pixel, thread: u32) {
    parts[thread] = p.t.x;
    parts[SPLIT_THREADS + thread] = p.light.x;
    parts[2u * SPLIT_THREADS + thread] = p.light.y;
    parts[3u * SPLIT_THREADS + thread] = p.light.z;
    parts[4u * SPLIT_THREADS + thread] = p.light.w;
    if (BOTH) {
        parts[5u * SPLIT_THREADS + thread] = p.t.y;
        parts[6u * SPLIT_THREADS + thread] = p.radio.x;
        parts[7u * SPLIT_THREADS + thread] = p.radio.y;
        parts[8u * SPLIT_THREADS + thread] = p.radio.z;
        parts[9u * SPLIT_THREADS + thread] = p.radio.w;
    }
}

fn part(thread: u32) -> Pixel {
    var p: Pixel;
    p.t.x = parts[thread];
    p.light = vec4(
        parts[SPLIT_THREADS + thread],
        parts[2u * SPLIT_THREADS + thread],
        parts[3u * SPLIT_THREADS + thread],
        parts[4u * SPLIT_THREADS + thread],
    );
    if (BOTH) {
        p.t.y = parts[5u * SPLIT_THREADS + thread];
        p.radio = vec4(
            parts[6u * SPLIT_THREADS + thread],
            parts[7u * SPLIT_THREADS + thread],
            parts[8u * SPLIT_THREADS + thread],
            parts[9u * SPLIT_THREADS + thread],
        );
    }
    return p;
}

// A pixel behind a bucket that by itself does `part`. Where it had ended nothing is added.
fn behind(p: Pixel, part: Pixel) -> Pixel {
    let is_open = p.t >= vec2(MIN_TRANSMITTANCE);
    let light = fma(vec4(p.t.x), part.light, p.light);
    let radio = fma(vec4(p.t.y), part.radio, p.radio);
    return Pixel(
        select(p.t, p.t * part.t, is_open),
        select(p.light, light, is_open.x),
        select(p.radio, radio, is_open.y),
    );
}

fn draw(p: ptr<function, Pixel>, first: u32, count: u32, centre: vec2<f32>) {
    for (var k = 0u; k < count; k += 8u) {
        let slot = first + k;
        let a = falloffs(slot, centre);
        let b = falloffs(slot + 4u, centre);
        add_four(p, slot, a);
        add_four(p, slot + 4u, b);
    }
}

fn add_four(p: ptr<function, Pixel>, slot: u32, f: vec4<f32>) {
    _ = add(p, slot, f.x);
    _ = add(p, slot + 1u, f.y);
    _ = add(p, slot + 2u, f.z);
    _ = add(p, slot + 3u, f.w);
}

@compute @workgroup_size(SPLIT_THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let index = group_number(id);
    if (index >= params.tile_total) { return; }
    let pixel = thread % AREA;
    let segment = thread / AREA;
    let tile = tile_of(index, pixel);
    let centre = vec2<f32>(tile.pixel - tile.corner) + 0.5;
    let list = lists[index];
    // The pixel before the batch: the same in all its threads.
    var p = Pixel(vec2(select(0.0, 1.0, tile.inside)), vec4(0.0), vec4(0.0));
    if (!BOTH) { p.t.y = 0.0; }
    // The next batch is fetched while one is drawn.
    var next = nothing();
    if (thread < min(list.count, BATCH)) { next = drawn(entries[list.first + thread].x, tile.corner); }
    var begin = 0u;
    for (; begin < list.count; begin += BATCH) {
        if (thread == 0u) { atomicStore(&open, 0u); }
        workgroupBarrier();
        if (max(p.t.x, p.t.y) >= MIN_TRANSMITTANCE) { atomicStore(&open, 1u); }
        if (thread < BATCH) {
            batch_place[thread] = next.place;
            batch_power[thread] = next.power;
            batch_color[thread] = next.color;
            if (BOTH) { batch_radio[thread] = next.radio; }
        }
        workgroupBarrier();
        if (thread == 0u) { any_open = atomicLoad(&open); }
        if (workgroupUniformLoad(&any_open) == 0u) { break; }
        next = nothing();
        if (thread < BATCH && begin + BATCH + thread < list.count) {
            next = drawn(entries[list.first + begin + BATCH + thread].x, tile.corner);
        }
        let first = segment * BUCKET;
        let left = list.count - begin;
        let count = min(max(left, first) - first, BUCKET);
        var own = Pixel(vec2(1.0), vec4(0.0), vec4(0.0));
        draw(&own, first, count, centre);
        show(own, thread);
        workgroupBarrier();
        var before = p;
        for (var s = 0u; s < segment; s++) { before = behind(before, part(s * AREA + pixel)); }
        if (KEEP && count > 0u && begin + first > 0u) { save(before, list.checkpoint + (begin + first) / BUCKET - 1u, pixel); }
        // A pixel that ends within this bucket takes nothing of what follows there: it is drawn again, from what it is.
        let after = behind(before, own);
        let ends = (before.t >= vec2(MIN_TRANSMITTANCE)) & (after.t < vec2(MIN_TRANSMITTANCE));
        workgroupBarrier();
        if (any(ends)) {
            var exact = before;
            draw(&exact, first, count, centre);
            let scale = 1.0 / max(before.t, vec2(MIN_TRANSMITTANCE));
            show(Pixel(exact.t * scale, (exact.light - before.light) * scale.x, (exact.radio - before.radio) * scale.y), thread);
        }
        workgroupBarrier();
        for (var s = 0u; s < SEGMENTS; s++) { p = behind(p, part(s * AREA + pixel)); }
    }
    if (KEEP && thread == 0u) { visited[index] = min(begin, list.count); }
    if (tile.inside && segment == 0u) { finish(tile, p); }
}
