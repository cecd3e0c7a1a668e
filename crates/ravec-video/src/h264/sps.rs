//! Sequence parameter sets: sizes, cropping, and what decoding needs.

use super::bits::{BitReader, BitWriter, with_emulation, without_emulation};
use super::vui::Vui;

/// Profile of the decoder's copy of a set: scalable baseline, which has the syntax of the high profiles and no reordering.
const PROFILE_WITHOUT_REORDERING: u8 = 83;

/// Level 5.2.
const HIGHEST_LEVEL: u8 = 52;

/// The profiles whose sets have the syntax of the high profiles.
const HIGH_SYNTAX: [u8; 12] = [100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134];

/// The profiles whose pictures the decoder reads, if depth and chroma allow.
const READ_PROFILES: [u8; 7] = [66, 77, 88, 100, 110, 122, 244];

/// The largest picture that the decoder reads, in macroblocks of 16 × 16 pixels: that of level 5.2.
const MAX_MACROBLOCKS: u32 = 36_864;

/// A sequence parameter set.
#[derive(Debug, Clone, PartialEq)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "the flags of the standard, one for one"
)]
pub(crate) struct Sps {
    profile: u8,
    constraints: u8,
    level: u8,
    id: u32,
    /// 0 gray, 1 4:2:0, 2 4:2:2, 3 4:4:4.
    chroma_format: u32,
    depth_luma: u32,
    depth_chroma: u32,
    transform_bypass: bool,
    /// Bits of the scaling lists, as they are.
    scaling: Option<Vec<bool>>,
    frame_number_bits: u32,
    order: PictureOrder,
    reference_frames: u32,
    number_gaps: bool,
    /// Macroblocks.
    columns: u32,
    /// Macroblocks of a frame, or of a field if interlaced.
    map_rows: u32,
    frames_only: bool,
    adaptive_fields: bool,
    direct_8x8: bool,
    /// Left, right, top, bottom, in units of chroma.
    pub(crate) crop: [u32; 4],
    /// Meaning of the samples, if stated.
    pub(crate) vui: Option<Vui>,
}

#[derive(Debug, Clone, PartialEq)]
enum PictureOrder {
    LowBits(u32),
    Cycle {
        always_zero: bool,
        other_offset: i32,
        bottom_offset: i32,
        offsets: Vec<i32>,
    },
    Decoding,
}

impl Sps {
    /// Reads a set from its NAL unit; `None` if it is cut or breaks the syntax.
    pub(crate) fn parse(nal: &[u8]) -> Option<Self> {
        let payload = without_emulation(nal.get(1..)?);
        let [profile, constraints, level] = *payload.first_chunk()?;
        let mut bits = BitReader::new(&payload[3..]);
        let id = bits.ue().filter(|&id| id < 32)?;
        let mut sps = Self {
            profile,
            constraints,
            level,
            id,
            chroma_format: 1,
            depth_luma: 8,
            depth_chroma: 8,
            transform_bypass: false,
            scaling: None,
            frame_number_bits: 0,
            order: PictureOrder::Decoding,
            reference_frames: 0,
            number_gaps: false,
            columns: 0,
            map_rows: 0,
            frames_only: true,
            adaptive_fields: false,
            direct_8x8: false,
            crop: [0; 4],
            vui: None,
        };
        if HIGH_SYNTAX.contains(&profile) {
            sps.parse_high(&mut bits)?;
        }
        sps.frame_number_bits = bits.ue().filter(|&bits| bits <= 12)?;
        sps.order = PictureOrder::parse(&mut bits)?;
        sps.reference_frames = bits.ue().filter(|&frames| frames <= 16)?;
        sps.number_gaps = bits.bit()?;
        // so bounded, products of sizes fit 64 bits and sizes in pixels 32
        let macroblocks = |count: u32| (count < 1 << 16).then_some(count + 1);
        sps.columns = macroblocks(bits.ue()?)?;
        sps.map_rows = macroblocks(bits.ue()?)?;
        sps.frames_only = bits.bit()?;
        if !sps.frames_only {
            sps.adaptive_fields = bits.bit()?;
        }
        sps.direct_8x8 = bits.bit()?;
        if bits.bit()? {
            for side in &mut sps.crop {
                *side = bits.ue()?;
            }
        }
        if bits.bit()? {
            // a damaged description of colors is no reason to refuse the frames
            sps.vui = Vui::parse(&mut bits);
        }
        sps.cropped_size()?;
        Some(sps)
    }

