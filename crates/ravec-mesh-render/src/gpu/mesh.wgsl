// The picture of a mesh: surface, lines, and the outline of a section, as `tile.rs`, `scene.rs` and `lines.rs` draw it.

struct View {
    // from a place relative to the origin of the mesh to clip coordinates
    clip: mat4x4<f32>,
    // from space to the coordinates of the view
    turn: mat3x3<f32>,
    // the eye relative to the origin of the mesh; with w = 0 the direction toward it
    eye: vec4<f32>,
    // xyz · place + w is above 0 for what the section takes away
    section: vec4<f32>,
    front: vec4<f32>,
    back: vec4<f32>,
    cut: vec4<f32>,
    // width and height in pixels, pixels per unit of length at unit distance, depth per unit of length there
    screen: vec4<f32>,
    // FLAT, SHADED, ...
    flags: u32,
    // one of PLAIN, VERTEX_COLORS, ...
    paint: u32,
}

const FLAT: u32 = 1u;
const SHADED: u32 = 2u;
const CUT_OPEN: u32 = 4u;
const CAPPED: u32 = 8u;

const PLAIN: u32 = 0u;
const VERTEX_COLORS: u32 = 1u;
const FACE_COLORS: u32 = 2u;
const VERTEX_VALUES: u32 = 3u;
const FACE_VALUES: u32 = 4u;

const NO_NUMBER: f32 = -1e6;

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> positions: array<f32>;
@group(0) @binding(2) var<storage, read> triangles: array<u32>;
@group(0) @binding(3) var<storage, read> normals: array<u32>;
@group(0) @binding(4) var<storage, read> paints: array<u32>;
// the scale of colors, and at its end the color of what is not a number
@group(0) @binding(5) var<storage, read> scale: array<vec4<f32>>;

fn position(vertex: u32) -> vec3<f32> {
    return vec3(positions[3u * vertex], positions[3u * vertex + 1u], positions[3u * vertex + 2u]);
}

fn corner(triangle: u32, which: u32) -> vec3<f32> {
    return position(triangles[3u * triangle + which]);
}

fn face_normal(triangle: u32) -> vec3<f32> {
    let a = corner(triangle, 0u);
    let normal = cross(corner(triangle, 1u) - a, corner(triangle, 2u) - a);
    let size = length(normal);
    return select(vec3(0.0), normal / size, size > 0.0);
}

// A unit vector from its place on an octahedron; 0 from the code of no direction.
fn direction(packed: u32) -> vec3<f32> {
    if packed == 0x80008000u {
        return vec3(0.0);
    }
    let at = unpack2x16snorm(packed);
    var d = vec3(at, 1.0 - abs(at.x) - abs(at.y));
    if d.z < 0.0 {
        let folded = (1.0 - abs(at.yx)) * select(vec2(-1.0), vec2(1.0), at >= vec2(0.0));
        d = vec3(folded, d.z);
    }
    return normalize(d);
}

fn toward_eye(place: vec3<f32>) -> vec3<f32> {
    return normalize(view.eye.xyz - view.eye.w * place);
}

fn beyond_section(place: vec3<f32>) -> f32 {
    if (view.flags & CUT_OPEN) == 0u {
        return -1.0;
    }
    return dot(view.section.xyz, place) + view.section.w;
}

// ---- surface

struct Surface {
    @builtin(position) at: vec4<f32>,
    @location(0) place: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) color: vec3<f32>,
    // value as a share of the scale; below NO_NUMBER if it is none
    @location(3) share: f32,
}

fn linear(color: vec3<f32>) -> vec3<f32> {
    return select(pow((color + 0.055) / 1.055, vec3(2.4)), color / 12.92, color <= vec3(0.04045));
}

@vertex
fn surface_vertex(@builtin(vertex_index) index: u32) -> Surface {
    let triangle = index / 3u;
    let vertex = triangles[index];
    let place = position(vertex);
    var out: Surface;
    out.at = view.clip * vec4(place, 1.0);
    out.place = place;
    if (view.flags & FLAT) != 0u {
        out.normal = face_normal(triangle);
    } else {
        out.normal = direction(normals[index]);
    }
    if view.paint == VERTEX_COLORS {
        out.color = linear(unpack4x8unorm(paints[vertex]).rgb);
    } else if view.paint == FACE_COLORS {
        out.color = linear(unpack4x8unorm(paints[triangle]).rgb);
    } else if view.paint == VERTEX_VALUES {
        out.share = bitcast<f32>(paints[vertex]);
    } else if view.paint == FACE_VALUES {
        out.share = bitcast<f32>(paints[triangle]);
    }
    return out;
}

