//! `library`: a catalogue of photos, from which mosaics are made.

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::Operation;
use crate::report::Report;
use ravec::progress::Progress;
use ravec_catalogue::{Catalogue, CatalogueError, Entry, belongs_to_catalogue, would_read};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Parameters of [`Add`], [`Remove`] and [`Stats`]; there are none yet.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Plain {}

/// Parameters of [`List`].
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct ListParams {
    /// Also photos that were cleaned away
    #[cfg_attr(feature = "cli", arg(long))]
    pub all: bool,
}

/// Parameters of [`Clean`].
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct CleanParams {
    /// Only say what would be cleaned away
    #[cfg_attr(feature = "cli", arg(long))]
    pub dry_run: bool,
}

/// The files that the database keeps beside a catalogue while it is changed, or after it was killed.
pub(crate) fn journals(catalogue: &Path) -> Vec<PathBuf> {
    let beside = |ending: &str| {
        let mut name = catalogue.as_os_str().to_owned();
        name.push(ending);
        name.into()
    };
    ["-journal", "-wal", "-shm"].map(beside).to_vec()
}

/// Refuses files that would take the place of the catalogue or of a photo that it knows.
pub(crate) fn check_side_outputs(
    catalogue: &Catalogue,
    context: &Context,
) -> Result<(), CatalogueError> {
    let mut files = side_files(context);
    files.try_for_each(|path| catalogue.check_output(path))
}

/// Opens a catalogue that no side output would replace, nor a photo that it knows.
fn opened(
    path: &Path,
    open: impl FnOnce(&Path, &Progress) -> Result<Catalogue, CatalogueError>,
    context: &Context,
) -> Result<Catalogue, JobError> {
    context.check_is_file(path)?;
    let catalogue = open(path, &context.progress).map_err(JobError::from_catalogue)?;
    check_side_outputs(&catalogue, context).map_err(JobError::from_catalogue)?;
    Ok(catalogue)
}

/// The files that the caller writes after the run, without standard output.
fn side_files(context: &Context) -> impl Iterator<Item = &Path> {
    let paths = context.side_outputs.iter().map(PathBuf::as_path);
    paths.filter(|path| !files::is_stream(path))
}

/// Add photos and folders to a catalogue, which is created if it is missing
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP_ADD))]
pub struct Add {
    /// Photos, and folders with everything below them
    #[cfg_attr(feature = "cli", arg(required = true))]
    pub paths: Vec<PathBuf>,
    /// The catalogue, one file
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub catalogue: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Plain,
}

#[cfg(feature = "cli")]
const HELP_ADD: &str = "\
Examples:
  ravec library add photos --catalogue photos.ravec
  ravec library add photo.jpg noisy.jpg --catalogue photos.ravec

What is known is not looked at again, so that an interrupted run goes on where it was. Files that moved are recognized by their \
content. Photos wait for memory, and one that alone needs more than --max-bytes is left out with a warning. Pieces of pages that \
zoom are passed by.

Figures: new, changed, moved, unchanged, copies (of other files), unreadable.";

impl Operation for Add {
    const NAME: &'static str = "library add";

    fn inputs(&self) -> Vec<&Path> {
        let photos = self.paths.iter().map(PathBuf::as_path);
        std::iter::once(&*self.catalogue).chain(photos).collect()
    }

    fn outputs(&self) -> Vec<&Path> {
        Vec::new()
    }

    fn side_files(&self) -> Vec<PathBuf> {
        journals(&self.catalogue)
    }

    /// Adds photos, and folders with all that is in them.
    ///
    /// Figures: `new`, `changed`, `moved`, `unchanged`, `copies` (files with the content of another one), `unreadable`. Files that
    /// cannot be read are warnings.
    ///
    /// # Errors
    /// [`JobError::Catalogue`], also if a side output is the catalogue, one of the photos or one that the
    /// catalogue knows, [`JobError::Cancelled`]; photos that were added before stay.
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            paths,
            catalogue,
            params,
        } = self;
        let progress = &context.progress;
        for path in self.inputs() {
            context.check_is_file(path)?;
        }
        for path in paths {
            if let Err(cause) = path.metadata() {
                return Err(JobError::from_catalogue(CatalogueError::Add {
                    path: path.clone(),
                    reason: crate::error::plain(&cause),
                }));
            }
        }
        if !catalogue.exists() {
            files::check_files(&[], &[catalogue])?;
        }
        for path in side_files(context) {
            let photo = || would_read(paths, path, progress).map_err(JobError::from_catalogue);
            if belongs_to_catalogue(catalogue, path) || photo()? {
                return Err(JobError::OverwritesInput { path: path.into() });
            }
        }
        let mut report = Report::of(self, params);
        let added = report.time("add", || {
            let mut catalogue = Catalogue::open_or_make(catalogue, progress)?;
            check_side_outputs(&catalogue, context)?;
            ravec_catalogue::add(&mut catalogue, paths, &context.limits, progress)
        });
        let added = added.map_err(JobError::from_catalogue)?;
        for (path, reason) in &added.unreadable {
            report.warn(format!("{}: {reason}", path.display()));
        }
        for (name, count) in [
            ("new", added.new),
            ("changed", added.changed),
            ("moved", added.moved),
            ("unchanged", added.unchanged),
            ("copies", added.copies),
            ("unreadable", added.unreadable.len()),
        ] {
            report.figures.insert(name, count as f64);
        }
        Ok(report)
    }
}