    fn parse_high(&mut self, bits: &mut BitReader) -> Option<()> {
        self.chroma_format = bits.ue().filter(|&format| format <= 3)?;
        if self.chroma_format == 3 {
            // separate planes are refused with the rest of 4:4:4
            bits.bit()?;
        }
        self.depth_luma = 8 + bits.ue().filter(|&more| more <= 6)?;
        self.depth_chroma = 8 + bits.ue().filter(|&more| more <= 6)?;
        self.transform_bypass = bits.bit()?;
        if bits.bit()? {
            let lists = if self.chroma_format == 3 { 12 } else { 8 };
            self.scaling = Some(parse_scaling(bits, lists)?);
        }
        Some(())
    }

    /// Columns and rows of the coded frame.
    pub(crate) fn coded_size(&self) -> (u32, u32) {
        let fields = if self.frames_only { 1 } else { 2 };
        (16 * self.columns, 16 * self.map_rows * fields)
    }

    /// Pixels per unit of cropping.
    fn crop_unit(&self) -> (u32, u32) {
        let (x, y) = match self.chroma_format {
            1 => (2, 2),
            2 => (2, 1),
            _ => (1, 1),
        };
        (x, if self.frames_only { y } else { 2 * y })
    }

    /// First column and row, width and height of the cropped frame; `None` if nothing remains.
    pub(crate) fn cropped_size(&self) -> Option<[u32; 4]> {
        let ((width, height), (x, y)) = (self.coded_size(), self.crop_unit());
        let [left, right, top, bottom] = self.crop;
        let side = |length: u32, first: u32, last: u32, unit: u32| {
            let first = first.checked_mul(unit)?;
            let rest = length
                .checked_sub(first)?
                .checked_sub(last.checked_mul(unit)?)?;
            (rest > 0).then_some((first, rest))
        };
        let (col, width) = side(width, left, right, x)?;
        let (row, height) = side(height, top, bottom, y)?;
        Some([col, row, width, height])
    }

    /// The property of the pictures that the decoder does not read, if any.
    pub(crate) fn unsupported(&self) -> Option<String> {
        if self.chroma_format != 1 {
            let colors = ["gray", "4:2:0", "4:2:2", "4:4:4"][self.chroma_format as usize];
            return Some(format!("H.264 with {colors} samples"));
        }
        if (self.depth_luma, self.depth_chroma) != (8, 8) {
            return Some(format!(
                "H.264 with {} bits a sample",
                self.depth_luma.max(self.depth_chroma)
            ));
        }
        if !self.frames_only {
            return Some("interlaced H.264".to_owned());
        }
        if self.transform_bypass {
            return Some("lossless H.264".to_owned());
        }
        if !READ_PROFILES.contains(&self.profile) {
            return Some(format!("H.264 of profile {}", self.profile));
        }
        if self
            .vui
            .and_then(|vui| vui.color)
            .is_some_and(|[_, _, matrix]| matrix == 0 || matrix == 8)
        {
            return Some("H.264 whose colors are not Y'CbCr".to_owned());
        }
        // the decoder bounds each side as well, by that of a frame eight times as long as it is wide
        let side = self.columns.max(self.map_rows);
        if self.columns * self.map_rows > MAX_MACROBLOCKS || side * side > 8 * MAX_MACROBLOCKS {
            let (width, height) = self.coded_size();
            return Some(format!("H.264 with frames of {width} x {height} pixels"));
        }
        None
    }

    /// True if frames of both sets have one size.
    pub(crate) fn same_pictures(&self, other: &Self) -> bool {
        (self.coded_size(), self.crop) == (other.coded_size(), other.crop)
    }

    /// The set as the decoder gets it: without cropping and description of colors, which are applied here, with a profile for
    /// which it hands out pictures at once, and with the highest level that it knows, because sizes were checked.
    pub(crate) fn for_decoder(&self) -> Vec<u8> {
        let sps = Self {
            profile: PROFILE_WITHOUT_REORDERING,
            constraints: 0,
            level: HIGHEST_LEVEL,
            crop: [0; 4],
            vui: None,
            ..self.clone()
        };
        sps.to_nal()
    }

