//! ravec-scenes
