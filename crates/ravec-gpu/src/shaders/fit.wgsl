// The exact fit of the blocks of a band, from its plane.

// Oklab times weight, and weight: the first pixels of all blocks, then the second ones, and so on.
@group(0) @binding(1) var<storage, read> plane: array<vec4<f32>>;
// Blocks with weights, for the second kernel.
@group(0) @binding(8) var<storage, read> chosen: array<u32>;

const WEIGHTED_WORDS: u32 = 13u;

var<private> block: u32;

fn raw_pixel(i: u32) -> vec4<f32> {
    return plane[i * params.blocks + block];
}

// The corner of the block in the band.
fn corner() -> vec2<u32> {
    return vec2(block % params.columns_of_blocks, block / params.columns_of_blocks) * SIDE;
}

fn inside(i: u32) -> f32 {
    let at = corner() + vec2(i % SIDE, i / SIDE);
    return select(0.0, 1.0, at.x < params.width && at.y < params.rows);
}

@compute @workgroup_size(GROUP)
fn fit_opaque(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    block = id.y * groups.x * GROUP + id.x;
    if (block >= params.count) {
        return;
    }
    // beyond the border of the image there is no weight
    var opaque = true;
    for (var i = 0u; i < params.pixels; i++) {
        opaque = opaque && raw_pixel(i).w == 1.0;
    }
    if (opaque) {
        store(WORDS * block, best_split());
    } else {
        results[WORDS * block] = NOT_FITTED;
    }
}

@compute @workgroup_size(GROUP)
fn fit_weighted(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = id.y * groups.x * GROUP + id.x;
    if (index >= params.count) {
        return;
    }
    block = chosen[index];
    let found = best_weighted_split();
    let at = WEIGHTED_WORDS * index;
    store(at, found);
    results[at + 9u] = bitcast<u32>(found.weights.x);
    results[at + 10u] = bitcast<u32>(found.weights.y);
    results[at + 11u] = bitcast<u32>(found.insides.x);
    results[at + 12u] = bitcast<u32>(found.insides.y);
}
