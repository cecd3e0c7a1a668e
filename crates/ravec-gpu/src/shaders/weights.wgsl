// Colors times weights, and sums over them.
//
// The kernel gives `raw_pixel(i)`, Oklab times weight and the weight, and `inside(i)`, the part of the pixel that lies inside
// the image. Operation for operation the sums of ravec_twocolor's `sweep.rs`.

// what is taken off each pixel, one after the other
var<private> steps: array<vec3<f32>, 2>;

// 1 / weight, 0 where there is none.
fn inverse(weight: f32) -> f32 {
    return select(0.0, reciprocal(weight), weight > MIN_WEIGHT);
}

struct Totals {
    weight: f32,
    inside: f32,
    mean_alpha: f32,
    energy: f32,
}

// Color times weight without that of the mean, and the weight.
fn centered_weighted_pixel(i: u32) -> vec4<f32> {
    let raw = raw_pixel(i);
    return vec4(raw.xyz - scaled(steps[0], raw.w) - scaled(steps[1], raw.w), raw.w);
}

// Finds the mean color of a block and adds up what is left without it.
fn center_weighted() -> Totals {
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
    totals.energy = 0.0;
    for (var i = 0u; i < params.pixels; i++) {
        let pixel = centered_weighted_pixel(i);
        let off_alpha = pixel.w - rounded(inside(i) * totals.mean_alpha);
        let color = rounded(squared_length(pixel.xyz) * inverse(pixel.w));
        totals.energy += color + rounded(off_alpha * off_alpha);
    }
    return totals;
}
