// Least-significant-digit radix sort, 8 bits a pass, stable: counts per (digit, block), their sums along each digit's row, scatter.
// The number of keys lies in device memory.
struct SortPass {
    shift: u32,
    // Where the number of keys is found.
    count_slot: u32,
    // Blocks a row of the histogram has room for.
    stride: u32,
    // 1: values are the keys' places. 2: keys of all ones are left out.
    flags: u32,
}
const DIGITS = 256u;
const IMPLICIT_VALUES = 1u;
const SKIP_SENTINELS = 2u;
const SENTINEL = 0xffffffffu;