/// Remove photos and folders from a catalogue; the files stay
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP_REMOVE))]
pub struct Remove {
    /// Photos, and folders with everything below them
    #[cfg_attr(feature = "cli", arg(required = true))]
    pub paths: Vec<PathBuf>,
    /// The catalogue, one file
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub catalogue: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Plain,
}

#[cfg(feature = "cli")]
const HELP_REMOVE: &str = "\
Examples:
  ravec library remove photo.jpg --catalogue photos.ravec

Figures: removed.";

impl Operation for Remove {
    const NAME: &'static str = "library remove";

    fn inputs(&self) -> Vec<&Path> {
        // removed photos are not read
        vec![&self.catalogue]
    }

    fn outputs(&self) -> Vec<&Path> {
        Vec::new()
    }

    fn side_files(&self) -> Vec<PathBuf> {
        journals(&self.catalogue)
    }

    /// Removes photos, and all photos in folders. Figure: `removed`.
    ///
    /// # Errors
    /// [`JobError::Catalogue`], also if a side output is the catalogue or a photo that it knows.
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            paths,
            catalogue,
            params,
        } = self;
        let mut report = Report::of(self, params);
        let mut catalogue = opened(catalogue, Catalogue::open, context)?;
        let removed =
            ravec_catalogue::remove(&mut catalogue, paths).map_err(JobError::from_catalogue)?;
        report.figures.insert("removed", removed as f64);
        Ok(report)
    }
}

/// Print the photos as JSON
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP_LIST))]
pub struct List {
    /// The catalogue, one file
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub catalogue: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: ListParams,
}

#[cfg(feature = "cli")]
const HELP_LIST: &str = "\
Examples:
  ravec library list --catalogue photos.ravec

Standard output gets a list in JSON of objects with path, width, height, orientation (1 to 8 as in EXIF), taken (when), unreadable, \
flaw and dropped (reasons, or null). With --json, it is result in the report.

Figures: photos.";

impl Operation for List {
    const NAME: &'static str = "library list";

    const PRINTS_RESULT: bool = true;

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.catalogue]
    }

    fn outputs(&self) -> Vec<&Path> {
        Vec::new()
    }

    fn side_files(&self) -> Vec<PathBuf> {
        journals(&self.catalogue)
    }

    /// Lists the photos. The report's `result` is a list of objects with `path`, `width`, `height`,
    /// `orientation` (1 to 8 as in EXIF), `taken`, `unreadable`, `flaw` and `dropped` (a reason or null). Figure: `photos`.
    ///
    /// # Errors
    /// [`JobError::Catalogue`], also if a side output is the catalogue or a photo that it knows.
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self { catalogue, params } = self;
        let mut report = Report::of(self, params);
        let catalogue = opened(catalogue, Catalogue::open_to_read, context)?;
        let entries = catalogue
            .entries(params.all)
            .map_err(JobError::from_catalogue)?;
        report.figures.insert("photos", entries.len() as f64);
        let described = |entry: &Entry| {
            json!({
                "path": entry.path.to_string_lossy(),
                "width": entry.width,
                "height": entry.height,
                "orientation": entry.orientation,
                "taken": entry.taken,
                "unreadable": entry.unreadable,
                "flaw": entry.flaw,
                "dropped": entry.dropped,
            })
        };
        report.result = Some(entries.iter().map(described).collect());
        Ok(report)
    }
}

/// Exclude photos that are not worth a tile, and print them as JSON with the reason
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP_CLEAN))]
pub struct Clean {
    /// The catalogue, one file
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub catalogue: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: CleanParams,
}

#[cfg(feature = "cli")]
const HELP_CLEAN: &str = "\
Examples:
  ravec library clean --catalogue photos.ravec --dry-run
  ravec library clean --catalogue photos.ravec

Standard output gets a list in JSON of objects with path and reason: unreadable, tiny, contentless, framed, near-duplicate or missing, \
and details. With --json, it is result in the report. Photos that were taken out of use are not added again.

Figures: dropped.";

impl Operation for Clean {
    const NAME: &'static str = "library clean";

