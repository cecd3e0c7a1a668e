// The sweep over blocks whose pixels have weights: by transparency, or beyond the border of the image.
//
// The kernel gives `inside(i)`, 1 for a pixel inside the image and else 0.

var<private> prefix_covers: array<vec2<f32>, PIXELS + 1u>;

// 1 / weight, 0 where there is none.
fn inverse(weight: f32) -> f32 {
    return select(0.0, reciprocal(weight), weight > MIN_WEIGHT);
}

struct Totals {
    weight: f32,
    inside: f32,
    mean_alpha: f32,
}

fn weighted_gain(totals: Totals, sum: vec3<f32>, cover: vec2<f32>) -> f32 {
    let both = inverse(cover.x) + inverse(totals.weight - cover.x);
    let colors = rounded(squared_length(sum) * both);
    let off_alpha = cover.x - rounded(cover.y * totals.mean_alpha);
    let both_inside = inverse(cover.y) + inverse(totals.inside - cover.y);
    let alphas = rounded(rounded(off_alpha * off_alpha) * both_inside);
    return colors + alphas;
}

// Color times weight without that of the mean, and the weight.
fn centered_weighted_pixel(i: u32) -> vec4<f32> {
    let raw = raw_pixel(i);
    return vec4(raw.xyz - scaled(steps[0], raw.w) - scaled(steps[1], raw.w), raw.w);
}

// The best split of a block with weights.
fn best_weighted_split() -> Found {
    var found: Found;
    var totals: Totals;
    totals.weight = 0.0;
    totals.inside = 0.0;
    for (var i = 0u; i < params.pixels; i++) {
        totals.weight += raw_pixel(i).w;
        totals.inside += inside(i);
    }
    let inverse_weight = inverse(totals.weight);
    totals.mean_alpha = rounded(totals.weight * inverse(totals.inside));
    steps[0] = vec3(0.0);
    steps[1] = vec3(0.0);
    for (var round = 0u; round < 2u; round++) {
        var total = vec3(0.0);
        for (var i = 0u; i < params.pixels; i++) {
            total += centered_weighted_pixel(i).xyz;
        }
        steps[round] = scaled(total, inverse_weight);
    }
    found.mean = steps[0] + steps[1];
    found.energy = 0.0;
    for (var i = 0u; i < params.pixels; i++) {
        let pixel = centered_weighted_pixel(i);
        let off_alpha = pixel.w - rounded(inside(i) * totals.mean_alpha);
        let color = rounded(squared_length(pixel.xyz) * inverse(pixel.w));
        found.energy += color + rounded(off_alpha * off_alpha);
    }

    var sum = vec3(0.0);
    var cover = vec2(0.0);
    prefixes[0] = sum;
    prefix_covers[0] = cover;
    for (var k = 0u; k < params.pixels; k++) {
        let pixel = centered_weighted_pixel(order[k]);
        sum += pixel.xyz;
        cover += vec2(pixel.w, inside(order[k]));
        prefixes[k + 1u] = sum;
        prefix_covers[k + 1u] = cover;
    }
    var best = 0.0;
    found.event = 0u;
    for (var number = 0u; number < params.events; number++) {
        let event = events[number];
        let k = event & 0xffffu;
        let pixel = centered_weighted_pixel(event >> 16u);
        let renewed = prefixes[k - 1u] + pixel.xyz;
        let renewed_cover = prefix_covers[k - 1u] + vec2(pixel.w, inside(event >> 16u));
        prefixes[k] = renewed;
        prefix_covers[k] = renewed_cover;
        let gain = weighted_gain(totals, renewed, renewed_cover);
        if (gain > best) {
            best = gain;
            found.event = number;
        }
    }

    let normal = vec2(lines[3u * found.event], lines[3u * found.event + 1u]);
    let offset = lines[3u * found.event + 2u];
    found.sum_0 = vec3(0.0);
    var cover_0 = vec2(0.0);
    for (var row = 0u; row < params.side; row++) {
        let limit = offset - rounded(normal.y * (f32(row) - HALF));
        for (var col = 0u; col < params.side; col++) {
            if (rounded(normal.x * (f32(col) - HALF)) < limit) {
                let i = row * params.side + col;
                let pixel = centered_weighted_pixel(i);
                found.sum_0 += pixel.xyz;
                cover_0 += vec2(pixel.w, inside(i));
            }
        }
    }
    found.gain = weighted_gain(totals, found.sum_0, cover_0);
    found.weights = vec2(totals.weight, cover_0.x);
    found.insides = vec2(totals.inside, cover_0.y);
    return found;
}
