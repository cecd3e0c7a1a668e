//! Work in pieces: an executor and a store that Python carries, and workers.

use crate::error::{of_request, of_task};
use crate::work;
use pyo3::exceptions::PyFileNotFoundError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyString};
use ravec::memory::MemoryBudget;
use ravec::offset;
use ravec::pieces::{Cluster, Executor, FolderStore, PartStore};
use ravec::progress::Progress;
use ravec_jobs::mosaic::MosaicWorker;
use std::io::{Error, ErrorKind, Result};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

/// Parts that an object of Python keeps, by its methods `write`, `read`, `read_all` and `remove`.
struct PythonStore(Py<PyAny>);

fn of_python(py: Python<'_>, error: &PyErr) -> Error {
    let kind = if error.is_instance_of::<PyFileNotFoundError>(py) {
        ErrorKind::NotFound
    } else {
        ErrorKind::Other
    };
    Error::new(kind, error.value(py).to_string())
}

impl PythonStore {
    fn call<'py>(
        &self,
        py: Python<'py>,
        method: &str,
        arguments: impl pyo3::call::PyCallArgs<'py>,
    ) -> Result<Bound<'py, PyAny>> {
        let called = self.0.bind(py).call_method1(method, arguments);
        called.map_err(|error| of_python(py, &error))
    }
}

impl PartStore for PythonStore {
    fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        Python::attach(|py| {
            self.call(py, "write", (name, PyBytes::new(py, bytes)))
                .map(drop)
        })
    }

    fn read(&self, name: &str, range: Range<u64>) -> Result<Vec<u8>> {
        Python::attach(|py| {
            let found = self.call(py, "read", (name, range.start, range.end))?;
            let bytes: Vec<u8> = found.extract().map_err(|error| of_python(py, &error))?;
            if bytes.len() as u64 != range.end - range.start {
                let reason = format!("the part {name} is shorter than it was");
                return Err(Error::new(ErrorKind::UnexpectedEof, reason));
            }
            Ok(bytes)
        })
    }

    fn read_all(&self, name: &str) -> Result<Vec<u8>> {
        Python::attach(|py| {
            let found = self.call(py, "read_all", (name,))?;
            found.extract().map_err(|error| of_python(py, &error))
        })
    }

    fn remove(&self, name: &str) -> Result<()> {
        Python::attach(|py| self.call(py, "remove", (name,)).map(drop))
    }
}

/// An executor that an object of Python leads, by its methods `submit(number, piece)` and `next()`, which returns a number and an
/// answer, or `None` after a short time without one.
struct PythonExecutor(Py<PyAny>);

impl Executor for PythonExecutor {
    fn submit(&mut self, number: u64, piece: Vec<u8>) -> Result<()> {
        Python::attach(|py| {
            let piece = PyBytes::new(py, &piece);
            let called = self.0.bind(py).call_method1("submit", (number, piece));
            called.map(drop).map_err(|error| of_python(py, &error))
        })
    }

    fn next(&mut self, progress: &Progress) -> Result<(u64, Vec<u8>)> {
        loop {
            if progress.is_cancelled() {
                return Err(ErrorKind::Interrupted.into());
            }
            let answer = Python::attach(|py| {
                let answer = self.0.bind(py).call_method0("next");
                let answer = answer.and_then(|answer| answer.extract::<Option<(u64, Vec<u8>)>>());
                answer.map_err(|error| of_python(py, &error))
            });
            if let Some(answer) = answer? {
                return Ok(answer);
            }
        }
    }
}

/// The store of a folder, or of an object.
fn store(value: &Bound<'_, PyAny>) -> PyResult<Arc<dyn PartStore>> {
    if value.is_instance_of::<PyString>() {
        let folder: PathBuf = value.extract()?;
        return Ok(Arc::new(FolderStore::new(&folder)));
    }
    Ok(Arc::new(PythonStore(value.clone().unbind())))
}

/// The cluster of a store and an executor.
pub fn cluster(value: Option<&Bound<'_, PyAny>>) -> PyResult<Option<Arc<Cluster>>> {
    let Some(value) = value else { return Ok(None) };
    let (parts, executor): (Bound<'_, PyAny>, Py<PyAny>) = value.extract()?;
    let cluster = Cluster::new(store(&parts)?, Box::new(PythonExecutor(executor)));
    Ok(Some(Arc::new(cluster)))
}

/// A worker for the pieces of one work.
#[pyclass(frozen, module = "ravec._ravec")]
pub struct Worker(Kind);

#[derive(Clone)]
enum Kind {
    Offset(Arc<offset::OffsetWorker>),
    Mosaic(Arc<MosaicWorker>),
}

#[pymethods]
impl Worker {
    /// A worker for an operation whose parts are in a store, with a memory limit for photos in bytes.
    #[new]
    #[pyo3(signature = (operation, parts, memory_bytes = None))]
    fn new(
        py: Python<'_>,
        operation: &str,
        parts: &Bound<'_, PyAny>,
        memory_bytes: Option<u64>,
    ) -> PyResult<Self> {
        let parts = store(parts)?;
        match operation {
            "offset" => {
                let worker = work::run(py, None, move |progress| {
                    offset::OffsetWorker::open(parts, progress).map_err(of_task)
                })?;
                Ok(Self(Kind::Offset(Arc::new(worker))))
            }
            "mosaic" => {
                let memory = memory_bytes.map_or_else(MemoryBudget::default, MemoryBudget::new);
                let worker = MosaicWorker::new(parts, memory);
                Ok(Self(Kind::Mosaic(Arc::new(worker))))
            }
            other => Err(of_request(format!(
                "{other} is not an operation in pieces: only offset and mosaic are"
            ))),
        }
    }

    /// Runs a piece, and returns the answer.
    fn run<'py>(&self, py: Python<'py>, piece: Vec<u8>) -> PyResult<Bound<'py, PyBytes>> {
        let kind = self.0.clone();
        let answer = work::run(py, None, move |progress| match kind {
            Kind::Offset(worker) => worker.run(&piece, progress).map_err(of_task),
            Kind::Mosaic(worker) => worker.run(&piece, progress).map_err(of_task),
        })?;
        Ok(PyBytes::new(py, &answer))
    }
}
