//! Text made of words, numbers and lines.

use super::Hand;

const NUMBERS: [&str; 30] = [
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "3",
    "0.5",
    "-0.5",
    "255",
    "256",
    "4294967295",
    "4294967296",
    "-2147483648",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551615",
    "18446744073709551616",
    "1e9",
    "1e-9",
    "1e38",
    "1e39",
    "1e308",
    "1e309",
    "-1e308",
    "5e-324",
    "NaN",
    "nan",
    "inf",
    "-inf",
    "99999999999999999999999999999999999999999",
];

/// Changes a number, or repeats, drops or exchanges words or lines.
pub fn mutated(input: &[u8], hand: &mut Hand) -> Option<Vec<u8>> {
    match hand.dice.below(6) {
        0..=2 => with_other_number(input, hand),
        3 => with_other_pieces(input, hand, |byte| byte == b'\n'),
        4 => with_other_pieces(input, hand, |byte| b" \n,<>{}[]\"".contains(&byte)),
        _ => Some(hand.changed(input)),
    }
}

/// Puts another number in the place of one.
fn with_other_number(input: &[u8], hand: &mut Hand) -> Option<Vec<u8>> {
    let is_number = |byte: u8| byte.is_ascii_digit() || b"+-.eE".contains(&byte);
    let starts: Vec<usize> = (0..input.len())
        .filter(|&at| {
            input[at].is_ascii_digit()
                && (at == 0 || !is_number(input[at - 1]) || input[at - 1] == b'-')
        })
        .collect();
    if starts.is_empty() {
        return None;
    }
    let start = *hand.dice.pick(&starts);
    let length = input[start..]
        .iter()
        .take_while(|&&byte| is_number(byte))
        .count();
    let number = match hand.dice.below(4) {
        // that of another place
        0 => {
            let other = *hand.dice.pick(&starts);
            let length = input[other..]
                .iter()
                .take_while(|&&byte| is_number(byte))
                .count();
            input[other..other + length].to_vec()
        }
        1 => hand.changed(&input[start..start + length]),
        _ => hand.dice.pick(&NUMBERS).as_bytes().to_vec(),
    };
    Some([&input[..start], &number, &input[start + length..]].concat())
}

/// Repeats, drops or exchanges pieces, each with the separator behind it.
fn with_other_pieces(input: &[u8], hand: &mut Hand, is_end: fn(u8) -> bool) -> Option<Vec<u8>> {
    let mut pieces: Vec<&[u8]> = input.split_inclusive(|&byte| is_end(byte)).collect();
    if pieces.len() < 2 {
        return None;
    }
    let first = hand.dice.below(pieces.len());
    let other = hand.dice.below(pieces.len());
    match hand.dice.below(4) {
        0 => {
            pieces.remove(first);
        }
        1 => pieces.insert(other, pieces[first]),
        2 => pieces.swap(first, other),
        // a block, again and again
        _ => {
            let end = (first + 1 + hand.dice.below(8)).min(pieces.len());
            let block = pieces[first..end].to_vec();
            for _ in 0..=hand.dice.below(16) {
                pieces.splice(end..end, block.iter().copied());
            }
        }
    }
    Some(pieces.concat())
}
