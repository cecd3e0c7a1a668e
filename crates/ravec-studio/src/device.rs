//! The device on which edits run: one for the program, chosen when it starts.

use eframe::wgpu::{AdapterInfo, DeviceType};
use ravec::progress::Progress;
use ravec_jobs::{Context, Device};
use std::sync::OnceLock;

/// The device, and the name that it was chosen by.
static DEVICE: OnceLock<(Device, String)> = OnceLock::new();

/// Chooses the device of all edits: `cpu`, `gpu`, `auto` or part of an adapter's name. The first choice stays.
///
/// # Errors
/// One sentence if there is no such device.
pub fn choose_device(name: &str) -> Result<(), String> {
    let device = Device::open(name).map_err(|error| error.to_string())?;
    DEVICE.get_or_init(|| (device, name.to_lowercase()));
    Ok(())
}

/// The surroundings of an edit, on the chosen device.
pub(crate) fn edit_context(progress: &Progress) -> Context {
    let mut context = Context::new(progress);
    let device = DEVICE.get().map(|(device, _)| device.clone());
    context.device = device.unwrap_or_default();
    context
}

/// `true` if meshes are drawn by the adapter of the window: a hardware adapter, or the one that was chosen by name.
pub(crate) fn draws_meshes(adapter: &AdapterInfo) -> bool {
    let is_chosen = |(_, name): &(Device, String)| adapter.name.to_lowercase().contains(name);
    adapter.device_type != DeviceType::Cpu || DEVICE.get().is_some_and(is_chosen)
}
