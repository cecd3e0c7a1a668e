// Running sums of each block along its rows and along its columns, a row or column a thread.

@group(0) @binding(1) var<storage, read> plane: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> found: array<f32>;
// For each block its rows, then its columns, of side + 1 sums each.
@group(0) @binding(3) var<storage, read_write> prefixes: array<vec4<f32>>;

fn step_of(round: u32) -> vec3<f32> {
    let at = (STEPS + 3u * round) * params.blocks + block;
    return vec3(found[at], found[at + params.blocks], found[at + 2u * params.blocks]);
}

@compute @workgroup_size(GROUP)
fn add_prefixes(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = id.y * groups.x * GROUP + id.x;
    if (index >= 2u * params.side * params.blocks) {
        return;
    }
    block = index % params.blocks;
    let line = index / params.blocks;
    let along_row = line < params.side;
    let number = line % params.side;
    let first = select(number, number * params.side, along_row);
    let next = select(params.side, 1u, along_row);
    let steps = array(step_of(0u), step_of(1u));
    let to = (block * 2u * params.side + line) * (params.side + 1u);
    var sum = vec4(0.0);
    prefixes[to] = sum;
    for (var k = 0u; k < params.side; k++) {
        var pixel = plane[(first + k * next) * params.blocks + block];
        if (FROM_IMAGE) {
            pixel = vec4(pixel.xyz - scaled(steps[0], pixel.w) - scaled(steps[1], pixel.w), pixel.w);
        }
        sum += pixel;
        prefixes[to + k + 1u] = sum;
    }
}
