// A level of half the side from the next finer one, a pixel a thread. The finest one, FROM_IMAGE, has its mean color still.

@group(0) @binding(1) var<storage, read> finer: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> found: array<f32>;
@group(0) @binding(3) var<storage, read_write> reduced: array<vec4<f32>>;

fn step_of(round: u32) -> vec3<f32> {
    let at = (STEPS + 3u * round) * params.blocks + block;
    return vec3(found[at], found[at + params.blocks], found[at + 2u * params.blocks]);
}

fn finer_pixel(col: u32, row: u32) -> vec4<f32> {
    let raw = finer[(row * 2u * params.side + col) * params.blocks + block];
    if (FROM_IMAGE) {
        return vec4(raw.xyz - scaled(step_of(0u), raw.w) - scaled(step_of(1u), raw.w), raw.w);
    }
    return raw;
}

@compute @workgroup_size(GROUP)
fn reduce(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = id.y * groups.x * GROUP + id.x;
    if (index >= params.blocks * params.pixels) {
        return;
    }
    block = index % params.blocks;
    let i = index / params.blocks;
    let col = 2u * (i % params.side);
    let row = 2u * (i / params.side);
    let left = finer_pixel(col, row) * 0.5 + finer_pixel(col, row + 1u) * 0.5;
    let right = finer_pixel(col + 1u, row) * 0.5 + finer_pixel(col + 1u, row + 1u) * 0.5;
    reduced[index] = left * 0.5 + right * 0.5;
}
