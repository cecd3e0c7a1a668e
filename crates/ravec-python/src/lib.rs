//! The compiled half of the Python package `ravec`.
//!
//! It converts arrays and meshes, runs operations in a pool of threads while the interpreter is free for other threads, and hands
//! interruptions and progress to Python. Names, defaults and documentation that users see are those of the package in
//! `python/ravec`; everything here is called by it.
//!
//! | module | what is in it |
//! | --- | --- |
//! | `array` | NumPy arrays as pictures, and back in the samples that came in |
//! | `mesh` | vertices and triangles as a mesh, and back |
//! | `work` | the pool, interruption and progress |
//! | `device` | the CPU or a GPU, for two-color pixels and warps |
//! | `operation` | any operation and any recipe, with inputs and outputs in memory |
//! | `pieces` | work in pieces that other processes run |
//! | `twocolor`, `retarget`, `completion`, `planar` | what is prepared once and asked many times |
//! | `error` | exceptions |
//!
//! # Guarantees
//!
//! - Inputs are copied once, while the interpreter is locked, so that other threads may write to them during the work. Results are
//!   handed over without a copy.
//! - Work runs in a pool of its own, which a process that was forked makes anew; work on few pixels may run on the calling thread.
//! - An interruption ends the work at its next check for cancellation.

#![expect(
    clippy::needless_pass_by_value,
    reason = "arguments of functions that Python calls are owned"
)]

mod array;
mod completion;
mod device;
mod error;
mod mesh;
mod operation;
mod pieces;
mod planar;
mod retarget;
mod twocolor;
mod work;

use pyo3::prelude::*;
use std::ffi::OsString;

/// Runs the command line, and returns its exit code.
#[pyfunction]
fn main(py: Python<'_>, arguments: Vec<String>) -> u8 {
    py.detach(|| ravec_cli::run(arguments.into_iter().map(OsString::from)))
}

/// The recipe of a command line as JSON, and an exit code if there is none: help was asked for, or something is wrong.
#[pyfunction]
fn recipe_of(arguments: Vec<String>) -> (Option<String>, u8) {
    match ravec_cli::recipe_of(arguments.into_iter().map(OsString::from)) {
        Ok(recipe) => (Some(recipe), 0),
        Err(code) => (None, code),
    }
}

#[pymodule]
fn _ravec(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("OPERATIONS", ravec_jobs::Step::NAMES.to_vec())?;
    module.add("Error", module.py().get_type::<error::Error>())?;
    module.add_class::<mesh::MeshData>()?;
    module.add_class::<operation::Outcome>()?;
    module.add_class::<pieces::Worker>()?;
    module.add_class::<twocolor::Field>()?;
    module.add_class::<retarget::Retargeter>()?;
    module.add_class::<completion::FragmentIndex>()?;
    module.add_function(wrap_pyfunction!(main, module)?)?;
    module.add_function(wrap_pyfunction!(recipe_of, module)?)?;
    module.add_function(wrap_pyfunction!(array::png, module)?)?;
    module.add_function(wrap_pyfunction!(device::set_device, module)?)?;
    module.add_function(wrap_pyfunction!(work::set_threads, module)?)?;
    module.add_function(wrap_pyfunction!(operation::run_operation, module)?)?;
    module.add_function(wrap_pyfunction!(operation::run_recipe, module)?)?;
    module.add_function(wrap_pyfunction!(planar::estimate, module)?)?;
    module.add_function(wrap_pyfunction!(planar::estimate_robust, module)?)?;
    module.add_function(wrap_pyfunction!(planar::warp, module)?)?;
    Ok(())
}
