//! The device that computes two-color pixels and warps, for all work of the process.

use crate::error::{of_job, of_request};
use pyo3::exceptions::PyRuntimeWarning;
use pyo3::prelude::*;
use ravec_jobs::Device;
use std::ffi::CString;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};

/// A device, and the process that opened it.
struct Opened {
    process: u32,
    device: Device,
}

static DEVICE: Mutex<Option<Opened>> = Mutex::new(None);

/// The process that loaded the driver of an adapter, or 0. Drivers do not survive a fork: they wait forever for threads that are gone.
static DRIVER_OWNER: AtomicU32 = AtomicU32::new(0);

/// Opens the device for work from now on, and returns its adapter and driver, or nothing for the CPU.
#[pyfunction]
pub fn set_device(py: Python<'_>, name: &str) -> PyResult<Option<String>> {
    let owner = DRIVER_OWNER.load(Ordering::Relaxed);
    if name != "cpu" && owner != 0 && owner != std::process::id() {
        return Err(of_request(format!(
            "cannot use the device `{name}`: this process was forked from one that had opened a device; start processes by `spawn`, or choose `cpu`"
        )));
    }
    py.detach(|| {
        let device = Device::open(name).map_err(|error| of_job(&error))?;
        let adapter = device.adapter();
        if adapter.is_some() {
            DRIVER_OWNER.store(std::process::id(), Ordering::Relaxed);
        }
        keep(device);
        Ok(adapter)
    })
}

/// The device that was chosen, or the CPU. In a process that was forked from one with a device it is the CPU, with a `RuntimeWarning`.
///
/// # Errors
/// The warning itself where filters of Python make it an exception.
pub fn device(py: Python<'_>) -> PyResult<Device> {
    if is_forked() {
        keep(Device::default());
        let text =
            c"this process was forked from one that had opened a device: the CPU does its work";
        PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), text, 2)?;
    }
    let opened = DEVICE.lock().unwrap_or_else(PoisonError::into_inner);
    let device = opened.as_ref().map(|opened| opened.device.clone());
    Ok(device.unwrap_or_default())
}

/// Issues a `RuntimeWarning` for what the CPU had to do instead of the device.
///
/// # Errors
/// The warning itself where filters of Python make it an exception.
pub fn warn(py: Python<'_>, device: &Device) -> PyResult<()> {
    for warning in device.take_warnings() {
        let text = CString::new(warning.replace('\0', ""))?;
        PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &text, 2)?;
    }
    Ok(())
}

/// True if another process opened the device, and it is not the CPU.
fn is_forked() -> bool {
    let opened = DEVICE.lock().unwrap_or_else(PoisonError::into_inner);
    opened.as_ref().is_some_and(|opened| {
        opened.process != std::process::id() && opened.device.adapter().is_some()
    })
}

/// Replaces the device. One of another process is not closed: its driver's threads are not in this one.
fn keep(device: Device) {
    let process = std::process::id();
    let mut current = DEVICE.lock().unwrap_or_else(PoisonError::into_inner);
    let before = current.replace(Opened { process, device });
    if let Some(before) = before
        && before.process != process
    {
        std::mem::forget(before);
    }
}
