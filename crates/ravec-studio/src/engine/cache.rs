//! Results of edits by what made them.

use super::SourceFrame;
use crate::content::{Content, View};
use crate::document::EditId;
use ravec_jobs::Report;
use std::collections::{HashMap, VecDeque};
use std::path::Path;
use std::sync::Arc;

/// Bytes of results that are kept.
const CACHE_BYTES: usize = 1 << 30;

/// Views that are kept: those of the result and of the source, and as many before them.
const MAX_VIEWS: usize = 4;

/// Text that changes with the content of a file: its name, length and time.
pub(crate) fn source_key(path: &Path, frame: Option<&SourceFrame>) -> String {
    let data = std::fs::metadata(path).ok();
    let length = data.as_ref().map(std::fs::Metadata::len);
    let modified = data.and_then(|data| data.modified().ok());
    let frame = frame.map(|frame| frame.place.number);
    format!("{} {length:?} {modified:?} {frame:?}", path.display())
}

/// Results by what made them, the ones that were used last, and the views of a few.
#[derive(Default)]
pub(super) struct Cache {
    entries: HashMap<String, Cached>,
    bytes: usize,
    clock: u64,
    /// Views with their keys and exposures, the last one first.
    views: VecDeque<(String, f32, View)>,
    /// The last result of the brush in the hand: the edit, the key of its input, and that of the result.
    painted: Option<(EditId, Arc<str>, String)>,
}

/// The result of an edit.
#[derive(Clone)]
pub(super) struct Cached {
    pub content: Content,
    pub report: Option<Arc<Report>>,
    bytes: usize,
    used: u64,
}

impl Cached {
    pub fn new(content: Content, report: Option<Arc<Report>>) -> Self {
        Self {
            bytes: content.bytes(),
            content,
            report,
            used: 0,
        }
    }
}

impl Cache {
    /// The view of a content. Only what is shown has one: results between edits do not.
    pub fn view(&mut self, key: &str, content: &Content, exposure: f32) -> View {
        let known = self
            .views
            .iter()
            .position(|(of, at, _)| of == key && *at == exposure);
        let found = match known.and_then(|index| self.views.remove(index)) {
            Some((_, _, view)) => view,
            None => View::new(content, exposure),
        };
        self.views
            .push_front((key.to_owned(), exposure, found.clone()));
        self.views.truncate(MAX_VIEWS);
        found
    }

    /// Takes a result of the brush in the hand, with its view at no exposure, in place of the one before of the same edit: the brush
    /// goes back to earlier strokes itself, and paints faster into a picture that nobody holds any more.
    pub fn insert_painted(
        &mut self,
        edit: EditId,
        input: &Arc<str>,
        key: &str,
        cached: Cached,
        view: Option<View>,
    ) {
        let painted = (edit, input.clone(), key.to_owned());
        if let Some(before) = self.painted.replace(painted)
            && before.0 == edit
            && before.1 == *input
            && before.2 != key
        {
            self.views.retain(|(of, ..)| *of != before.2);
            if let Some(removed) = self.entries.remove(&before.2) {
                self.bytes -= removed.bytes;
            }
        }
        if let Some(view) = view {
            self.views.push_front((key.to_owned(), 0.0, view));
            self.views.truncate(MAX_VIEWS);
        }
        self.insert(key, cached);
    }

    pub fn get(&mut self, key: &str) -> Option<Cached> {
        self.clock += 1;
        let cached = self.entries.get_mut(key)?;
        cached.used = self.clock;
        Some(cached.clone())
    }

    pub fn insert(&mut self, key: &str, cached: Cached) {
        self.clock += 1;
        self.bytes += cached.bytes;
        let used = self.clock;
        if let Some(replaced) = self
            .entries
            .insert(key.to_owned(), Cached { used, ..cached })
        {
            self.bytes -= replaced.bytes;
        }
        while self.bytes > CACHE_BYTES && self.entries.len() > 1 {
            let oldest = self.entries.iter().min_by_key(|(_, cached)| cached.used);
            let Some(key) = oldest.map(|(key, _)| key.clone()) else {
                break;
            };
            if let Some(removed) = self.entries.remove(&key) {
                self.bytes -= removed.bytes;
            }
        }
    }
}
