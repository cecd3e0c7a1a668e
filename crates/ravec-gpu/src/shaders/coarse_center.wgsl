// Sums over each block, by one thread.

// Oklab times weight, and weight: the first pixels of all blocks, then the second ones, and so on.
@group(0) @binding(1) var<storage, read> plane: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> found: array<f32>;

fn raw_pixel(i: u32) -> vec4<f32> {
    return plane[i * params.blocks + block];
}

fn put(word: u32, value: f32) {
    found[word * params.blocks + block] = value;
}

@compute @workgroup_size(GROUP)
fn center_blocks(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    block = id.y * groups.x * GROUP + id.x;
    if (block >= params.blocks) {
        return;
    }
    let totals = center_weighted();
    // beyond the border of the image there is no weight
    var is_opaque = 1.0;
    for (var i = 0u; i < params.pixels; i++) {
        is_opaque = min(is_opaque, select(0.0, 1.0, raw_pixel(i).w == 1.0));
    }
    for (var round = 0u; round < 2u; round++) {
        for (var channel = 0u; channel < 3u; channel++) {
            put(STEPS + 3u * round + channel, steps[round][channel]);
        }
    }
    put(WEIGHT, totals.weight);
    put(INSIDE, totals.inside);
    put(MEAN_ALPHA, totals.mean_alpha);
    put(ENERGY, totals.energy);
    put(IS_OPAQUE, is_opaque);
}
