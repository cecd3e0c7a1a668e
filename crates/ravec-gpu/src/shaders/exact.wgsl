// Arithmetic that gives the bits of the CPU.
//
// Sums, differences and products are rounded correctly on every device, but a compiler may contract `a * b + c` to one
// operation with one rounding, and `b` of `a + (b - a)`. `rounded` hides a product or difference from it: `params.zero` is 0,
// which the compiler cannot know.
// Quotients may be off by 2.5 units in the last place; `divided` corrects them in integers.

fn rounded(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) ^ params.zero);
}

// a / b, correctly rounded, for normal numbers with a normal quotient; for others what the device gives.
fn divided(a: f32, b: f32) -> f32 {
    let estimate = a / b;
    let bits = bitcast<u32>(estimate);
    let a_bits = bitcast<u32>(a) & 0x7fffffffu;
    let b_bits = bitcast<u32>(b) & 0x7fffffffu;
    let a_mantissa = (a_bits & 0x7fffffu) | 0x800000u;
    let b_mantissa = (b_bits & 0x7fffffu) | 0x800000u;
    // the quotient of the mantissas, shifted so that it has 24 bits
    let shift = select(23u, 24u, a_mantissa < b_mantissa);
    let exponent = i32(a_bits >> 23u) - i32(b_bits >> 23u) + 150 - i32(shift);
    let quotient = corrected(bits, exponent, a_mantissa << shift, b_mantissa);
    let magnitude = (u32(exponent) << 23u) + (quotient - 0x800000u);
    let normal = min(a_bits, b_bits) >= 0x800000u && max(a_bits, b_bits) < 0x7f800000u
        && exponent > 1 && exponent < 254;
    return select(estimate, bitcast<f32>(magnitude | (bits & 0x80000000u)), normal);
}

// 1 / b, correctly rounded, for 1e-30 < b < 1e30.
fn reciprocal(b: f32) -> f32 {
    let bits = bitcast<u32>(1.0 / b);
    let b_bits = bitcast<u32>(b);
    let b_mantissa = (b_bits & 0x7fffffu) | 0x800000u;
    let exponent = 254 - i32(b_bits >> 23u) - select(0, 1, b_mantissa > 0x800000u);
    // 2^46 and 2^47 have no lower 32 bits
    let quotient = corrected(bits, exponent, 0u, b_mantissa);
    return bitcast<f32>((u32(exponent) << 23u) + (quotient - 0x800000u));
}

// The nearest integer to dividend / divisor, of 24 bits, given a float whose mantissa is some units off. Only the lowest 32 bits of
// the dividend are needed, since the remainder is a few divisors at most.
fn corrected(estimate: u32, exponent: i32, dividend: u32, divisor: u32) -> u32 {
    let mantissa = (estimate & 0x7fffffu) | 0x800000u;
    let off = i32((estimate >> 23u) & 0xffu) - exponent;
    var quotient = select(select(mantissa, mantissa << 1u, off > 0), mantissa >> 1u, off < 0);
    let length = i32(divisor);
    var remainder = i32(dividend - quotient * divisor);
    let steps = i32(floor(f32(remainder) / f32(length)));
    quotient += u32(steps);
    remainder -= steps * length;
    let last = select(select(0, 1, remainder >= length), -1, remainder < 0);
    quotient += u32(last);
    remainder -= last * length;
    // quotients of numbers with 24 bits never lie halfway between two such numbers
    return quotient + select(0u, 1u, 2 * remainder > length);
}

// The nearest number with 24 bits, ties to even, to an integer below 2^31.
fn float_of(value: u32) -> f32 {
    let excess = u32(max(0, 8 - i32(countLeadingZeros(value))));
    if (excess == 0u) {
        return f32(value);
    }
    let half = (1u << (excess - 1u)) - 1u + ((value >> excess) & 1u);
    return f32(((value + half) >> excess) << excess);
}

fn squared_length(v: vec3<f32>) -> f32 {
    return rounded(v.x * v.x) + rounded(v.y * v.y) + rounded(v.z * v.z);
}

// The products of a and b, added from the left.
fn weighted_sum(a: vec3<f32>, b: vec3<f32>) -> f32 {
    return rounded(a.x * b.x) + rounded(a.y * b.y) + rounded(a.z * b.z);
}

fn scaled(v: vec3<f32>, factor: f32) -> vec3<f32> {
    return vec3(rounded(v.x * factor), rounded(v.y * factor), rounded(v.z * factor));
}

// The square root, correctly rounded, of a normal number.
fn square_root(x: f32) -> f32 {
    let bits = bitcast<u32>(x);
    let power = i32(bits >> 23u) - 127;
    let mantissa = (bits & 0x7fffffu) | 0x800000u;
    let odd = u32(power & 1);
    let exponent = (power - i32(odd)) / 2 + 127;
    // the square of the result's mantissa is mantissa · 2^23 or 2^24, of which the lowest 32 bits are enough
    let square = mantissa << (23u + odd);
    let estimate = bitcast<u32>(sqrt(x));
    let found = (estimate & 0x7fffffu) | 0x800000u;
    let off = i32(estimate >> 23u) - exponent;
    var root = select(select(found, found << 1u, off > 0), found >> 1u, off < 0);
    var remainder = i32(square - root * root);
    for (var round = 0u; round < 4u; round++) {
        if (remainder > i32(root)) {
            remainder -= 2 * i32(root) + 1;
            root += 1u;
        } else if (remainder <= -i32(root)) {
            remainder += 2 * i32(root) - 1;
            root -= 1u;
        }
    }
    return bitcast<f32>((u32(exponent) << 23u) + (root - 0x800000u));
}