const TO_KEY: vec3<f32> = vec3(-0.4082483, 0.57735, 0.70710678);
const TO_FILL: vec3<f32> = vec3(0.805823, 0.161165, 0.569803);
const KEY_POWER: f32 = 0.62;
const FILL_POWER: f32 = 0.15;
const SKY: f32 = 0.34;
const GROUND: f32 = 0.12;
const SHINE: f32 = 0.14;
const SHARPNESS: f32 = 32.0;
const RELIEF_OF_NUMBERS: f32 = 0.5;
const BACK_OF_NUMBERS: f32 = 0.55;

fn lit(color: vec3<f32>, has_numbers: bool, normal: vec3<f32>, eye: vec3<f32>) -> vec3<f32> {
    let key = max(dot(normal, TO_KEY), 0.0);
    let fill = max(dot(normal, TO_FILL), 0.0);
    let sky = GROUND + (SKY - GROUND) * (0.5 + 0.5 * normal.y);
    let bright = KEY_POWER * key + FILL_POWER * fill + sky;
    if has_numbers {
        return color * (1.0 + RELIEF_OF_NUMBERS * (bright - 1.0));
    }
    let half = normalize(TO_KEY + eye);
    return color * bright + SHINE * pow(max(dot(normal, half), 0.0), SHARPNESS);
}

@fragment
fn surface_fragment(in: Surface, @builtin(front_facing) is_front: bool) -> @location(0) vec4<f32> {
    if beyond_section(in.place) > 0.0 {
        discard;
    }
    if (view.flags & CAPPED) != 0u && !is_front {
        return vec4(view.cut.rgb, 1.0);
    }
    let has_numbers = view.paint != PLAIN;
    var color = select(view.back.rgb, view.front.rgb, is_front);
    if has_numbers {
        color = in.color;
        if view.paint >= VERTEX_VALUES {
            let steps = arrayLength(&scale) - 1u;
            var entry = steps;
            if in.share > NO_NUMBER {
                entry = u32(clamp(in.share, 0.0, 1.0) * f32(steps - 1u) + 0.5);
            }
            color = scale[entry].rgb;
        }
        color *= select(BACK_OF_NUMBERS, 1.0, is_front);
    }
    if (view.flags & SHADED) == 0u {
        return vec4(color, 1.0);
    }
    let eye = view.turn * toward_eye(in.place);
    var normal = view.turn * in.normal;
    normal = select(-normal, normal, is_front);
    // smoothed normals may lean away from the eye at silhouettes
    normal -= min(dot(normal, eye), 0.0) * eye;
    let size = length(normal);
    normal = select(eye, normal / size, size > 1e-6);
    return vec4(lit(color, has_numbers, normal, eye), 1.0);
}

// ---- lines

struct Style {
    color: vec4<f32>,
    // half of the width in pixels
    half_width: f32,
    // cosine of the angle from which an edge is a feature
    crease_cos: f32,
    // ALL_EDGES or FEATURES
    edges: u32,
    silhouettes: u32,
}

const ALL_EDGES: u32 = 0u;
const FEATURES: u32 = 1u;

@group(1) @binding(0) var<uniform> style: Style;

struct Edge {
    @location(0) ends: vec2<u32>,
    // of the triangles beside it, the second one as if it ran along the edge the other way than the first
    @location(1) normals: vec2<u32>,
    @location(2) kind: u32,
}

// Kinds of edges, and a bit for two triangles that run along the edge the same way.
const FEATURE: u32 = 0u;
const BEND: u32 = 1u;
const FLAT_EDGE: u32 = 2u;
const TWISTED: u32 = 4u;

struct Line {
    @builtin(position) at: vec4<f32>,
    @location(0) place: vec3<f32>,
    // pixels beside the middle of the line
    @location(1) beside: f32,
}

