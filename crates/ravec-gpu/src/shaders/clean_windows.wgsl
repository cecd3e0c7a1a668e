// The model of each window of a strip: a line and, for each channel and side, a shrunken plane and the share of the residual that
// stands out of the noise. A window a thread.
//
// Operation for operation that of ravec_twocolor's `clean/window.rs`: see there for the method and the notation.

struct Params {
    // 0: see `rounded`
    zero: u32,
    // of the padded strip
    width: u32,
    windows_x: u32,
    windows: u32,
    stride: u32,
    side: u32,
    pixels: u32,
    events: u32,
    // of the target: its columns, its first column and row in the padded strip, its pixels
    target_width: u32,
    lead_x: u32,
    lead_y: u32,
    count: u32,
    windows_y: u32,
    // brightnesses of the table of noise
    classes: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
// Encoded opponent colors of the padded strip, row by row.
@group(0) @binding(1) var<storage, read> colors: array<vec4<f32>>;
// Standard deviations of the noise, channel by channel.
@group(0) @binding(2) var<storage, read> sigma: array<f32>;
// Word `k` of a window is number `k · windows + window`.
@group(0) @binding(7) var<storage, read_write> models: array<f32>;

// What is taken off each pixel, the line, and ESTIMATE_WORDS for each channel and side.
const STEPS: u32 = 0u;
const LINE: u32 = 6u;
const ESTIMATES: u32 = 9u;
const ESTIMATE_WORDS: u32 = 5u;

var<private> window: u32;

fn raw_pixel(i: u32) -> vec4<f32> {
    let corner = vec2(window % params.windows_x, window / params.windows_x) * params.stride;
    let at = corner + vec2(i % SIDE, i / SIDE);
    return vec4(colors[at.y * params.width + at.x].xyz, 1.0);
}

fn inside(i: u32) -> f32 {
    return 1.0;
}

fn put(word: u32, value: f32) {
    models[word * params.windows + window] = value;
}

// The noise variance of a channel at a brightness.
fn variance_at(luma: f32, channel: u32) -> f32 {
    let last = f32(params.classes - 1u);
    let position = rounded(clamp(luma * INVERSE_LUMA_RANGE, 0.0, 1.0) * last);
    let low = min(u32(position), params.classes - 2u);
    let share = position - f32(low);
    let first = channel * params.classes + low;
    let level = sigma[first] + rounded(share * (sigma[first + 1u] - sigma[first]));
    return max(rounded(level * level), MIN_VARIANCE);
}

struct Moments {
    y: f32,
    yy: f32,
    xy: f32,
    zy: f32,
}

struct Positions {
    n: f32,
    x: f32,
    z: f32,
    xx: f32,
    xz: f32,
    zz: f32,
}

struct Estimate {
    base: f32,
    slope: vec2<f32>,
    keep: f32,
    weight: f32,
}

fn moments_without(all: Moments, part: Moments) -> Moments {
    return Moments(all.y - part.y, all.yy - part.yy, all.xy - part.xy, all.zy - part.zy);
}

// Steps 3 to 5 for one side and channel. An empty side gets no weight.
fn estimate(positions: Positions, moments: Moments, variance: f32, residual_shrink: f32) -> Estimate {
    let n = max(positions.n, 1.0);
    let inverse_n = reciprocal(n);
    let center = vec2(rounded(positions.x * inverse_n), rounded(positions.z * inverse_n));
    let m = rounded(moments.y * inverse_n);

    // slope: M g = b
    let m_xx = positions.xx - rounded(positions.x * center.x) + SCATTER_FLOOR;
    let m_xz = positions.xz - rounded(positions.x * center.y);
    let m_zz = positions.zz - rounded(positions.z * center.y) + SCATTER_FLOOR;
    let b_x = moments.xy - rounded(moments.y * center.x);
    let b_z = moments.zy - rounded(moments.y * center.y);
    let inverse_det = reciprocal(rounded(m_xx * m_zz) - rounded(m_xz * m_xz));
    let g_x = rounded((rounded(m_zz * b_x) - rounded(m_xz * b_z)) * inverse_det);
    let g_z = rounded((rounded(m_xx * b_z) - rounded(m_xz * b_x)) * inverse_det);
    let plane_energy = max(rounded(g_x * b_x) + rounded(g_z * b_z), 0.0);
    let noise_in_plane = rounded(variance * SLOPE_SHRINK);
    let r = max(rounded(1.0 - divided(noise_in_plane, max(plane_energy, noise_in_plane))), 0.0);

    // residual
    let total = max(moments.yy - rounded(moments.y * m), 0.0);
    let lost = 1.0 - r;
    let left = max(total - rounded(plane_energy * (1.0 - rounded(lost * lost))), 0.0);
    let freedom = max(n - 1.0 - rounded(r * 2.0), 1.0);
    let noise_in_residual = rounded(variance * residual_shrink);
    let a = rounded(1.0 - divided(noise_in_residual, max(divided(left, freedom), noise_in_residual)));

    let expected = rounded(a * variance)
        + rounded(rounded((1.0 - a + rounded(r * 2.0)) * variance) * inverse_n);
    let keep_plane = 1.0 - a;
    let share = rounded(keep_plane * r);
    let slope = vec2(rounded(share * g_x), rounded(share * g_z));
    let base = rounded(keep_plane * m) - rounded(slope.x * center.x) - rounded(slope.y * center.y);
    return Estimate(base, slope, a, select(0.0, reciprocal(expected), positions.n > 0.5));
}

fn put_estimate(at: u32, found: Estimate) {
    put(at, found.base);
    put(at + 1u, found.slope.x);
    put(at + 2u, found.slope.y);
    put(at + 3u, found.keep);
    put(at + 4u, found.weight);
}

// The estimate above a mean, times its weight.
fn weighted(found: Estimate, mean: f32) -> Estimate {
    let weight = found.weight;
    return Estimate(
        rounded(weight * (mean + found.base)),
        vec2(rounded(weight * found.slope.x), rounded(weight * found.slope.y)),
        rounded(weight * found.keep),
        weight,
    );
}

@compute @workgroup_size(GROUP)
fn model_windows(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    window = id.y * groups.x * GROUP + id.x;
    if (window >= params.windows) {
        return;
    }
    let found = best_split();
    var variance = array(0.0, 0.0, 0.0);
    for (var c = 0u; c < 3u; c++) {
        variance[c] = variance_at(found.mean.x, c);
    }
    let mean_variance = variance[0] + variance[1] + variance[2];
    let least = rounded(rounded(MIN_GAIN * mean_variance) * THIRD);
    // two sides if the gain stands out of the noise; else everything lies on side 0
    var normal = vec2(0.0);
    var offset = 1.0;
    if (found.gain > least) {
        normal = vec2(lines[3u * found.event], lines[3u * found.event + 1u]);
        offset = lines[3u * found.event + 2u];
    }

    var positions = Positions(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    var parts: array<Moments, 3>;
    var wholes: array<Moments, 3>;
    for (var c = 0u; c < 3u; c++) {
        parts[c] = Moments(0.0, 0.0, 0.0, 0.0);
        wholes[c] = Moments(0.0, 0.0, 0.0, 0.0);
    }
    for (var row = 0u; row < params.side; row++) {
        let z = f32(row) - HALF;
        let limit = offset - rounded(normal.y * z);
        // within a row z is constant, so its moments are those of the row's sums
        var row_positions = vec3(0.0);
        var row_part = vec3(0.0);
        var row_whole = vec3(0.0);
        for (var col = 0u; col < params.side; col++) {
            let x = f32(col) - HALF;
            let on_0 = select(0.0, 1.0, rounded(normal.x * x) < limit);
            row_positions += on_0 * vec3(1.0, x, x * x);
            let pixel = centered_pixel(row * params.side + col);
            let part = on_0 * pixel;
            row_part += part;
            row_whole += pixel;
            for (var c = 0u; c < 3u; c++) {
                parts[c].yy += rounded(part[c] * pixel[c]);
                wholes[c].yy += rounded(pixel[c] * pixel[c]);
                parts[c].xy += rounded(part[c] * x);
                wholes[c].xy += rounded(pixel[c] * x);
            }
        }
        // sums of positions are exact in any order
        positions.n += row_positions.x;
        positions.x += row_positions.y;
        positions.xx += row_positions.z;
        positions.z += row_positions.x * z;
        positions.xz += row_positions.y * z;
        positions.zz += row_positions.x * (z * z);
        for (var c = 0u; c < 3u; c++) {
            parts[c].y += row_part[c];
            parts[c].zy += rounded(row_part[c] * z);
            wholes[c].y += row_whole[c];
            wholes[c].zy += rounded(row_whole[c] * z);
        }
    }
    let rest = Positions(
        f32(PIXELS) - positions.n,
        0.0 - positions.x,
        0.0 - positions.z,
        SQUARES - positions.xx,
        0.0 - positions.xz,
        SQUARES - positions.zz,
    );

    for (var round = 0u; round < 2u; round++) {
        for (var c = 0u; c < 3u; c++) {
            put(STEPS + 3u * round + c, steps[round][c]);
        }
    }
    put(LINE, normal.x);
    put(LINE + 1u, normal.y);
    put(LINE + 2u, offset);
    for (var c = 0u; c < 3u; c++) {
        let shrink = select(CHROMA_SHRINK, LUMA_SHRINK, c == 0u);
        let side_0 = estimate(positions, parts[c], variance[c], shrink);
        let side_1 = estimate(rest, moments_without(wholes[c], parts[c]), variance[c], shrink);
        let at = ESTIMATES + 2u * ESTIMATE_WORDS * c;
        put_estimate(at, weighted(side_0, found.mean[c]));
        put_estimate(at + ESTIMATE_WORDS, weighted(side_1, found.mean[c]));
    }
}
