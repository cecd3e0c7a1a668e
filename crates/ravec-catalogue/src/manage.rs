//! Photos leave the catalogue, and what is in it.

use crate::catalogue::{Catalogue, Change, Entry, Loaded};
use crate::error::CatalogueError;
use ravec_memory::MemoryBudget;
use ravec_mosaic::{Describer, Descriptor, Frame, MAX_DEGREE, NEAR_DUPLICATE, near_duplicates};
use ravec_progress::Progress;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A photo that was cleaned away, or would be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Dropped {
    /// Path of its file, which may be gone.
    pub path: PathBuf,
    /// Why: `unreadable`, `tiny`, `contentless`, `framed`, `near-duplicate` or `missing`, and what there is to say about it.
    pub reason: String,
}

/// Contents of a catalogue.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Stats {
    /// Photos that can be used.
    pub usable: usize,
    /// Of these, those that are wider than high by more than 3 %.
    pub landscape: usize,
    /// Of these, those that are higher than wide by more than 3 %.
    pub portrait: usize,
    /// Of these, the others.
    pub square: usize,
    /// Files that could not be read.
    pub unreadable: usize,
    /// Photos that were cleaned away, by the first word of the reason.
    pub dropped: BTreeMap<String, usize>,
    /// Bytes of all files.
    pub bytes: u64,
}

/// Forgets files, and all files in folders. Returns the number of photos that were removed.
///
/// # Errors
/// As for [`Catalogue::entries`], and [`CatalogueError::Change`].
pub fn remove(catalogue: &mut Catalogue, paths: &[PathBuf]) -> Result<usize, CatalogueError> {
    let roots: Vec<PathBuf> = paths.iter().map(|path| absolute(path)).collect();
    let gone: Vec<Change> = catalogue
        .entries(true)?
        .iter()
        .filter(|entry| roots.iter().any(|root| entry.path.starts_with(root)))
        .map(|entry| Change::Forget {
            id: entry.id,
            path: entry.path.clone(),
        })
        .collect();
    catalogue.change(&gone)
}

/// The place that a path names, whether or not there is something.
fn absolute(path: &Path) -> PathBuf {
    path.canonicalize()
        .or_else(|_| std::path::absolute(path))
        .unwrap_or_else(|_| path.into())
}

/// Finds the photos that are not worth a tile, and unless it is a `dry_run` takes them out of use. Of near-duplicates the
/// one with the most pixels stays. Files that are no longer there are forgotten.
///
/// # Errors
/// As for [`Catalogue::entries`], and [`CatalogueError::Change`].
pub fn clean(
    catalogue: &mut Catalogue,
    dry_run: bool,
    progress: &Progress,
) -> Result<Vec<Dropped>, CatalogueError> {
    let mut found: Vec<(i64, Dropped, bool)> = Vec::new();
    let mut note = |entry: &Entry, reason: String, forget: bool| {
        let path = entry.path.clone();
        found.push((entry.id, Dropped { path, reason }, forget));
    };
    for entry in catalogue.entries(false)? {
        progress.check()?;
        if !entry.path.exists() {
            note(&entry, "missing".into(), true);
        } else if let Some(reason) = &entry.unreadable {
            note(&entry, format!("unreadable: {reason}"), false);
        }
    }
    let Loaded {
        entries: mut photos,
        memory: _memory,
    } = catalogue.usable(&MemoryBudget::default())?;
    photos.retain(|entry| entry.path.exists());
    for entry in &photos {
        if let Some(flaw) = &entry.flaw {
            note(entry, flaw.clone(), false);
        }
    }
    photos.retain(|entry| entry.flaw.is_none());
    // the first of a group leads it
    photos.sort_by_key(|entry| std::cmp::Reverse(entry.width.saturating_mul(entry.height)));
    let descriptors: Vec<Descriptor> = photos.iter().filter_map(whole_descriptor).collect();
    let groups = near_duplicates(&descriptors, NEAR_DUPLICATE, progress)?;
    let mut leaders: Vec<&Entry> = Vec::new();
    for (entry, &group) in photos.iter().zip(&groups) {
        match leaders.get(group as usize) {
            Some(leader) => note(
                entry,
                format!("near-duplicate of {}", leader.path.display()),
                false,
            ),
            None => leaders.push(entry),
        }
    }
    found.sort_by(|a, b| a.1.path.cmp(&b.1.path));
    if !dry_run {
        let changes: Vec<Change> = found
            .iter()
            .map(|(id, dropped, forget)| match forget {
                true => Change::Forget {
                    id: *id,
                    path: dropped.path.clone(),
                },
                false => Change::Drop {
                    id: *id,
                    path: dropped.path.clone(),
                    reason: dropped.reason.clone(),
                },
            })
            .collect();
        catalogue.change(&changes)?;
    }
    Ok(found.into_iter().map(|(_, dropped, _)| dropped).collect())
}

/// Descriptor of a whole photo.
fn whole_descriptor(entry: &Entry) -> Option<Descriptor> {
    let image = entry.thumbnail.as_ref()?;
    Some(Describer::default().describe(image, Frame::of(image), MAX_DEGREE))
}

/// Counts what is in a catalogue.
///
/// # Errors
/// As for [`Catalogue::entries`], and [`CatalogueError::Change`].
pub fn stats(catalogue: &Catalogue) -> Result<Stats, CatalogueError> {
    let mut stats = Stats::default();
    for entry in catalogue.entries(true)? {
        stats.bytes = stats.bytes.saturating_add(entry.bytes);
        if let Some(reason) = &entry.dropped {
            let word = reason.split([' ', ':']).next().unwrap_or_default();
            *stats.dropped.entry(word.into()).or_default() += 1;
        } else if entry.unreadable.is_some() {
            stats.unreadable += 1;
        } else {
            stats.usable += 1;
            let log = (entry.width as f64 / entry.height.max(1) as f64).ln();
            if log > ravec_mosaic::SAME_PROPORTIONS {
                stats.landscape += 1;
            } else if log < -ravec_mosaic::SAME_PROPORTIONS {
                stats.portrait += 1;
            } else {
                stats.square += 1;
            }
        }
    }
    Ok(stats)
}
