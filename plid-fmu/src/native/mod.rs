//! The functions of an FMU's shared library. This is the only module with unsafe code.
//!
//! The behaviour of an FMU cannot be checked from outside: a library that violates the standard may crash the process.
//! The program therefore runs FMUs in a child process.
#![allow(unsafe_code)]

mod fmi2;
mod fmi3;
mod log;
mod states;

use std::ffi::{CString, c_int, c_void};
use std::fmt::{Display, Formatter};
use std::path::Path;

use libloading::Library;

use self::log::Log;
use self::states::States;
use crate::description::Version;

/// The status that a function of an FMU returns. The numbers are those of both versions of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Status {
    Ok,
    Warning,
    Discard,
    Error,
    Fatal,
    Pending,
    /// A number that the standard does not define.
    Unknown(c_int),
}

impl From<c_int> for Status {
    fn from(status: c_int) -> Self {
        match status {
            0 => Self::Ok,
            1 => Self::Warning,
            2 => Self::Discard,
            3 => Self::Error,
            4 => Self::Fatal,
            5 => Self::Pending,
            other => Self::Unknown(other),
        }
    }
}

impl Display for Status {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Ok => f.write_str("ok"),
            Self::Warning => f.write_str("warning"),
            Self::Discard => f.write_str("discard"),
            Self::Error => f.write_str("error"),
            Self::Fatal => f.write_str("fatal"),
            Self::Pending => f.write_str("pending"),
            Self::Unknown(number) => write!(f, "{number}"),
        }
    }
}

/// A call that failed.
#[derive(Debug)]
pub(crate) struct Failed {
    /// Name of the function.
    pub function: &'static str,
    /// The returned status, in words.
    pub found: String,
    /// Whether the instance can no longer be used.
    fatal: bool,
}

/// Checks the status that a function returned.
fn done(function: &'static str, status: c_int) -> Result<(), Failed> {
    let found = match Status::from(status) {
        Status::Ok | Status::Warning => return Ok(()),
        Status::Pending => "\"pending\": it computes asynchronously".into(),
        other => format!("{:?}", other.to_string()),
    };
    Err(Failed { function, found, fatal: Status::from(status) == Status::Fatal })
}

/// The arguments with which an instance is created.
pub(crate) struct Birth {
    /// Its name.
    pub name: CString,
    /// The GUID of FMI 2.0, the instantiation token of FMI 3.0.
    pub token: CString,
    /// The folder of resources: a URI for FMI 2.0, a path for FMI 3.0.
    pub resources: CString,
}

/// The functions of one version of the standard.
enum Functions {
    Two(fmi2::Functions),
    Three(fmi3::Functions),
}

/// The shared library of an FMU.
pub(crate) struct Binary {
    functions: Functions,
    /// The functions that store states, if the library has them.
    states: Option<states::Functions>,
    /// The library that contains the functions above, which is therefore dropped last.
    _library: Library,
}

impl Binary {
    /// Loads a library.
    pub fn load(file: &Path, version: Version) -> Result<Self, String> {
        // SAFETY: the initialisers of a foreign library run here. The caller has been asked to load it.
        let library = unsafe { Library::new(file) }.map_err(|error| in_words(&error))?;
        // SAFETY: the types of the functions are those of the standard, which the FMU claims to follow.
        let functions = unsafe {
            match version {
                Version::Two => fmi2::Functions::of(&library).map(Functions::Two),
                Version::Three => fmi3::Functions::of(&library).map(Functions::Three),
            }
        };
        let names = match version {
            Version::Two => ["fmi2GetFMUstate", "fmi2SetFMUstate", "fmi2FreeFMUstate"],
            Version::Three => ["fmi3GetFMUState", "fmi3SetFMUState", "fmi3FreeFMUState"],
        };
        // SAFETY: as above.
        let states = unsafe { states::Functions::of(&library, names) }.ok();
        Ok(Self { functions: functions.map_err(|error| in_words(&error))?, states, _library: library })
    }
}

/// Returns the message of an error together with that of the operating system.
fn in_words(error: &dyn std::error::Error) -> String {
    match error.source() {
        Some(source) => format!("{error}: {}", in_words(source)),
        None => error.to_string(),
    }
}

/// The stages of an instance's life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Created or reset.
    New,
    /// Initialised, so that it can take steps.
    Steps,
    /// A function failed.
    Failed,
    /// A function failed fatally, so that no further call is allowed.
    Lost,
}

/// An instance of an FMU. It holds its library, so the library is closed only after the instance is freed.
pub(crate) struct Instance {
    binary: std::sync::Arc<Binary>,
    /// The instance, which is never null.
    pointer: *mut c_void,
    stage: Stage,
    states: States,
    log: Box<Log>,
    /// The callbacks, whose address FMI 2.0 keeps.
    _callbacks: Box<fmi2::Callbacks>,
}

// SAFETY: the standard allows calls from any thread as long as there is one at a time, and `Instance` is not `Sync`.
unsafe impl Send for Instance {}

