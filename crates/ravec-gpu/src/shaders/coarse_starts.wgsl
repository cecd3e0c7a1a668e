// The lines to follow: the best splits of two sectors of angle at the coarsest level, one block a thread.

@group(0) @binding(1) var<storage, read> plane: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> found: array<f32>;
// first events of the sectors, and the end of the last
@group(0) @binding(7) var<storage, read> sectors: array<u32>;
@group(0) @binding(8) var<storage, read_write> starts: array<f32>;

fn raw_pixel(i: u32) -> vec4<f32> {
    return plane[i * params.blocks + block];
}

// The best of two sectors, the better first; of equal ones the lower number.
var<private> best: array<Best, STARTS>;

fn keep(candidate: Best, sector: u32) {
    if (sector == 0u || candidate.gain > best[0].gain) {
        best[1] = best[0];
        best[0] = candidate;
    } else if (sector == 1u || candidate.gain > best[1].gain) {
        best[1] = candidate;
    }
}

fn store_starts() {
    // a line that is not followed is the first one once more
    let second = select(0u, 1u, best[1].gain >= rounded(START_SHARE * best[0].gain));
    for (var start = 0u; start < STARTS; start++) {
        let event = best[start * second].event;
        for (var word = 0u; word < 3u; word++) {
            let at = (LINE_WORDS * start + word) * params.blocks + block;
            starts[at] = lines[3u * event + word];
        }
    }
}

fn takes(id: vec3<u32>, groups: vec3<u32>, is_opaque: f32) -> bool {
    block = id.y * groups.x * GROUP + id.x;
    return block < params.blocks && found[IS_OPAQUE * params.blocks + block] == is_opaque;
}

@compute @workgroup_size(GROUP)
fn opaque_starts(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    if (!takes(id, groups, 1.0)) {
        return;
    }
    let energy = center_opaque();
    begin_sweep();
    for (var sector = 0u; sector < SECTORS; sector++) {
        keep(sweep(sectors[sector], sectors[sector + 1u]), sector);
    }
    store_starts();
}

@compute @workgroup_size(GROUP)
fn weighted_starts(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    if (!takes(id, groups, 0.0)) {
        return;
    }
    let totals = center_weighted();
    begin_weighted_sweep();
    for (var sector = 0u; sector < SECTORS; sector++) {
        keep(weighted_sweep(totals, sectors[sector], sectors[sector + 1u]), sector);
    }
    store_starts();
}
