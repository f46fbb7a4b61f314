// The list of a tile: its first entry and how many, its first checkpoint, its first bucket.
struct List { first: u32, count: u32, checkpoint: u32, bucket: u32 }
