// cache/mod.rs: light that a surface receives, at the fineness that a ray's footprint asks for. A tile that is not there is
// wanted from now on, and the
// path that asked for it counts for nothing.

fn slot_state(slot: u32) -> u32 {
    return atomicLoad(&slots[slot]);
}

fn want(slot: u32) {
    lacking = true;
    if (atomicMax(&slots[slot], 1u) == MISSING) {
        atomicStore(&work[WANTED_AT + atomicAdd(&work[WANTED], 1u)], slot);
    }
}

fn read_level(spot: Spot, first_field: u32, fields: u32, start: u32, footprint_m: f32) -> Received {
    var wanted = 0u;
    while (wanted + 1u < fields && params.spacing_m[first_field + wanted].x > footprint_m) { wanted += 1u; }
    var k = min(wanted, start);
    loop {
        let reading = read_field(first_field + k, spot);
        if (!reading.found) {
            want(corners_of(first_field + k, spot).slot);
            return reading.received;
        }
        if (!reading.rough || k >= wanted) { return reading.received; }
        k += 1u;
    }
    return none_received();
}

struct Answer {
    received: Received,
    // Whether lights without extent are in it.
    has_punctual: bool,
}

fn received_on(surface: Surface, triangle: u32, footprint_m: f32) -> Answer {
    let spot = spot_of(surface, triangle);
    if (footprint_m > params.spacing_m[0].x) { return Answer(read_coarse(spot), true); }
    let direct = read_level(spot, 1u, params.direct_fields, DIRECT_START, footprint_m);
    let indirect = read_level(spot, 1u + params.direct_fields, params.indirect_fields, 0u, footprint_m);
    return Answer(with_scaled(direct, indirect, 1.0), false);
}
