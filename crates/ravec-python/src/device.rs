//! The device that computes two-color pixels and warps, for all work of the process.

use crate::error::of_job;
use pyo3::exceptions::PyRuntimeWarning;
use pyo3::prelude::*;
use ravec_jobs::Device;
use std::ffi::CString;
use std::sync::{Mutex, PoisonError};

/// A device, and the process that opened it: adapters do not survive a fork.
struct Opened {
    process: u32,
    name: String,
    device: Device,
}

static DEVICE: Mutex<Option<Opened>> = Mutex::new(None);

/// Opens the device for work from now on, and returns its adapter and driver, or nothing for the CPU.
#[pyfunction]
pub fn set_device(py: Python<'_>, name: &str) -> PyResult<Option<String>> {
    py.detach(|| {
        let opened = open(name)?;
        let adapter = opened.device.adapter();
        keep(opened);
        Ok(adapter)
    })
}

/// The device that was chosen, or the CPU. A process that was forked opens its own.
///
/// # Errors
/// That of [`Device::open`] in a process that was forked.
pub fn device() -> PyResult<Device> {
    let forked = {
        let opened = DEVICE.lock().unwrap_or_else(PoisonError::into_inner);
        match &*opened {
            None => return Ok(Device::default()),
            Some(opened) if opened.process == std::process::id() => {
                return Ok(opened.device.clone());
            }
            Some(opened) => opened.name.clone(),
        }
    };
    let opened = open(&forked)?;
    let device = opened.device.clone();
    keep(opened);
    Ok(device)
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

fn open(name: &str) -> PyResult<Opened> {
    Ok(Opened {
        process: std::process::id(),
        name: name.to_owned(),
        device: Device::open(name).map_err(|error| of_job(&error))?,
    })
}

/// Replaces the device. One of another process is not closed: its driver's threads are not in this one.
fn keep(opened: Opened) {
    let mut current = DEVICE.lock().unwrap_or_else(PoisonError::into_inner);
    let before = current.replace(opened);
    if let Some(before) = before
        && before.process != std::process::id()
    {
        std::mem::forget(before);
    }
}
