//! Dependencies: licenses, sources, repeated versions and known advisories, by `cargo-deny` and `deny.toml`.
//!
//! Advisories need the database of `RustSec`, which is fetched from the network; without it they are left out, with a line
//! that says so.

use crate::tool::Tool;
use anyhow::bail;

const CARGO_DENY: Tool = Tool {
    program: "cargo-deny",
    package: "cargo-deny",
};

/// Checks the dependencies as far as the installed programs and the network allow, and reports the parts that are skipped.
pub fn deny() -> anyhow::Result<()> {
    if !CARGO_DENY.is_installed("deny") {
        return Ok(());
    }
    if !CARGO_DENY.passes(&["check", "licenses", "bans", "sources"])? {
        bail!("a dependency is not as deny.toml asks");
    }
    if !CARGO_DENY.succeeds(&["fetch", "db"]) {
        println!("deny: SKIPPED: the database of advisories cannot be fetched");
        return Ok(());
    }
    if !CARGO_DENY.passes(&["check", "advisories"])? {
        bail!("a dependency has a known fault or is not maintained");
    }
    Ok(())
}