impl Instance {
    /// Creates an instance; the message of a failure contains the FMU's own messages.
    pub fn new(binary: &std::sync::Arc<Binary>, birth: &Birth) -> Result<Self, String> {
        let log = Log::new();
        let callbacks = Box::new(fmi2::Callbacks::of(log.address()));
        // SAFETY: all pointers live as long as the instance.
        let pointer = unsafe {
            match &binary.functions {
                Functions::Two(functions) => functions.create(birth, &callbacks),
                Functions::Three(functions) => functions.create(birth, log.address()),
            }
        };
        if pointer.is_null() {
            return Err(log.take());
        }
        let binary = std::sync::Arc::clone(binary);
        Ok(Self { binary, pointer, stage: Stage::New, states: States::default(), log, _callbacks: callbacks })
    }

    /// Returns the FMU's messages since the last call.
    pub fn said(&self) -> String {
        self.log.take()
    }

    /// Returns whether it may be reset, which is so if no call has failed.
    pub fn is_sound(&self) -> bool {
        matches!(self.stage, Stage::New | Stage::Steps)
    }

    /// Initialises with these values of parameters.
    pub fn initialise(&mut self, time: f64, references: &[u32], values: &[f64]) -> Result<(), Failed> {
        debug_assert_eq!(references.len(), values.len());
        let pointer = self.pointer;
        // SAFETY: the instance is alive, and the arrays have the stated lengths.
        self.call(|functions| unsafe {
            match functions {
                Functions::Two(functions) => functions.initialise(pointer, time, references, values),
                Functions::Three(functions) => functions.initialise(pointer, time, references, values),
            }
        })?;
        self.stage = Stage::Steps;
        Ok(())
    }

    /// Returns to the state after its creation.
    pub fn reset(&mut self) -> Result<(), Failed> {
        self.forget();
        let pointer = self.pointer;
        // SAFETY: the instance is alive.
        self.call(|functions| unsafe {
            match functions {
                Functions::Two(functions) => functions.reset(pointer),
                Functions::Three(functions) => functions.reset(pointer),
            }
        })?;
        self.stage = Stage::New;
        Ok(())
    }

    /// Sets real variables.
    pub fn set(&mut self, references: &[u32], values: &[f64]) -> Result<(), Failed> {
        debug_assert_eq!(references.len(), values.len());
        if references.is_empty() {
            return Ok(());
        }
        let pointer = self.pointer;
        // SAFETY: the instance is alive, and the arrays have the stated lengths.
        self.call(|functions| unsafe {
            match functions {
                Functions::Two(functions) => functions.set(pointer, references, values),
                Functions::Three(functions) => functions.set(pointer, references, values),
            }
        })
    }

    /// Reads real variables.
    pub fn get(&mut self, references: &[u32], values: &mut [f64]) -> Result<(), Failed> {
        debug_assert_eq!(references.len(), values.len());
        if references.is_empty() {
            return Ok(());
        }
        let pointer = self.pointer;
        // SAFETY: the instance is alive, and the arrays have the stated lengths.
        self.call(|functions| unsafe {
            match functions {
                Functions::Two(functions) => functions.get(pointer, references, values),
                Functions::Three(functions) => functions.get(pointer, references, values),
            }
        })
    }

    /// Advances by a step from a time (both in s).
    pub fn advance(&mut self, time: f64, step: f64) -> Result<(), Failed> {
        let pointer = self.pointer;
        // SAFETY: the instance is alive.
        self.call(|functions| unsafe {
            match functions {
                Functions::Two(functions) => functions.advance(pointer, time, step),
                Functions::Three(functions) => functions.advance(pointer, time, step),
            }
        })
    }

    /// Stores the present state, and returns whether the library can do so.
    pub fn save(&mut self, slot: usize) -> Result<bool, Failed> {
        let Self { binary, pointer, states, .. } = self;
        let Some(functions) = &binary.states else { return Ok(false) };
        // SAFETY: the instance is alive.
        let result = unsafe { states.save(functions, *pointer, slot) };
        self.noted(result).map(|()| true)
    }

    /// Returns to a stored state, and returns whether there is one.
    pub fn restore(&mut self, slot: usize) -> Result<bool, Failed> {
        let Self { binary, pointer, states, .. } = self;
        let Some(functions) = &binary.states else { return Ok(false) };
        // SAFETY: the instance is alive.
        let result = unsafe { states.restore(functions, *pointer, slot) };
        self.noted(result)
    }

    /// Frees all stored states.
    pub fn forget(&mut self) {
        let Self { binary, pointer, states, .. } = self;
        if let Some(functions) = &binary.states {
            // SAFETY: the instance is alive.
            unsafe { states.clear(functions, *pointer) };
        }
    }

    /// Calls functions, and notes a failure.
    fn call(&mut self, work: impl FnOnce(&Functions) -> Result<(), Failed>) -> Result<(), Failed> {
        let result = work(&self.binary.functions);
        self.noted(result)
    }

    fn noted<T>(&mut self, result: Result<T, Failed>) -> Result<T, Failed> {
        if let Err(failed) = &result {
            self.stage = if failed.fatal { Stage::Lost } else { Stage::Failed };
        }
        result
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // The standard forbids any call after a fatal failure, so that instance is left behind.
        if self.stage == Stage::Lost {
            return;
        }
        self.forget();
        // SAFETY: the instance is alive, and nothing uses it afterwards.
        unsafe {
            match &self.binary.functions {
                Functions::Two(functions) => functions.end(self.pointer, self.stage == Stage::Steps),
                Functions::Three(functions) => functions.end(self.pointer, self.stage == Stage::Steps),
            }
        }
    }
}
