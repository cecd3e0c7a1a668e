//! TIFF: entries of the first directory get other tags, types, counts and values.

use super::{Hand, number};

/// Tags that decide how much is read and from where.
const TAGS: [u16; 26] = [
    254, 256, 257, 258, 259, 262, 266, 273, 274, 277, 278, 279, 284, 292, 317, 320, 322, 323, 324,
    325, 338, 339, 347, 530, 34675, 34665,
];

/// Values that tags have in files: compressions, kinds of color, predictors, formats of samples.
const VALUES: [u32; 20] = [
    1, 2, 3, 4, 5, 6, 7, 8, 16, 24, 32, 64, 128, 32773, 32946, 34712, 50000, 50001, 8, 16,
];

/// Changes an entry, or numbers anywhere.
pub fn mutated(input: &[u8], hand: &mut Hand) -> Option<Vec<u8>> {
    let little = match input.get(..4)? {
        b"II*\0" => true,
        b"MM\0*" => false,
        _ => return number::mutated(input, hand),
    };
    if hand.dice.below(3) == 0 {
        return number::mutated(input, hand);
    }
    let mut made = input.to_vec();
    let read16 = |bytes: &[u8]| {
        let bytes = [bytes[0], bytes[1]];
        if little {
            u16::from_le_bytes(bytes)
        } else {
            u16::from_be_bytes(bytes)
        }
    };
    let put16 = |slot: &mut [u8], value: u16| {
        slot.copy_from_slice(&if little {
            value.to_le_bytes()
        } else {
            value.to_be_bytes()
        });
    };
    let put32 = |slot: &mut [u8], value: u32| {
        slot.copy_from_slice(&if little {
            value.to_le_bytes()
        } else {
            value.to_be_bytes()
        });
    };
    let at: [u8; 4] = input.get(4..8)?.try_into().ok()?;
    let directory = if little {
        u32::from_le_bytes(at)
    } else {
        u32::from_be_bytes(at)
    } as usize;
    let count = usize::from(read16(input.get(directory..directory.checked_add(2)?)?));
    for _ in 0..=hand.dice.below(2) {
        let entry = directory + 2 + 12 * hand.dice.below(count);
        let entry = made.get_mut(entry..entry + 12)?;
        match hand.dice.below(6) {
            0 => put16(&mut entry[..2], *hand.dice.pick(&TAGS)),
            1 => put16(&mut entry[2..4], hand.dice.below(19) as u16),
            2 => put32(&mut entry[4..8], *hand.dice.pick(&number::INTEGERS) as u32),
            3 => put32(&mut entry[8..12], *hand.dice.pick(&number::INTEGERS) as u32),
            // a short value stands in the first two bytes
            4 => put16(&mut entry[8..10], *hand.dice.pick(&VALUES) as u16),
            _ => put32(&mut entry[8..12], hand.dice.below(input.len()) as u32),
        }
    }
    Some(made)
}
