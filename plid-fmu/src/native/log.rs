//! The log of an FMU.

use std::collections::VecDeque;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::sync::{Mutex, PoisonError};

use super::Status;

/// Number of messages that are kept.
const KEPT: usize = 8;

/// Longest part of a message that is kept.
const LENGTH: usize = 1000;

/// The last messages of an instance. The instance knows the address of this value, so it must not move.
#[repr(C)]
pub(super) struct Log {
    /// The function to which the logger in logger.c passes a message.
    keep: unsafe extern "C" fn(*const Log, c_int, *const c_char),
    messages: Mutex<VecDeque<String>>,
}

impl Log {
    pub fn new() -> Box<Self> {
        Box::new(Self { keep, messages: Mutex::default() })
    }

    /// Returns the address that the FMU passes with each message.
    pub fn address(&self) -> *mut c_void {
        std::ptr::from_ref(self).cast_mut().cast()
    }

    /// Returns the last messages, one per line, and deletes them.
    pub fn take(&self) -> String {
        let messages: Vec<String> = self.locked().drain(..).collect();
        messages.join("\n")
    }

    fn add(&self, status: c_int, text: &str) {
        let mut messages = self.locked();
        if messages.len() == KEPT {
            messages.pop_front();
        }
        let text: String = text.trim_end().chars().take(LENGTH).collect();
        messages.push_back(format!("{}: {text}", Status::from(status)));
    }

    fn locked(&self) -> std::sync::MutexGuard<'_, VecDeque<String>> {
        self.messages.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Stores a message.
///
/// # Safety
/// `log` is null or a living `Log`, and `message` null or a string that ends with a zero.
unsafe extern "C" fn keep(log: *const Log, status: c_int, message: *const c_char) {
    // SAFETY: as the caller promises.
    let (log, message) = unsafe { (log.as_ref(), (!message.is_null()).then(|| CStr::from_ptr(message))) };
    // The categories of messages differ between FMUs, so messages are distinguished by their status, where 0 is OK.
    if let (Some(log), Some(message), 1..) = (log, message, status) {
        log.add(status, &message.to_string_lossy());
    }
}

/// The logger of FMI 3.0.
///
/// # Safety
/// `environment` is null or the address of a living `Log`, and `message` null or a string that ends with a zero.
pub(super) unsafe extern "C" fn logger3(
    environment: *mut c_void,
    status: c_int,
    _category: *const c_char,
    message: *const c_char,
) {
    // SAFETY: as the caller promises.
    unsafe { keep(environment.cast_const().cast(), status, message) };
}

unsafe extern "C" {
    /// The logger of FMI 2.0, in logger.c.
    pub(super) fn plid_fmu_logger(
        environment: *mut c_void,
        instance: *const c_char,
        status: c_int,
        category: *const c_char,
        message: *const c_char,
        ...
    );
}
