// Parameters and results of an exact fit of the blocks of a band of a picture.

struct Params {
    // 0: see `rounded`
    zero: u32,
    width: u32,
    // pixels of the band
    rows: u32,
    columns_of_blocks: u32,
    // blocks of the band
    blocks: u32,
    // blocks that are fitted
    count: u32,
    // of a block, its pixels and its splits
    side: u32,
    pixels: u32,
    events: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
// For each block the number of the best split, or NOT_FITTED, followed by what was found.
@group(0) @binding(7) var<storage, read_write> results: array<u32>;

const NOT_FITTED: u32 = 0xffffffffu;
const WORDS: u32 = 9u;

fn store(at: u32, found: Found) {
    results[at] = found.event;
    results[at + 1u] = bitcast<u32>(found.gain);
    results[at + 2u] = bitcast<u32>(found.energy);
    results[at + 3u] = bitcast<u32>(found.mean.x);
    results[at + 4u] = bitcast<u32>(found.mean.y);
    results[at + 5u] = bitcast<u32>(found.mean.z);
    results[at + 6u] = bitcast<u32>(found.sum_0.x);
    results[at + 7u] = bitcast<u32>(found.sum_0.y);
    results[at + 8u] = bitcast<u32>(found.sum_0.z);
}
