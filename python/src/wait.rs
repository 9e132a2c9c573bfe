//! Long work away from Python: the GIL is free, signals are seen, and progress is told.

use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;

use crate::errors::of_panic;

/// Python looks for Ctrl-C this often.
const PATIENCE: Duration = Duration::from_millis(50);

/// What the work knows of its caller.
pub struct Caller {
    stopped: AtomicBool,
    sender: Mutex<Option<Sender<String>>>,
}

impl Caller {
    /// Returns whether the work may go on.
    pub fn may_go_on(&self) -> bool {
        !self.stopped.load(Ordering::Relaxed)
    }

    /// Passes a line of progress on.
    pub fn tell(&self, line: String) {
        if let Ok(Some(sender)) = self.sender.lock().as_deref() {
            // Nobody listens any more once the work is to stop.
            let _ = sender.send(line);
        }
    }

    /// Ends the conversation, which wakes the caller.
    fn done(&self) {
        if let Ok(mut sender) = self.sender.lock() {
            sender.take();
        }
    }
}

/// Tells the caller that the work has ended, also by a panic.
struct AtTheEnd<'a>(&'a Caller);

impl Drop for AtTheEnd<'_> {
    fn drop(&mut self) {
        self.0.done();
    }
}

/// Runs `work` in a thread of its own. Each line of progress is passed to `progress` in the calling thread.
///
/// # Errors
/// `KeyboardInterrupt` after Ctrl-C, whatever `progress` raises, and `RuntimeError` for a panic. The work is stopped
/// first.
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

/// Listens until the work ends or somebody objects.
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
