// A field drawn at any size with exact coverage, one pixel of the rendering a thread: see ravec_twocolor's `render.rs`.
//
// Borders of blocks in the rendering are `block · side · to / from`. They are taken apart in integers into a whole pixel and a
// rest, so that they are as exact far from the corner as near it.

struct Params {
    from_width: u32,
    from_height: u32,
    to_width: u32,
    to_height: u32,
    side: u32,
    columns_of_blocks: u32,
    rows_of_blocks: u32,
    // the first row of blocks that was uploaded, and the first row of pixels that is rendered
    first_block_row: u32,
    first_row: u32,
    count: u32,
}

struct Paint {
    // n.x, n.y, d from the block's center, and 1 for a block with a line
    line: vec4<f32>,
    // premultiplied light
    side_0: vec4<f32>,
    side_1: vec4<f32>,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> paints: array<Paint>;
@group(0) @binding(2) var<storage, read_write> results: array<vec4<f32>>;

// A position `pixel` of the image in the rendering, as seen from the rendering's pixel `at`.
fn border(pixel: u32, at: u32, from_length: u32, to_length: u32) -> f32 {
    let scaled_up = min(pixel, from_length) * to_length;
    let whole = i32(scaled_up / from_length) - i32(at);
    return f32(whole) + f32(scaled_up % from_length) / f32(from_length);
}

@compute @workgroup_size(GROUP)
fn render(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = id.y * groups.x * GROUP + id.x;
    if (index >= params.count) {
        return;
    }
    let x = index % params.to_width;
    let y = params.first_row + index / params.to_width;
    let ratio = vec2(
        f32(params.to_width) / f32(params.from_width),
        f32(params.to_height) / f32(params.from_height),
    );
    let side = params.side;
    // the blocks under the pixel
    let first_col = x * params.from_width / params.to_width / side;
    let last_col = min(((x + 1u) * params.from_width - 1u) / params.to_width / side, params.columns_of_blocks - 1u);
    let first_block = y * params.from_height / params.to_height / side;
    let last_block = min(((y + 1u) * params.from_height - 1u) / params.to_height / side, params.rows_of_blocks - 1u);
    var sum = vec4(0.0);
    for (var row = first_block; row <= last_block; row++) {
        let y0 = border(row * side, y, params.from_height, params.to_height);
        let y1 = border((row + 1u) * side, y, params.from_height, params.to_height);
        let top = max(y0, 0.0);
        let bottom = min(y1, 1.0);
        for (var col = first_col; col <= last_col; col++) {
            let x0 = border(col * side, x, params.from_width, params.to_width);
            let x1 = border((col + 1u) * side, x, params.from_width, params.to_width);
            let left = max(x0, 0.0);
            let right = min(x1, 1.0);
            let extent = max(vec2(right - left, bottom - top), vec2(0.0));
            let paint = paints[(row - params.first_block_row) * params.columns_of_blocks + col];
            var share = 1.0;
            if (paint.line.w != 0.0) {
                // the block's center, which the border of the image does not move
                let center = vec2(x0, y0) + 0.5 * f32(side) * ratio;
                let normal = paint.line.xy / ratio;
                let at = 0.5 * vec2(left + right, top + bottom) - center;
                let stretched = normal * extent;
                share = clamp(share_at(stretched, paint.line.z - dot(normal, at)), 0.0, 1.0);
            }
            let area = extent.x * extent.y;
            sum += area * (share * paint.side_0 + (1.0 - share) * paint.side_1);
        }
    }
    if (sum.w <= 0.0) {
        results[index] = vec4(0.0);
    } else {
        results[index] = vec4(sum.xyz / sum.w, sum.w);
    }
}
