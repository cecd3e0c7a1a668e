//! The studio: documents of operations under the hand.
//!
//! A [`Document`] is an input that is never changed and a list of edits, which are operations with their parameters: the same that the
//! command line and recipes have. Every edit can be changed, switched off, moved and removed at any time; what follows from it is
//! computed again, beside the window, and what did not change comes from a cache.
//!
//! ```
//! use ravec_studio::{Document, History};
//!
//! let mut history = History::new(Document::new("photo.jpg"));
//! let mut document = history.document().clone();
//! document.push("twocolor", serde_json::Map::new());
//! history.commit(document);
//! assert_eq!(history.document().edits.len(), 1);
//! history.undo();
//! assert!(history.document().edits.is_empty());
//! ```
//!
//! # Words
//!
//! *Document*: an input and its edits. *Edit*: an operation without its files. *Gesture*: what the hand does from press to release;
//! it is undone at once. *Form*: the settings of an operation. *Tool*: gestures on the canvas that change an edit.
//!
//! # Guarantees
//!
//! - The window's thread reads and writes no file, computes no result and waits for nothing.
//! - An export has the bytes that `ravec run` writes for the saved project.
//! - After the end of the program, however it came, everything up to the last finished gesture is offered again.
//!
//! # Current status
//!
//! Pictures, meshes and clips. Tools with gestures: brush, retargeting with areas, planes, completion as a whole and by fragments,
//! photo mosaics whose tiles are pinned and banned. Meshes have offsets, simplification and repair by their panels, with a list of
//! defects, and Booleans whose parts are moved and turned by a handle. Clips are shown on a timeline; edits of them show a frame, and
//! planes are tracked while one watches. A plate and a matte are found beside the window; removal, replacement, enhancement, paste and
//! overlays show their result on the frame at the playhead. Exports are written one after the other by a render queue.

mod analyses;
mod assistant;
pub mod autosave;
mod background;
pub mod clip;
mod clip_forms;
mod content;
mod controls;
mod device;
mod document;
mod engine;
mod example;
mod history;
pub mod measure;
mod open;
mod painting;
mod project;
pub mod settings;
mod shown;
mod studio;
mod tools;
mod tracking;
mod view;
mod worker;

pub use analyses::AnalysisView;
pub use content::{Content, Kind, View, Visible};
pub use controls::{Control, Controls};
pub use device::choose_device;
pub use document::{Document, Edit, EditError, EditId};
pub use engine::{Busy, EditInput, Engine, Failure, Request, Snapshot, SourceFrame, export};
pub use history::History;
pub use project::{Project, ProjectError};
pub use shown::{Shown, TILE, Tile, TileIndex};
pub use studio::Studio;
pub use view::mesh;
