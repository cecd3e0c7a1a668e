//! Corrections by hand as they are given.

use crate::plane::Quad;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Corners in a frame, given by hand: `FRAME:x,y,x,y,x,y,x,y`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct FrameQuad {
    /// Number of the frame, from 0.
    pub frame: u64,
    /// The corners.
    pub quad: Quad,
}

impl FromStr for FrameQuad {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "`{text}` does not begin with a frame: write FRAME:x,y,x,y,x,y,x,y, as in 40:10,10,90,12,88,70,9,60"
            )
        };
        let (frame, quad) = text.split_once(':').ok_or_else(wrong)?;
        Ok(Self {
            frame: frame.trim().parse().map_err(|_| wrong())?,
            quad: quad.parse()?,
        })
    }
}

impl fmt::Display for FrameQuad {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.frame, self.quad)
    }
}

impl TryFrom<String> for FrameQuad {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<FrameQuad> for String {
    fn from(value: FrameQuad) -> Self {
        value.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_and_its_corners_come_back() {
        let text = "40:10,10,90,12.5,88,70,9,60";
        let found: FrameQuad = text.parse().unwrap();
        assert_eq!((found.frame, found.to_string().as_str()), (40, text));
        for text in [
            "",
            "10,10,90,12,88,70,9,60",
            "a:1,2,3,4,5,6,7,8",
            "4:1,2",
            "-1:1,2,3,4,5,6,7,8",
        ] {
            assert!(text.parse::<FrameQuad>().is_err(), "{text}");
        }
    }
}
