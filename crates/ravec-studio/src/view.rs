//! Parts of the window.

pub(crate) mod canvas;
pub mod mesh;
pub(crate) mod panel;
mod tiler;
pub(crate) mod timeline;
