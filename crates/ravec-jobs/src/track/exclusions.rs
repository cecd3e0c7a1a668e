//! Pixels that do not belong to the plane: a mask for all frames or a clip of masks, and strokes in some frames.

use crate::context::Context;
use crate::error::JobError;
use crate::mask::{mask_of, read_mask};
use crate::report::{FileReport, Report};
use crate::video::{is_clip, open_clip, read_error};
use ravec::raster::{Image, Mask, Size, Srgba};
use ravec_video::{Clip, FrameSource as _, Pattern};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Values of strokes from which a pixel belongs to the foreground, and up to which it belongs to the plane. Those between say
/// nothing; JPEG and smooth borders leave room on both sides.
const FOREGROUND: u8 = 192;
const PLANE: u8 = 63;

/// Masks by frame.
pub(crate) struct Exclusions {
    size: Size,
    still: Option<Mask>,
    moving: Option<Moving>,
    strokes: StrokePictures,
}

/// Pictures of strokes by frame, read when they are needed.
#[derive(Clone)]
pub(crate) struct StrokePictures {
    size: Size,
    files: BTreeMap<u64, PathBuf>,
    limits: ravec_media::Limits,
}

/// A clip of masks, read along with the clip.
struct Moving {
    clip: Clip,
    path: PathBuf,
    next: u64,
    /// Number of its frames, once its end was reached.
    frames: Option<u64>,
}

/// Files of masks, as an operation has them.
pub(crate) struct MaskFiles<'a> {
    /// The clip that is tracked, for messages.
    pub input: &'a Path,
    pub exclude: Option<&'a Path>,
    pub strokes: Option<&'a Path>,
}

impl Exclusions {
    /// Opens the files. `reference` is the frame of a single picture of strokes without a number in its name.
    pub fn open(
        files: &MaskFiles<'_>,
        size: Size,
        reference: u64,
        report: &mut Report,
        context: &Context,
    ) -> Result<Self, JobError> {
        let (mut still, mut moving) = (None, None);
        match files.exclude {
            Some(path) if is_clip(path, context) => {
                let clip = open_clip(path, None, report, context)?;
                check_size(files.input, size, path, clip.info().size)?;
                moving = Some(Moving {
                    clip,
                    path: path.to_path_buf(),
                    next: 0,
                    frames: None,
                });
            }
            Some(path) => still = Some(read_mask(path, files.input, size, report, context)?),
            None => {}
        }
        let strokes = match files.strokes {
            Some(path) => {
                context.check_is_file(path)?;
                let found = stroke_files(path, reference, context.max_frames)?;
                for file in found.values() {
                    report.protect(file);
                }
                report.inputs.push(FileReport {
                    path: path.display().to_string(),
                    format: "pictures".to_owned(),
                    frames: Some(found.len() as u64),
                    ..FileReport::default()
                });
                found
            }
            None => BTreeMap::new(),
        };
        Ok(Self {
            size,
            still,
            moving,
            strokes: StrokePictures {
                size,
                files: strokes,
                limits: context.limits.clone(),
            },
        })
    }

    /// Bytes of a mask of a frame, 0 if there are none.
    pub fn bytes(&self) -> usize {
        let some = self.still.is_some() || self.moving.is_some() || !self.strokes.files.is_empty();
        if some { 4 * self.size.pixels() } else { 0 }
    }

    /// The first frame behind the end of a clip of masks, if it was reached.
    pub fn end(&self) -> Option<(&Path, u64)> {
        let moving = self.moving.as_ref()?;
        Some((&moving.path, moving.frames?))
    }

    /// The pictures of strokes.
    pub fn stroke_pictures(&self) -> StrokePictures {
        self.strokes.clone()
    }

    /// Strokes of a frame: foreground and plane.
    pub fn strokes(&self, index: u64) -> Result<Option<[Mask; 2]>, JobError> {
        self.strokes.of(index)
    }

    /// The pixels of a frame that do not belong to the plane. Clips of masks are read forward fastest.
    pub fn of(&mut self, index: u64) -> Result<Option<Mask>, JobError> {
        let moving = match &mut self.moving {
            Some(moving) => moving.mask(index, self.size)?,
            None => None,
        };
        let mask = moving.or_else(|| self.still.clone());
        let Some([foreground, plane]) = self.strokes(index)? else {
            return Ok(mask);
        };
        let mask = match mask {
            // strokes know better; sizes are the same by the checks above
            Some(mask) => mask
                .subtract(&plane)
                .and_then(|mask| mask.union(&foreground)),
            None => return Ok(Some(foreground)),
        };
        Ok(mask.ok())
    }
}

impl StrokePictures {
    /// Frames that have strokes.
    pub fn frames(&self) -> impl Iterator<Item = u64> {
        self.files.keys().copied()
    }

    /// Strokes of a frame: foreground and plane.
    pub fn of(&self, index: u64) -> Result<Option<[Mask; 2]>, JobError> {
        let Some(path) = self.files.get(&index) else {
            return Ok(None);
        };
        let picture = ravec_media::read(path, &self.limits)?;
        let found = picture.image.size();
        if found != self.size {
            let reason = format!("it has {found} pixels, the frames have {}", self.size);
            let path = path.clone();
            return Err(JobError::Strokes { path, reason });
        }
        let image: Image<Srgba<u8>> = picture.convert();
        let member = |chosen: fn(u8) -> bool| {
            Mask::from_fn(self.size, |col, row| {
                let Srgba([r, g, b, alpha]) = image[(col, row)];
                alpha >= 128 && [r, g, b].into_iter().all(chosen)
            })
        };
        Ok(Some([
            member(|value| value >= FOREGROUND),
            member(|value| value <= PLANE),
        ]))
    }
}

