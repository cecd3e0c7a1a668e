// A picture seen through a homography, one pixel a thread: the method of ravec_planar's `warp.rs`.
//
// The output is cut into tiles. Each has the map between coordinates that begin near it, in the output and in the image, so
// that numbers stay small and single precision is enough.

struct Tile {
    // rows of the map from the tile's center, to the image from `origin`; scaled, the sign kept
    row_0: vec4<f32>,
    row_1: vec4<f32>,
    row_2: vec4<f32>,
    origin: vec2<i32>,
    padding: vec2<i32>,
}

// The image, and that halved once, twice and so on.
struct Level {
    // index of the first pixel that was uploaded, and its row
    start: u32,
    first_row: u32,
    end_row: u32,
    width: u32,
    height: u32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

struct Params {
    // of the output
    width: u32,
    first_row: u32,
    count: u32,
    // tiles in a row, and the first row of tiles
    tile_columns: u32,
    first_tile_row: u32,
    levels: u32,
    // 1: the border goes on; 0: `empty`
    endless: u32,
    entries: u32,
    empty: vec4<f32>,
}

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> pixels: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> levels: array<Level>;
@group(0) @binding(3) var<storage, read> tiles: array<Tile>;
@group(0) @binding(4) var<storage, read> kernel: array<f32>;
@group(0) @binding(5) var<storage, read_write> results: array<vec4<f32>>;

const MAX_ANISOTROPY: f32 = 24.0;
const MIN_MINOR_PX: f32 = 4.0;
const MAX_MINOR_PX: f32 = 16.0;
const BLEND: f32 = 0.25;

var<private> origin: vec2<i32>;

fn pixel_at(level: Level, at: vec2<i32>) -> vec4<f32> {
    let col = u32(clamp(at.x, 0, i32(level.width) - 1));
    let row = u32(clamp(at.y, i32(level.first_row), i32(level.end_row) - 1));
    return pixels[level.start + (row - level.first_row) * level.width + col];
}

fn cubics(t: f32) -> vec4<f32> {
    let t2 = t * t;
    let t3 = t2 * t;
    return vec4(
        -0.5 * t3 + t2 - 0.5 * t,
        1.5 * t3 - 2.5 * t2 + 1.0,
        -1.5 * t3 + 2.0 * t2 + 0.5 * t,
        0.5 * t3 - 0.5 * t2,
    );
}

// The interpolating cubic at a place relative to the origin of the tile.
fn catmull_rom(at: vec2<f32>) -> vec4<f32> {
    let corner = floor(at - 0.5);
    let t = at - 0.5 - corner;
    let wx = cubics(t.x);
    let wy = cubics(t.y);
    let first = origin + vec2<i32>(corner) - vec2(1, 1);
    var sum = vec4(0.0);
    for (var j = 0; j < 4; j++) {
        var line = vec4(0.0);
        for (var i = 0; i < 4; i++) {
            line += wx[i] * pixel_at(levels[0], first + vec2(i, j));
        }
        sum += wy[j] * line;
    }
    return sum;
}

// The average within twice the ellipse, in an image that was halved `number` times.
fn average(number: u32, at: vec2<f32>, metric: vec3<f32>) -> vec4<f32> {
    let level = levels[number];
    let scale = 1.0 / f32(1u << number);
    // whole pixels of the level, and the place relative to them
    let whole = vec2(origin.x >> number, origin.y >> number);
    let rest = vec2<f32>(origin - vec2(whole.x << number, whole.y << number));
    let place = (at + rest) * scale;
    let xx = metric.x;
    let xy = metric.y;
    let yy = metric.z;
    let determinant = xx * yy - xy * xy;
    let reach_y = sqrt(SUPPORT_SQ * xx / determinant);
    let first = i32(ceil(place.y - reach_y - 0.5));
    let last = i32(floor(place.y + reach_y - 0.5));
    var sum = vec4(0.0);
    var weights = 0.0;
    for (var row = first; row <= last; row++) {
        let dy = f32(row) + 0.5 - place.y;
        let under_root = xy * dy * xy * dy - xx * (yy * dy * dy - SUPPORT_SQ);
        if (under_root < 0.0) {
            continue;
        }
        let middle = place.x - xy * dy / xx;
        let half = sqrt(under_root) / xx;
        let start = i32(ceil(middle - half - 0.5));
        let end = i32(floor(middle + half - 0.5));
        for (var col = start; col <= end; col++) {
            let dx = f32(col) + 0.5 - place.x;
            let distance_sq = dx * (xx * dx + 2.0 * xy * dy) + yy * dy * dy;
            let entry = u32(max(distance_sq, 0.0) * f32(params.entries) / SUPPORT_SQ);
            if (entry < params.entries) {
                let weight = kernel[entry];
                sum += weight * pixel_at(level, whole + vec2(col, row));
                weights += weight;
            }
        }
    }
    return sum / weights;
}

// Share of an interval of a length around a place that lies in the image along an axis.
fn share_inside(at: f32, origin_at: i32, extent: f32, length: u32) -> f32 {
    let below_first = clamp((at + f32(origin_at)) / extent + 0.5, 0.0, 1.0);
    let below_last = clamp((at + f32(origin_at - i32(length))) / extent + 0.5, 0.0, 1.0);
    return below_first - below_last;
}

@compute @workgroup_size(GROUP)
fn homography_warp(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = id.y * groups.x * GROUP + id.x;
    if (index >= params.count) {
        return;
    }
    let col = index % params.width;
    let row = params.first_row + index / params.width;
    let tile = tiles[(row / TILE - params.first_tile_row) * params.tile_columns + col / TILE];
    origin = tile.origin;
    let local = vec2(f32(col % TILE), f32(row % TILE)) + 0.5 - 0.5 * f32(TILE);
    let point = vec3(local, 1.0);
    let z = dot(tile.row_2.xyz, point);
    results[index] = params.empty;
    if (!(z > 0.0)) {
        return;
    }
    let at = vec2(dot(tile.row_0.xyz, point), dot(tile.row_1.xyz, point)) / z;
    let along_x = (vec2(tile.row_0.x, tile.row_1.x) - at * tile.row_2.x) / z;
    let along_y = (vec2(tile.row_0.y, tile.row_1.y) - at * tile.row_2.y) / z;
    let xx = along_x.x * along_x.x + along_y.x * along_y.x;
    let xy = along_x.x * along_x.y + along_y.x * along_y.y;
    let yy = along_x.y * along_x.y + along_y.y * along_y.y;
    let mean = 0.5 * (xx + yy);
    let spread = sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy);
    // beyond what a footprint can be computed with
    if (!(mean + spread < 1e30) || max(abs(at.x), abs(at.y)) > 1e9) {
        return;
    }
    var share = 1.0;
    if (params.endless == 0u) {
        share = share_inside(at.x, origin.x, sqrt(xx), levels[0].width)
            * share_inside(at.y, origin.y, sqrt(yy), levels[0].height);
        if (share <= 0.0) {
            return;
        }
    }
    let major = max(mean + spread, 1.0);
    let minor = max(max(mean - spread, 1.0), major / (MAX_ANISOTROPY * MAX_ANISOTROPY));
    let blend = (sqrt(major) - 1.0) / BLEND;
    var seen = vec4(0.0);
    if (blend < 1.0) {
        seen = catmull_rom(at);
    }
    if (blend > 0.0) {
        let difference = select(0.0, (1.0 / major - 1.0 / minor) / (2.0 * spread), spread > 0.0);
        let lower = mean - spread;
        // halvings after which the ellipse is still as wide as its least width
        var number = 0u;
        var widest = 4.0 * MIN_MINOR_PX * MIN_MINOR_PX;
        while (number + 1u < params.levels && minor >= widest) {
            number += 1u;
            widest *= 4.0;
        }
        let scale = 1.0 / f32(1u << number);
        let narrower = max(sqrt(minor) * scale / MAX_MINOR_PX, 1.0) / scale;
        let metric = narrower * narrower * vec3(
            1.0 / minor + difference * (xx - lower),
            difference * xy,
            1.0 / minor + difference * (yy - lower),
        );
        let mixed_in = average(number, at, metric);
        seen = mix(seen, mixed_in, min(blend, 1.0));
    }
    results[index] = mix(params.empty, seen, share);
}
