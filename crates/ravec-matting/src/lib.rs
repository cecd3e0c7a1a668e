//! Alpha matting: with a known background, or with a trimap or strokes alone.
