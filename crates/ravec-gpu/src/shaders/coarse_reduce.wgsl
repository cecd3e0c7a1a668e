// A level of half the side from the next finer one, a pixel a thread.

@group(0) @binding(3) var<storage, read_write> reduced: array<vec4<f32>>;

fn finer_pixel(col: u32, row: u32) -> vec4<f32> {
    return level_pixel(row * 2u * params.side + col);
}

@compute @workgroup_size(GROUP)
fn reduce(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = id.y * groups.x * GROUP + id.x;
    if (index >= params.blocks * params.pixels) {
        return;
    }
    begin_block(index % params.blocks);
    let i = index / params.blocks;
    let col = 2u * (i % params.side);
    let row = 2u * (i / params.side);
    let left = finer_pixel(col, row) * 0.5 + finer_pixel(col, row + 1u) * 0.5;
    let right = finer_pixel(col + 1u, row) * 0.5 + finer_pixel(col + 1u, row + 1u) * 0.5;
    reduced[index] = left * 0.5 + right * 0.5;
}
