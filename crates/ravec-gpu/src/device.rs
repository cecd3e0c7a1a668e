//! Adapters, and the device that is opened on one of them.

use crate::error::{Failure, GpuError};
use std::collections::HashMap;
use std::fmt;
use std::str::FromStr;
use std::sync::{Arc, Mutex, PoisonError};

/// Choice of the device that computes.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The CPU.
    Cpu,
    /// A hardware adapter if there is one, else the CPU (default). Nothing is measured.
    #[default]
    Auto,
    /// A hardware adapter: a discrete one before an integrated one. An error if there is none.
    Gpu,
    /// The first adapter whose name contains this text, in any case: the only way to a software driver.
    Named(String),
}

impl FromStr for DeviceChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "" => Err(
                "the name of the device is empty: choose cpu, gpu, auto or an adapter's name"
                    .to_owned(),
            ),
            "cpu" => Ok(Self::Cpu),
            "auto" => Ok(Self::Auto),
            "gpu" => Ok(Self::Gpu),
            name => Ok(Self::Named(name.to_owned())),
        }
    }
}

impl fmt::Display for DeviceChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cpu => "cpu",
            Self::Auto => "auto",
            Self::Gpu => "gpu",
            Self::Named(name) => name,
        })
    }
}

/// An adapter of this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AdapterInfo {
    /// Name, such as that of the graphics card.
    pub name: String,
    /// Interface: Vulkan, Metal or Dx12.
    pub interface: String,
    /// Name and version of the driver.
    pub driver: String,
    /// True for a driver that computes on the CPU.
    pub is_software: bool,
}

impl AdapterInfo {
    fn of(adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        Self {
            name: info.name,
            interface: format!("{:?}", info.backend),
            driver: format!("{} {}", info.driver, info.driver_info)
                .trim()
                .to_owned(),
            is_software: info.device_type == wgpu::DeviceType::Cpu,
        }
    }
}

impl fmt::Display for AdapterInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}", self.name, self.interface)?;
        if !self.driver.is_empty() {
            write!(f, ", {}", self.driver)?;
        }
        f.write_str(if self.is_software { ", software)" } else { ")" })
    }
}

/// Options for opening a device.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct OpenOptions {
    /// Run the validation layers of the interface, where they are installed; their messages go to the `log` facade. Slow.
    pub validation: bool,
}

/// The interfaces. OpenGL is left out: it has no compute shaders on many machines, and it is where software drivers hide.
const INTERFACES: wgpu::Backends = wgpu::Backends::PRIMARY;

fn instance(options: OpenOptions) -> wgpu::Instance {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = INTERFACES;
    descriptor.flags = if options.validation {
        wgpu::InstanceFlags::VALIDATION
    } else {
        wgpu::InstanceFlags::empty()
    };
    wgpu::Instance::new(descriptor)
}

/// The adapters of this machine, hardware first.
pub fn adapters() -> Vec<AdapterInfo> {
    let found = sorted_adapters(&instance(OpenOptions::default()));
    found.iter().map(AdapterInfo::of).collect()
}

fn sorted_adapters(instance: &wgpu::Instance) -> Vec<wgpu::Adapter> {
    let mut found = pollster::block_on(instance.enumerate_adapters(INTERFACES));
    found.sort_by_key(|adapter| match adapter.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    });
    found
}

/// An open device with its kernels.
///
/// One is enough for a process: threads may share it, and their work is queued.
pub struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) kernels: Mutex<HashMap<String, Arc<wgpu::ComputePipeline>>>,
    pub(crate) tables: Mutex<HashMap<String, Arc<wgpu::Buffer>>>,
    info: AdapterInfo,
    health: Arc<Mutex<Health>>,
}

#[derive(Default)]
struct Health {
    /// Reason for which the device is no longer used.
    lost: Option<String>,
    /// The last error outside an error scope.
    refused: Option<Failure>,
    /// Warnings not yet returned to the caller.
    warnings: Vec<String>,
}

impl fmt::Debug for Gpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Gpu")
            .field("adapter", &self.info)
            .finish_non_exhaustive()
    }
}

impl Gpu {
    /// Opens the chosen device; nothing for the CPU.
    ///
    /// The device gets the default limits of WebGPU, so that what runs here runs everywhere. Before it is returned, a small
    /// picture is fitted on it and on the CPU: a device whose arithmetic gives other fields is refused.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] if there is no such adapter, [`GpuError::Open`] if its driver refuses, [`GpuError::Rounding`] if
    /// its results differ from those of the CPU. [`DeviceChoice::Auto`] gives the CPU instead of the first, and errors for the
    /// others.
    pub fn open(choice: &DeviceChoice, options: OpenOptions) -> Result<Option<Self>, GpuError> {
        if *choice == DeviceChoice::Cpu {
            return Ok(None);
        }
        let found = sorted_adapters(&instance(options));
        let infos: Vec<AdapterInfo> = found.iter().map(AdapterInfo::of).collect();
        let Some(index) = position(&infos, choice) else {
            if *choice == DeviceChoice::Auto {
                return Ok(None);
            }
            return Err(GpuError::NoAdapter {
                wanted: choice.to_string(),
                found: infos.iter().map(ToString::to_string).collect(),
            });
        };
        let gpu = Self::open_adapter(&found[index], infos[index].clone())?;
        crate::probe::check(&gpu)?;
        Ok(Some(gpu))
    }

