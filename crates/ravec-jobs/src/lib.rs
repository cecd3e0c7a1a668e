//! ravec-jobs
