//! The first line of a Y4M file.

use crate::color::{ColorInfo, Range, Siting, SitingAxis, Subsampling};
use crate::error::VideoError;
use crate::time::Rational;
use crate::yuv::YuvFormat;

/// Start of every file.
pub(super) const MAGIC: &[u8] = b"YUV4MPEG2";

/// Longest header line that is read, in bytes.
pub(super) const MAX_LINE: usize = 4096;

/// Properties that the first line names.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    pub width: u64,
    pub height: u64,
    pub rate: Option<Rational>,
    pub pixel_aspect: Rational,
    pub format: YuvFormat,
    pub siting: Siting,
    pub range: Option<Range>,
}

impl Header {
    pub fn parse(line: &str) -> Result<Self, VideoError> {
        let damaged = |reason: String| VideoError::Damaged { reason };
        let mut header = Self {
            width: 0,
            height: 0,
            rate: None,
            pixel_aspect: Rational::ONE,
            format: YuvFormat::YUV420P8,
            siting: Siting::CENTER,
            range: None,
        };
        for field in line.split_ascii_whitespace().skip(1) {
            let mut chars = field.chars();
            let key = chars.next();
            let value = chars.as_str();
            let side = || {
                value
                    .parse::<u64>()
                    .map_err(|_| damaged(format!("`{}` is no size", shortened(field))))
            };
            match key {
                Some('W') => header.width = side()?,
                Some('H') => header.height = side()?,
                // 0:0 is unknown
                Some('F') => header.rate = value.parse().ok(),
                Some('A') => header.pixel_aspect = value.parse().unwrap_or(Rational::ONE),
                Some('C') => (header.format, header.siting) = color_space(value)?,
                Some('X') => match value {
                    "COLORRANGE=FULL" => header.range = Some(Range::Full),
                    "COLORRANGE=LIMITED" => header.range = Some(Range::Limited),
                    _ => {}
                },
                // interlacing and comments
                _ => {}
            }
        }
        if header.width == 0 || header.height == 0 {
            return Err(damaged("the header names no size".to_owned()));
        }
        Ok(header)
    }

    /// Meaning of the samples of frames of this height.
    pub fn color(&self, height: usize) -> ColorInfo {
        let guess = ColorInfo::guess(height);
        ColorInfo {
            siting: self.siting,
            range: self.range.unwrap_or(guess.range),
            ..guess
        }
    }
}

fn shortened(text: &str) -> String {
    text.chars().take(24).collect()
}

/// Layout and siting by the name of a color space, without its `C`.
fn color_space(name: &str) -> Result<(YuvFormat, Siting), VideoError> {
    let unknown = || VideoError::Unsupported {
        feature: format!("the color space `C{}` of a Y4M file", shortened(name)),
        hint: None,
    };
    let format = |subsampling, depth| YuvFormat {
        subsampling,
        depth,
        alpha: false,
    };
    let siting = match name {
        "420mpeg2" => Siting::LEFT,
        "420paldv" => Siting::TOP_LEFT,
        _ if name.starts_with("420p") || name.starts_with("422") || name.starts_with("411") => {
            Siting::LEFT
        }
        _ => Siting::CENTER,
    };
    if name == "444alpha" {
        let format = format(Subsampling::S444, 8);
        return Ok((
            YuvFormat {
                alpha: true,
                ..format
            },
            siting,
        ));
    }
    let (base, depth) = match name {
        "420" | "420jpeg" | "420mpeg2" | "420paldv" => ("420", 8),
        "mono" => ("mono", 8),
        _ => match name.strip_prefix("mono") {
            Some(depth) => ("mono", depth.parse().map_err(|_| unknown())?),
            None => match name.split_once('p') {
                Some((base, depth)) => (base, depth.parse().map_err(|_| unknown())?),
                None => (name, 8),
            },
        },
    };
    let subsampling = match base {
        "420" => Subsampling::S420,
        "422" => Subsampling::S422,
        "440" => Subsampling::S440,
        "444" => Subsampling::S444,
        "411" => Subsampling::S411,
        "mono" => Subsampling::Gray,
        _ => return Err(unknown()),
    };
    if !(8..=16).contains(&depth) {
        return Err(unknown());
    }
    Ok((format(subsampling, depth), siting))
}

