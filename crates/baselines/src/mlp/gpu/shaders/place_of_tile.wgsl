    let column_tiles = (shape.columns + COLUMNS - 1u) / COLUMNS;
    let tiles = (shape.rows + ROWS - 1u) / ROWS * column_tiles;
    let number = id.y * 32768u + id.x;
    let part = number / tiles;
    let row = ROWS * (number % tiles / column_tiles);
    let column = COLUMNS * (number % tiles % column_tiles);
    let first = part * shape.part;
    let end = min(first + shape.part, shape.inner);
    // Rows of workgroups are filled up.
    if (first >= end) { return; }
