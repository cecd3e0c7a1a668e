//! The size of an image: never zero.

/// Width and height of an image in pixels, both at least 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Size {
    width: u32,
    height: u32,
}

/// A width or a height was 0, or the picture would not fit into memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "an image of {width} x {height} pixels cannot be held: each side must be at least 1 and their product below 2^40"
)]
pub struct SizeError {
    /// The requested width.
    pub width: u64,
    /// The requested height.
    pub height: u64,
}

impl Size {
    /// The most pixels that a size may have. Keeps every byte count of an image far from overflow.
    pub const MAX_PIXELS: u64 = 1 << 40;

    /// A size of `width` × `height` pixels.
    ///
    /// # Errors
    /// [`SizeError`] if a side is 0 or larger than `u32::MAX`, or the product exceeds [`Size::MAX_PIXELS`].
    pub fn new(width: usize, height: usize) -> Result<Self, SizeError> {
        let error = SizeError {
            width: width as u64,
            height: height as u64,
        };
        let (Ok(w), Ok(h)) = (u32::try_from(width), u32::try_from(height)) else {
            return Err(error);
        };
        let pixels = u64::from(w) * u64::from(h);
        if pixels == 0 || pixels > Self::MAX_PIXELS {
            return Err(error);
        }
        Ok(Self {
            width: w,
            height: h,
        })
    }

    /// Columns, at least 1.
    pub fn width(self) -> usize {
        self.width as usize
    }

    /// Rows, at least 1.
    pub fn height(self) -> usize {
        self.height as usize
    }

    /// Columns × rows.
    pub fn pixels(self) -> usize {
        self.width() * self.height()
    }

    /// The size with its sides exchanged.
    pub fn transposed(self) -> Self {
        Self {
            width: self.height,
            height: self.width,
        }
    }

    /// Number of cells of `cell_px` × `cell_px` pixels, per axis, that cover the size; the last column and row may be
    /// partial.
    ///
    /// # Panics
    /// If `cell_px` is 0.
    pub fn cells(self, cell_px: usize) -> Self {
        Self {
            width: self.width().div_ceil(cell_px) as u32,
            height: self.height().div_ceil(cell_px) as u32,
        }
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} x {}", self.width, self.height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_has_no_zero_side_and_a_bounded_product() {
        assert!(Size::new(0, 5).is_err());
        assert!(Size::new(5, 0).is_err());
        assert!(Size::new(usize::MAX, 2).is_err());
        assert!(Size::new(1 << 21, 1 << 21).is_err());
        assert_eq!(Size::new(3, 4).map(Size::pixels), Ok(12));
    }

    #[test]
    fn cells_cover_the_last_column_and_row() {
        let size = Size::new(17, 8).unwrap();
        assert_eq!(size.cells(8), Size::new(3, 1).unwrap());
    }
}
