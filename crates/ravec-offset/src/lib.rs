//! Offset surfaces.
