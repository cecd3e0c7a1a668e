//! When a photo was taken, as its EXIF block says.
//!
//! Source: CIPA DC-008, tag `DateTimeOriginal`. Does not guarantee: that the camera's clock was right.

use crate::picture::Origin;
use exif::{In, Reader, Tag};

impl Origin {
    /// The local time at which the photo was taken, as in `2016-05-04 03:02:01`, if the EXIF block says so.
    pub fn taken_at(&self) -> Option<String> {
        let exif = Reader::new().read_raw(self.exif.as_ref()?.to_vec()).ok()?;
        let field = exif.get_field(Tag::DateTimeOriginal, In::PRIMARY)?;
        Some(field.display_value().to_string())
            .filter(|text| text.starts_with(|c: char| c.is_ascii_digit()))
    }
}
