//! Panics distinguished: ours are bugs wherever they are caught, those of foreign decoders are contained by the
//! readers.

use super::memory;
use std::backtrace::Backtrace;
use std::panic::{Location, PanicHookInfo};
use std::sync::{Mutex, Once, PoisonError};

static OWN: Mutex<Option<String>> = Mutex::new(None);
static FOREIGN: Mutex<Option<String>> = Mutex::new(None);

/// Replaces the panic hook, once.
pub fn watch() {
    static WATCHED: Once = Once::new();
    WATCHED
        .call_once(|| std::panic::set_hook(Box::new(|panic| memory::uncounted(|| record(panic)))));
}

/// The first panic of our own code since the last call.
pub fn take_own() -> Option<String> {
    OWN.lock().unwrap_or_else(PoisonError::into_inner).take()
}

/// The last panic of foreign code.
pub fn take_foreign() -> Option<String> {
    FOREIGN
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .take()
}

fn record(panic: &PanicHookInfo<'_>) {
    let place = panic.location().map_or("", Location::file);
    let ours = is_ours(place);
    let slot = if ours { &OWN } else { &FOREIGN };
    let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
    // what follows our first panic is its consequence
    if slot.is_none() || !ours {
        *slot = Some(panic.to_string());
    }
}

/// Returns `true` if a panic in this source file is one of our code. Of the standard library's, which do not name their
/// callers, the caller is found on the stack.
fn is_ours(file: &str) -> bool {
    if file.contains("/registry/src/") || file.contains("/git/checkouts/") {
        return false;
    }
    if !file.starts_with("/rustc/") && !file.contains("/library/") {
        return true;
    }
    let stack = Backtrace::force_capture().to_string();
    is_ours_by_stack(&stack)
}

/// Returns `true` if the first function below the panic that is not of the standard library is one of ours.
fn is_ours_by_stack(stack: &str) -> bool {
    let functions = stack.lines().filter_map(|line| {
        let (number, name) = line.trim().split_once(": ")?;
        number.parse::<u32>().ok().map(|_| name)
    });
    let is_standard = |name: &str| {
        let name = name.trim_start_matches(['<', '_', '&']);
        ["core::", "alloc::", "std::", "rust_", "_rust", "rustc"]
            .iter()
            .any(|start| name.starts_with(start))
    };
    functions
        .skip_while(|name| {
            !name.contains("begin_panic_handler") && !name.contains("rust_begin_unwind")
        })
        .find(|name| !is_standard(name))
        .is_none_or(|name| name.contains("ravec"))
}
