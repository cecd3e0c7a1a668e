//! Reading and writing for all operations: each file leaves its trace in the report.

use crate::context::{Context, Intermediate};
use crate::error::JobError;
use crate::identity::FileIdentity;
use crate::report::{FileReport, Report};
use ravec::raster::Size;
pub(crate) use ravec_files::is_stream;
use ravec_files::{check_writable, remove_stale_in, write_atomically};
use ravec_media::{EncodeError, Format, Picture, SampleKind, Warning, WarningKind, WriteOptions};
use std::collections::HashSet;
use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::path::Path;

/// Records what reading or writing a picture has changed, dropped or assumed.
fn record_warnings(warnings: &[Warning], path: &Path, report: &mut Report) {
    for warning in warnings {
        let sentence = format!("{}: {warning}", path.display());
        match warning.kind() {
            WarningKind::Assumed => report.record_assumed(sentence),
            WarningKind::Changed => report.record_changed(sentence),
            WarningKind::Dropped => report.record_dropped(sentence),
        }
    }
}

/// Reads a picture for an operation, or takes it from memory: records the file and its warnings in the report, and protects it
/// from the outputs of the run.
///
/// # Errors
/// [`JobError::Read`], [`JobError::NoIntermediate`], [`JobError::Cancelled`].
pub fn read(path: &Path, report: &mut Report, context: &Context) -> Result<Picture, JobError> {
    context.progress.check()?;
    if context.is_intermediate(path) {
        let picture = context.stored_picture(path)?;
        let file = described(path, IN_MEMORY, picture.origin.sample, &picture);
        report.inputs.push(file);
        return Ok(picture);
    }
    tracing::info!("reading {}", path.display());
    let phase = context.progress.phase("read", 1);
    let picture = report.time("read", || ravec_media::read(path, &context.limits))?;
    phase.advance(1);
    record_warnings(&picture.warnings, path, report);
    let format = picture.origin.format.map_or("none", |format| format.name());
    let file = described(path, format, picture.origin.sample, &picture);
    report.inputs.push(file);
    report.protect(path);
    Ok(picture)
}

/// The format of an intermediate result, as the report names it.
pub(crate) const IN_MEMORY: &str = "in memory";

/// Refuses a target whose extension says no format, before any work is done for it.
pub(crate) fn check_target(path: &Path, context: &Context) -> Result<(), JobError> {
    let needs_none = is_stream(path) || context.is_intermediate(path);
    if needs_none || Format::from_extension(path).is_some() {
        return Ok(());
    }
    Err(unwritable(path, EncodeError::UnknownExtension))
}

/// Refuses a picture that the target's format cannot hold, before any work is done for it. `source` is what the picture
/// is made from.
pub(crate) fn check_size(
    path: &Path,
    size: Size,
    source: &Picture,
    context: &Context,
) -> Result<(), JobError> {
    if context.is_intermediate(path) {
        return Ok(());
    }
    let format = format_of(path, source, &WriteOptions::default());
    let (limit, longest) = (format.max_side(), size.width().max(size.height()));
    if longest as u64 <= limit {
        return Ok(());
    }
    let cause = EncodeError::TooLarge {
        format,
        size,
        limit,
    };
    Err(unwritable(path, cause))
}

/// Refuses files that get in each other's way, and outputs that cannot be written, before any work is done for them.
///
/// An output may take the place of an older file, but not that of an input or of another output, whatever link or spelling
/// leads to it; nor that of a picture in a folder that is an input. Standard input and standard output serve once. Pipes and devices are the caller's business.
///
/// # Errors
/// [`JobError::InputTwice`], [`JobError::OverwritesInput`], [`JobError::OutputTwice`], [`JobError::Write`].
pub fn check_files(inputs: &[&Path], outputs: &[&Path]) -> Result<(), JobError> {
    if inputs.iter().filter(|path| is_stream(path)).count() > 1 {
        return Err(JobError::InputTwice);
    }
    let read: HashSet<_> = inputs
        .iter()
        .filter_map(|path| FileIdentity::of(path))
        .collect();
    let mut written = HashSet::new();
    let mut to_stream = false;
    for &path in outputs {
        let owned = || path.to_path_buf();
        let identity = FileIdentity::of(path);
        if identity.as_ref().is_some_and(|file| read.contains(file))
            || inputs.iter().any(|input| reads_within(input, path))
        {
            return Err(JobError::OverwritesInput { path: owned() });
        }
        let twice = match identity {
            Some(file) => !written.insert(file),
            None => is_stream(path) && std::mem::replace(&mut to_stream, true),
        };
        if twice {
            return Err(JobError::OutputTwice { path: owned() });
        }
    }
    for path in outputs.iter().filter(|path| !is_stream(path)) {
        check_writable(path).map_err(|cause| unwritable(path, cause))?;
    }
    Ok(())
}

