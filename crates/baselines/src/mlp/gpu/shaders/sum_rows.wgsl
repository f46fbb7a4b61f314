    // The sums of dZ, by those that are first in their row of tiles: one thread a block of the panel, then one a vector of columns.
    if (column == 0u) {
        if (t < A_BLOCKS) { row_sums[a_inner(t) * (ROWS / 4u) + a_outer(t)] = sums; }
        workgroupBarrier();
        if (t < ROWS / 4u && row + 4u * t < shape.rows) {
            var sum = row_sums[t];
            for (var i = 1u; i < INNER / 4u; i++) { sum += row_sums[i * (ROWS / 4u) + t]; }
            c[part * shape.c_part + shape.rows * shape.c_stride + row / 4u + t] = sum;
        }
    }
