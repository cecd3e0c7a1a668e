// Lines of blocks to a fraction of a pixel, one block a thread: the method of ravec_twocolor's `subpixel.rs`.
//
// Colors are taken relative to their mean in the block. That changes no line, since a constant is explained by every line, and
// it keeps sums of squares small enough for single precision.

struct Params {
    width: u32,
    rows: u32,
    columns_of_blocks: u32,
    blocks: u32,
    side: u32,
    pixels: u32,
    steps: u32,
    halvings: u32,
}

const UNCHANGED: u32 = 0u;
const REFINED: u32 = 1u;
const NOT_REFINED: u32 = 2u;
const WORDS: u32 = 10u;

const MIN_SIDE_AREA: f32 = 0.75;
const DAMPING: f32 = 1e-3;
const MIN_IMPROVEMENT: f32 = 1e-5;

@group(0) @binding(0) var<uniform> params: Params;
// Linear light and weight: the first pixels of all blocks, then the second ones, and so on.
@group(0) @binding(1) var<storage, read> plane: array<vec4<f32>>;
// n.x, n.y, d of each block, and 1 for those that are refined
@group(0) @binding(2) var<storage, read> fitted: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> results: array<u32>;

var<private> block: u32;
var<private> mean: vec3<f32>;

struct Model {
    normal: vec2<f32>,
    offset: f32,
    color_0: vec3<f32>,
    color_1: vec3<f32>,
    error: f32,
    valid: bool,
}

// Color relative to the mean, and weight; no weight beyond the border of the image.
fn member(i: u32) -> vec4<f32> {
    let pixel = plane[i * params.blocks + block];
    return vec4(pixel.xyz - mean, pixel.w);
}

fn center_of(i: u32) -> vec2<f32> {
    let half = 0.5 * (f32(params.side) - 1.0);
    return vec2(f32(i % params.side) - half, f32(i / params.side) - half);
}

// The best colors of the two sides of a line, unless one side is almost empty.
fn fitted_model(normal: vec2<f32>, offset: f32) -> Model {
    var sums = vec3(0.0);
    var right_0 = vec3(0.0);
    var right_1 = vec3(0.0);
    for (var i = 0u; i < params.pixels; i++) {
        let pixel = member(i);
        let f = share_at(normal, offset - dot(normal, center_of(i)));
        let w0 = pixel.w * f;
        let w1 = pixel.w * (1.0 - f);
        sums += vec3(w0 * f, w0 * (1.0 - f), w1 * (1.0 - f));
        right_0 += w0 * pixel.xyz;
        right_1 += w1 * pixel.xyz;
    }
    var model: Model;
    model.normal = normal;
    model.offset = offset;
    let det = sums.x * sums.z - sums.y * sums.y;
    model.valid = sums.x + sums.y >= MIN_SIDE_AREA && sums.z + sums.y >= MIN_SIDE_AREA && det >= 1e-9;
    model.color_0 = (sums.z * right_0 - sums.y * right_1) / det;
    model.color_1 = (sums.x * right_1 - sums.y * right_0) / det;
    // from the residuals: as a difference of the energies it would have few digits
    model.error = 0.0;
    for (var i = 0u; i < params.pixels; i++) {
        let pixel = member(i);
        let f = share_at(normal, offset - dot(normal, center_of(i)));
        let residual = pixel.xyz - model.color_0 * f - model.color_1 * (1.0 - f);
        model.error += pixel.w * dot(residual, residual);
    }
    return model;
}

