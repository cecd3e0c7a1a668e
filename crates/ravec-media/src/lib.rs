//! ravec-media