/// True if `input` is a folder, of which all pictures are read, and `output` is one of them.
fn reads_within(input: &Path, output: &Path) -> bool {
    let place = |path: &Path| path.canonicalize().ok();
    input.is_dir()
        && Format::from_extension(output).is_some()
        && place(output)
            .zip(place(input))
            .is_some_and(|(output, folder)| output.starts_with(folder))
}

/// Refuses a folder that cannot be made or written into, before any work is done for it. Temporary files that killed
/// processes left in it are removed.
///
/// # Errors
/// [`JobError::Write`].
pub fn check_folder(path: &Path) -> Result<(), JobError> {
    // the nearest folder that is there decides; the last ancestor of a relative path is empty and means the present one
    let nearest = path.ancestors().find(|path| path.exists());
    let nearest = nearest.unwrap_or(Path::new(""));
    if nearest.is_file() {
        let text = if nearest == path {
            "it is a file, not a folder"
        } else {
            "what should be its folder is a file"
        };
        let cause = io::Error::new(io::ErrorKind::NotADirectory, text);
        return Err(unwritable(path, cause));
    }
    remove_stale_in(path);
    check_writable(&nearest.join(".ravec-probe")).map_err(|cause| match cause.kind() {
        io::ErrorKind::PermissionDenied => {
            let text = if nearest == path {
                "the folder is write-protected"
            } else {
                "its folder is write-protected"
            };
            unwritable(path, io::Error::new(cause.kind(), text))
        }
        _ => unwritable(path, cause),
    })
}

fn unwritable(path: &Path, cause: impl Into<EncodeError>) -> JobError {
    JobError::Write {
        path: path.to_path_buf(),
        cause: cause.into(),
    }
}

/// The format that [`ravec_media::write`] will take.
fn format_of(path: &Path, picture: &Picture, options: &WriteOptions) -> Format {
    let by_name = Format::from_extension(path).filter(|_| !is_stream(path));
    let format = options.format.or(by_name).or(picture.origin.format);
    format.unwrap_or(Format::Png)
}

/// Takes a text from memory, or reads one of at most `max_bytes` as [`read_text`] does.
pub(crate) fn read_text_in(path: &Path, max_bytes: u64, context: &Context) -> io::Result<String> {
    if context.is_intermediate(path) {
        let text = context.stored_text(path);
        return text.map_err(|error| io::Error::other(error.to_string()));
    }
    read_text(path, max_bytes)
}

/// Reads a text of at most `max_bytes`, without the byte order mark that some editors put first; `-` is standard input.
///
/// The error says what is wrong, without the path.
pub(crate) fn read_text(path: &Path, max_bytes: u64) -> io::Result<String> {
    let mut data = Vec::new();
    let most = max_bytes.saturating_add(1);
    if is_stream(path) {
        io::stdin().lock().take(most).read_to_end(&mut data)?;
    } else {
        File::open(path)?.take(most).read_to_end(&mut data)?;
    }
    if data.len() as u64 > max_bytes {
        let text = format!("it has more than {max_bytes} bytes, which is the most that is read");
        return Err(io::Error::other(text));
    }
    if data.is_empty() {
        return Err(io::Error::other("it is empty"));
    }
    let text = String::from_utf8(data).map_err(|_| io::Error::other("it is not text in UTF-8"))?;
    Ok(match text.strip_prefix('\u{feff}') {
        Some(rest) => rest.to_owned(),
        None => text,
    })
}

/// Writes a picture, whole or not at all, or keeps it in memory, and records it.
pub(crate) fn write(
    path: &Path,
    picture: &Picture,
    options: &WriteOptions,
    report: &mut Report,
    context: &Context,
) -> Result<(), JobError> {
    context.progress.check()?;
    if context.is_intermediate(path) {
        let file = described(path, IN_MEMORY, picture.origin.sample, picture);
        report.outputs.push(file);
        context.store(path, Intermediate::Picture(picture.clone()));
        return Ok(());
    }
    report.check_output(path)?;
    tracing::info!("writing {}", path.display());
    let warnings = report.time("write", || ravec_media::write(path, picture, options))?;
    record_warnings(&warnings, path, report);
    let format = format_of(path, picture, options);
    let sample = format.nearest_sample(options.sample.unwrap_or(picture.origin.sample));
    let mut file = described(path, format.name(), sample, picture);
    if !format.has_alpha() {
        file.pixels = Some(pixels(sample, false));
    }
    report.outputs.push(file);
    Ok(())
}

