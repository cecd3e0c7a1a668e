//! What reading may cost at most.

use crate::read::DecodeError;

/// Bounds on a picture that is read: every file is taken to be hostile.
///
/// Both are checked against the file's header before anything of the picture's size is allocated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// The most pixels a picture may have (default 400 million).
    pub max_pixels: u64,
    /// The most bytes that reading may hold at a time: encoded data in memory, the decoder's working memory and the
    /// decoded picture (default 8 GiB).
    pub max_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            max_pixels: 400_000_000,
            max_bytes: 8 << 30,
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

    /// Passes a need of `bytes`, or names the limit that it breaks.
    pub(crate) fn check_bytes(&self, bytes: u64) -> Result<(), DecodeError> {
        if bytes > self.max_bytes {
            return Err(DecodeError::TooManyBytes {
                bytes: Some(bytes),
                limit: self.max_bytes,
            });
        }
        Ok(())
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
    fn a_need_as_large_as_the_limit_passes() {
        let limits = Limits {
            max_pixels: 6,
            max_bytes: 7,
        };
        assert!(limits.check_pixels(2, 3).is_ok() && limits.check_bytes(7).is_ok());
        assert!(limits.check_pixels(7, 1).is_err() && limits.check_bytes(8).is_err());
        assert!(limits.check_pixels(u64::MAX, u64::MAX).is_err());
    }
}
