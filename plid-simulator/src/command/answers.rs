//! The end of a pipe at which answers arrive.

use std::io::{self, Read};
use std::process::ChildStdout;
use std::time::{Duration, Instant};

/// How long an answer is looked for before the thread sleeps. Waking a thread on another core takes longer than a short
/// step of a simulator, and a diagnosis waits for millions of steps.
const LOOKING: Duration = Duration::from_micros(50);

/// The standard output of a program. A read looks for an answer for a moment, and then sleeps until one arrives.
pub(super) struct Answers {
    pipe: ChildStdout,
    /// Whether reading from the pipe returns at once.
    returns: bool,
}

impl Answers {
    /// Takes a pipe.
    pub fn new(pipe: ChildStdout) -> Self {
        let returns = returns_at_once(&pipe);
        Self { pipe, returns }
    }
}

impl Read for Answers {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if !self.returns {
            return self.pipe.read(bytes);
        }
        let began = Instant::now();
        loop {
            match self.pipe.read(bytes) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    if began.elapsed() < LOOKING {
                        // The program may need this core.
                        std::thread::yield_now();
                    } else {
                        sleep(&self.pipe)?;
                    }
                }
                read => return read,
            }
        }
    }
}

/// Makes reading return at once; returns whether that worked. Only this end of the pipe changes.
#[cfg(unix)]
fn returns_at_once(pipe: &ChildStdout) -> bool {
    use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
    fcntl_getfl(pipe).and_then(|flags| fcntl_setfl(pipe, flags | OFlags::NONBLOCK)).is_ok()
}

/// Sleeps until there is something to read, or the other end is closed.
#[cfg(unix)]
fn sleep(pipe: &ChildStdout) -> io::Result<()> {
    use rustix::event::{PollFd, PollFlags, poll};
    match poll(&mut [PollFd::new(pipe, PollFlags::IN)], None) {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

#[cfg(not(unix))]
fn returns_at_once(_pipe: &ChildStdout) -> bool {
    false
}

#[cfg(not(unix))]
fn sleep(_pipe: &ChildStdout) -> io::Result<()> {
    Ok(())
}
