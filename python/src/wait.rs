//! Long computations in a thread of their own. The GIL is released, signals are handled, and progress is reported.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;

use crate::errors::of_panic;

/// Interval at which Python checks for Ctrl-C.
const PATIENCE: Duration = Duration::from_millis(50);

/// The connection from the computation to its caller.
pub struct Caller {
    stopped: AtomicBool,
    sender: Mutex<Option<Sender<String>>>,
}

impl Caller {
    /// Returns whether the computation may continue.
    pub fn may_go_on(&self) -> bool {
        !self.stopped.load(Ordering::Relaxed)
    }

    /// Passes a line of progress on.
    pub fn tell(&self, line: String) {
        if let Ok(Some(sender)) = self.sender.lock().as_deref() {
            // The receiver is gone once the computation is to stop.
            let _ = sender.send(line);
        }
    }

    /// Closes the connection, which wakes the caller.
    fn done(&self) {
        if let Ok(mut sender) = self.sender.lock() {
            sender.take();
        }
    }
}

/// Tells the caller that the computation has ended, even by a panic.
struct AtTheEnd<'a>(&'a Caller);

impl Drop for AtTheEnd<'_> {
    fn drop(&mut self) {
        self.0.done();
    }
}

/// Runs `work` in a thread of its own. Each line of progress is passed to `progress` in the calling thread.
///
/// # Errors
/// Returns `KeyboardInterrupt` after Ctrl-C, any exception of `progress`, or `RuntimeError` for a panic. The
/// computation is stopped first.
pub fn off_the_interpreter<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Caller) -> T + Send,
) -> PyResult<T> {
    let (sender, receiver) = channel();
    let caller = Caller { stopped: AtomicBool::new(false), sender: Mutex::new(Some(sender)) };
    let receiver = Mutex::new(receiver);
    thread::scope(|scope| {
        let worker = scope.spawn(|| {
            let _end = AtTheEnd(&caller);
            work(&caller)
        });
        let watched = watch(py, progress, &receiver);
        caller.stopped.store(true, Ordering::Relaxed);
        let result = py.detach(|| worker.join());
        watched?;
        result.map_err(|panic| of_panic(panic.as_ref()))
    })
}

/// Passes progress on until the computation ends or an exception is raised.
fn watch(py: Python<'_>, progress: Option<&Bound<'_, PyAny>>, receiver: &Mutex<Receiver<String>>) -> PyResult<()> {
    let next = || receiver.lock().map_or(Err(RecvTimeoutError::Disconnected), |r| r.recv_timeout(PATIENCE));
    loop {
        let heard = py.detach(next);
        py.check_signals()?;
        match (heard, progress) {
            (Ok(line), Some(progress)) => drop(progress.call1((line,))?),
            (Ok(_), None) | (Err(RecvTimeoutError::Timeout), _) => {}
            (Err(RecvTimeoutError::Disconnected), _) => return Ok(()),
        }
    }
}