    /// The set as a NAL unit.
    pub(crate) fn to_nal(&self) -> Vec<u8> {
        let mut bits = BitWriter::default();
        bits.ue(self.id);
        if HIGH_SYNTAX.contains(&self.profile) {
            bits.ue(self.chroma_format);
            if self.chroma_format == 3 {
                bits.bit(false);
            }
            bits.ue(self.depth_luma - 8);
            bits.ue(self.depth_chroma - 8);
            bits.bit(self.transform_bypass);
            bits.bit(self.scaling.is_some());
            for &bit in self.scaling.iter().flatten() {
                bits.bit(bit);
            }
        }
        bits.ue(self.frame_number_bits);
        self.order.write(&mut bits);
        bits.ue(self.reference_frames);
        bits.bit(self.number_gaps);
        bits.ue(self.columns - 1);
        bits.ue(self.map_rows - 1);
        bits.bit(self.frames_only);
        if !self.frames_only {
            bits.bit(self.adaptive_fields);
        }
        bits.bit(self.direct_8x8);
        bits.bit(self.crop != [0; 4]);
        if self.crop != [0; 4] {
            self.crop.iter().for_each(|&side| bits.ue(side));
        }
        bits.bit(self.vui.is_some());
        if let Some(vui) = &self.vui {
            vui.write(&mut bits, self.reference_frames);
        }
        let mut payload = vec![self.profile, self.constraints, self.level];
        payload.extend(bits.finish());
        let mut nal = vec![0x67];
        nal.extend(with_emulation(&payload));
        nal
    }
}

/// Steps over scaling lists and keeps their bits.
fn parse_scaling(bits: &mut BitReader, lists: usize) -> Option<Vec<bool>> {
    let mut copy = BitCopy {
        bits,
        copied: Vec::new(),
    };
    for list in 0..lists {
        if !copy.bit()? {
            continue;
        }
        let (mut last, mut next) = (8i32, 8i32);
        for _ in 0..if list < 6 { 16 } else { 64 } {
            if next != 0 {
                next = (last + copy.se()?).rem_euclid(256);
            }
            last = if next == 0 { last } else { next };
        }
    }
    Some(copy.copied)
}

/// A reader that keeps the bits that it read.
struct BitCopy<'a, 'b> {
    bits: &'a mut BitReader<'b>,
    copied: Vec<bool>,
}

impl BitCopy<'_, '_> {
    fn bit(&mut self) -> Option<bool> {
        let bit = self.bits.bit()?;
        self.copied.push(bit);
        Some(bit)
    }

    /// A signed code of at most 17 bits, which all deltas of scaling lists are.
    fn se(&mut self) -> Option<i32> {
        let mut zeros = 0;
        while !self.bit()? {
            zeros += 1;
            if zeros > 8 {
                return None;
            }
        }
        let mut code = 1i32;
        for _ in 0..zeros {
            code = code << 1 | i32::from(self.bit()?);
        }
        Some(if code % 2 == 0 { code / 2 } else { -(code / 2) })
    }
}

impl PictureOrder {
    fn parse(bits: &mut BitReader) -> Option<Self> {
        Some(match bits.ue()? {
            0 => Self::LowBits(bits.ue().filter(|&bits| bits <= 12)?),
            1 => Self::Cycle {
                always_zero: bits.bit()?,
                other_offset: bits.se()?,
                bottom_offset: bits.se()?,
                offsets: (0..bits.ue().filter(|&count| count <= 255)?)
                    .map(|_| bits.se())
                    .collect::<Option<_>>()?,
            },
            2 => Self::Decoding,
            _ => return None,
        })
    }

