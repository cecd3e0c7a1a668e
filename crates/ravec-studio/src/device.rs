//! The device on which edits run: one for the program, chosen when it starts.

use ravec::progress::Progress;
use ravec_jobs::{Context, Device};
use std::sync::OnceLock;

static DEVICE: OnceLock<Device> = OnceLock::new();

/// Chooses the device of all edits: `cpu`, `gpu`, `auto` or part of an adapter's name. The first choice stays.
///
/// # Errors
/// One sentence if there is no such device.
pub fn choose_device(name: &str) -> Result<(), String> {
    let device = Device::open(name).map_err(|error| error.to_string())?;
    DEVICE.get_or_init(|| device);
    Ok(())
}

/// The surroundings of an edit, on the chosen device.
pub(crate) fn edit_context(progress: &Progress) -> Context {
    let mut context = Context::new(progress);
    context.device = DEVICE.get().cloned().unwrap_or_default();
    context
}
