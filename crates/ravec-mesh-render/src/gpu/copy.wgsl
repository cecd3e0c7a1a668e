// Lays a finished picture over the target: premultiplied linear light becomes premultiplied sRGB, or stays light where the
// target encodes it.

struct Copy {
    opacity: f32,
    encodes: u32,
}

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var<uniform> copy: Copy;

struct Corner {
    @builtin(position) at: vec4<f32>,
    @location(0) share: vec2<f32>,
}

@vertex
fn copy_vertex(@builtin(vertex_index) index: u32) -> Corner {
    // a triangle that covers the viewport
    let share = vec2(f32((index << 1u) & 2u), f32(index & 2u));
    return Corner(vec4(2.0 * share.x - 1.0, 1.0 - 2.0 * share.y, 0.0, 1.0), share);
}

@fragment
fn copy_fragment(corner: Corner) -> @location(0) vec4<f32> {
    let size = vec2<f32>(textureDimensions(picture));
    let place = vec2<i32>(min(corner.share * size, size - 1.0));
    let light = textureLoad(picture, place, 0);
    if light.a <= 0.0 {
        return vec4(0.0);
    }
    var color = clamp(light.rgb / light.a, vec3(0.0), vec3(1.0));
    if copy.encodes != 0u {
        color = select(1.055 * pow(color, vec3(1.0 / 2.4)) - 0.055, 12.92 * color, color <= vec3(0.0031308));
    }
    let alpha = copy.opacity * light.a;
    return vec4(color * alpha, alpha);
}
