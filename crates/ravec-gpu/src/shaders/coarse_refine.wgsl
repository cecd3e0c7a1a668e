// Moves the lines of each block to the best place near them: two blocks a group, a candidate of a line a thread.

@group(0) @binding(1) var<storage, read> prefixes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> found: array<f32>;
@group(0) @binding(3) var<storage, read_write> starts: array<f32>;
// For each block at the finest level what was found.
@group(0) @binding(4) var<storage, read_write> results: array<f32>;

const WORDS: u32 = 15u;

// Threads of a line, of which the grid has work for 9 and the climb for 8.
const SLOTS: u32 = 16u;

struct Line {
    normal: vec2<f32>,
    offset: f32,
    gain: f32,
}

// Sums over a side of a line: color times weight and the weight, and the pixels inside the image.
struct Sums {
    sum: vec4<f32>,
    inside: f32,
}

var<workgroup> gains: array<f32, GROUP>;
var<workgroup> bests: array<Line, GROUP / SLOTS>;

fn word(number: u32) -> f32 {
    return found[number * params.blocks + block];
}

// 1 / whole, 0 where there is none.
fn share_of(whole: f32) -> f32 {
    return select(0.0, reciprocal(whole), whole > MIN_SHARED);
}

// The line with its two ends moved by `a` and `b` pixels along the normal.
fn moved(line: Line, a: f32, b: f32) -> Line {
    let turn = (a - b) * params.inverse_side;
    let normal = vec2(
        line.normal.x - rounded(turn * line.normal.y),
        line.normal.y + rounded(turn * line.normal.x),
    );
    return Line(normal, line.offset + 0.5 * (a + b), 0.0);
}

// A start of the next coarser level, in pixels of this one.
fn scaled_start(start: u32) -> Line {
    let at = LINE_WORDS * start * params.blocks + block;
    let normal = vec2(starts[at], starts[at + params.blocks]);
    let length = square_root(rounded(normal.x * normal.x) + rounded(normal.y * normal.y));
    return Line(
        vec2(divided(normal.x, length), divided(normal.y, length)),
        2.0 * divided(starts[at + 2u * params.blocks], length),
        0.0,
    );
}

// The sums over the side of the line that lies towards smaller x (or y where the line is flatter).
fn sums_below(line: Line) -> Sums {
    let half = 0.5 * (f32(params.side) - 1.0);
    let limit = f32(params.side);
    let by_rows = abs(line.normal.x) >= abs(line.normal.y);
    let along = select(line.normal.y, line.normal.x, by_rows);
    let across = select(line.normal.x, line.normal.y, by_rows);
    // pixel i of row j lies below the line where i < begin + j · step
    let step = divided(-across, along);
    let begin = divided(line.offset, along) + half - rounded(step * half);
    let first = block * 2u * params.side + select(params.side, 0u, by_rows);
    var sums = Sums(vec4(0.0), 0.0);
    for (var j = 0u; j < params.side; j++) {
        let end = min(max(begin + rounded(f32(j) * step), 0.0), limit);
        let whole = u32(end);
        let k = min(whole + select(0u, 1u, f32(whole) < end), params.side);
        sums.sum += prefixes[(first + j) * (params.side + 1u) + k];
        sums.inside += inside_below(j, k, by_rows);
    }
    return sums;
}

// Pixels of the image in the first `k` pixels of row (or column) `j`, in pixels of this level.
fn inside_below(j: u32, k: u32, by_rows: bool) -> f32 {
    let corner = vec2(block % params.columns_of_blocks, block / params.columns_of_blocks)
        * params.side;
    let origin = (corner + select(vec2(j, 0u), vec2(0u, j), by_rows)) * params.factor;
    let size = select(vec2(1u, k), vec2(k, 1u), by_rows) * params.factor;
    let end = vec2(params.width, params.rows);
    let cells = min(end - min(origin, end), size);
    return f32(cells.x * cells.y) * params.pixel_share;
}

fn gain_of(line: Line) -> f32 {
    let below = sums_below(line);
    let weight_0 = below.sum.w;
    let weight_1 = word(WEIGHT) * params.pixel_share - weight_0;
    let inside_1 = word(INSIDE) * params.pixel_share - below.inside;
    if (below.inside <= MIN_SHARED || inside_1 <= MIN_SHARED) {
        return 0.0;
    }
    let both = share_of(weight_0) + share_of(weight_1);
    let colors = rounded(squared_length(below.sum.xyz) * both);
    let off_alpha = weight_0 - rounded(below.inside * word(MEAN_ALPHA));
    let both_inside = share_of(below.inside) + share_of(inside_1);
    return colors + rounded(rounded(off_alpha * off_alpha) * both_inside);
}

