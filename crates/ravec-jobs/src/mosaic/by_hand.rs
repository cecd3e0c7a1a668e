//! Photos that are set by hand, as they are given.

use ravec_catalogue::{Ban, Pin};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// A tile of the grid with the photo that it has, as `COL,ROW:PHOTO`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct PinnedPhoto {
    /// Column and row of the tile, from 0.
    pub tile: [usize; 2],
    /// The photo, by its path in the catalogue.
    pub photo: PathBuf,
}

/// A photo that is not used, as `PHOTO`, or not at a tile of the grid, as `COL,ROW:PHOTO`.
///
/// A photo whose relative path begins like a tile is written with a `./` before it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct BannedPhoto {
    /// Column and row of the tile, from 0; none for all tiles.
    pub tile: Option<[usize; 2]>,
    /// The photo, by its path in the catalogue.
    pub photo: PathBuf,
}

/// Splits a text into a tile and what follows it.
fn split(text: &str) -> Option<([usize; 2], &str)> {
    let (tile, photo) = text.split_once(':')?;
    let (col, row) = tile.split_once(',')?;
    Some(([col.parse().ok()?, row.parse().ok()?], photo))
}

impl FromStr for PinnedPhoto {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (tile, photo) = split(text)
            .filter(|(_, photo)| !photo.is_empty())
            .ok_or_else(|| {
                format!(
                    "`{text}` is no tile with a photo: write COL,ROW:PHOTO, as in 3,0:/photos/a.jpg"
                )
            })?;
        Ok(Self {
            tile,
            photo: photo.into(),
        })
    }
}

impl FromStr for BannedPhoto {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (tile, photo) = split(text).map_or((None, text), |(tile, photo)| (Some(tile), photo));
        if photo.is_empty() {
            return Err(format!(
                "`{text}` names no photo: write PHOTO or COL,ROW:PHOTO, as in 3,0:/photos/a.jpg"
            ));
        }
        Ok(Self {
            tile,
            photo: photo.into(),
        })
    }
}

impl fmt::Display for PinnedPhoto {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [col, row] = self.tile;
        write!(f, "{col},{row}:{}", self.photo.display())
    }
}

impl fmt::Display for BannedPhoto {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some([col, row]) = self.tile {
            write!(f, "{col},{row}:")?;
        }
        write!(f, "{}", self.photo.display())
    }
}

impl TryFrom<String> for PinnedPhoto {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl TryFrom<String> for BannedPhoto {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<PinnedPhoto> for String {
    fn from(pinned: PinnedPhoto) -> Self {
        pinned.to_string()
    }
}

impl From<BannedPhoto> for String {
    fn from(banned: BannedPhoto) -> Self {
        banned.to_string()
    }
}

impl From<&PinnedPhoto> for Pin {
    fn from(pinned: &PinnedPhoto) -> Self {
        let [col, row] = pinned.tile;
        let photo = pinned.photo.clone();
        Self { col, row, photo }
    }
}

impl From<&BannedPhoto> for Ban {
    fn from(banned: &BannedPhoto) -> Self {
        Self {
            tile: banned.tile,
            photo: banned.photo.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_and_photos_come_back() {
        let pinned: PinnedPhoto = "3,0:/photos/a: 1,2.jpg".parse().unwrap();
        assert_eq!(pinned.tile, [3, 0]);
        assert_eq!(pinned.photo, PathBuf::from("/photos/a: 1,2.jpg"));
        assert_eq!(pinned.to_string(), "3,0:/photos/a: 1,2.jpg");
        for (text, tile, photo) in [
            ("/photos/a.jpg", None, "/photos/a.jpg"),
            ("12,7:/photos/a.jpg", Some([12, 7]), "/photos/a.jpg"),
            ("a,b:c.jpg", None, "a,b:c.jpg"),
            ("C:\\photos\\a.jpg", None, "C:\\photos\\a.jpg"),
            ("./1,2:c.jpg", None, "./1,2:c.jpg"),
        ] {
            let banned: BannedPhoto = text.parse().unwrap();
            assert_eq!(
                (banned.tile, banned.photo.as_path()),
                (tile, photo.as_ref())
            );
            assert_eq!(banned.to_string(), text);
        }
        for wrong in ["", "3,0", "3,0:", "a.jpg", "3:a.jpg", "-1,0:a.jpg"] {
            assert!(wrong.parse::<PinnedPhoto>().is_err(), "{wrong}");
        }
        for wrong in ["", "3,0:"] {
            assert!(wrong.parse::<BannedPhoto>().is_err(), "{wrong}");
        }
    }
}
