//! The judge of offset surfaces: plain definitions, slow and independent of what they judge.

#![allow(dead_code, reason = "each test program uses its own part of the judge")]

pub mod coverage;
pub mod oracle;
pub mod sweep;
pub mod verdict;
