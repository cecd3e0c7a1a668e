//! Mutations that know the structure of a format: they keep checksums and lengths right, so that damage gets behind them.
//!
//! A mutator takes the bytes apart, changes a part, by [`Dice`] or by libFuzzer, and puts them together again. Bytes that
//! it cannot take apart are left to libFuzzer, and so is a share of all others.

mod jpeg;
mod number;
mod packed;
mod png;
mod riff;
mod text;
mod tiff;

/// The mutation of libFuzzer: bytes, their number, the most there may be; returns the new number.
pub type Plain = fn(&mut [u8], usize, usize) -> usize;

/// Random numbers (xorshift), enough to choose among mutations.
pub struct Dice(u64);

impl Dice {
    fn new(seed: u32) -> Self {
        Self(u64::from(seed).wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// A number below `bound`, which is at least 1.
    pub fn below(&mut self, bound: usize) -> usize {
        (self.next() >> 16) as usize % bound.max(1)
    }

    /// An element, of a slice that has some.
    pub fn pick<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.below(of.len())]
    }
}

/// Inputs of a structured mutation.
pub struct Hand {
    pub dice: Dice,
    plain: Plain,
}

impl Hand {
    /// A part changed by libFuzzer, which may grow by some bytes.
    pub fn changed(&mut self, part: &[u8]) -> Vec<u8> {
        let most = part.len() + 16 + self.dice.below(64);
        let mut bytes = part.to_vec();
        bytes.resize(most, 0);
        let size = (self.plain)(&mut bytes, part.len(), most);
        bytes.truncate(size);
        bytes
    }
}

/// Mutates an input of the target in place and returns its new size.
pub fn mutate(
    target: &str,
    data: &mut [u8],
    size: usize,
    max_size: usize,
    seed: u32,
    plain: Plain,
) -> usize {
    let mut hand = Hand {
        dice: Dice::new(seed),
        plain,
    };
    let input = &data[..size];
    // a share stays with libFuzzer, which also crosses inputs; PNG without right checksums is hardly examined
    let structured = hand.dice.below(8) > 1;
    let made = match target {
        _ if !structured => None,
        "png" => png::mutated(input, &mut hand),
        "jpeg" => jpeg::mutated(input, &mut hand),
        "webp" => riff::mutated(input, &mut hand),
        "tiff" => tiff::mutated(input, &mut hand),
        "bmp" | "exr" | "mp4" | "catalogue_file" => number::mutated(input, &mut hand),
        "hdr" | "ply" | "stl" => match hand.dice.below(2) {
            0 => number::mutated(input, &mut hand),
            _ => text::mutated(input, &mut hand),
        },
        "threemf_package" => packed::mutated_archive(input, &mut hand),
        "gltf" => packed::mutated_gltf(input, &mut hand),
        _ => text::mutated(input, &mut hand),
    };
    if let Some(made) = made
        && made.len() <= max_size
        && !made.is_empty()
    {
        data[..made.len()].copy_from_slice(&made);
        return made.len();
    }
    let size = plain(data, size, max_size);
    if target == "png"
        && let Some(repaired) = png::repaired(&data[..size])
    {
        data[..repaired.len()].copy_from_slice(&repaired);
    }
    size
}
