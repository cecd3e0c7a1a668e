// Pixels as fits see them.

// True for a number within the range of light that fits compute with. By its bits, since compilers may assume that there are no
// others.
fn is_countable(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) <= MAX_LIGHT_BITS;
}

// A pixel as fits see it: Oklab times the weight, and the weight. What is not a number counts as fully transparent.
fn weighted_oklab(pixel: vec4<f32>) -> vec4<f32> {
    let countable = is_countable(pixel.x) && is_countable(pixel.y) && is_countable(pixel.z)
        && is_countable(pixel.w);
    if (!countable) {
        return vec4(0.0);
    }
    let weight = clamp(pixel.w, 0.0, 1.0);
    let lab = oklab_from_linear(pixel.xyz);
    return vec4(rounded(weight * lab.x), rounded(weight * lab.y), rounded(weight * lab.z), weight);
}
