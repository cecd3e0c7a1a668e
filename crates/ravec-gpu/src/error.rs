//! Errors of devices.

/// Errors of opening a device.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// No adapter of this machine matches the choice.
    #[error("no adapter for the device `{wanted}`: {}", listed(found))]
    NoAdapter {
        /// The choice.
        wanted: String,
        /// The adapters that are there.
        found: Vec<String>,
    },
    /// The driver refused to open the adapter.
    #[error("{adapter} cannot be opened: {cause}; choose the device `cpu`")]
    Open {
        /// The adapter.
        adapter: String,
        /// Message of the driver.
        cause: String,
    },
    /// The device stopped in the middle of a measurement.
    #[error("{adapter} stopped: {cause}")]
    Stopped {
        /// The adapter.
        adapter: String,
        /// Message of the device or its driver.
        cause: String,
    },
    /// The device's results are not those of the CPU.
    #[error(
        "{adapter} gives other two-color pixels than the CPU ({cause}): update its driver, or choose the device `cpu`"
    )]
    Rounding {
        /// The adapter.
        adapter: String,
        /// The first difference.
        cause: String,
    },
}

fn listed(found: &[String]) -> String {
    if found.is_empty() {
        return "this machine has none; install a driver for Vulkan, or choose the device `cpu`"
            .to_owned();
    }
    format!(
        "this machine has {}; choose one by its name, or the device `cpu`",
        found.join(", ")
    )
}

/// Failures of a device during its work. The CPU computes the rest.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(crate) enum Failure {
    #[error("the device was lost ({0})")]
    Lost(String),
    #[error("the memory of the device is exhausted")]
    Memory,
    #[error("the driver refused the work ({0})")]
    Refused(String),
}

impl Failure {
    pub fn of(error: &wgpu::Error) -> Self {
        match error {
            wgpu::Error::OutOfMemory { .. } => Self::Memory,
            other => Self::Refused(
                other
                    .to_string()
                    .lines()
                    .map(str::trim)
                    .collect::<Vec<_>>()
                    .join(" "),
            ),
        }
    }
}

/// Reasons for which work on a device ends early.
#[derive(Debug)]
pub(crate) enum Stopped {
    Cancelled(ravec_progress::Cancelled),
    Failed(Failure),
}

impl From<Failure> for Stopped {
    fn from(failure: Failure) -> Self {
        Self::Failed(failure)
    }
}

impl From<ravec_progress::Cancelled> for Stopped {
    fn from(cancelled: ravec_progress::Cancelled) -> Self {
        Self::Cancelled(cancelled)
    }
}
