// The weighted mean of what all windows over a pixel estimate, a pixel of the target a thread.

@group(0) @binding(8) var<storage, read_write> cleaned: array<f32>;

fn model(word: u32) -> f32 {
    return models[word * params.windows + window];
}

@compute @workgroup_size(GROUP)
fn gather(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let index = id.y * groups.x * GROUP + id.x;
    if (index >= params.count) {
        return;
    }
    let at = vec2(params.lead_x + index % params.target_width, params.lead_y + index / params.target_width);
    let color = colors[at.y * params.width + at.x].xyz;
    let last = min(at / params.stride, vec2(params.windows_x, params.windows_y) - 1u);
    // the first window that reaches the pixel
    let first = (max(at + 1u, vec2(SIDE)) - SIDE + params.stride - 1u) / params.stride;
    var sums = vec3(0.0);
    var weights = vec3(0.0);
    for (var j = first.y; j <= last.y; j++) {
        for (var i = first.x; i <= last.x; i++) {
            window = j * params.windows_x + i;
            let place = vec2<f32>(at - vec2(i, j) * params.stride) - HALF;
            let limit = model(LINE + 2u) - rounded(model(LINE + 1u) * place.y);
            let side = select(ESTIMATE_WORDS, 0u, rounded(model(LINE) * place.x) < limit);
            for (var c = 0u; c < 3u; c++) {
                let from_mean = color[c] - model(STEPS + c) - model(STEPS + 3u + c);
                let word = ESTIMATES + 2u * ESTIMATE_WORDS * c + side;
                sums[c] += model(word)
                    + rounded(model(word + 2u) * place.y)
                    + rounded(model(word + 1u) * place.x)
                    + rounded(model(word + 3u) * from_mean);
                weights[c] += model(word + 4u);
            }
        }
    }
    for (var c = 0u; c < 3u; c++) {
        cleaned[3u * index + c] = divided(sums[c], weights[c]);
    }
}
