//! Reading and writing for all operations: each file leaves its trace in the report.

use crate::error::JobError;
use crate::report::{FileReport, Report};
use ravec::progress::Progress;
use ravec::raster::AnyImage;
use ravec_media::{Limits, Picture, WriteOptions, write_atomically};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A picture file to be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// Where it is; `-` is standard input.
    pub path: PathBuf,
    /// What reading it may cost.
    pub limits: Limits,
}

impl Source {
    /// A file with the default limits.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            limits: Limits::default(),
        }
    }
}

/// Reads a picture and records it.
pub(crate) fn read(
    source: &Source,
    report: &mut Report,
    progress: &Progress,
) -> Result<Picture, JobError> {
    let path = &source.path;
    progress.check()?;
    tracing::info!("reading {}", path.display());
    let phase = progress.phase("read", 1);
    let picture = report.time("read", || ravec_media::read(path, &source.limits))?;
    phase.advance(1);
    for warning in &picture.warnings {
        report.warn(format!("{}: {warning}", path.display()));
    }
    let format = picture.origin.format.map_or("none", |format| format.name());
    report.inputs.push(described(path, format, &picture.image));
    Ok(picture)
}

/// Refuses a target whose extension says no format, before any work is done for it.
pub(crate) fn check_target(path: &Path) -> Result<(), JobError> {
    if path.as_os_str() == "-" || ravec_media::Format::from_extension(path).is_some() {
        return Ok(());
    }
    Err(JobError::Write {
        path: path.to_path_buf(),
        cause: ravec_media::EncodeError::UnknownExtension,
    })
}

/// Writes a picture, whole or not at all, and records it.
pub(crate) fn write(
    path: &Path,
    picture: &Picture,
    options: &WriteOptions,
    report: &mut Report,
    progress: &Progress,
) -> Result<(), JobError> {
    progress.check()?;
    tracing::info!("writing {}", path.display());
    let warnings = report.time("write", || ravec_media::write(path, picture, options))?;
    for warning in warnings {
        report.warn(format!("{}: {warning}", path.display()));
    }
    let by_name = ravec_media::Format::from_extension(path);
    let format = options.format.or(by_name).or(picture.origin.format);
    let format = format.unwrap_or(ravec_media::Format::Png).name();
    report.outputs.push(described(path, format, &picture.image));
    Ok(())
}

/// Writes a text, whole or not at all.
///
/// # Errors
/// [`JobError::Write`] if the file cannot be written; an old file of that name is then as it was.
pub fn write_text(path: &Path, text: &str) -> Result<(), JobError> {
    write_atomically(path, |writer| writer.write_all(text.as_bytes())).map_err(|cause| {
        JobError::Write {
            path: path.to_path_buf(),
            cause: cause.into(),
        }
    })
}

/// Writes a text that is an output of the operation, and records it.
pub(crate) fn write_output_text(
    path: &Path,
    format: &str,
    text: &str,
    report: &mut Report,
) -> Result<(), JobError> {
    tracing::info!("writing {}", path.display());
    report.time("write", || write_text(path, text))?;
    report.outputs.push(FileReport {
        path: path.display().to_string(),
        format: format.to_owned(),
        width: None,
        height: None,
        pixels: None,
    });
    Ok(())
}

/// Makes a folder and those above it.
pub(crate) fn make_folder(path: &Path) -> Result<(), JobError> {
    std::fs::create_dir_all(path).map_err(|cause| JobError::Write {
        path: path.to_path_buf(),
        cause: cause.into(),
    })
}

fn described(path: &Path, format: &str, image: &AnyImage) -> FileReport {
    FileReport {
        path: path.display().to_string(),
        format: format.to_owned(),
        width: Some(image.size().width()),
        height: Some(image.size().height()),
        pixels: Some(match image {
            AnyImage::Srgb8(_) => "8 bit",
            AnyImage::Srgba8(_) => "8 bit with alpha",
            AnyImage::Srgb16(_) => "16 bit",
            AnyImage::Srgba16(_) => "16 bit with alpha",
            AnyImage::Linear(_) => "float",
            AnyImage::LinearAlpha(_) => "float with alpha",
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::{Image, Size, Srgba};

    #[test]
    fn a_picture_that_is_written_and_read_leaves_its_trace_in_the_report() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let size = Size::new(5, 3).unwrap();
        let picture = Picture::from_image(Image::new(size, Srgba([9u8, 8, 7, 6])));
        let mut report = Report::new("test", &());
        let progress = Progress::none();
        write(
            &path,
            &picture,
            &WriteOptions::default(),
            &mut report,
            &progress,
        )
        .unwrap();
        let again = read(&Source::new(&path), &mut report, &progress).unwrap();
        assert_eq!(again.image, picture.image);
        assert_eq!(report.inputs, report.outputs);
        assert_eq!(report.inputs[0].format, "PNG");
        assert_eq!(
            (report.inputs[0].width, report.inputs[0].height),
            (Some(5), Some(3))
        );
        assert_eq!(report.inputs[0].pixels, Some("8 bit with alpha"));
        let phases: Vec<_> = report.timings.iter().map(|timing| timing.phase).collect();
        assert_eq!(phases, ["write", "read"]);
    }

    #[test]
    fn nothing_is_read_or_written_after_a_cancellation() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let picture = Picture::from_image(Image::new(Size::new(1, 1).unwrap(), Srgba([0u8; 4])));
        let mut report = Report::new("test", &());
        let progress = Progress::none();
        progress.cancel();
        let error = write(
            &path,
            &picture,
            &WriteOptions::default(),
            &mut report,
            &progress,
        );
        assert!(matches!(error, Err(JobError::Cancelled)));
        let error = read(&Source::new(&path), &mut report, &progress);
        assert!(matches!(error, Err(JobError::Cancelled)));
        assert!(!path.exists() && report.timings.is_empty());
    }

    #[test]
    fn a_text_in_a_missing_folder_is_an_output_error() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_text(&folder.path().join("no/a.txt"), "x").unwrap_err();
        assert_eq!(error.exit_code(), 4);
        let file = folder.path().join("file");
        write_text(&file, "x").unwrap();
        assert_eq!(make_folder(&file).unwrap_err().exit_code(), 4);
    }
}