    fn write(&self, bits: &mut BitWriter) {
        match self {
            Self::LowBits(low) => {
                bits.ue(0);
                bits.ue(*low);
            }
            Self::Cycle {
                always_zero,
                other_offset,
                bottom_offset,
                offsets,
            } => {
                bits.ue(1);
                bits.bit(*always_zero);
                bits.se(*other_offset);
                bits.se(*bottom_offset);
                bits.ue(offsets.len() as u32);
                for &offset in offsets {
                    bits.se(offset);
                }
            }
            Self::Decoding => bits.ue(2),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{ColorInfo, Range, Siting};
    use crate::time::Rational;

    /// 60 × 44 pixels of High profile by x264, with B-frames.
    const HIGH: [u8; 25] = [
        0x67, 0x64, 0x00, 0x0a, 0xac, 0xd9, 0x44, 0x7e, 0xef, 0x01, 0x10, 0x00, 0x00, 0x03, 0x00,
        0x10, 0x00, 0x00, 0x03, 0x03, 0x20, 0xf1, 0x22, 0x59, 0x60,
    ];

    #[test]
    fn a_set_of_x264_is_read() {
        let sps = Sps::parse(&HIGH).unwrap();
        assert_eq!(sps.unsupported(), None);
        assert_eq!((sps.profile, sps.level), (100, 10));
        let again = Sps::parse(&sps.to_nal()).unwrap();
        assert_eq!(again, sps);
        let simple = Sps::parse(&sps.for_decoder()).unwrap();
        assert_eq!(
            (simple.profile, simple.vui, simple.crop),
            (83, None, [0; 4])
        );
        assert_eq!(simple.coded_size(), sps.coded_size());
        assert_eq!(simple.order, sps.order);
    }

    #[test]
    fn cut_sets_are_refused_or_lack_only_the_description() {
        let whole = Sps::parse(&HIGH).unwrap();
        for end in 0..HIGH.len() {
            if let Some(sps) = Sps::parse(&HIGH[..end]) {
                assert_eq!(
                    Sps {
                        vui: whole.vui,
                        ..sps
                    },
                    whole,
                    "{end}"
                );
            }
        }
    }

    #[test]
    fn descriptions_survive_a_round_trip() {
        let base = Sps::parse(&HIGH).unwrap();
        for (matrix, full, siting) in [
            (1, true, Siting::CENTER),
            (6, false, Siting::TOP_LEFT),
            (9, true, Siting::LEFT),
        ] {
            let mut color = ColorInfo::guess(48);
            color.set_matrix_code(matrix);
            color.range = if full { Range::Full } else { Range::Limited };
            color.siting = siting;
            (color.primaries, color.transfer) = (matrix, 13);
            let aspect = Rational::new(4, 3).unwrap();
            let sps = Sps {
                vui: Some(Vui::of(color, aspect)),
                crop: [0, 1, 0, 2],
                ..base.clone()
            };
            let read = Sps::parse(&sps.to_nal()).unwrap();
            let mut found = ColorInfo::guess(48);
            read.vui.unwrap().apply(&mut found);
            assert_eq!(found, color);
            assert_eq!(read.vui.unwrap().pixel_aspect, Some(aspect));
            let (width, height) = sps.coded_size();
            assert_eq!(read.cropped_size(), Some([0, 0, width - 2, height - 4]));
        }
    }

    #[test]
    fn cropping_that_leaves_nothing_is_refused() {
        let sps = Sps {
            crop: [0, 1000, 0, 0],
            ..Sps::parse(&HIGH).unwrap()
        };
        assert_eq!(Sps::parse(&sps.to_nal()), None);
        let sps = Sps {
            crop: [u32::MAX - 1, 1, 0, 0],
            ..sps
        };
        assert_eq!(Sps::parse(&sps.to_nal()), None);
    }

    #[test]
    fn what_the_decoder_does_not_read_has_a_name() {
        let base = Sps::parse(&HIGH).unwrap();
        let cases = [
            (
                Sps {
                    chroma_format: 3,
                    ..base.clone()
                },
                "4:4:4",
            ),
            (
                Sps {
                    depth_luma: 10,
                    ..base.clone()
                },
                "10 bits",
            ),
            (
                Sps {
                    frames_only: false,
                    ..base.clone()
                },
                "interlaced",
            ),
            (
                Sps {
                    transform_bypass: true,
                    ..base.clone()
                },
                "lossless",
            ),
            (
                Sps {
                    columns: 1000,
                    map_rows: 1000,
                    ..base.clone()
                },
                "16000 x 16000",
            ),
            (
                Sps {
                    columns: 600,
                    map_rows: 1,
                    ..base
                },
                "9600 x 16",
            ),
        ];
        for (sps, name) in cases {
            let reason = sps.unsupported().unwrap();
            assert!(reason.contains(name), "{reason}");
        }
    }
}
