//! A watch over a program that is expected to read or to write.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// Interval between two checks.
const INTERVAL: Duration = Duration::from_millis(20);

/// The state that is shared with the watching thread. Times are in ms since the start.
pub(super) struct Watch {
    began: Instant,
    /// The time for which the program may be silent.
    patience: AtomicU64,
    /// The time at which it must have read or written something; zero between requests.
    until: AtomicU64,
    overdue: AtomicBool,
    ended: AtomicBool,
}

impl Watch {
    /// Starts a thread that calls `stop` once the program is overdue.
    pub fn over(patience: Duration, stop: impl FnOnce() + Send + 'static) -> Arc<Self> {
        let watch = Arc::new(Self {
            began: Instant::now(),
            patience: AtomicU64::new(0),
            until: AtomicU64::new(0),
            overdue: AtomicBool::new(false),
            ended: AtomicBool::new(false),
        });
        watch.set_patience(patience);
        let watching = Arc::clone(&watch);
        thread::spawn(move || watching.look(stop));
        watch
    }

    /// Returns the time for which the program may be silent.
    pub fn patience(&self) -> Duration {
        Duration::from_millis(self.patience.load(Ordering::Relaxed))
    }

    /// Sets the time for which the program may be silent.
    pub fn set_patience(&self, patience: Duration) {
        self.patience.store(patience.as_millis() as u64, Ordering::Relaxed);
    }

    /// Starts the watch: the program must read or write something from now on.
    pub fn expect(&self) {
        let until = self.began.elapsed() + self.patience();
        self.until.store(until.as_millis().max(1) as u64, Ordering::Relaxed);
    }

    /// Notes that the program has written something, and gives it as much time again for the next part.
    pub fn has_written(&self) {
        if self.until.load(Ordering::Relaxed) > 0 {
            self.expect();
        }
    }

    /// Pauses the watch until the next request.
    pub fn rest(&self) {
        self.until.store(0, Ordering::Relaxed);
    }

    /// Returns whether the program was too late, and was stopped.
    pub fn is_overdue(&self) -> bool {
        self.overdue.load(Ordering::Relaxed)
    }

    /// Ends the watch.
    pub fn end(&self) {
        self.ended.store(true, Ordering::Relaxed);
    }

    fn look(&self, stop: impl FnOnce()) {
        while !self.ended.load(Ordering::Relaxed) {
            thread::sleep(INTERVAL);
            let until = self.until.load(Ordering::Relaxed);
            if until > 0 && self.began.elapsed().as_millis() as u64 > until {
                self.overdue.store(true, Ordering::Relaxed);
                stop();
                return;
            }
        }
    }
}
