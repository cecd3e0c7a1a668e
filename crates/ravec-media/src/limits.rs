//! Limits on what reading may cost.

use crate::read::DecodeError;
use ravec_memory::{MemoryBudget, OverBudget};

/// Bounds on a picture that is read: every file is taken to be hostile.
///
/// Both are checked against the file's header before anything of the picture's size is allocated. Clones share the memory
/// budget, so that all files that are read with one `Limits`, by however many threads, share it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    /// The most pixels a picture may have (default 400 million).
    pub max_pixels: u64,
    /// Memory for encoded data, decoders and decoded pictures, as long as these exist (default: half of the memory of the
    /// machine).
    pub memory: MemoryBudget,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_pixels: 400_000_000,
            memory: MemoryBudget::default(),
        }
    }
}

impl Limits {
    /// Passes a picture of `width` × `height` pixels, or names the limit that it breaks.
    pub(crate) fn check_pixels(&self, width: u64, height: u64) -> Result<(), DecodeError> {
        if width.saturating_mul(height) > self.max_pixels {
            return Err(DecodeError::TooManyPixels {
                width,
                height,
                limit: self.max_pixels,
            });
        }
        Ok(())
    }
}

/// Reports the whole need of a picture, of which `reserved` bytes were reserved before.
pub(crate) fn over_budget(over: OverBudget, reserved: u64) -> DecodeError {
    DecodeError::TooManyBytes {
        bytes: Some(over.needed.saturating_add(reserved)),
        others: over.used.saturating_sub(reserved),
        limit: over.limit,
    }
}

/// A number of bytes as people read it.
pub(crate) fn display_bytes(bytes: u64) -> String {
    const UNITS: [&str; 5] = ["KiB", "MiB", "GiB", "TiB", "PiB"];
    if bytes < 1024 {
        return format!("{bytes} bytes");
    }
    let mut value = bytes as f64 / 1024.0;
    let mut unit = 0;
    while value >= 1024.0 && unit + 1 < UNITS.len() {
        value /= 1024.0;
        unit += 1;
    }
    format!("{value:.1} {}", UNITS[unit])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_shown_in_the_largest_fitting_unit() {
        assert_eq!(display_bytes(1000), "1000 bytes");
        assert_eq!(display_bytes(1536), "1.5 KiB");
        assert_eq!(display_bytes(8 << 30), "8.0 GiB");
        assert_eq!(display_bytes(u64::MAX), "16384.0 PiB");
    }

    #[test]
    fn a_picture_as_large_as_the_limit_passes() {
        let limits = Limits {
            max_pixels: 6,
            memory: MemoryBudget::unlimited(),
        };
        assert!(limits.check_pixels(2, 3).is_ok());
        assert!(limits.check_pixels(7, 1).is_err());
        assert!(limits.check_pixels(u64::MAX, u64::MAX).is_err());
    }

    #[test]
    fn the_sentence_names_the_need_the_limit_and_what_others_hold() {
        let budget = MemoryBudget::new(8 << 20);
        let held = budget.reserve(2 << 20).unwrap();
        let own = budget.reserve(1 << 20).unwrap();
        let over = budget.reserve(6 << 20).unwrap_err();
        let sentence = over_budget(over, own.bytes()).to_string();
        assert_eq!(
            sentence,
            "reading the picture needs 7.0 MiB, more than the limit of 8.0 MiB of which 2.0 MiB are in use (raise `max_bytes`)"
        );
        drop(held);
        let over = budget.reserve(9 << 20).unwrap_err();
        let sentence = over_budget(over, own.bytes()).to_string();
        assert_eq!(
            sentence,
            "reading the picture needs 10.0 MiB, more than the limit of 8.0 MiB (raise `max_bytes`)"
        );
    }
}
