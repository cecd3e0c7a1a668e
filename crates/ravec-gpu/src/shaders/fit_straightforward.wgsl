// The exact fit as a straightforward port of the loop of the CPU, one block a thread: the thread reads its block from the
// picture as it lies there, and keeps the pixels in private memory beside the prefixes. For comparison with `fit.wgsl`.

var<private> block: u32;
var<private> pixels: array<vec4<f32>, PIXELS>;

fn raw_pixel(i: u32) -> vec4<f32> {
    return pixels[i];
}

fn inside(i: u32) -> f32 {
    return 1.0;
}

@compute @workgroup_size(GROUP)
fn fit_straightforward(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    block = id.y * groups.x * GROUP + id.x;
    if (block >= params.count) {
        return;
    }
    let corner = vec2(block % params.columns_of_blocks, block / params.columns_of_blocks) * SIDE;
    var opaque = corner.x + SIDE <= params.width && corner.y + SIDE <= params.rows;
    for (var i = 0u; i < params.pixels && opaque; i++) {
        let at = corner + vec2(i % SIDE, i / SIDE);
        pixels[i] = weighted_oklab(source_pixel(at.y * params.width + at.x));
        opaque = pixels[i].w == 1.0;
    }
    if (opaque) {
        store(WORDS * block, best_split());
    } else {
        results[WORDS * block] = NOT_FITTED;
    }
}
