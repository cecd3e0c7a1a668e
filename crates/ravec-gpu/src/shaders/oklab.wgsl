// The plane that fits read: for each pixel Oklab times the weight, and the weight; or, for refinements, linear light and the
// weight.
//
// For blocks of more than one pixel, the first pixels of all blocks come first, then the second ones, and so on, so that
// neighboring threads, one a block, read neighboring pixels. Pixels of clipped blocks beyond the border stay 0.

struct Params {
    // 0: see `rounded`
    zero: u32,
    count: u32,
    width: u32,
    // 1: rows of pixels
    side: u32,
    columns_of_blocks: u32,
    blocks: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(3) var<storage, read_write> plane: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn fill_plane(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = id.y * groups.x * GROUP + id.x;
    if (index >= params.count) {
        return;
    }
    let at = vec2(index % params.width, index / params.width);
    let block = at / params.side;
    let within = at % params.side;
    let pixel = within.y * params.side + within.x;
    let to = pixel * params.blocks + block.y * params.columns_of_blocks + block.x;
    let light_here = source_pixel(index);
    if (LINEAR_PLANE) {
        plane[to] = vec4(light_here.xyz, clamp(light_here.w, 0.0, 1.0));
    } else {
        plane[to] = weighted_oklab(light_here);
    }
}
