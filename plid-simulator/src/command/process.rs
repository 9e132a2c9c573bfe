//! A program with its pipes, its log and a watch over its answers.

use std::collections::VecDeque;
use std::io::{BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use super::answers::Answers;
use super::watch::Watch;
use crate::SimulatorError;

/// Number of bytes of the log that are kept.
const KEPT: usize = 65536;

/// Number of lines of the log in a message.
const LINES: usize = 8;

/// Number of checks of a program whose pipes are closed. Together they take a second.
const CHECKS: usize = 200;

/// Interval between two of them.
const MOMENT: Duration = Duration::from_millis(5);

/// Number of bytes that are written together. It is the capacity of a pipe, so that the progress of a program that
/// reads slowly is noticed.
const TOGETHER: usize = 1 << 16;

/// A running program.
pub(super) struct Process {
    name: String,
    input: ChildStdin,
    output: BufReader<Answers>,
    /// The program. It is dropped after the pipes, whose closing ends it.
    child: Running,
    log: Arc<Mutex<VecDeque<u8>>>,
    logger: Option<thread::JoinHandle<()>>,
    watch: Arc<Watch>,
}

impl Process {
    /// Starts a program in a folder.
    pub fn start(command: &[String], folder: &Path, patience: Duration) -> Result<Self, SimulatorError> {
        let Some((program, arguments)) = command.split_first() else {
            return Err(SimulatorError::failed("the command of the simulator is empty"));
        };
        let mut child = std::process::Command::new(program)
            .args(arguments)
            .current_dir(folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| SimulatorError::failed(format!("{program:?} cannot be started: {error}")))?;
        let (Some(input), Some(output), Some(errors)) = (child.stdin.take(), child.stdout.take(), child.stderr.take())
        else {
            return Err(SimulatorError::failed(format!("{program:?} has no pipes")));
        };
        let log = Arc::new(Mutex::new(VecDeque::new()));
        let kept = Arc::clone(&log);
        let logger = thread::spawn(move || keep(errors, &kept));
        let child = Running(Arc::new(Mutex::new(child)));
        let watched = Arc::clone(&child.0);
        let watch = Watch::over(patience, move || drop(locked(&watched).kill()));
        let answers = Answers::new(output, Arc::clone(&watch));
        Ok(Self {
            name: command.join(" "),
            input,
            output: BufReader::with_capacity(1 << 16, answers),
            child,
            log,
            logger: Some(logger),
            watch,
        })
    }

    /// Returns the time for which the program may be silent.
    pub fn patience(&self) -> Duration {
        self.watch.patience()
    }

    /// Sets the time for which the program may be silent.
    pub fn set_patience(&self, patience: Duration) {
        self.watch.set_patience(patience);
    }

    /// Writes all parts together.
    pub fn send(&mut self, parts: &[&[u8]]) -> Result<(), SimulatorError> {
        let mut chunks = parts.iter().flat_map(|part| part.chunks(TOGETHER));
        let sent = chunks.try_for_each(|chunk| {
            self.watch.expect();
            self.input.write_all(chunk)
        });
        let sent = sent.and_then(|()| self.input.flush());
        self.watch.rest();
        sent.map_err(|error| self.broken(&error))
    }

    /// Reads a part of an answer.
    pub fn answering<T>(
        &mut self,
        read: impl FnOnce(&mut BufReader<Answers>) -> std::io::Result<T>,
    ) -> Result<T, SimulatorError> {
        self.watch.expect();
        let answer = read(&mut self.output);
        self.watch.rest();
        answer.map_err(|error| self.broken(&error))
    }

    /// Returns a failure with the end of the log.
    pub fn failed(&self, message: String) -> SimulatorError {
        let log: Vec<u8> = locked(&self.log).iter().copied().collect();
        let text = String::from_utf8_lossy(&log);
        let lines: Vec<&str> = text.lines().collect();
        let last = lines[lines.len().saturating_sub(LINES)..].join("\n");
        let log = if last.is_empty() { String::new() } else { format!("; the end of its log:\n{last}") };
        SimulatorError::failed(format!("{}: {message}{log}", self.name))
    }

    /// Returns the failure of a program that can no longer be written to or read from.
    fn broken(&mut self, error: &std::io::Error) -> SimulatorError {
        if self.watch.is_overdue() {
            let message = format!("it did not answer within {} s and was stopped", self.patience().as_secs_f64());
            return self.failed(message);
        }
        let ended = self.child.end();
        // The log is complete once the program has ended.
        if ended.is_some()
            && let Some(logger) = self.logger.take()
        {
            logger.join().ok();
        }
        match ended {
            Some(status) => self.failed(format!("it ended before it answered ({status})")),
            None => self.failed(error.to_string()),
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.watch.end();
    }
}

/// A program that does not outlive this value.
struct Running(Arc<Mutex<Child>>);

impl Running {
    /// Waits a moment for the end of a program whose pipes are closed.
    fn end(&self) -> Option<ExitStatus> {
        for _ in 0..CHECKS {
            if let Ok(Some(status)) = locked(&self.0).try_wait() {
                return Some(status);
            }
            thread::sleep(MOMENT);
        }
        None
    }
}

impl Drop for Running {
    /// Lets the program end, so that it can remove its files, and stops it if it continues.
    fn drop(&mut self) {
        if self.end().is_none() {
            let mut child = locked(&self.0);
            child.kill().ok();
            child.wait().ok();
        }
    }
}

/// Reads a log to its end and keeps its last bytes.
fn keep(mut from: impl Read, log: &Mutex<VecDeque<u8>>) {
    let mut bytes = [0; 4096];
    while let Ok(count) = from.read(&mut bytes) {
        if count == 0 {
            return;
        }
        let mut log = locked(log);
        log.extend(&bytes[..count]);
        let more = log.len().saturating_sub(KEPT);
        log.drain(..more);
    }
}

fn locked<T>(of: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}
