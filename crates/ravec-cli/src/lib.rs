//! ravec-cli
