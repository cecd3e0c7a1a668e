//! Numbers that are likely to trip a reader.

use super::Hand;

/// Bounds of integers, and what lies beside them.
pub const INTEGERS: [u64; 24] = [
    0,
    1,
    2,
    3,
    7,
    8,
    15,
    16,
    17,
    31,
    32,
    127,
    128,
    255,
    256,
    32_767,
    32_768,
    65_535,
    65_536,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    i64::MAX as u64,
    u64::MAX,
];

/// Writes an integer of 1, 2, 4 or 8 bytes, in one of both orders, somewhere, more often near the start.
pub fn mutated(input: &[u8], hand: &mut Hand) -> Option<Vec<u8>> {
    let mut made = input.to_vec();
    for _ in 0..=hand.dice.below(2) {
        let width = *hand.dice.pick(&[1, 2, 4, 8]);
        let reach = if hand.dice.below(2) == 0 {
            made.len()
        } else {
            made.len().min(128)
        };
        let at = hand.dice.below(reach);
        let slot = made.get_mut(at..at + width)?;
        let mut old = [0; 8];
        old[..width].copy_from_slice(slot);
        let old = u64::from_le_bytes(old);
        let value = match hand.dice.below(4) {
            0 => old.wrapping_add(hand.dice.below(9) as u64).wrapping_sub(4),
            1 => old ^ 1 << hand.dice.below(8 * width),
            _ => *hand.dice.pick(&INTEGERS),
        };
        let bytes = value.to_le_bytes();
        slot.copy_from_slice(&bytes[..width]);
        if hand.dice.below(2) == 0 {
            slot.reverse();
        }
    }
    Some(made)
}
