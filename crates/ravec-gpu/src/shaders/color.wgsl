// Oklab, by the formulas of ravec_raster::color.

fn cube_root(x: f32) -> f32 {
    let sign = bitcast<u32>(x) & 0x80000000u;
    let bits = bitcast<u32>(x) & 0x7fffffffu;
    let a = bitcast<f32>(bits);
    let third = rounded(float_of(bits) * 0.33333334);
    var t = bitcast<f32>(u32(i32(third)) + 0x2a5119f2u);
    for (var step = 0; step < 2; step++) {
        let cube = rounded(rounded(t * t) * t);
        t = rounded(t * divided(cube + a + a, cube + cube + a));
    }
    // 0 below the smallest normal number
    return bitcast<f32>(select(bitcast<u32>(t), 0u, bits < 0x800000u) | sign);
}

fn oklab_from_linear(light: vec3<f32>) -> vec3<f32> {
    let l = cube_root(weighted_sum(light, vec3(0.41222146, 0.53633255, 0.051445995)));
    let m = cube_root(weighted_sum(light, vec3(0.2119035, 0.6806995, 0.10739696)));
    let s = cube_root(weighted_sum(light, vec3(0.08830246, 0.28171885, 0.6299787)));
    return vec3(
        rounded(0.21045426 * l) + rounded(0.7936178 * m) - rounded(0.004072047 * s),
        rounded(1.9779985 * l) - rounded(2.4285922 * m) + rounded(0.4505937 * s),
        rounded(0.025904037 * l) + rounded(0.78277177 * m) - rounded(0.80867577 * s),
    );
}

fn linear_from_oklab(lab: vec3<f32>) -> vec3<f32> {
    let l = lab.x + rounded(0.39633778 * lab.y) + rounded(0.21580376 * lab.z);
    let m = lab.x - rounded(0.105561346 * lab.y) - rounded(0.06385417 * lab.z);
    let s = lab.x - rounded(0.08948418 * lab.y) - rounded(1.2914855 * lab.z);
    let cubes = vec3(
        rounded(rounded(l * l) * l),
        rounded(rounded(m * m) * m),
        rounded(rounded(s * s) * s),
    );
    return vec3(
        rounded(4.0767417 * cubes.x) - rounded(3.3077116 * cubes.y) + rounded(0.23096994 * cubes.z),
        rounded(-1.268438 * cubes.x) + rounded(2.6097574 * cubes.y) - rounded(0.34131938 * cubes.z),
        rounded(-0.0041960863 * cubes.x) - rounded(0.7034186 * cubes.y) + rounded(1.7076147 * cubes.z),
    );
}
