//! Spelling: American English in code and documents, by `typos` and `typos.toml`.

use crate::tool::Tool;
use anyhow::bail;

const TYPOS: Tool = Tool {
    program: "typos",
    package: "typos-cli",
};

/// Checks all files that git does not ignore.
pub fn spelling() -> anyhow::Result<()> {
    if TYPOS.is_installed("spelling") && !TYPOS.passes(&["--format", "brief"])? {
        bail!("a word is misspelled; if it is right, add it to typos.toml");
    }
    Ok(())
}