    fn open_adapter(adapter: &wgpu::Adapter, info: AdapterInfo) -> Result<Self, GpuError> {
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("ravec"),
            required_limits: wgpu::Limits::default(),
            ..Default::default()
        };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&descriptor)).map_err(|error| {
                GpuError::Open {
                    adapter: info.to_string(),
                    cause: error.to_string(),
                }
            })?;
        let health = Arc::new(Mutex::new(Health::default()));
        let shared = Arc::clone(&health);
        device.set_device_lost_callback(move |_, message| {
            lock(&shared).lost = Some(one_line(&message));
        });
        let shared = Arc::clone(&health);
        // without a handler such an error ends the program
        device.on_uncaptured_error(Arc::new(move |error| {
            lock(&shared).refused = Some(Failure::of(&error));
        }));
        Ok(Self {
            device,
            queue,
            kernels: Mutex::default(),
            tables: Mutex::default(),
            info,
            health,
        })
    }

    /// The adapter.
    pub fn adapter(&self) -> &AdapterInfo {
        &self.info
    }

    /// True once the device was lost. What is asked of it from then on is computed on the CPU.
    pub fn is_lost(&self) -> bool {
        lock(&self.health).lost.is_some()
    }

    /// Warnings about work that was done on the CPU instead, since the last call.
    pub fn take_warnings(&self) -> Vec<String> {
        std::mem::take(&mut lock(&self.health).warnings)
    }

    /// Destroys the device, as a driver does that is reset: what is under way fails, and the CPU goes on with it.
    pub fn destroy(&self) {
        self.device.destroy();
        let mut health = lock(&self.health);
        health
            .lost
            .get_or_insert_with(|| "it was destroyed".to_owned());
    }

    /// Fails if the device is lost or has refused what was asked of it.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        let mut health = lock(&self.health);
        if let Some(cause) = &health.lost {
            return Err(Failure::Lost(cause.clone()));
        }
        match health.refused.take() {
            Some(failure) => Err(failure),
            None => Ok(()),
        }
    }

    /// Records that work goes on with the CPU. A device that was lost causes one warning and not one a picture.
    pub(crate) fn warn(&self, work: &str, failure: &Failure) {
        let text = format!("{}: {failure}; {work} continues on the CPU", self.info.name);
        let mut health = lock(&self.health);
        if let Failure::Lost(cause) | Failure::Refused(cause) = failure {
            health.lost.get_or_insert_with(|| cause.clone());
        }
        if !health.warnings.contains(&text) {
            health.warnings.push(text);
        }
    }
}

/// The first of the adapters, hardware first, that the choice allows.
fn position(adapters: &[AdapterInfo], choice: &DeviceChoice) -> Option<usize> {
    adapters.iter().position(|adapter| match choice {
        DeviceChoice::Cpu => false,
        DeviceChoice::Auto | DeviceChoice::Gpu => !adapter.is_software,
        DeviceChoice::Named(name) => adapter.name.to_lowercase().contains(&name.to_lowercase()),
    })
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn one_line(message: &str) -> String {
    let mut lines = message
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty());
    lines.next().unwrap_or("no reason was given").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(name: &str, is_software: bool) -> AdapterInfo {
        AdapterInfo {
            name: name.to_owned(),
            interface: "Vulkan".to_owned(),
            driver: String::new(),
            is_software,
        }
    }

    #[test]
    fn software_drivers_are_taken_by_name_only() {
        let both = [
            adapter("Hardware One", false),
            adapter("llvmpipe (LLVM)", true),
        ];
        assert_eq!(position(&both, &DeviceChoice::Gpu), Some(0));
        assert_eq!(position(&both, &DeviceChoice::Auto), Some(0));
        assert_eq!(
            position(&both, &DeviceChoice::Named("LLVMpipe".to_owned())),
            Some(1)
        );
        assert_eq!(
            position(&both, &DeviceChoice::Named("other".to_owned())),
            None
        );
        assert_eq!(position(&both[1..], &DeviceChoice::Gpu), None);
        assert_eq!(position(&both[1..], &DeviceChoice::Auto), None);
        assert_eq!(position(&both, &DeviceChoice::Cpu), None);
    }

    #[test]
    fn choices_are_read_as_they_are_written() {
        for text in ["cpu", "gpu", "auto", "NVIDIA H100"] {
            assert_eq!(text.parse::<DeviceChoice>().unwrap().to_string(), text);
        }
        assert!("".parse::<DeviceChoice>().is_err());
    }
}
