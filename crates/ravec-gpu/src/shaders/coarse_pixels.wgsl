// The pixels of the level that a kernel reads. Those of the image, FROM_IMAGE, have their mean color still.

@group(0) @binding(1) var<storage, read> plane: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> found: array<f32>;

// what is taken off each pixel, one after the other
var<private> steps: array<vec3<f32>, 2>;

// Selects a block.
fn begin_block(number: u32) {
    block = number;
    if (FROM_IMAGE) {
        for (var k = 0u; k < 6u; k++) {
            steps[k / 3u][k % 3u] = found[(STEPS + k) * params.blocks + block];
        }
    }
}

// Pixel `i` of the block: color times weight without the mean, and the weight.
fn level_pixel(i: u32) -> vec4<f32> {
    let raw = plane[i * params.blocks + block];
    if (FROM_IMAGE) {
        return vec4(raw.xyz - scaled(steps[0], raw.w) - scaled(steps[1], raw.w), raw.w);
    }
    return raw;
}
