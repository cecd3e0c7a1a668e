//! ravec
