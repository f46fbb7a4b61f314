const ARGS_APPEARANCE = 0u;
const ARGS_GEOMETRY = 1u;
const ARGS_PAIRS = 2u;
const ARGS_BUCKETS = 3u;
const ARGS_SHARES = 4u;
const ARGS_ORDER = 5u;
const ARGS_MERGE = 6u;

// Workgroups in rows of 32768; never none, so that what runs once per dispatch runs.
fn folded(groups: u32) -> vec4<u32> {
    let n = max(groups, 1u);
    return vec4(min(n, 32768u), (n + 32767u) / 32768u, 1u, 0u);
}
