//! Colors of coded frames: matrix, range, chroma subsampling and siting.

use serde::{Deserialize, Serialize};

/// The matrix between R′G′B′ and Y′CbCr.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Matrix {
    /// Standard definition, JPEG, and most of what carries no tag.
    Bt601,
    /// High definition.
    Bt709,
    /// Ultra high definition, non-constant luminance.
    Bt2020,
}

impl Matrix {
    /// The weights of red and blue in luma, Kr and Kb.
    pub fn luma_weights(self) -> (f64, f64) {
        match self {
            Self::Bt601 => (0.299, 0.114),
            Self::Bt709 => (0.2126, 0.0722),
            Self::Bt2020 => (0.2627, 0.0593),
        }
    }

    /// The matrix that players take for frames of this height without a tag: BT.709 from 720 rows, else BT.601.
    pub fn of_height(height: usize) -> Self {
        if height >= 720 {
            Self::Bt709
        } else {
            Self::Bt601
        }
    }
}

/// The codes between black and white.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Range {
    /// 16 to 235 for luma and 16 to 240 for chroma, at 8 bits.
    Limited,
    /// All codes.
    Full,
}

/// Colors per number of luma samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Subsampling {
    /// No chroma.
    #[serde(rename = "gray")]
    Gray,
    /// One chroma sample for 2 × 2 of luma.
    #[serde(rename = "4:2:0")]
    S420,
    /// One chroma sample for 2 × 1 of luma.
    #[serde(rename = "4:2:2")]
    S422,
    /// One chroma sample for 1 × 2 of luma: a rotated 4:2:2.
    #[serde(rename = "4:4:0")]
    S440,
    /// One chroma sample for 4 × 1 of luma.
    #[serde(rename = "4:1:1")]
    S411,
    /// One chroma sample for each of luma.
    #[serde(rename = "4:4:4")]
    S444,
}

impl Subsampling {
    /// Base-2 logarithms of the luma samples per chroma sample, horizontally and vertically; `None` without chroma.
    pub fn log2_steps(self) -> Option<(u32, u32)> {
        match self {
            Self::Gray => None,
            Self::S420 => Some((1, 1)),
            Self::S422 => Some((1, 0)),
            Self::S440 => Some((0, 1)),
            Self::S411 => Some((2, 0)),
            Self::S444 => Some((0, 0)),
        }
    }

    /// Size of a chroma plane for luma of this size; odd sides round up. `None` without chroma.
    pub fn chroma_size(self, width: usize, height: usize) -> Option<(usize, usize)> {
        let (x, y) = self.log2_steps()?;
        Some((width.div_ceil(1 << x), height.div_ceil(1 << y)))
    }
}

/// Position of a chroma sample among the luma samples that it stands for, along one axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SitingAxis {
    /// On the first luma sample (left or top).
    First,
    /// Midway between them.
    Center,
    /// On the last luma sample (right or bottom), as in a clip that was turned.
    Last,
}

/// Position of the chroma samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Siting {
    /// Horizontally.
    pub x: SitingAxis,
    /// Vertically.
    pub y: SitingAxis,
}

impl Siting {
    /// MPEG-2, H.264 and later: left, midway between rows.
    pub const LEFT: Self = Self {
        x: SitingAxis::First,
        y: SitingAxis::Center,
    };
    /// JPEG and MPEG-1: in the middle.
    pub const CENTER: Self = Self {
        x: SitingAxis::Center,
        y: SitingAxis::Center,
    };
    /// Ultra high definition: on the first sample in both directions.
    pub const TOP_LEFT: Self = Self {
        x: SitingAxis::First,
        y: SitingAxis::First,
    };
}

/// Meaning of coded samples. The numbers of primaries and transfer are those of ITU-T H.273 (2 is "unspecified"); they are
/// carried from source to sink and do not change how samples are converted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct ColorInfo {
    /// Matrix between R′G′B′ and Y′CbCr.
    pub matrix: Matrix,
    /// Codes of black and white.
    pub range: Range,
    /// Position of chroma samples.
    pub siting: Siting,
    /// Primaries by H.273.
    pub primaries: u8,
    /// Transfer characteristics by H.273.
    pub transfer: u8,
    /// False if matrix and range are a guess because the file does not name them.
    pub tagged: bool,
}

/// "Unspecified" in H.273.
pub const UNSPECIFIED: u8 = 2;

impl ColorInfo {
    /// The usual meaning of frames of this height without a tag.
    pub fn guess(height: usize) -> Self {
        Self {
            matrix: Matrix::of_height(height),
            range: Range::Limited,
            siting: Siting::LEFT,
            primaries: UNSPECIFIED,
            transfer: UNSPECIFIED,
            tagged: false,
        }
    }

    /// The code of the matrix by H.273: 6, 1 or 9.
    pub fn matrix_code(&self) -> u8 {
        match self.matrix {
            Matrix::Bt601 => 6,
            Matrix::Bt709 => 1,
            Matrix::Bt2020 => 9,
        }
    }

    /// Replaces the matrix by that of an H.273 code; unknown and unspecified codes change nothing.
    pub fn set_matrix_code(&mut self, code: u8) {
        self.matrix = match code {
            1 => Matrix::Bt709,
            4..=7 => Matrix::Bt601,
            9 | 10 => Matrix::Bt2020,
            _ => return,
        };
        self.tagged = true;
    }
}