    const PRINTS_RESULT: bool = true;

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.catalogue]
    }

    fn outputs(&self) -> Vec<&Path> {
        Vec::new()
    }

    fn side_files(&self) -> Vec<PathBuf> {
        journals(&self.catalogue)
    }

    /// Excludes photos that are not worth a tile. The report's `result` is a list of objects with `path` and `reason`
    /// (unreadable, tiny, contentless, framed, near-duplicate or missing, and details). Figure: `dropped`.
    ///
    /// # Errors
    /// [`JobError::Catalogue`], also if a side output is the catalogue or a photo that it knows, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self { catalogue, params } = self;
        let mut report = Report::of(self, params);
        let dropped = report.time("clean", || {
            let open = if params.dry_run {
                Catalogue::open_to_read
            } else {
                Catalogue::open
            };
            let mut catalogue = opened(catalogue, open, context)?;
            ravec_catalogue::clean(&mut catalogue, params.dry_run, &context.progress)
                .map_err(JobError::from_catalogue)
        })?;
        report.figures.insert("dropped", dropped.len() as f64);
        let described = |dropped: &ravec_catalogue::Dropped| json!({ "path": dropped.path.to_string_lossy(), "reason": dropped.reason });
        report.result = Some(dropped.iter().map(described).collect());
        Ok(report)
    }
}

/// Print counts of a catalogue
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP_STATS))]
pub struct Stats {
    /// The catalogue, one file
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub catalogue: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Plain,
}

#[cfg(feature = "cli")]
const HELP_STATS: &str = "\
Examples:
  ravec library stats --catalogue photos.ravec

Figures: usable, landscape, portrait, square, unreadable, dropped, bytes (of all files).";

impl Operation for Stats {
    const NAME: &'static str = "library stats";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.catalogue]
    }

    fn outputs(&self) -> Vec<&Path> {
        Vec::new()
    }

    fn side_files(&self) -> Vec<PathBuf> {
        journals(&self.catalogue)
    }

    /// Counts the photos of a catalogue. Figures: `usable`, `landscape`, `portrait`, `square`, `unreadable`, `dropped`, `bytes`; the
    /// report's `result` says how many were dropped for which reason.
    ///
    /// # Errors
    /// [`JobError::Catalogue`], also if a side output is the catalogue or a photo that it knows.
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self { catalogue, params } = self;
        let mut report = Report::of(self, params);
        let catalogue = opened(catalogue, Catalogue::open_to_read, context)?;
        let stats = ravec_catalogue::stats(&catalogue).map_err(JobError::from_catalogue)?;
        for (name, count) in [
            ("usable", stats.usable),
            ("landscape", stats.landscape),
            ("portrait", stats.portrait),
            ("square", stats.square),
            ("unreadable", stats.unreadable),
            ("dropped", stats.dropped.values().sum()),
        ] {
            report.figures.insert(name, count as f64);
        }
        report.figures.insert("bytes", stats.bytes as f64);
        report.result = Some(json!({ "dropped": stats.dropped }));
        Ok(report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ErrorKind;
    use ravec::raster::{Image, Size, Srgb};
    use ravec_media::{Picture, WriteOptions};

    #[test]
    fn a_catalogue_goes_through_its_life() {
        let folder = tempfile::tempdir().unwrap();
        let photos = folder.path().join("photos");
        std::fs::create_dir(&photos).unwrap();
        for number in 0..3u8 {
            let image = Image::from_fn(Size::new(80, 60).unwrap(), |col, row| {
                Srgb([60 * number, 3 * col as u8, 4 * row as u8])
            });
            let path = photos.join(format!("{number}.png"));
            ravec_media::write(&path, &Picture::from_image(image), &WriteOptions::default())
                .unwrap();
        }
        let catalogue = folder.path().join("photos.ravec");
        let context = Context::default();
        let add = |path: PathBuf| {
            let paths = vec![path];
            let catalogue = catalogue.clone();
            let params = Plain::default();
            Add {
                paths,
                catalogue,
                params,
            }
            .run(&context)
        };
        let list = || {
            let catalogue = catalogue.clone();
            let params = ListParams::default();
            List { catalogue, params }.run(&context)
        };
        assert_eq!(list().unwrap_err().kind(), ErrorKind::Input);
        let added = add(photos.clone()).unwrap();
        assert_eq!(added.figures["new"], 3.0);
        assert_eq!(list().unwrap().result.unwrap()[2]["width"], 80);
        std::fs::remove_file(photos.join("1.png")).unwrap();
        let clean = Clean {
            catalogue: catalogue.clone(),
            params: CleanParams { dry_run: true },
        };
        let cleaned = clean.run(&context).unwrap();
        assert_eq!(cleaned.result.unwrap()[0]["reason"], "missing");
        let remove = Remove {
            paths: vec![photos.join("0.png")],
            catalogue: catalogue.clone(),
            params: Plain::default(),
        };
        let removed = remove.run(&context).unwrap();
        assert_eq!(removed.figures["removed"], 1.0);
        let stats = Stats {
            catalogue: catalogue.clone(),
            params: Plain::default(),
        };
        let counted = stats.run(&context).unwrap();
        assert_eq!(counted.figures["landscape"], 2.0);
        let error = add(folder.path().join("no")).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input);
    }
}