const MIN_BIAS: f32 = 1e-5;
const MAX_BIAS: f32 = 5e-3;

// By how much the depth of a surface changes over a pixel.
fn slope(normal: vec3<f32>, distance: f32) -> f32 {
    let n = view.turn * normal;
    return length(n.xy) / max(abs(n.z), 1e-6) * view.screen.w / (view.screen.z * distance);
}

fn hidden() -> Line {
    var out: Line;
    out.at = vec4(0.0, 0.0, -1.0, 1.0);
    return out;
}

// A corner of the strip of four that covers a line.
fn line_corner(index: u32, a: vec3<f32>, b: vec3<f32>, normal_a: vec3<f32>, normal_b: vec3<f32>) -> Line {
    let is_end = (index & 1u) != 0u;
    let side = select(-1.0, 1.0, (index & 2u) != 0u);
    let from_clip = view.clip * vec4(a, 1.0);
    let to_clip = view.clip * vec4(b, 1.0);
    let half_size = 0.5 * view.screen.xy;
    var along = (to_clip.xy / to_clip.w - from_clip.xy / from_clip.w) * half_size;
    let size = length(along);
    along = select(vec2(1.0, 0.0), along / size, size > 1e-6);
    let across = vec2(-along.y, along.x);
    let reach = style.half_width + 0.5;
    let offset = side * reach * across + select(-1.0, 1.0, is_end) * style.half_width * along;
    var at = select(from_clip, to_clip, is_end);
    at += vec4(offset / half_size * at.w, 0.0, 0.0);
    let steepest = max(slope(normal_a, at.w), slope(normal_b, at.w));
    // a line lies on the surface that slopes toward the eye beside it
    at.z += clamp(steepest * (reach + 1.0), MIN_BIAS, MAX_BIAS) * at.w;
    var out: Line;
    out.at = at;
    out.place = select(a, b, is_end);
    out.beside = side * reach;
    return out;
}

@vertex
fn edge_vertex(@builtin(vertex_index) index: u32, edge: Edge) -> Line {
    let a = position(edge.ends.x);
    let b = position(edge.ends.y);
    let first = direction(edge.normals.x);
    let second = direction(edge.normals.y);
    if style.edges == FEATURES {
        let kind = edge.kind & 3u;
        let is_crease = kind == BEND && dot(first, second) < style.crease_cos;
        let eye = toward_eye(a);
        let twist = select(1.0, -1.0, (edge.kind & TWISTED) != 0u);
        let turns = (dot(first, eye) > 0.0) != (twist * dot(second, eye) > 0.0);
        let is_silhouette = kind == BEND && style.silhouettes != 0u && turns;
        if kind != FEATURE && !is_crease && !is_silhouette {
            return hidden();
        }
    }
    return line_corner(index, a, b, first, second);
}

// The line in which a triangle is cut.
@vertex
fn cut_vertex(@builtin(vertex_index) index: u32, @builtin(instance_index) triangle: u32) -> Line {
    var places: array<vec3<f32>, 3>;
    var count = 0u;
    for (var i = 0u; i < 3u; i++) {
        let a = corner(triangle, i);
        let b = corner(triangle, (i + 1u) % 3u);
        let beyond_a = beyond_section(a);
        let beyond_b = beyond_section(b);
        if (beyond_a > 0.0) != (beyond_b > 0.0) {
            places[count] = mix(a, b, beyond_a / (beyond_a - beyond_b));
            count++;
        }
    }
    if count != 2u {
        return hidden();
    }
    let normal = face_normal(triangle);
    return line_corner(index, places[0], places[1], normal, normal);
}

fn covered(line: Line) -> vec4<f32> {
    let cover = clamp(style.half_width + 0.5 - abs(line.beside), 0.0, 1.0);
    return vec4(style.color.rgb * cover, cover);
}

@fragment
fn edge_fragment(line: Line) -> @location(0) vec4<f32> {
    if beyond_section(line.place) > 0.0 {
        discard;
    }
    return covered(line);
}

@fragment
fn cut_fragment(line: Line) -> @location(0) vec4<f32> {
    return covered(line);
}
