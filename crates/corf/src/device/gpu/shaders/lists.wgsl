// The list of a tile: its first entry and how many, its first checkpoint, its first bucket.
struct List { first: u32, count: u32, checkpoint: u32, bucket: u32 }

// Of how many chunks a list is that several workgroups order: not of one, and not of more than an entry is looked up in.
fn chunks_of(count: u32) -> u32 {
    let chunks = (count + CHUNK - 1u) / CHUNK;
    return select(0u, chunks, chunks > 1u && chunks <= MOST_CHUNKS);
}
