// The two-color operator at every pixel of a region: the window around it, its split, and what its mode makes of it.

struct Params {
    // 0: see `rounded`
    zero: u32,
    width: u32,
    height: u32,
    // row of the image with which the plane begins
    first_row: u32,
    // the region of this run
    left: u32,
    top: u32,
    columns: u32,
    count: u32,
    side: u32,
    pixels: u32,
    events: u32,
    mode: u32,
    strength: f32,
    // a window whose gain is at most this times its weight has one color
    flat: f32,
}

const ABSTRACT: u32 = 0u;
const SMOOTH: u32 = 1u;
const SHARPEN: u32 = 2u;
const ANTIALIAS: u32 = 3u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(7) var<storage, read> plane: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> results: array<vec4<f32>>;

// The center of the window in the image.
var<private> center: vec2<i32>;

fn place(i: u32) -> vec2<i32> {
    let half = i32(SIDE / 2u);
    return center + vec2(i32(i % SIDE), i32(i / SIDE)) - vec2(half, half);
}

fn is_inside(at: vec2<i32>) -> bool {
    return at.x >= 0 && at.y >= 0 && at.x < i32(params.width) && at.y < i32(params.height);
}

fn plane_index(at: vec2<i32>) -> u32 {
    return (u32(at.y) - params.first_row) * params.width + u32(at.x);
}

fn raw_pixel(i: u32) -> vec4<f32> {
    let at = place(i);
    if (!is_inside(at)) {
        return vec4(0.0);
    }
    return plane[plane_index(at)];
}

fn inside(i: u32) -> f32 {
    return select(0.0, 1.0, is_inside(place(i)));
}

struct Sides {
    own: vec3<f32>,
    other: vec3<f32>,
    coverage: f32,
    variance: f32,
    remoteness: f32,
}

fn sides_of(found: Found, opaque: bool) -> Sides {
    var sides: Sides;
    let count = f32(PIXELS);
    let weight = select(found.insides.x, count, opaque);
    let flat = !(found.gain > rounded(params.flat * weight));
    sides.coverage = 1.0;
    sides.remoteness = 1.0;
    if (flat) {
        sides.own = found.mean;
        sides.other = found.mean;
        sides.variance = divided(max(found.energy, 0.0), max(weight, 1.0));
        return sides;
    }
    var counts = found.weights;
    if (opaque) {
        counts = vec2(count, f32(events[found.event] & 0xffffu));
    }
    let rest = counts.x - counts.y;
    let scale_0 = select(0.0, reciprocal(counts.y), counts.y > 1e-6);
    let scale_1 = select(0.0, reciprocal(rest), rest > 1e-6);
    let color_0 = found.mean + scaled(found.sum_0, scale_0);
    let color_1 = found.mean + scaled(found.sum_0, -scale_1);
    let normal = normalize(vec2(lines[3u * found.event], lines[3u * found.event + 1u]));
    let offset = lines[3u * found.event + 2u];
    // the central pixel is at the line's origin
    let own_is_1 = offset < 0.0;
    sides.own = select(color_0, color_1, own_is_1);
    sides.other = select(color_1, color_0, own_is_1);
    let coverage_0 = share_at(normal, offset);
    sides.coverage = select(coverage_0, 1.0 - coverage_0, own_is_1);
    sides.variance = divided(max(found.energy - found.gain, 0.0), weight);
    sides.remoteness = abs(offset) / (0.5 * f32(SIDE));
    return sides;
}

fn is_finite(v: vec3<f32>) -> bool {
    let bits = bitcast<vec3<u32>>(v) & vec3(0x7fffffffu);
    return max(max(bits.x, bits.y), bits.z) < 0x7f800000u;
}

fn smooth_step(t: f32) -> f32 {
    let s = clamp(t, 0.0, 1.0);
    return s * s * (3.0 - 2.0 * s);
}

fn smoothed(here: vec3<f32>, sides: Sides) -> vec3<f32> {
    let deviation_sq = squared_length(here - sides.own);
    let noise = 9.0 * sides.variance;
    let share = select(0.0, divided(noise, noise + deviation_sq), deviation_sq > 0.0);
    return here + scaled(sides.own - here, share);
}

fn sharpened(here: vec3<f32>, sides: Sides) -> vec3<f32> {
    let axis = sides.own - sides.other;
    let length_sq = dot(axis, axis);
    if (length_sq <= 0.0) {
        return here;
    }
    let place = dot(here - sides.other, axis) / length_sq;
    let push = max(sides.coverage - place, 0.0);
    let explained = 0.25 * length_sq / (0.25 * length_sq + sides.variance);
    let share = smooth_step((explained - 0.3) / 0.3) * smooth_step(2.0 - 2.0 * sides.remoteness);
    let low = min(min(here, sides.own), sides.other);
    let high = max(max(here, sides.own), sides.other);
    return clamp(here + share * push * axis, low, high);
}

// Share of the window that two colors explain.
fn quality(sides: Sides) -> f32 {
    let axis = sides.own - sides.other;
    let contrast_sq = dot(axis, axis);
    if (contrast_sq <= 0.0) {
        return 0.0;
    }
    let kept = max(1.0 - 4.0 * sides.variance / (0.25 * contrast_sq), 0.0);
    return kept * (2.0 - kept);
}

fn mixed(before: vec4<f32>, to: vec4<f32>, share: f32) -> vec4<f32> {
    if (share <= 0.0) {
        return before;
    }
    if (share >= 1.0) {
        return to;
    }
    let step = to - before;
    return before + vec4(scaled(step.xyz, share), rounded(step.w * share));
}

fn applied(pixel: vec4<f32>, sides: Sides) -> vec4<f32> {
    if (pixel.w <= 0.0) {
        return pixel;
    }
    let here = oklab_from_linear(pixel.xyz);
    // a pixel that is not a number, or has one in its window, stays as it is
    if (!(is_finite(here) && is_finite(sides.own) && is_finite(sides.other))) {
        return pixel;
    }
    if (params.mode == ANTIALIAS) {
        let mixture = sides.coverage * linear_from_oklab(sides.own)
            + (1.0 - sides.coverage) * linear_from_oklab(sides.other);
        let share = select(0.0, quality(sides), sides.coverage < 1.0);
        return mixed(pixel, vec4(mixture, pixel.w), share);
    }
    var color = sides.own;
    if (params.mode == SMOOTH) {
        color = smoothed(here, sides);
    } else if (params.mode == SHARPEN) {
        color = sharpened(here, sides);
    }
    return vec4(linear_from_oklab(color), pixel.w);
}

@compute @workgroup_size(GROUP)
fn dense(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = id.y * groups.x * GROUP + id.x;
    if (index >= params.count) {
        return;
    }
    center = vec2(
        i32(params.left + index % params.columns),
        i32(params.top + index / params.columns),
    );
    var opaque = true;
    for (var i = 0u; i < params.pixels; i++) {
        opaque = opaque && raw_pixel(i).w == 1.0;
    }
    var found: Found;
    if (opaque) {
        found = best_split();
    } else {
        found = best_weighted_split();
    }
    let pixel = source_pixel(plane_index(center));
    results[index] = mixed(pixel, applied(pixel, sides_of(found, opaque)), params.strength);
}
