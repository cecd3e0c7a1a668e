//! Results of edits by what made them.

use super::SourceFrame;
use crate::content::{Content, Visible};
use ravec_jobs::Report;
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

/// Bytes of results that are kept.
const CACHE_BYTES: usize = 1 << 30;

/// Text that changes with the content of a file: its name, length and time.
pub(super) fn source_key(path: &Path, frame: Option<&SourceFrame>, exposure: f32) -> String {
    let data = std::fs::metadata(path).ok();
    let length = data.as_ref().map(std::fs::Metadata::len);
    let modified = data.and_then(|data| data.modified().ok());
    let frame = frame.map(|frame| frame.number);
    format!(
        "{} {length:?} {modified:?} {frame:?} {exposure}",
        path.display()
    )
}

/// Results by what made them, the ones that were used last.
#[derive(Default)]
pub(super) struct Cache {
    entries: HashMap<String, Cached>,
    bytes: usize,
    clock: u64,
}

#[derive(Clone)]
pub(super) struct Cached {
    pub visible: Visible,
    pub report: Option<Arc<Report>>,
    bytes: usize,
    used: u64,
}

impl Cached {
    pub fn new(content: Content, exposure: f32, report: Option<Arc<Report>>) -> Self {
        let visible = Visible::exposed(content, exposure);
        Self {
            bytes: visible.bytes(),
            visible,
            report,
            used: 0,
        }
    }
}

impl Cache {
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
