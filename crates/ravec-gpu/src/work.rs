//! Kernels, buffers and work in flight.

use crate::device::Gpu;
use crate::error::{Failure, Stopped};
use ravec_progress::Progress;
use ravec_raster::Rect;
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::mpsc;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

/// Threads in a group: two to four warps of any hardware, and few enough that a group's private memory fits a cache.
pub(crate) const GROUP: u32 = 64;

/// Groups in a row of a dispatch, which may have 65 535 at most.
const GROUPS_PER_ROW: u32 = 32_768;

/// Bands on the device at a time: one is read back while one is computed and one is uploaded.
const IN_FLIGHT: usize = 3;

/// Longest time between two looks at the device and at the caller's cancellation.
const MAX_PAUSE: Duration = Duration::from_millis(1);

/// After this a device counts as lost: far beyond the watchdogs of drivers.
const PATIENCE: Duration = Duration::from_mins(2);

/// One run of a kernel.
pub(crate) struct Run<'a> {
    pub kernel: &'a wgpu::ComputePipeline,
    pub bindings: Vec<(u32, &'a wgpu::Buffer)>,
    /// Threads that have work.
    pub threads: usize,
}

/// Results on their way to the CPU.
pub(crate) struct Pending {
    buffer: wgpu::Buffer,
    bytes: u64,
    /// When the work was handed to the device.
    pub submitted: Instant,
    mapped: mpsc::Receiver<Result<(), wgpu::BufferAsyncError>>,
}

