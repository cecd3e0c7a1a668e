//! Work in a pool of threads, while the interpreter is free: interruption, progress and panics.

use crate::error;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use ravec::progress::{Progress, Update};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Time between two looks at interruptions and progress.
const POLL: Duration = Duration::from_millis(25);

/// The pool, and the process that made it: threads do not survive a fork.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Number of threads that was asked for; 0 for all cores.
static THREADS: AtomicUsize = AtomicUsize::new(0);

/// Sets the number of threads for work from now on; 0 for all cores. Results do not depend on it.
#[pyfunction]
pub fn set_threads(count: usize) {
    if THREADS.swap(count, Ordering::Relaxed) != count {
        let pool = POOL.lock().unwrap_or_else(PoisonError::into_inner).take();
        match pool {
            // its threads end when the work that they have is done
            Some((owner, pool)) if owner == std::process::id() => drop(pool),
            // threads of another process do not end
            pool => std::mem::forget(pool),
        }
    }
}

fn pool() -> PyResult<Arc<ThreadPool>> {
    let process = std::process::id();
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((owner, pool)) = &*pool
        && *owner == process
    {
        return Ok(Arc::clone(pool));
    }
    let made = new_pool()?;
    // threads of another process cannot be joined
    std::mem::forget(pool.replace((process, Arc::clone(&made))));
    Ok(made)
}

fn new_pool() -> PyResult<Arc<ThreadPool>> {
    ThreadPoolBuilder::new()
        .num_threads(THREADS.load(Ordering::Relaxed))
        .thread_name(|index| format!("ravec-{index}"))
        .build()
        .map(Arc::new)
        .map_err(|error| PyRuntimeError::new_err(format!("no threads can be started: {error}")))
}

/// Runs `work` in the pool and waits for it with the interpreter unlocked.
///
/// `listener` is called with the phase, the units that are done and their total, at most once in 25 milliseconds. An exception of it, and an
/// interruption, cancel the work and are raised when it has ended.
///
/// # Errors
/// The error of `work`, the exception of the listener, or that of a signal handler.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    listener: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Progress) -> PyResult<T> + Send + 'static,
) -> PyResult<T> {
    run_in(&*pool()?, py, listener, work)
}

/// Maximum number of pixels of work that runs on the calling thread, as passing it to the pool and back takes longer. It cannot be
/// interrupted.
const MAX_PIXELS_OF_CALLER: usize = 64 * 64;

/// Maximum number of calling threads with a pool of their own, whose 8 kB are not freed when the thread ends.
const MAX_CALLERS: usize = 64;

/// Number of threads that have called.
static CALLERS: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// A pool whose only thread is this one, for the first callers. It starts no thread, and so survives a fork.
    static CALLER: Option<Arc<ThreadPool>> = pool_of_caller();
}

fn pool_of_caller() -> Option<Arc<ThreadPool>> {
    if CALLERS.fetch_add(1, Ordering::Relaxed) >= MAX_CALLERS {
        return None;
    }
    let pool = ThreadPoolBuilder::new().num_threads(1);
    pool.use_current_thread().build().ok().map(Arc::new)
}

/// Runs `work` on about this number of `pixels`: on the calling thread if there are few and no listener, else as [`run`].
///
/// # Errors
/// As [`run`].
pub fn run_sized<T: Send + 'static>(
    py: Python<'_>,
    pixels: usize,
    listener: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Progress) -> PyResult<T> + Send + 'static,
) -> PyResult<T> {
    let is_small = pixels <= MAX_PIXELS_OF_CALLER && listener.is_none();
    let Some(pool) = is_small.then(|| CALLER.with(Option::clone)).flatten() else {
        return run(py, listener, work);
    };
    let guarded = || catch_unwind(AssertUnwindSafe(|| work(&Progress::none())));
    let done = py.detach(|| pool.install(guarded));
    done.unwrap_or_else(|panic| Err(bug(&*panic)))
}

/// Runs `work` as [`run`] does, in a pool of its own: work that waits for other work of this process.
///
/// # Errors
/// As [`run`].
pub fn run_apart<T: Send + 'static>(
    py: Python<'_>,
    listener: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Progress) -> PyResult<T> + Send + 'static,
) -> PyResult<T> {
    run_in(&*new_pool()?, py, listener, work)
}

fn run_in<T: Send + 'static>(
    pool: &ThreadPool,
    py: Python<'_>,
    listener: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Progress) -> PyResult<T> + Send + 'static,
) -> PyResult<T> {
    let latest: Arc<Mutex<Option<Update>>> = Arc::default();
    let progress = if listener.is_some() {
        let latest = Arc::clone(&latest);
        Progress::new(move |update| {
            *latest.lock().unwrap_or_else(PoisonError::into_inner) = Some(update);
        })
    } else {
        Progress::none()
    };
    let (sender, mut receiver) = sync_channel(1);
    let watched = progress.clone();
    pool.spawn(move || {
        let done = catch_unwind(AssertUnwindSafe(|| work(&watched)));
        // nobody waits any more if the interpreter ends
        drop(sender.send(done));
    });
    let mut interruption = None;
    loop {
        let received;
        (receiver, received) = py.detach(move || {
            let received = receiver.recv_timeout(POLL);
            (receiver, received)
        });
        match received {
            Ok(done) => {
                if let Some(interruption) = interruption {
                    return Err(interruption);
                }
                let done = done.unwrap_or_else(|panic| Err(bug(&*panic)))?;
                notify(listener, &latest)?;
                return Ok(done);
            }
            Err(RecvTimeoutError::Disconnected) => {
                return Err(error::of_task("the work has ended without a result"));
            }
            Err(RecvTimeoutError::Timeout) if interruption.is_none() => {
                let checked = py.check_signals().and_then(|()| notify(listener, &latest));
                if let Err(raised) = checked {
                    progress.cancel();
                    interruption = Some(raised);
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
        }
    }
}

/// Calls the listener with the latest update, if there is a new one.
fn notify(listener: Option<&Bound<'_, PyAny>>, latest: &Mutex<Option<Update>>) -> PyResult<()> {
    let update = latest.lock().unwrap_or_else(PoisonError::into_inner).take();
    if let (Some(listener), Some(update)) = (listener, update) {
        listener.call1((update.phase, update.done, update.total))?;
    }
    Ok(())
}

fn bug(panic: &(dyn std::any::Any + Send)) -> PyErr {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
    PyRuntimeError::new_err(format!(
        "this is a bug in ravec, please report it: {}",
        text.unwrap_or("a panic without words")
    ))
}
