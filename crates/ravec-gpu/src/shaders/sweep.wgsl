// The rotating sweep over all splits of a block, one block a thread.
//
// Operation for operation that of ravec_twocolor's `sweep.rs`: see there for the idea. The kernel gives `raw_pixel(i)`, Oklab
// times weight and the weight, from memory where threads of a group find theirs side by side; the mean is taken off on the
// way, for pixels of its own would take as much memory as the prefixes. The prefixes are private to the thread; all threads
// of a group walk through the same events, so that their accesses lie side by side, too.
//
// Loops end at numbers of `params`: drivers unroll those with constant bounds, which takes them minutes.

@group(0) @binding(3) var<storage, read> order: array<u32>;
// prefix in the lower half, pixel in the upper
@group(0) @binding(4) var<storage, read> events: array<u32>;
@group(0) @binding(5) var<storage, read> gain_weights: array<f32>;
// n.x, n.y, d of each event
@group(0) @binding(6) var<storage, read> lines: array<f32>;

const PIXELS: u32 = SIDE * SIDE;
const HALF: f32 = 0.5 * (f32(SIDE) - 1.0);

var<private> prefixes: array<vec3<f32>, PIXELS + 1u>;

struct Found {
    event: u32,
    gain: f32,
    energy: f32,
    mean: vec3<f32>,
    sum_0: vec3<f32>,
    weights: vec2<f32>,
    insides: vec2<f32>,
}

// The first of the splits that gain most.
struct Best {
    event: u32,
    gain: f32,
}

fn centered_pixel(i: u32) -> vec3<f32> {
    return raw_pixel(i).xyz - steps[0] - steps[1];
}

// Finds the mean of an opaque block and returns the energy that is left without it.
fn center_opaque() -> f32 {
    let inverse_count = 1.0 / f32(PIXELS);
    steps[0] = vec3(0.0);
    steps[1] = vec3(0.0);
    for (var round = 0u; round < 2u; round++) {
        var total = vec3(0.0);
        for (var i = 0u; i < params.pixels; i++) {
            total += centered_pixel(i);
        }
        steps[round] = scaled(total, inverse_count);
    }
    var energy = 0.0;
    for (var i = 0u; i < params.pixels; i++) {
        energy += squared_length(centered_pixel(i));
    }
    return energy;
}

// Fills the prefixes of the initial order.
fn begin_sweep() {
    var sum = vec3(0.0);
    prefixes[0] = sum;
    for (var k = 0u; k < params.pixels; k++) {
        sum += centered_pixel(order[k]);
        prefixes[k + 1u] = sum;
    }
}

// Goes on with the events from `first` to before `end`.
fn sweep(first: u32, end: u32) -> Best {
    var best = Best(first, 0.0);
    for (var number = first; number < end; number++) {
        let event = events[number];
        let k = event & 0xffffu;
        let renewed = prefixes[k - 1u] + centered_pixel(event >> 16u);
        prefixes[k] = renewed;
        let gain = squared_length(renewed) * gain_weights[k];
        if (gain > best.gain) {
            best = Best(number, gain);
        }
    }
    return best;
}

// The best split of an opaque block.
fn best_split() -> Found {
    var found: Found;
    found.energy = center_opaque();
    found.mean = steps[0] + steps[1];
    begin_sweep();
    found.event = sweep(0u, params.events).event;

    // afresh: the running sums have drifted
    let normal = vec2(lines[3u * found.event], lines[3u * found.event + 1u]);
    let offset = lines[3u * found.event + 2u];
    found.sum_0 = vec3(0.0);
    for (var row = 0u; row < params.side; row++) {
        let limit = offset - rounded(normal.y * (f32(row) - HALF));
        for (var col = 0u; col < params.side; col++) {
            if (rounded(normal.x * (f32(col) - HALF)) < limit) {
                found.sum_0 += centered_pixel(row * params.side + col);
            }
        }
    }
    let prefix = events[found.event] & 0xffffu;
    found.gain = squared_length(found.sum_0) * gain_weights[prefix];
    return found;
}
