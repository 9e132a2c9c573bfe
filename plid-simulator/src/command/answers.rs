//! The reading end of a program's standard output.

use std::io::{self, Read};
use std::process::ChildStdout;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::watch::Watch;

/// How long a read polls the pipe before the thread sleeps. Waking a thread on another core takes longer than a short
/// step of a simulator, and a diagnosis waits for millions of steps.
const POLLING: Duration = Duration::from_micros(50);

/// The standard output of a program. A read polls for a moment, and then sleeps until an answer arrives.
pub(super) struct Answers {
    pipe: ChildStdout,
    /// Whether reading from the pipe does not block.
    nonblocking: bool,
    /// The watch, which is notified of every part of an answer.
    watch: Arc<Watch>,
}

impl Answers {
    /// Wraps a pipe.
    pub fn new(pipe: ChildStdout, watch: Arc<Watch>) -> Self {
        let nonblocking = set_nonblocking(&pipe);
        Self { pipe, nonblocking, watch }
    }

    /// Reads from the pipe. If that does not block, it polls before it sleeps.
    fn wait(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if !self.nonblocking {
            return self.pipe.read(bytes);
        }
        let began = Instant::now();
        loop {
            match self.pipe.read(bytes) {
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    if began.elapsed() < POLLING {
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

impl Read for Answers {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let count = self.wait(bytes)?;
        if count > 0 {
            self.watch.has_written();
        }
        Ok(count)
    }
}

/// Makes reads non-blocking, and returns whether this succeeded. Only this end of the pipe changes.
#[cfg(unix)]
fn set_nonblocking(pipe: &ChildStdout) -> bool {
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
fn set_nonblocking(_pipe: &ChildStdout) -> bool {
    false
}

#[cfg(not(unix))]
fn sleep(_pipe: &ChildStdout) -> io::Result<()> {
    Ok(())
}
