// What the kernels of the fit coarse to fine share: the levels of the blocks of a band.
//
// Operation for operation that of ravec_twocolor's `coarse_to_fine.rs`: see there for the method. Sides are powers of two, so
// that shares of pixels, their products and sums of counts are exact.

struct Params {
    // 0: see `rounded`
    zero: u32,
    width: u32,
    // pixels of the band
    rows: u32,
    columns_of_blocks: u32,
    // blocks of the band
    blocks: u32,
    // of a block at this level: its side, its pixels and, where it is fitted exactly, its splits
    side: u32,
    pixels: u32,
    events: u32,
    // pixels of the image in a row of a pixel of this level
    factor: u32,
    // 1 / factor², 1 / side
    pixel_share: f32,
    inverse_side: f32,
    is_finest: u32,
}

@group(0) @binding(0) var<uniform> params: Params;

// The blocks as `center_blocks` has found them: word `k` of a block is number `k · blocks + block`.
const STEPS: u32 = 0u;
const WEIGHT: u32 = 6u;
const INSIDE: u32 = 7u;
const MEAN_ALPHA: u32 = 8u;
const ENERGY: u32 = 9u;
const IS_OPAQUE: u32 = 10u;

// Lines that are followed: normal, offset and gain of each.
const STARTS: u32 = 2u;
const LINE_WORDS: u32 = 4u;

var<private> block: u32;

// Pixels of the image in the cell of a pixel of this level, along x and y.
fn cells_inside(col: u32, row: u32) -> vec2<u32> {
    let corner = vec2(block % params.columns_of_blocks, block / params.columns_of_blocks)
        * params.side + vec2(col, row);
    let end = vec2(params.width, params.rows);
    let first = min(corner * params.factor, end);
    return min(end - first, vec2(params.factor));
}

// The part of a pixel of this level that lies inside the image.
fn inside(i: u32) -> f32 {
    let cells = cells_inside(i % params.side, i / params.side);
    return f32(cells.x * cells.y) * params.pixel_share;
}
