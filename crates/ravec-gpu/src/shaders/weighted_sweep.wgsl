// The sweep over blocks whose pixels have weights: by transparency, or beyond the border of the image.

var<private> prefix_covers: array<vec2<f32>, PIXELS + 1u>;

fn weighted_gain(totals: Totals, sum: vec3<f32>, cover: vec2<f32>) -> f32 {
    let both = inverse(cover.x) + inverse(totals.weight - cover.x);
    let colors = rounded(squared_length(sum) * both);
    let off_alpha = cover.x - rounded(cover.y * totals.mean_alpha);
    let both_inside = inverse(cover.y) + inverse(totals.inside - cover.y);
    let alphas = rounded(rounded(off_alpha * off_alpha) * both_inside);
    return colors + alphas;
}

// Fills the prefixes of the initial order.
fn begin_weighted_sweep() {
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
}

// Goes on with the events from `first` to before `end`.
fn weighted_sweep(totals: Totals, first: u32, end: u32) -> Best {
    var best = Best(first, 0.0);
    for (var number = first; number < end; number++) {
        let event = events[number];
        let k = event & 0xffffu;
        let pixel = centered_weighted_pixel(event >> 16u);
        let renewed = prefixes[k - 1u] + pixel.xyz;
        let renewed_cover = prefix_covers[k - 1u] + vec2(pixel.w, inside(event >> 16u));
        prefixes[k] = renewed;
        prefix_covers[k] = renewed_cover;
        let gain = weighted_gain(totals, renewed, renewed_cover);
        if (gain > best.gain) {
            best = Best(number, gain);
        }
    }
    return best;
}

// The best split of a block with weights.
fn best_weighted_split() -> Found {
    var found: Found;
    let totals = center_weighted();
    found.energy = totals.energy;
    found.mean = steps[0] + steps[1];
    begin_weighted_sweep();
    found.event = weighted_sweep(totals, 0u, params.events).event;

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
