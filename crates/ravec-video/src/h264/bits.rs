//! Bits of parameter sets: Exp-Golomb codes and emulation prevention.

/// Reads bits from the first of a byte on.
pub(super) struct BitReader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> BitReader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    pub(super) fn bit(&mut self) -> Option<bool> {
        let byte = self.bytes.get(self.at / 8)?;
        let bit = byte >> (7 - self.at % 8) & 1;
        self.at += 1;
        Some(bit == 1)
    }

    /// Up to 32 bits.
    pub(super) fn bits(&mut self, count: u32) -> Option<u32> {
        let mut value = 0u32;
        for _ in 0..count {
            value = value << 1 | u32::from(self.bit()?);
        }
        Some(value)
    }

    /// An unsigned Exp-Golomb code below 2^32 - 1.
    pub(super) fn ue(&mut self) -> Option<u32> {
        let mut zeros = 0;
        while !self.bit()? {
            zeros += 1;
            if zeros > 31 {
                return None;
            }
        }
        Some((1u32 << zeros) - 1 + self.bits(zeros)?)
    }

    /// A signed Exp-Golomb code.
    pub(super) fn se(&mut self) -> Option<i32> {
        let code = i64::from(self.ue()?);
        let value = if code % 2 == 1 {
            (code + 1) / 2
        } else {
            -(code / 2)
        };
        i32::try_from(value).ok()
    }
}

/// Writes bits from the first of a byte on.
#[derive(Default)]
pub(super) struct BitWriter {
    bytes: Vec<u8>,
    filled: u32,
}

impl BitWriter {
    pub(super) fn bit(&mut self, bit: bool) {
        if self.filled.is_multiple_of(8) {
            self.bytes.push(0);
        }
        if let Some(last) = self.bytes.last_mut() {
            *last |= u8::from(bit) << (7 - self.filled % 8);
        }
        self.filled += 1;
    }

    pub(super) fn bits(&mut self, value: u32, count: u32) {
        for at in (0..count).rev() {
            self.bit(value >> at & 1 == 1);
        }
    }

    pub(super) fn ue(&mut self, value: u32) {
        let code = u64::from(value) + 1;
        let length = 64 - code.leading_zeros();
        for _ in 1..length {
            self.bit(false);
        }
        for at in (0..length).rev() {
            self.bit(code >> at & 1 == 1);
        }
    }

    pub(super) fn se(&mut self, value: i32) {
        let magnitude = value.unsigned_abs();
        self.ue(if value > 0 {
            2 * magnitude - 1
        } else {
            2 * magnitude
        });
    }

    /// The bytes after the stop bit.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.bit(true);
        self.bytes
    }
}

/// The payload of a NAL unit without the bytes that keep it from looking like a start code.
pub(super) fn without_emulation(nal: &[u8]) -> Vec<u8> {
    let mut payload = Vec::with_capacity(nal.len());
    let mut zeros = 0;
    for &byte in nal {
        if zeros >= 2 && byte == 3 {
            zeros = 0;
            continue;
        }
        zeros = if byte == 0 { zeros + 1 } else { 0 };
        payload.push(byte);
    }
    payload
}

/// The payload with the bytes that keep it from looking like a start code.
pub(super) fn with_emulation(payload: &[u8]) -> Vec<u8> {
    let mut nal = Vec::with_capacity(payload.len() + 4);
    let mut zeros = 0;
    for &byte in payload {
        if zeros >= 2 && byte <= 3 {
            nal.push(3);
            zeros = 0;
        }
        zeros = if byte == 0 { zeros + 1 } else { 0 };
        nal.push(byte);
    }
    nal
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn codes_that_are_written_are_read(values in prop::collection::vec((0..u32::MAX - 1, any::<i16>(), 0..33u32), 0..40)) {
            let mut writer = BitWriter::default();
            for &(unsigned, signed, count) in &values {
                writer.ue(unsigned);
                writer.se(i32::from(signed));
                writer.bits(unsigned, count);
            }
            let bytes = writer.finish();
            let mut reader = BitReader::new(&bytes);
            for &(unsigned, signed, count) in &values {
                prop_assert_eq!(reader.ue(), Some(unsigned));
                prop_assert_eq!(reader.se(), Some(i32::from(signed)));
                let low = (u64::from(unsigned) & ((1u64 << count) - 1)) as u32;
                prop_assert_eq!(reader.bits(count), Some(low));
            }
        }

        #[test]
        fn emulation_prevention_hides_start_codes_and_is_undone(payload in prop::collection::vec(0u8..5, 0..60)) {
            let nal = with_emulation(&payload);
            prop_assert!(!nal.windows(3).any(|three| three[0] == 0 && three[1] == 0 && three[2] <= 2));
            prop_assert_eq!(without_emulation(&nal), payload);
        }
    }

    #[test]
    fn the_end_of_the_bits_is_no_code() {
        assert_eq!(BitReader::new(&[0, 0, 0, 0, 0, 0]).ue(), None);
        assert_eq!(BitReader::new(&[]).bit(), None);
        assert_eq!(BitReader::new(&[0xff]).bits(9), None);
    }
}
