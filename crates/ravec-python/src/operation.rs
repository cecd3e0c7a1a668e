//! Any operation, with inputs and outputs in memory.

use crate::array::{self, PixelKind};
use crate::device::device;
use crate::error::{of_job, of_request};
use crate::mesh::MeshData;
use crate::pieces;
use crate::work;
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use ravec::progress::Progress;
use ravec_jobs::{Context, Recipe, Report, Step};
use ravec_media::Picture;
use std::path::PathBuf;
use std::sync::Arc;

/// Result of an operation or a recipe: the report, and what it left in memory.
#[pyclass(frozen, module = "ravec._ravec")]
pub struct Outcome {
    context: Context,
    report: String,
    kind: PixelKind,
}

#[pymethods]
impl Outcome {
    /// The report as JSON.
    #[getter]
    fn report(&self) -> &str {
        &self.report
    }

    /// A picture by its name, such as `@output`, in the samples of the input.
    fn picture(&self, py: Python<'_>, name: PathBuf) -> PyResult<Py<PyAny>> {
        let picture = self
            .context
            .picture(&name)
            .map_err(|error| missing(&error))?;
        array::array(py, picture.image, self.kind)
    }

    /// A mesh by its name.
    fn mesh(&self, name: PathBuf) -> PyResult<MeshData> {
        let mesh = self.context.mesh(&name).map_err(|error| missing(&error))?;
        Ok(MeshData::new(mesh))
    }

    /// A text by its name.
    fn text(&self, name: PathBuf) -> PyResult<String> {
        self.context.text(&name).map_err(|error| missing(&error))
    }
}

fn missing(error: &ravec_jobs::JobError) -> PyErr {
    PyKeyError::new_err(error.to_string())
}

/// Puts inputs into a context: arrays are pictures, strings texts. Gives the kind of pixels of the first picture.
fn insert(
    context: &Context,
    inputs: &Bound<'_, PyDict>,
    color_space: &str,
) -> PyResult<Option<PixelKind>> {
    let linear = PixelKind::is_linear(color_space)?;
    let mut first = None;
    for (name, value) in inputs {
        let name: PathBuf = name.extract()?;
        if !name.to_string_lossy().starts_with('@') {
            return Err(of_request(format!(
                "the name of an input in memory is {}, but must begin with @",
                name.display()
            )));
        }
        if let Ok(mesh) = value.cast::<MeshData>() {
            context.insert_mesh(&name, Arc::clone(&mesh.get().file));
        } else if let Ok(text) = value.cast::<PyString>() {
            context.insert_text(&name, text.to_string());
        } else {
            let (image, kind) = array::picture(&value, linear)?;
            context.insert_picture(&name, Picture::from_image(image));
            first = first.or(Some(kind));
        }
    }
    Ok(first)
}

/// Runs work with inputs in memory.
fn run(
    py: Python<'_>,
    inputs: &Bound<'_, PyDict>,
    color_space: &str,
    progress: Option<&Bound<'_, PyAny>>,
    cluster: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Context) -> Result<Report, ravec_jobs::JobError> + Send + 'static,
) -> PyResult<Outcome> {
    let mut context = Context::default().with_intermediates();
    context.cluster = pieces::cluster(cluster)?;
    context.device = device(py)?;
    let kind = insert(&context, inputs, color_space)?.unwrap_or(PixelKind::RGB8);
    let given = context.clone();
    let is_remote = context.cluster.is_some();
    let work = move |progress: &Progress| {
        let mut context = given;
        context.progress = progress.clone();
        work(&context).map_err(|error| of_job(&error))
    };
    let report = if is_remote {
        // workers may be threads of this process, and need the pool
        work::run_apart(py, progress, work)?
    } else {
        work::run(py, progress, work)?
    };
    let report = report.to_json();
    Ok(Outcome {
        context,
        report,
        kind,
    })
}

/// Runs an operation whose fields are JSON. Paths that begin with @ are inputs and outputs in memory. A cluster is a store and an executor
/// that run its pieces.
#[pyfunction]
#[pyo3(signature = (fields, inputs, color_space = "srgb", progress = None, cluster = None))]
pub fn run_operation(
    py: Python<'_>,
    fields: &str,
    inputs: &Bound<'_, PyDict>,
    color_space: &str,
    progress: Option<&Bound<'_, PyAny>>,
    cluster: Option<&Bound<'_, PyAny>>,
) -> PyResult<Outcome> {
    let step: Step = serde_json::from_str(fields).map_err(of_request)?;
    run(py, inputs, color_space, progress, cluster, move |context| {
        step.operation().run(context)
    })
}

/// Runs a recipe, as if it was read from `file`.
#[pyfunction]
#[pyo3(signature = (recipe, file, inputs, color_space = "srgb", progress = None))]
pub fn run_recipe(
    py: Python<'_>,
    recipe: &str,
    file: PathBuf,
    inputs: &Bound<'_, PyDict>,
    color_space: &str,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Outcome> {
    let recipe = Recipe::from_json(recipe).map_err(of_request)?;
    run(py, inputs, color_space, progress, None, move |context| {
        recipe.run(&file, context)
    })
}
