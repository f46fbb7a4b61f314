// The counter of a frame's (Gaussian, tile) pairs. It wraps at 2³²; that it has is kept, and the pairs are then the most that a word holds: more than
// there is room for.
const MOST = 0xffffffffu;

// Takes numbers for so many pairs; returns the first.
fn take_pairs(count: u32) -> u32 {
    let begin = atomicAdd(&state[COUNTED], count);
    if (count > MOST - begin) { atomicStore(&state[WRAPPED], 1u); }
    return begin;
}

// The pairs of all; the counter is left at zero for the next frame.
fn all_pairs() -> u32 {
    let pairs = atomicExchange(&state[COUNTED], 0u);
    return select(pairs, MOST, atomicExchange(&state[WRAPPED], 0u) != 0u);
}
