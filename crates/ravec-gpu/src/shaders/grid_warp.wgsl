// A picture in its new shape, one pixel a thread: the method of ravec_retarget's `warp.rs`.
//
// Places are relative to the corner of their cell, so that they are as exact far from the corner of the picture as near it.

struct Params {
    width: u32,
    count: u32,
    source_width: u32,
    source_height: u32,
    // the rows of the source that were uploaded begin here
    source_first_row: u32,
}

struct Span {
    first: u32,
    cell: u32,
    // of the first pixel, from the corner of its cell
    corner: vec2<f32>,
    width: vec2<f32>,
    step: vec2<f32>,
}

struct Cell {
    e: vec2<f32>,
    f: vec2<f32>,
    g: vec2<f32>,
    // the corner in the source: whole pixels, and the rest
    first: vec2<i32>,
    rest: vec2<f32>,
    extent: vec2<f32>,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(3) var<storage, read> spans: array<Span>;
@group(0) @binding(4) var<storage, read> row_starts: array<u32>;
@group(0) @binding(5) var<storage, read> cells: array<Cell>;
@group(0) @binding(6) var<storage, read_write> results: array<vec4<f32>>;

const REACH: f32 = 2.0;

// The span of the row that holds a column.
fn span_at(row: u32, col: u32) -> Span {
    var low = row_starts[row];
    var high = row_starts[row + 1u];
    while (high - low > 1u) {
        let middle = (low + high) / 2u;
        if (spans[middle].first <= col) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return spans[low];
}

fn premultiplied(at: vec2<i32>) -> vec4<f32> {
    let col = u32(clamp(at.x, 0, i32(params.source_width) - 1));
    let row = u32(clamp(at.y, 0, i32(params.source_height) - 1)) - params.source_first_row;
    let pixel = source_pixel(row * params.source_width + col);
    return vec4(pixel.xyz * pixel.w, pixel.w);
}

// Twice the interpolating cubic of Catmull and Rom.
fn catmull_rom(x: f32) -> f32 {
    let outer = max(2.0 - abs(x), 0.0);
    let left = outer - 1.0;
    let inner = max(left, 0.0);
    return outer * outer * left + inner * inner * (2.0 - 4.0 * inner);
}

fn crossed(a: vec2<f32>, b: vec2<f32>) -> f32 {
    return a.x * b.y - a.y * b.x;
}

@compute @workgroup_size(GROUP)
fn grid_warp(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = id.y * groups.x * GROUP + id.x;
    if (index >= params.count) {
        return;
    }
    let col = index % params.width;
    let span = span_at(index / params.width, col);
    let cell = cells[span.cell];
    let k = f32(col) - f32(span.first);

    // the place in the cell
    let h = span.corner + vec2(k, 0.0);
    let k2 = crossed(cell.g, cell.f);
    let k0 = crossed(h, cell.e);
    let k1 = crossed(h, cell.g) + crossed(cell.e, cell.f);
    let root = sqrt(max(k1 * k1 - 4.0 * k0 * k2, 0.0));
    let v = -2.0 * k0 / (k1 + root);
    let u = (h.x - v * cell.f.x) / (v * cell.g.x + cell.e.x);
    let at = cell.rest + clamp(vec2(u, v), vec2(0.0), vec2(1.0)) * cell.extent;

    // the old pixels that are seen, and their weights
    let reach = REACH * (span.width + span.step * k);
    let first = floor(at - reach + 0.5);
    let step = REACH / reach;
    let start = (first + 0.5 - at) * step;
    let taps = vec2<i32>(ceil((2.0 - start) / step));
    let corner = cell.first + vec2<i32>(first);
    var sum = vec4(0.0);
    var weights = vec2(0.0);
    for (var y = 0; y < taps.y; y++) {
        let weight_y = catmull_rom(f32(y) * step.y + start.y);
        var line = vec4(0.0);
        weights.x = 0.0;
        for (var x = 0; x < taps.x; x++) {
            let weight_x = catmull_rom(f32(x) * step.x + start.x);
            line += premultiplied(corner + vec2(x, y)) * weight_x;
            weights.x += weight_x;
        }
        sum += line * weight_y;
        weights.y += weight_y;
    }
    let light = sum / (weights.x * weights.y);
    let scale = select(0.0, 1.0 / light.w, light.w > 0.0);
    if (HAS_ALPHA) {
        results[index] = vec4(light.xyz * scale, clamp(light.w, 0.0, 1.0));
    } else {
        results[index] = vec4(light.xyz, 1.0);
    }
}