/// Writes a text, whole or not at all, or to standard output if the path is `-`.
///
/// # Errors
/// [`JobError::Write`] if the file cannot be written; an old file of that name is then as it was.
pub fn write_text(path: &Path, text: &str) -> Result<(), JobError> {
    let written = if is_stream(path) {
        let mut out = io::stdout().lock();
        out.write_all(text.as_bytes()).and_then(|()| out.flush())
    } else {
        write_atomically(path, |writer| writer.write_all(text.as_bytes()))
    };
    written.map_err(|cause| unwritable(path, cause))
}

/// Writes a text that is an output of the operation, whole or not at all, and records it as of the `format`.
///
/// # Errors
/// [`JobError::Write`]; [`JobError::OverwritesInput`] or [`JobError::OutputTwice`] if the run has read or written the file.
pub fn write_output_text(
    path: &Path,
    format: &str,
    text: &str,
    report: &mut Report,
    context: &Context,
) -> Result<(), JobError> {
    let stays = context.is_intermediate(path);
    if stays {
        context.store(path, Intermediate::Text(text.to_owned()));
    } else {
        report.check_output(path)?;
        tracing::info!("writing {}", path.display());
        report.time("write", || write_text(path, text))?;
    }
    report.outputs.push(FileReport {
        path: path.display().to_string(),
        format: if stays { IN_MEMORY } else { format }.to_owned(),
        ..FileReport::default()
    });
    Ok(())
}

/// Writes a text that is too long for memory, whole or not at all, and records it as of the `format`.
///
/// # Errors
/// As [`write_output_text`]; an error of `write` is one of the file.
pub(crate) fn write_output_with(
    path: &Path,
    format: &str,
    report: &mut Report,
    write: impl FnOnce(&mut dyn io::Write) -> io::Result<()>,
) -> Result<(), JobError> {
    report.check_output(path)?;
    tracing::info!("writing {}", path.display());
    let written = report.time("write", || write_atomically(path, |writer| write(writer)));
    written.map_err(|cause| unwritable(path, cause))?;
    report.outputs.push(FileReport {
        path: path.display().to_string(),
        format: format.to_owned(),
        ..FileReport::default()
    });
    Ok(())
}

/// Makes a folder and those above it.
///
/// # Errors
/// [`JobError::Write`] if one cannot be made.
pub fn make_folder(path: &Path) -> Result<(), JobError> {
    std::fs::create_dir_all(path).map_err(|cause| unwritable(path, cause))
}

fn described(path: &Path, format: &str, sample: SampleKind, picture: &Picture) -> FileReport {
    let size = picture.image.size();
    FileReport {
        path: path.display().to_string(),
        format: format.to_owned(),
        width: Some(size.width()),
        height: Some(size.height()),
        pixels: Some(pixels(sample, picture.image.has_alpha())),
        ..FileReport::default()
    }
}

