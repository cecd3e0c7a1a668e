// Running sums of each block along its rows and along its columns, a row or column a thread.

// For each block its rows, then its columns, of side + 1 sums each.
@group(0) @binding(3) var<storage, read_write> prefixes: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn add_prefixes(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = id.y * groups.x * GROUP + id.x;
    if (index >= 2u * params.side * params.blocks) {
        return;
    }
    begin_block(index % params.blocks);
    let line = index / params.blocks;
    let along_row = line < params.side;
    let number = line % params.side;
    let first = select(number, number * params.side, along_row);
    let next = select(params.side, 1u, along_row);
    let to = (block * 2u * params.side + line) * (params.side + 1u);
    var sum = vec4(0.0);
    prefixes[to] = sum;
    for (var k = 0u; k < params.side; k++) {
        sum += level_pixel(first + k * next);
        prefixes[to + k + 1u] = sum;
    }
}