/// The name of the nearest layout that a file can have, and that layout.
pub(super) fn nearest(format: YuvFormat, siting: Siting) -> (String, YuvFormat) {
    if format.alpha {
        let format = YuvFormat {
            subsampling: Subsampling::S444,
            depth: 8,
            alpha: true,
        };
        return ("444alpha".to_owned(), format);
    }
    let base = match format.subsampling {
        Subsampling::Gray if format.depth == 8 => "mono".to_owned(),
        Subsampling::Gray => format!("mono{}", format.depth),
        Subsampling::S420 if format.depth == 8 => match (siting.x, siting.y) {
            (SitingAxis::Center, _) => "420jpeg".to_owned(),
            (_, SitingAxis::First) => "420paldv".to_owned(),
            _ => "420mpeg2".to_owned(),
        },
        Subsampling::S420 => "420".to_owned(),
        Subsampling::S422 => "422".to_owned(),
        Subsampling::S440 => "440".to_owned(),
        Subsampling::S411 => "411".to_owned(),
        Subsampling::S444 => "444".to_owned(),
    };
    let gray = format.subsampling == Subsampling::Gray;
    let name = if format.depth > 8 && !gray {
        format!("{base}p{}", format.depth)
    } else {
        base
    };
    (name, format)
}

/// The siting that a reader will take from the name of a layout.
pub(super) fn siting_of(name: &str) -> Siting {
    color_space(name).map_or(Siting::CENTER, |(_, siting)| siting)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_of_common_programs_are_read() {
        let line =
            "YUV4MPEG2 W640 H480 F30000:1001 Ip A1:1 C420mpeg2 XYSCSS=420MPEG2 XCOLORRANGE=LIMITED";
        let header = Header::parse(line).unwrap();
        assert_eq!((header.width, header.height), (640, 480));
        assert_eq!(header.rate, Rational::new(30000, 1001));
        assert_eq!(header.siting, Siting::LEFT);
        assert_eq!(header.range, Some(Range::Limited));
        let header = Header::parse("YUV4MPEG2 W2 H2 F0:0 A0:0").unwrap();
        assert_eq!(header.rate, None);
        assert_eq!(header.format, YuvFormat::YUV420P8);
    }

    #[test]
    fn broken_headers_are_refused_in_a_sentence() {
        for (line, part) in [
            ("YUV4MPEG2", "no size"),
            ("YUV4MPEG2 W0 H2", "no size"),
            ("YUV4MPEG2 Wx H2", "`Wx` is no size"),
            ("YUV4MPEG2 W-1 H2", "no size"),
            ("YUV4MPEG2 W2 H2 C420p7", "C420p7"),
            ("YUV4MPEG2 W2 H2 C123", "C123"),
            ("YUV4MPEG2 W2 H2 Cmonox", "Cmonox"),
        ] {
            let error = Header::parse(line).unwrap_err().to_string();
            assert!(error.contains(part), "{line}: {error}");
        }
    }

    #[test]
    fn every_layout_that_is_written_is_read_as_itself() {
        let all = [
            Subsampling::Gray,
            Subsampling::S420,
            Subsampling::S422,
            Subsampling::S440,
            Subsampling::S411,
            Subsampling::S444,
        ];
        for subsampling in all {
            for depth in [8, 9, 10, 12, 14, 16] {
                let format = YuvFormat {
                    subsampling,
                    depth,
                    alpha: false,
                };
                let (name, written) = nearest(format, Siting::LEFT);
                assert_eq!(written, format);
                assert_eq!(color_space(&name).unwrap().0, format, "{name}");
            }
        }
        for siting in [Siting::LEFT, Siting::CENTER, Siting::TOP_LEFT] {
            let (name, _) = nearest(YuvFormat::YUV420P8, siting);
            assert_eq!(siting_of(&name), siting);
        }
    }
}
