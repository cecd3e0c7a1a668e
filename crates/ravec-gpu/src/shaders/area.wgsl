// Areas on one side of a line.
//
// With a ≥ b the absolute components of the normal and u the distance of a pixel's center within a side, the side has
// `1/2 + u/a` of the pixel while the line crosses two opposite borders, `|u| ≤ (a − b)/2`, and else leaves or takes a
// triangle, `((a + b)/2 − |u|)² / 2ab`. No two large numbers are subtracted, so that single precision is enough.

// The share of the unit pixel on side 0; the normal need not have length 1.
fn share_at(normal: vec2<f32>, u: f32) -> f32 {
    let a = max(abs(normal.x), abs(normal.y));
    let b = min(abs(normal.x), abs(normal.y));
    if (abs(u) <= 0.5 * (a - b)) {
        return 0.5 + u / a;
    }
    let corner = max(0.5 * (a + b) - abs(u), 0.0);
    let cut = select(0.0, min(corner * corner / (2.0 * a * b), 1.0), corner > 0.0);
    return select(cut, 1.0 - cut, u > 0.0);
}

// A line along the border of pixels touches those on both sides: they count as crossed, however `u` is rounded.
const BORDER: f32 = 1e-5;

// The derivatives of the share with respect to u and, at fixed u, to the angle of the unit normal.
fn share_gradient(normal: vec2<f32>, u: f32) -> vec2<f32> {
    let size = abs(normal);
    // of |cos| and |sin|
    let turned = vec2(-normal.y * sign(normal.x), normal.x * sign(normal.y));
    let x_is_larger = size.x >= size.y;
    let a = select(size.y, size.x, x_is_larger);
    let b = select(size.x, size.y, x_is_larger);
    let da = select(turned.y, turned.x, x_is_larger);
    let db = select(turned.x, turned.y, x_is_larger);
    if (b < 1e-4) {
        return vec2(select(0.0, 1.0, abs(u) < 0.5 + BORDER), 0.0);
    }
    if (abs(u) <= 0.5 * (a - b)) {
        return vec2(1.0 / a, -u / (a * a) * da);
    }
    let corner = 0.5 * (a + b) - abs(u);
    if (corner <= 0.0) {
        return vec2(0.0);
    }
    let cut = corner * corner / (2.0 * a * b);
    let turn = (corner * 0.5 * (da + db) - cut * (da * b + a * db)) / (a * b);
    return vec2(corner / (a * b), select(turn, -turn, u > 0.0));
}
