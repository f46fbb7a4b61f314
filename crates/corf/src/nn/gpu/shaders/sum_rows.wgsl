    // The sums of dZ, by those that are first in their row of tiles: one thread a block of the panel, then one a vector of columns.
    if (column == 0u) {
        workgroupBarrier();
        if (t < A_BLOCKS) { a_panel[a_inner(t) * a_STRIDE + a_outer(t)] = sums; }
        workgroupBarrier();
        if (t < ROWS / 4u && row + 4u * t < shape.rows) {
            var sum = a_panel[t];
            for (var i = 1u; i < INNER / 4u; i++) { sum += a_panel[i * a_STRIDE + t]; }
            c[part * shape.c_part + shape.rows * shape.c_stride + row / 4u + t] = sum;
        }
    }
