//! Frames as codecs hold them: planes of luma, chroma and alpha.

use crate::color::{ColorInfo, Subsampling};
use ravec_raster::{Image, Size};

/// One plane of samples.
#[derive(Debug, Clone, PartialEq)]
pub enum SamplePlane {
    /// 8 bits a sample.
    U8(Image<u8>),
    /// 9 to 16 bits a sample, in the low bits.
    U16(Image<u16>),
}

impl SamplePlane {
    /// A plane of one value.
    pub fn new(size: Size, depth: u32, value: u16) -> Self {
        if depth <= 8 {
            Self::U8(Image::new(size, value as u8))
        } else {
            Self::U16(Image::new(size, value))
        }
    }

    /// Columns and rows.
    pub fn size(&self) -> Size {
        match self {
            Self::U8(plane) => plane.size(),
            Self::U16(plane) => plane.size(),
        }
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        match self {
            Self::U8(plane) => plane.pixels().len(),
            Self::U16(plane) => 2 * plane.pixels().len(),
        }
    }
}

/// Runs the same generic code on samples of either width.
macro_rules! with_plane {
    ($plane:expr, $image:ident => $body:expr) => {
        match $plane {
            $crate::yuv::SamplePlane::U8($image) => $body,
            $crate::yuv::SamplePlane::U16($image) => $body,
        }
    };
}
pub(crate) use with_plane;

/// Layout of a frame in planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub struct YuvFormat {
    /// Resolution of chroma.
    pub subsampling: Subsampling,
    /// Bits a sample, 8 to 16.
    pub depth: u32,
    /// True for a plane of alpha of the size and depth of luma, full range, straight.
    pub alpha: bool,
}

impl YuvFormat {
    /// 8 bits, 4:2:0, opaque: the common ground of all players.
    pub const YUV420P8: Self = Self {
        subsampling: Subsampling::S420,
        depth: 8,
        alpha: false,
    };

    /// Bytes of a frame of this size.
    pub fn frame_bytes(&self, size: Size) -> u64 {
        let luma = size.pixels() as u64;
        let chroma = self
            .subsampling
            .chroma_size(size.width(), size.height())
            .map_or(0, |(width, height)| width as u64 * height as u64);
        let samples = luma * (1 + u64::from(self.alpha)) + 2 * chroma;
        samples * if self.depth > 8 { 2 } else { 1 }
    }
}

/// A frame in planes. The planes fit the format: sizes and sample widths were checked by [`new`](Self::new).
#[derive(Debug, Clone, PartialEq)]
pub struct YuvImage {
    format: YuvFormat,
    color: ColorInfo,
    /// Luma, then Cb and Cr unless gray, then alpha if any.
    planes: Vec<SamplePlane>,
}

/// Planes that do not fit their format.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("plane {plane} of a frame does not fit its format")]
pub struct PlaneMismatch {
    /// Number of the plane, from 0.
    pub plane: usize,
}

impl YuvImage {
    /// A frame from its planes: luma, Cb and Cr unless gray, alpha if the format has it.
    ///
    /// # Errors
    /// [`PlaneMismatch`] if a plane is missing, left over, or has another size or sample width. Sample values are not checked:
    /// codes above the depth are clipped by conversions.
    pub fn new(
        format: YuvFormat,
        color: ColorInfo,
        planes: Vec<SamplePlane>,
    ) -> Result<Self, PlaneMismatch> {
        let luma = planes.first().ok_or(PlaneMismatch { plane: 0 })?.size();
        let sizes = format.plane_sizes(luma);
        if sizes.len() != planes.len() {
            let plane = sizes.len().min(planes.len());
            return Err(PlaneMismatch { plane });
        }
        for (plane, (samples, size)) in planes.iter().zip(&sizes).enumerate() {
            let wide = matches!(samples, SamplePlane::U16(_));
            if samples.size() != *size || wide != (format.depth > 8) {
                return Err(PlaneMismatch { plane });
            }
        }
        Ok(Self {
            format,
            color,
            planes,
        })
    }

    /// Size of luma.
    pub fn size(&self) -> Size {
        self.planes[0].size()
    }

    /// Layout of the planes.
    pub fn format(&self) -> YuvFormat {
        self.format
    }

    /// Meaning of the samples.
    pub fn color(&self) -> ColorInfo {
        self.color
    }

    /// The same samples with another meaning.
    #[must_use]
    pub fn with_color(self, color: ColorInfo) -> Self {
        Self { color, ..self }
    }

    /// All planes: luma, Cb and Cr unless gray, alpha if any.
    pub fn planes(&self) -> &[SamplePlane] {
        &self.planes
    }

    /// Luma.
    pub fn luma(&self) -> &SamplePlane {
        &self.planes[0]
    }

    /// Cb and Cr, unless gray.
    pub fn chroma(&self) -> Option<(&SamplePlane, &SamplePlane)> {
        self.format.subsampling.log2_steps()?;
        Some((&self.planes[1], &self.planes[2]))
    }

    /// Alpha, if any.
    pub fn alpha(&self) -> Option<&SamplePlane> {
        self.format.alpha.then(|| self.planes.last())?
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> u64 {
        self.planes.iter().map(|plane| plane.bytes() as u64).sum()
    }
}

impl YuvFormat {
    /// Sizes of the planes for luma of this size, in their order.
    pub fn plane_sizes(&self, luma: Size) -> Vec<Size> {
        let mut sizes = vec![luma];
        if let Some((width, height)) = self.subsampling.chroma_size(luma.width(), luma.height()) {
            // sides round up, so that none is zero
            let chroma = Size::new(width, height).unwrap_or(luma);
            sizes.extend([chroma, chroma]);
        }
        if self.alpha {
            sizes.push(luma);
        }
        sizes
    }
}
