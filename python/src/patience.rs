//! The time limit of a call of Python. Only Python can end its own code, so an exception is raised in the thread that
//! does not return.

use std::cell::Cell;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use pyo3::exceptions::PyTimeoutError;
use pyo3::prelude::*;

/// A time limit, with the thread that watches over it until this is dropped.
pub struct Patience {
    name: String,
    longest: Duration,
    call: Arc<Mutex<Call>>,
    _end: Sender<()>,
}

/// The present call.
#[derive(Default)]
struct Call {
    /// Number of the call, or of the last one.
    number: u64,
    /// The thread of the call, as Python numbers it.
    thread: Option<u64>,
    /// Whether the exception was raised.
    overdue: bool,
}

impl Patience {
    /// A limit for the calls of a simulator of this name, in s.
    pub fn new(name: &str, seconds: f64) -> Self {
        let longest = Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX);
        let (sender, ended) = channel();
        let call = Arc::<Mutex<Call>>::default();
        let watched = Arc::clone(&call);
        thread::spawn(move || {
            let mut seen = (0, Instant::now());
            let pause = (longest / 10).clamp(Duration::from_millis(5), Duration::from_secs(1));
            while ended.recv_timeout(pause) == Err(RecvTimeoutError::Timeout) {
                let (number, inside) = {
                    let call = watched.lock().unwrap_or_else(PoisonError::into_inner);
                    (call.number, call.thread.is_some() && !call.overdue)
                };
                if !inside || number != seen.0 {
                    seen = (number, Instant::now());
                } else if seen.1.elapsed() >= longest {
                    raise(&watched, number);
                }
            }
        });
        Self { name: name.into(), longest, call, _end: sender }
    }

    /// Makes a call, which raises `TimeoutError` if it takes longer than the limit.
    pub fn over<T>(&self, py: Python<'_>, work: impl FnOnce() -> PyResult<T>) -> PyResult<T> {
        let thread = this_thread(py)?;
        {
            let mut call = self.call.lock().unwrap_or_else(PoisonError::into_inner);
            *call = Call { number: call.number + 1, thread: Some(thread), overdue: false };
        }
        let result = work();
        let mut call = self.call.lock().unwrap_or_else(PoisonError::into_inner);
        call.thread = None;
        if !call.overdue {
            return result;
        }
        match result {
            // The call returned before the exception reached it, which must not reach other code instead.
            Ok(found) => set_exception(py, thread, None).map(|()| found),
            Err(error) if error.is_instance_of::<PyTimeoutError>(py) => {
                let limit = self.longest.as_secs_f64();
                Err(PyTimeoutError::new_err(format!("{} has not returned within {limit} s", self.name)))
            }
            Err(error) => Err(error),
        }
    }
}

/// Raises the exception in the thread of a call, unless it has returned meanwhile. Whoever waits for the lock holds the
/// GIL, here as in [`Patience::over`].
fn raise(call: &Mutex<Call>, number: u64) {
    Python::attach(|py| {
        let mut call = call.lock().unwrap_or_else(PoisonError::into_inner);
        if let (true, Some(thread)) = (call.number == number, call.thread) {
            let class = py.get_type::<PyTimeoutError>().into_any();
            call.overdue = set_exception(py, thread, Some(&class)).is_ok();
        }
    });
}

/// Sets the exception that a thread raises at its next instruction, or takes it back.
fn set_exception(py: Python<'_>, thread: u64, class: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
    let ctypes = py.import("ctypes")?;
    let thread = ctypes.getattr("c_ulong")?.call1((thread,))?;
    let object = match class {
        Some(class) => ctypes.getattr("py_object")?.call1((class,))?,
        None => py.None().into_bound(py),
    };
    ctypes.getattr("pythonapi")?.call_method1("PyThreadState_SetAsyncExc", (thread, object)).map(drop)
}

/// Returns the number of this thread in Python.
fn this_thread(py: Python<'_>) -> PyResult<u64> {
    thread_local!(static NUMBER: Cell<Option<u64>> = const { Cell::new(None) });
    if let Some(number) = NUMBER.get() {
        return Ok(number);
    }
    let number = py.import("threading")?.call_method0("get_ident")?.extract()?;
    NUMBER.set(Some(number));
    Ok(number)
}