// The first of `count` candidates of a line that gain most and more than `least`; `count` if there is none.
fn best_candidate(first: u32, count: u32, least: f32) -> u32 {
    var best = count;
    var gain = least;
    for (var slot = 0u; slot < count; slot++) {
        if (gains[first + slot] > gain) {
            best = slot;
            gain = gains[first + slot];
        }
    }
    return best;
}

fn grid_move(line: Line, slot: u32) -> Line {
    let a = (f32(slot / 3u) - 1.0) * GRID_STEP;
    let b = (f32(slot % 3u) - 1.0) * GRID_STEP;
    return moved(line, a, b);
}

// One of the eight neighbors of the line in steps of its two ends.
fn climb_move(line: Line, slot: u32, step: f32) -> Line {
    let place = slot + select(0u, 1u, slot >= 4u);
    return moved(line, step * (f32(place / 3u) - 1.0), step * (f32(place % 3u) - 1.0));
}

@compute @workgroup_size(GROUP)
fn refine(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let wanted = (group.y * groups.x + group.x) * 2u + local / (STARTS * SLOTS);
    // threads beyond the last block repeat it: all of a group meet at the barriers
    block = min(wanted, params.blocks - 1u);
    let start = local / SLOTS % STARTS;
    let slot = local % SLOTS;
    let first = local - slot;

    let line = scaled_start(start);
    gains[local] = gain_of(grid_move(line, min(slot, 8u)));
    workgroupBarrier();
    // a gain is at least 0
    let begin = best_candidate(first, 9u, -1.0);
    var best = grid_move(line, begin);
    best.gain = gains[first + begin];
    workgroupBarrier();

    var step = CLIMB_STEP;
    for (var round = 0u; round < CLIMB_ROUNDS; round++) {
        gains[local] = gain_of(climb_move(best, min(slot, 7u), step));
        workgroupBarrier();
        let better = best_candidate(first, 8u, best.gain);
        if (better < 8u) {
            best = climb_move(best, better, step);
            best.gain = gains[first + better];
        }
        workgroupBarrier();
        step *= 0.5;
    }
    if (slot == 0u) {
        bests[local / SLOTS] = best;
    }
    workgroupBarrier();

    if (local % (STARTS * SLOTS) == 0u && wanted < params.blocks) {
        var ahead = bests[local / SLOTS];
        var behind = bests[local / SLOTS + 1u];
        if (behind.gain > ahead.gain) {
            let swapped = ahead;
            ahead = behind;
            behind = swapped;
        }
        if (params.is_finest == 1u) {
            store(ahead);
        } else {
            keep(0u, ahead);
            keep(1u, behind);
        }
    }
}

fn keep(start: u32, line: Line) {
    let at = LINE_WORDS * start * params.blocks + block;
    starts[at] = line.normal.x;
    starts[at + params.blocks] = line.normal.y;
    starts[at + 2u * params.blocks] = line.offset;
}

fn store(line: Line) {
    var side_0 = sums_below(line);
    let by_rows = abs(line.normal.x) >= abs(line.normal.y);
    if (select(line.normal.y, line.normal.x, by_rows) < 0.0) {
        // what lies below is side 1
        var total = vec4(0.0);
        let first = block * 2u * params.side;
        for (var row = 0u; row < params.side; row++) {
            total += prefixes[(first + row) * (params.side + 1u) + params.side];
        }
        side_0 = Sums(total - side_0.sum, word(INSIDE) - side_0.inside);
    }
    let at = WORDS * block;
    results[at] = line.normal.x;
    results[at + 1u] = line.normal.y;
    results[at + 2u] = line.offset;
    results[at + 3u] = line.gain;
    results[at + 4u] = word(ENERGY);
    for (var channel = 0u; channel < 3u; channel++) {
        results[at + 5u + channel] = word(STEPS + channel) + word(STEPS + 3u + channel);
        results[at + 8u + channel] = side_0.sum[channel];
    }
    results[at + 11u] = word(WEIGHT);
    results[at + 12u] = side_0.sum.w;
    results[at + 13u] = word(INSIDE);
    results[at + 14u] = side_0.inside;
}