impl Moving {
    fn mask(&mut self, index: u64, size: Size) -> Result<Option<Mask>, JobError> {
        let failed = read_error(&self.path);
        if self.frames.is_some_and(|frames| index >= frames) {
            return Ok(None);
        }
        if index != self.next {
            self.clip.seek(index).map_err(&failed)?;
            self.next = index;
        }
        let Some(frame) = self.clip.next_frame().map_err(&failed)? else {
            self.frames = Some(index);
            return Ok(None);
        };
        self.next += 1;
        check_size(&self.path, size, &self.path, frame.picture.size())?;
        Ok(Some(mask_of(&frame.picture.to_image())))
    }
}

fn check_size(a: &Path, a_size: Size, b: &Path, b_size: Size) -> Result<(), JobError> {
    if a_size == b_size {
        return Ok(());
    }
    Err(JobError::SizesDiffer {
        a: a.to_path_buf(),
        a_size,
        b: b.to_path_buf(),
        b_size,
    })
}

/// The last number in the name of a file, without its extension.
fn number_of(path: &Path) -> Option<u64> {
    let stem = path.file_stem()?.to_str()?;
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = stem[..end]
        .rfind(|c: char| !c.is_ascii_digit())
        .map_or(0, |at| {
            at + stem[at..].chars().next().map_or(1, char::len_utf8)
        });
    stem[start..end].parse().ok()
}

/// The pictures of strokes by the frames in their names.
fn stroke_files(
    path: &Path,
    reference: u64,
    max_frames: u64,
) -> Result<BTreeMap<u64, PathBuf>, JobError> {
    let wrong = |reason: String| JobError::Strokes {
        path: path.to_path_buf(),
        reason,
    };
    let pattern = Pattern::parse(path);
    if pattern.is_none() && !path.is_dir() {
        let frame = number_of(path).unwrap_or(reference);
        return Ok(BTreeMap::from([(frame, path.to_path_buf())]));
    }
    let folder = match path.parent() {
        _ if pattern.is_none() => path,
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let entries = std::fs::read_dir(folder).map_err(|error| wrong(error.to_string()))?;
    let mut found = BTreeMap::new();
    for entry in entries {
        let name = entry.map_err(|error| wrong(error.to_string()))?.file_name();
        let file = folder.join(&name);
        let hidden = name.to_str().is_none_or(|name| name.starts_with('.'));
        let picture = ravec_media::Format::from_extension(&file).is_some();
        let Some(number) = number_of(&file).filter(|_| picture && !hidden) else {
            continue;
        };
        let named = pattern.as_ref().map(|pattern| pattern.path(number));
        if named.is_some_and(|named| named.file_name() != file.file_name()) {
            continue;
        }
        if let Some(other) = found.insert(number, file.clone()) {
            return Err(wrong(format!(
                "{} and {} are both of frame {number}",
                other.display(),
                file.display()
            )));
        }
        if found.len() as u64 > max_frames {
            return Err(wrong(format!("it has more than {max_frames} pictures")));
        }
    }
    if found.is_empty() {
        return Err(wrong(
            "no picture has such a name with the number of a frame, as in stroke_0040.png"
                .to_owned(),
        ));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_number_of_a_name_is_the_frame() {
        for (name, number) in [
            ("stroke_0007.png", Some(7)),
            ("a/b2/shot3_12_mask.png", Some(12)),
            ("é9.png", Some(9)),
            ("12.png", Some(12)),
            ("plain.png", None),
            ("99999999999999999999.png", None),
        ] {
            assert_eq!(number_of(Path::new(name)), number, "{name}");
        }
    }

    #[test]
    fn pictures_of_strokes_are_found_in_folders_and_patterns() {
        let folder = tempfile::tempdir().unwrap();
        for name in [
            "s_0004.png",
            "s_0010.png",
            "t_7.png",
            "notes.txt",
            ".s_0001.png",
        ] {
            crate::files::write_text(&folder.path().join(name), "").unwrap();
        }
        let frames =
            |path: &Path| -> Vec<u64> { stroke_files(path, 3, 100).unwrap().into_keys().collect() };
        assert_eq!(frames(folder.path()), [4, 7, 10]);
        assert_eq!(frames(&folder.path().join("s_%04d.png")), [4, 10]);
        assert_eq!(frames(&folder.path().join("t_7.png")), [7]);
        assert_eq!(frames(&folder.path().join("plain.png")), [3]);
        crate::files::write_text(&folder.path().join("s_010.png"), "").unwrap();
        let error = stroke_files(folder.path(), 0, 100).unwrap_err();
        assert!(error.to_string().contains("both of frame 10"), "{error}");
        let none = stroke_files(&folder.path().join("u_%d.png"), 0, 100).unwrap_err();
        assert!(none.to_string().contains("stroke_0040.png"), "{none}");
    }
}
