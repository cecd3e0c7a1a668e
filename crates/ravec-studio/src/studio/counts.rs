//! Requests and answers by number: what a measurement sees of the work beside the window.

use super::Studio;
use crate::document::Edit;
use crate::open::DRAFT;
use crate::view::canvas::SeenTile;
use egui::{Pos2, Rect};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Who works for the window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Source {
    /// Results of documents.
    Results,
    /// Quick results of edits.
    Drafts,
    /// Frames of clips.
    Frames,
    /// Pictures of meshes.
    Meshes,
    /// Answers of a kind.
    Answers(&'static str),
}

/// Numbers of the last request and of the last one with an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Count {
    pub asked: u64,
    pub done: u64,
}

/// State of the document in front, as a measurement compares it from frame to frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Counts {
    pub sources: BTreeMap<Source, Count>,
    /// The edits. Those that have changed are others.
    pub edits: Vec<Arc<Edit>>,
    /// Zoom and position of the picture.
    pub view: Option<(f32, Pos2)>,
    /// Tiles that were seen in the last frame.
    pub tiles: Vec<SeenTile>,
}

impl Counts {
    /// The numbers of a source.
    pub fn of(&self, source: Source) -> Count {
        self.sources.get(&source).copied().unwrap_or_default()
    }

    /// True if the edits are others than those of `before`.
    pub fn has_other_edits(&self, before: &Self) -> bool {
        let same = |(a, b): (&Arc<Edit>, &Arc<Edit>)| Arc::ptr_eq(a, b);
        self.edits.len() != before.edits.len() || !self.edits.iter().zip(&before.edits).all(same)
    }
}

impl Studio {
    /// The numbers of the document in front.
    pub(crate) fn counts(&self) -> Counts {
        let Some(open) = self.open.get(self.active) else {
            return Counts::default();
        };
        let count = |[asked, done]: [u64; 2]| Count { asked, done };
        let mut sources = BTreeMap::new();
        sources.insert(Source::Results, count(open.engine.counts()));
        for (kind, numbers) in open.assistant.counts() {
            let source = if kind == DRAFT {
                Source::Drafts
            } else {
                Source::Answers(kind)
            };
            sources.insert(source, count(numbers));
        }
        if let Some(clip) = &open.clip {
            sources.insert(Source::Frames, count(clip.reader.counts()));
        }
        if let Some(canvas) = &open.mesh_canvas {
            sources.insert(Source::Meshes, count(canvas.counts()));
        }
        Counts {
            sources,
            edits: open.history.document().edits.clone(),
            view: open.canvas.view().map(|view| (view.zoom, view.origin)),
            tiles: open.canvas.seen().to_vec(),
        }
    }

    /// The screen rectangle of the whole picture of the document in front.
    pub(crate) fn picture_place(&self) -> Option<Rect> {
        let open = self.open.get(self.active)?;
        let view = open.canvas.view()?;
        let [width, height] = open.engine.snapshot().size()?;
        Some(Rect::from_min_max(
            view.to_screen(0.0, 0.0),
            view.to_screen(width as f64, height as f64),
        ))
    }
}
