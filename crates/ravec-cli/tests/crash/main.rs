//! The program killed at random moments, on full disks, in folders that may not be written to, and beside itself.
//!
//! Whatever the moment: inputs are as they were, an output is the old one or the whole new one, a catalogue is valid, and the
//! next run succeeds and leaves nothing of the killed one behind. Moments are drawn from a seed; where a kill finds the
//! program depends on the machine, so that every run of these tests looks at other moments, but no test depends on them.
//!
//! | variable | meaning |
//! | --- | --- |
//! | `RAVEC_CRASH_ROUNDS` | kills of each operation (default 3) |
//! | `RAVEC_CRASH_SEED` | seed of the moments (default 1) |
//! | `RAVEC_CRASH_PROGRAM` | the program (default: the one built with the tests) |

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

mod disks;
mod kills;
mod operations;
mod others;
mod world;
