//! The parts of the window.

pub(crate) mod canvas;
pub(crate) mod panel;
pub(crate) mod timeline;