fn pixels(sample: SampleKind, alpha: bool) -> &'static str {
    match (sample, alpha) {
        (SampleKind::U8, false) => "8 bit",
        (SampleKind::U8, true) => "8 bit with alpha",
        (SampleKind::U16, false) => "16 bit",
        (SampleKind::U16, true) => "16 bit with alpha",
        (SampleKind::F32, false) => "float",
        (SampleKind::F32, true) => "float with alpha",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ErrorKind;
    use ravec::raster::{Image, LinearRgba, Srgba};
    use std::path::PathBuf;

    #[test]
    fn a_picture_that_is_written_and_read_leaves_its_trace_in_the_report() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let size = Size::new(5, 3).unwrap();
        let picture = Picture::from_image(Image::new(size, Srgba([9u8, 8, 7, 6])));
        let mut report = Report::new("test", &());
        let context = Context::default();
        write(
            &path,
            &picture,
            &WriteOptions::default(),
            &mut report,
            &context,
        )
        .unwrap();
        let again = read(&path, &mut report, &context).unwrap();
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
    fn a_report_says_what_the_written_file_holds_not_what_was_in_memory() {
        let folder = tempfile::tempdir().unwrap();
        let size = Size::new(5, 3).unwrap();
        let picture = Picture::from_image(Image::new(size, LinearRgba([0.5, 0.4, 0.3, 0.2])));
        let mut report = Report::new("test", &());
        for (name, pixels) in [
            ("a.exr", "float with alpha"),
            ("a.png", "16 bit with alpha"),
            ("a.webp", "8 bit with alpha"),
            ("a.jpg", "8 bit"),
            ("a.hdr", "float"),
        ] {
            let path = folder.path().join(name);
            let options = WriteOptions::default();
            write(&path, &picture, &options, &mut report, &Context::default()).unwrap();
            let file = report.outputs.last().unwrap();
            assert_eq!(file.pixels, Some(pixels), "{name}");
        }
    }

    #[test]
    fn an_output_may_replace_an_old_file_but_no_input_and_no_other_output() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        write_text(&at("in"), "x").unwrap();
        write_text(&at("old"), "x").unwrap();
        let (input, old, new, stream) = (at("in"), at("old"), at("new"), PathBuf::from("-"));
        check_files(&[&input, &input], &[&old, &new, &stream]).unwrap();
        check_files(&[&stream], &[&stream]).unwrap();

        let disguised = folder.path().join(".").join("in");
        let error = check_files(&[&input], &[&disguised]).unwrap_err();
        assert!(matches!(error, JobError::OverwritesInput { .. }), "{error}");
        for twice in [&old, &new, &stream] {
            let error = check_files(&[&input], &[twice, twice]).unwrap_err();
            assert!(matches!(error, JobError::OutputTwice { .. }), "{error}");
        }
        let error = check_files(&[&stream, &stream], &[]).unwrap_err();
        assert!(matches!(error, JobError::InputTwice), "{error}");
        let error = check_files(&[], &[&new, &at("no/file")]).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Output);
        assert!(!new.exists());
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_an_input_is_that_input_and_a_device_takes_many_outputs() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        write_text(&file, "x").unwrap();
        std::os::unix::fs::symlink("file", &link).unwrap();
        let error = check_files(&[&file], &[&link]).unwrap_err();
        assert!(matches!(error, JobError::OverwritesInput { .. }), "{error}");
        let null = Path::new("/dev/null");
        check_files(&[null], &[null, null]).unwrap();
    }

    #[test]
    fn folders_are_looked_at_without_making_them() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        write_text(&file, "x").unwrap();
        check_folder(folder.path()).unwrap();
        check_folder(&folder.path().join("a/b")).unwrap();
        assert!(!folder.path().join("a").exists());
        for path in [&file, &file.join("below")] {
            assert_eq!(check_folder(path).unwrap_err().kind(), ErrorKind::Output);
        }
    }

    #[test]
    fn texts_are_read_up_to_a_limit_without_their_mark() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        let read = |text: &[u8]| {
            write_atomically(&path, |writer| writer.write_all(text)).unwrap();
            read_text(&path, 9).map_err(|error| error.to_string())
        };
        assert_eq!(read("\u{feff}[1, 2]".as_bytes()).unwrap(), "[1, 2]");
        assert_eq!(read(b"").unwrap_err(), "it is empty");
        assert_eq!(read(b"[\xff]").unwrap_err(), "it is not text in UTF-8");
        assert!(
            read(b"0123456789")
                .unwrap_err()
                .contains("more than 9 bytes")
        );
    }

    #[test]
    fn nothing_is_read_or_written_after_a_cancellation() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let picture = Picture::from_image(Image::new(Size::new(1, 1).unwrap(), Srgba([0u8; 4])));
        let mut report = Report::new("test", &());
        let context = Context::default();
        context.progress.cancel();
        let error = write(
            &path,
            &picture,
            &WriteOptions::default(),
            &mut report,
            &context,
        );
        assert!(matches!(error, Err(JobError::Cancelled)));
        let error = read(&path, &mut report, &context);
        assert!(matches!(error, Err(JobError::Cancelled)));
        assert!(!path.exists() && report.timings.is_empty());
    }

    #[test]
    fn a_text_in_a_missing_folder_is_an_output_error() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_text(&folder.path().join("no/a.txt"), "x").unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Output);
        let file = folder.path().join("file");
        write_text(&file, "x").unwrap();
        assert_eq!(make_folder(&file).unwrap_err().kind(), ErrorKind::Output);
    }
}
