//! Parts of the window.

pub(crate) mod canvas;
pub(crate) mod panel;
mod tiler;