// The Gauss-Newton step of angle and offset, and 1, or 0 if there is none.
fn step_of(model: Model) -> vec3<f32> {
    let normal = model.normal;
    let along = vec2(-normal.y, normal.x);
    let contrast = model.color_0 - model.color_1;
    let contrast_sq = dot(contrast, contrast);
    var basis = vec3(0.0);
    var cross_turn = vec2(0.0);
    var cross_shift = vec2(0.0);
    var gram = vec3(0.0);
    var right = vec2(0.0);
    for (var i = 0u; i < params.pixels; i++) {
        let pixel = member(i);
        let center = center_of(i);
        let u = model.offset - dot(normal, center);
        let f = share_at(normal, u);
        let gradient = share_gradient(normal, u);
        let columns = vec2(gradient.y - gradient.x * dot(along, center), gradient.x);
        let residual = dot(pixel.xyz - (model.color_0 * f + model.color_1 * (1.0 - f)), contrast);
        let w = pixel.w;
        basis += w * vec3(f * f, f * (1.0 - f), (1.0 - f) * (1.0 - f));
        gram += w * vec3(columns.x * columns.x, columns.x * columns.y, columns.y * columns.y);
        cross_turn += w * columns.x * vec2(f, 1.0 - f);
        cross_shift += w * columns.y * vec2(f, 1.0 - f);
        right += w * columns * residual;
    }
    let det = basis.x * basis.z - basis.y * basis.y;
    if (det < 1e-9) {
        return vec3(0.0);
    }
    // take off what the colors explain
    let by_turn = vec2(
        basis.z * cross_turn.x - basis.y * cross_turn.y,
        basis.x * cross_turn.y - basis.y * cross_turn.x,
    ) / det;
    let by_shift = vec2(
        basis.z * cross_shift.x - basis.y * cross_shift.y,
        basis.x * cross_shift.y - basis.y * cross_shift.x,
    ) / det;
    let a = (gram.x - dot(cross_turn, by_turn)) * contrast_sq * (1.0 + DAMPING) + 1e-12;
    let b = (gram.y - dot(cross_turn, by_shift)) * contrast_sq;
    let c = (gram.z - dot(cross_shift, by_shift)) * contrast_sq * (1.0 + DAMPING) + 1e-12;
    let det_normal = a * c - b * b;
    if (!(det_normal > 0.0)) {
        return vec3(0.0);
    }
    return vec3((c * right.x - b * right.y) / det_normal, (a * right.y - b * right.x) / det_normal, 1.0);
}

// The normal turned by at most half a radian. By series: the built-in functions have 11 bits.
fn turned_by(normal: vec2<f32>, angle: f32) -> vec2<f32> {
    let square = angle * angle;
    let sine = angle * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)));
    let cosine = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0)));
    return normalize(vec2(cosine * normal.x - sine * normal.y, sine * normal.x + cosine * normal.y));
}

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) < 0x7f800000u;
}

@compute @workgroup_size(GROUP)
fn refine(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    block = id.y * groups.x * GROUP + id.x;
    if (block >= params.blocks) {
        return;
    }
    let start = fitted[block];
    results[WORDS * block] = UNCHANGED;
    if (start.w == 0.0) {
        return;
    }
    mean = vec3(0.0);
    var sum = vec3(0.0);
    var low = vec3(3e38);
    var high = vec3(-3e38);
    var weight = 0.0;
    for (var i = 0u; i < params.pixels; i++) {
        let pixel = member(i);
        sum += pixel.w * pixel.xyz;
        weight += pixel.w;
        if (pixel.w > 0.0) {
            low = min(low, pixel.xyz);
            high = max(high, pixel.xyz);
        }
    }
    let sums = vec4(sum, weight);
    if (!(is_finite(sums.x) && is_finite(sums.y) && is_finite(sums.z) && is_finite(sums.w))) {
        results[WORDS * block] = NOT_REFINED;
        return;
    }
    mean = select(vec3(0.0), sum / weight, weight > 0.0);
    var best = fitted_model(start.xy, start.z);
    if (!best.valid) {
        return;
    }
    for (var round = 0u; round < params.steps; round++) {
        let step = step_of(best);
        if (step.z == 0.0) {
            break;
        }
        var scale = min(min(0.5 / max(abs(step.x), 1e-12), 1.0 / max(abs(step.y), 1e-12)), 1.0);
        var better = false;
        for (var halving = 0u; halving < params.halvings && !better; halving++) {
            let trial = fitted_model(turned_by(best.normal, scale * step.x), best.offset + scale * step.y);
            scale *= 0.5;
            if (trial.valid && trial.error < best.error * (1.0 - MIN_IMPROVEMENT)) {
                best = trial;
                better = true;
            }
        }
        if (!better) {
            break;
        }
    }
    let color_0 = clamp(best.color_0 + mean, low, high);
    let color_1 = clamp(best.color_1 + mean, low, high);
    let at = WORDS * block;
    results[at] = REFINED;
    results[at + 1u] = bitcast<u32>(best.normal.x);
    results[at + 2u] = bitcast<u32>(best.normal.y);
    results[at + 3u] = bitcast<u32>(best.offset);
    results[at + 4u] = bitcast<u32>(color_0.x);
    results[at + 5u] = bitcast<u32>(color_0.y);
    results[at + 6u] = bitcast<u32>(color_0.z);
    results[at + 7u] = bitcast<u32>(color_1.x);
    results[at + 8u] = bitcast<u32>(color_1.y);
    results[at + 9u] = bitcast<u32>(color_1.z);
}
