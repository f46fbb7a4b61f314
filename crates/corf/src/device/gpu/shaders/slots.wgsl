// Slots of the state shared by all kernels of a frame.
const COUNT = 0u;        // Gaussians held
const VISIBLE = 1u;      // of these, how many reach a tile; none where there is no room
const PAIRS = 2u;        // (Gaussian, tile) pairs; none where there is no room
const FAILED = 3u;       // 1 once a frame had more pairs than the capacity
const NEEDED = 4u;       // most pairs any frame had
const STEPS = 5u;        // steps taken
const LISTED = 6u;       // entries given to tiles
const CHECKPOINTS = 7u;  // checkpoints given to tiles
const BUCKETS = 8u;      // buckets given to tiles
const MOST_VISIBLE = 10u; // most visible Gaussians any frame had
const FINISHED = 9u;     // workgroups that are through, of a kernel whose last one settles what follows
const DRAWABLE = 11u;    // while Gaussians are projected: places given to visible ones
const SHARES = 12u;      // shares of blocks' pairs; none where there is no room
const CHUNKS = 13u;      // chunks of lists that are longer than one
const COUNTED = 14u;     // while Gaussians are projected: pairs
const CUT = 15u;         // while Gaussians are projected: shares
const WRAPPED = 16u;     // while Gaussians are projected: 1 once there were more pairs than a word counts
