//! Logs on standard error, in which names and texts from files are made safe to show.

use ravec_jobs::escape_except;
use std::io::{self, Write};

/// Standard error without control characters other than line breaks and, if lines are colored, the escape that begins a
/// color: the subscriber escapes that one in values itself.
pub struct SafeStderr {
    /// True for colored lines.
    pub colored: bool,
}

impl Write for SafeStderr {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // the subscriber writes whole lines
        let text = String::from_utf8_lossy(bytes);
        let kept: &[char] = if self.colored {
            &['\n', '\u{1b}']
        } else {
            &['\n']
        };
        let safe = escape_except(&text, kept);
        io::stderr().lock().write_all(safe.as_bytes())?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().flush()
    }
}
