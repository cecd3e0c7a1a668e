//! The meaning of samples, as a sequence parameter set states it (video usability information).

use super::bits::{BitReader, BitWriter};
use crate::color::{ColorInfo, Range, Siting, SitingAxis};
use crate::time::Rational;

/// Tables of `aspect_ratio_idc`, from 1.
const ASPECT_RATIOS: [(u32, u32); 16] = [
    (1, 1),
    (12, 11),
    (10, 11),
    (16, 11),
    (40, 33),
    (24, 11),
    (20, 11),
    (32, 11),
    (80, 33),
    (18, 11),
    (15, 11),
    (64, 33),
    (160, 99),
    (4, 3),
    (3, 2),
    (2, 1),
];

/// `aspect_ratio_idc` for numbers that follow.
const EXTENDED_ASPECT: u32 = 255;

/// Meaning of samples, as far as a set states it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Vui {
    /// Width by height of a pixel.
    pub(crate) pixel_aspect: Option<Rational>,
    /// True for full range.
    pub(crate) full_range: Option<bool>,
    /// Primaries, transfer and matrix by H.273.
    pub(crate) color: Option<[u8; 3]>,
    /// Position of chroma samples: `chroma_sample_loc_type`.
    pub(crate) chroma_location: Option<u32>,
}

impl Vui {
    /// Reads the part up to the position of chroma.
    pub(super) fn parse(bits: &mut BitReader) -> Option<Self> {
        let mut vui = Self::default();
        if bits.bit()? {
            vui.pixel_aspect = match bits.bits(8)? {
                EXTENDED_ASPECT => Rational::new(bits.bits(16)?, bits.bits(16)?),
                code => ASPECT_RATIOS
                    .get((code as usize).wrapping_sub(1))
                    .and_then(|&(x, y)| Rational::new(x, y)),
            };
        }
        if bits.bit()? {
            // overscan
            bits.bit()?;
        }
        if bits.bit()? {
            // the analog standard
            bits.bits(3)?;
            vui.full_range = Some(bits.bit()?);
            if bits.bit()? {
                let code = bits.bits(24)?.to_be_bytes();
                vui.color = Some([code[1], code[2], code[3]]);
            }
        }
        if bits.bit()? {
            vui.chroma_location = Some(bits.ue()?);
            bits.ue()?;
        }
        Some(vui)
    }

    /// Writes the description, with the promise that pictures come in the order of display.
    pub(super) fn write(&self, bits: &mut BitWriter, reference_frames: u32) {
        bits.bit(self.pixel_aspect.is_some());
        if let Some(aspect) = self.pixel_aspect {
            bits.bits(EXTENDED_ASPECT, 8);
            bits.bits(aspect.num(), 16);
            bits.bits(aspect.den(), 16);
        }
        bits.bit(false);
        let described = self.full_range.is_some() || self.color.is_some();
        bits.bit(described);
        if described {
            // unspecified analog standard
            bits.bits(5, 3);
            bits.bit(self.full_range == Some(true));
            bits.bit(self.color.is_some());
            for code in self.color.into_iter().flatten() {
                bits.bits(u32::from(code), 8);
            }
        }
        bits.bit(self.chroma_location.is_some());
        if let Some(location) = self.chroma_location {
            bits.ue(location);
            bits.ue(location);
        }
        // no timing, no hypothetical decoder, no structure of pictures; then the restrictions
        bits.bits(0b0_0_0_0_1, 5);
        bits.bit(true);
        for restriction in [0, 0, 16, 16, 0, reference_frames] {
            bits.ue(restriction);
        }
    }

    /// Replaces what the set states in `color`.
    pub(crate) fn apply(&self, color: &mut ColorInfo) {
        use SitingAxis::{Center, First, Last};
        if let Some(full) = self.full_range {
            color.range = if full { Range::Full } else { Range::Limited };
            color.tagged = true;
        }
        if let Some([primaries, transfer, matrix]) = self.color {
            (color.primaries, color.transfer) = (primaries, transfer);
            color.set_matrix_code(matrix);
        }
        let (x, y) = match self.chroma_location {
            None => return,
            Some(1) => (Center, Center),
            Some(2) => (First, First),
            Some(3) => (Center, First),
            Some(4) => (First, Last),
            Some(5) => (Center, Last),
            Some(_) => (First, Center),
        };
        color.siting = Siting { x, y };
    }

    /// The description of `color`; `None` for the position of chroma if it has no code.
    pub(crate) fn of(color: ColorInfo, pixel_aspect: Rational) -> Self {
        use SitingAxis::{Center, First, Last};
        let aspect = pixel_aspect.reduced();
        let stored = (aspect.num() < 1 << 16 && aspect.den() < 1 << 16).then_some(aspect);
        Self {
            pixel_aspect: stored,
            full_range: color.tagged.then_some(color.range == Range::Full),
            color: color
                .tagged
                .then_some([color.primaries, color.transfer, color.matrix_code()]),
            chroma_location: match (color.siting.x, color.siting.y) {
                (Center, Center) => Some(1),
                (First, First) => Some(2),
                (Center, First) => Some(3),
                (First, Last) => Some(4),
                (Center, Last) => Some(5),
                (First, Center) | (Last, _) => None,
            },
        }
    }
}
