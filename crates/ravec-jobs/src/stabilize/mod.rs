//! `stabilize`
