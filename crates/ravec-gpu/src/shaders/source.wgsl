// The rows of a picture in the pixel type that it has, read in linear light.
//
// FORMAT is one of the numbers below. `light` holds the linear light of each value of an integer sample, followed by its
// value on a scale of 0 to 1.

const SRGB8: u32 = 0u;
const SRGBA8: u32 = 1u;
const SRGB16: u32 = 2u;
const SRGBA16: u32 = 3u;
const LINEAR: u32 = 4u;
const LINEAR_ALPHA: u32 = 5u;

@group(0) @binding(1) var<storage, read> source: array<u32>;
@group(0) @binding(2) var<storage, read> light: array<f32>;

fn byte_at(index: u32) -> u32 {
    return (source[index >> 2u] >> (8u * (index & 3u))) & 0xffu;
}

fn half_at(index: u32) -> u32 {
    return (source[index >> 1u] >> (16u * (index & 1u))) & 0xffffu;
}

// Number `index` of the pixels that were uploaded.
fn source_pixel(index: u32) -> vec4<f32> {
    if (FORMAT == SRGB8) {
        let at = 3u * index;
        return vec4(light[byte_at(at)], light[byte_at(at + 1u)], light[byte_at(at + 2u)], 1.0);
    }
    if (FORMAT == SRGBA8) {
        let word = source[index];
        return vec4(
            light[word & 0xffu],
            light[(word >> 8u) & 0xffu],
            light[(word >> 16u) & 0xffu],
            light[256u + (word >> 24u)],
        );
    }
    if (FORMAT == SRGB16) {
        let at = 3u * index;
        return vec4(light[half_at(at)], light[half_at(at + 1u)], light[half_at(at + 2u)], 1.0);
    }
    if (FORMAT == SRGBA16) {
        let low = source[2u * index];
        let high = source[2u * index + 1u];
        return vec4(
            light[low & 0xffffu],
            light[low >> 16u],
            light[high & 0xffffu],
            light[65536u + (high >> 16u)],
        );
    }
    if (FORMAT == LINEAR) {
        let at = 3u * index;
        return vec4(
            bitcast<f32>(source[at]),
            bitcast<f32>(source[at + 1u]),
            bitcast<f32>(source[at + 2u]),
            1.0,
        );
    }
    let at = 4u * index;
    return vec4(
        bitcast<f32>(source[at]),
        bitcast<f32>(source[at + 1u]),
        bitcast<f32>(source[at + 2u]),
        bitcast<f32>(source[at + 3u]),
    );
}