impl Gpu {
    /// The kernel `entry` of a shader that is made of `constants` and `parts`. Compiled once.
    pub(crate) fn kernel(
        &self,
        entry: &str,
        constants: &str,
        parts: &[&str],
    ) -> Result<Arc<wgpu::ComputePipeline>, Failure> {
        self.check()?;
        let key = format!("{entry}\n{constants}");
        let mut kernels = self.kernels.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(kernel) = kernels.get(&key) {
            return Ok(Arc::clone(kernel));
        }
        let code = format!(
            "const GROUP: u32 = {GROUP}u;\n{constants}\n{}",
            parts.join("\n")
        );
        let kernel = self.scoped(|| {
            let module = self
                .device
                .create_shader_module(wgpu::ShaderModuleDescriptor {
                    label: Some(entry),
                    source: wgpu::ShaderSource::Wgsl(code.into()),
                });
            self.device
                .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(entry),
                    layout: None,
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    cache: None,
                })
        })?;
        let kernel = Arc::new(kernel);
        kernels.insert(key, Arc::clone(&kernel));
        Ok(kernel)
    }

    /// A buffer of data that many runs share, by its name. Uploaded once.
    pub(crate) fn table<T: bytemuck::NoUninit>(
        &self,
        name: &str,
        data: impl FnOnce() -> Vec<T>,
    ) -> Result<Arc<wgpu::Buffer>, Failure> {
        self.check()?;
        let mut tables = self.tables.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(table) = tables.get(name) {
            return Ok(Arc::clone(table));
        }
        let table =
            Arc::new(self.upload(bytemuck::cast_slice(&data()), wgpu::BufferUsages::STORAGE)?);
        tables.insert(name.to_owned(), Arc::clone(&table));
        Ok(table)
    }

    /// A buffer with these bytes, and up to three more.
    pub(crate) fn upload(
        &self,
        bytes: &[u8],
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, Failure> {
        let whole = bytes.len() / 4 * 4;
        let buffer = self.buffer(bytes.len(), usage | wgpu::BufferUsages::COPY_DST)?;
        self.scoped(|| {
            self.queue.write_buffer(&buffer, 0, &bytes[..whole]);
            if whole < bytes.len() {
                let mut last = [0; 4];
                last[..bytes.len() - whole].copy_from_slice(&bytes[whole..]);
                self.queue.write_buffer(&buffer, whole as u64, &last);
            }
        })?;
        Ok(buffer)
    }

    /// The parameters of a kernel.
    pub(crate) fn uniform<T: bytemuck::NoUninit>(
        &self,
        params: &T,
    ) -> Result<wgpu::Buffer, Failure> {
        self.upload(bytemuck::bytes_of(params), wgpu::BufferUsages::UNIFORM)
    }

    /// A buffer of at least `bytes` bytes, zeroed.
    pub(crate) fn buffer(
        &self,
        bytes: usize,
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, Failure> {
        self.scoped(|| {
            self.device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                // uniform buffers are read in units of 16 bytes
                size: bytes.next_multiple_of(16).max(16) as u64,
                usage,
                mapped_at_creation: false,
            })
        })
    }

    /// A buffer for the results of a kernel.
    pub(crate) fn output(&self, bytes: usize) -> Result<wgpu::Buffer, Failure> {
        self.buffer(
            bytes,
            wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
        )
    }

    /// Submits runs that follow each other, none to copy alone, and the copy of `bytes` bytes of `output` to the CPU.
    pub(crate) fn submit(
        &self,
        runs: &[Run<'_>],
        output: &wgpu::Buffer,
        bytes: usize,
    ) -> Result<Pending, Failure> {
        self.check()?;
        let size = bytes.next_multiple_of(4) as u64;
        let buffer = self.buffer(
            bytes,
            wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        )?;
        self.scoped(|| {
            let mut encoder = self
                .device
                .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            for run in runs {
                let entries: Vec<_> = run
                    .bindings
                    .iter()
                    .map(|(binding, buffer)| wgpu::BindGroupEntry {
                        binding: *binding,
                        resource: buffer.as_entire_binding(),
                    })
                    .collect();
                let group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: None,
                    layout: &run.kernel.get_bind_group_layout(0),
                    entries: &entries,
                });
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
                pass.set_pipeline(run.kernel);
                pass.set_bind_group(0, &group, &[]);
                let groups = run.threads.div_ceil(GROUP as usize) as u32;
                let row = groups.clamp(1, GROUPS_PER_ROW);
                pass.dispatch_workgroups(row, groups.div_ceil(row), 1);
            }
            encoder.copy_buffer_to_buffer(output, 0, &buffer, 0, Some(size));
            let commands = encoder.finish();
            let submitted = Instant::now();
            self.queue.submit([commands]);
            let (sender, mapped) = mpsc::channel();
            buffer.map_async(wgpu::MapMode::Read, 0..size, move |result| {
                // the receiver is gone if the work was cancelled
                let _ = sender.send(result);
            });
            Pending {
                buffer: buffer.clone(),
                bytes: size,
                submitted,
                mapped,
            }
        })
    }

    /// Waits for results and hands them to `receive`.
    pub(crate) fn receive<R>(
        &self,
        pending: &Pending,
        progress: &Progress,
        receive: impl FnOnce(&[u8]) -> R,
    ) -> Result<R, Stopped> {
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            progress.check()?;
            // without waiting: waits of several threads end in a panic of wgpu 30 (its pull request 9958)
            let poll = self.device.poll(wgpu::PollType::Poll);
            match pending.mapped.try_recv() {
                Ok(Ok(())) => {
                    let view = pending.buffer.get_mapped_range(0..pending.bytes);
                    let view = view.map_err(|error| Failure::Refused(error.to_string()))?;
                    return Ok(receive(&view));
                }
                Ok(Err(_)) | Err(mpsc::TryRecvError::Disconnected) => {
                    self.check()?;
                    return Err(Failure::Refused("results cannot be read".to_owned()).into());
                }
                Err(mpsc::TryRecvError::Empty) => {}
            }
            self.check()?;
            if let Err(error) = poll {
                return Err(Failure::Refused(error.to_string()).into());
            }
            // short pauses for short work
            std::thread::sleep((start.elapsed() / 16).min(MAX_PAUSE));
        }
        Err(Failure::Lost("it does not answer".to_owned()).into())
    }

    /// Runs `action`, and gives the errors that it causes on this thread.
    fn scoped<R>(&self, action: impl FnOnce() -> R) -> Result<R, Failure> {
        let filters = [
            wgpu::ErrorFilter::Internal,
            wgpu::ErrorFilter::OutOfMemory,
            wgpu::ErrorFilter::Validation,
        ];
        let scopes = filters.map(|filter| self.device.push_error_scope(filter));
        let result = action();
        let mut failure = None;
        for scope in scopes.into_iter().rev() {
            if let Some(error) = pollster::block_on(scope.pop()) {
                failure = Some(Failure::of(&error));
            }
        }
        // a lost device refuses everything: that it is lost says more
        match failure {
            Some(failure) => Err(self.check().err().unwrap_or(failure)),
            None => Ok(result),
        }
    }

    /// Runs bands one after the other, several in flight.
    ///
    /// `submit` starts a band and may keep something for it; `receive` takes that and the results, in order. Fails as soon as
    /// the device does, after the bands that it has computed were received.
    pub(crate) fn pipelined<Band: Clone, Kept>(
        &self,
        bands: impl IntoIterator<Item = Band>,
        progress: &Progress,
        mut submit: impl FnMut(Band) -> Result<(Kept, Pending), Failure>,
        mut receive: impl FnMut(Band, Kept, &[u8]) -> Result<(), Stopped>,
    ) -> Result<(), Stopped> {
        let mut in_flight = VecDeque::new();
        let mut finish = |(band, (kept, pending)): (Band, (Kept, Pending))| {
            self.receive(&pending, progress, |bytes| receive(band, kept, bytes))?
        };
        for band in bands {
            progress.check()?;
            if in_flight.len() == IN_FLIGHT
                && let Some(first) = in_flight.pop_front()
            {
                finish(first)?;
            }
            match submit(band.clone()) {
                Ok(started) => in_flight.push_back((band, started)),
                Err(failure) => {
                    // what is computed already need not be computed again
                    in_flight.into_iter().try_for_each(finish)?;
                    return Err(failure.into());
                }
            }
        }
        in_flight.into_iter().try_for_each(finish)
    }
}

/// `count` rows in bands of at most `rows`.
pub(crate) fn bands(count: usize, rows: usize) -> impl Iterator<Item = Range<usize>> {
    (0..count)
        .step_by(rows)
        .map(move |first| first..(first + rows).min(count))
}

/// The rows of `region` that are left after the first `done` ones.
pub(crate) fn rest_of(region: Rect, done: usize) -> Rect {
    Rect::new(
        region.col,
        region.row + done,
        region.width,
        region.height - done,
    )
}

/// Numbers behind each other in the bytes of a buffer.
pub(crate) struct Words<'a>(&'a [u32]);

impl<'a> Words<'a> {
    /// The words of the results of a kernel.
    pub fn new(bytes: &'a [u8]) -> Self {
        // mapped ranges begin at multiples of 8 bytes
        Self(bytemuck::cast_slice(&bytes[..bytes.len() / 4 * 4]))
    }

    pub fn word(&self, at: usize) -> u32 {
        self.0[at]
    }

    pub fn floats<const N: usize>(&self, at: usize) -> [f32; N] {
        std::array::from_fn(|k| f32::from_bits(self.0[at + k]))
    }
}
