//! FMI 3.0.

use std::ffi::{c_char, c_int, c_uint, c_void};

use libloading::Library;

use super::log::logger3;
use super::{Birth, Failed, done};

type Component = *mut c_void;
type Logger = unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char);
/// `fmi3Boolean`. An FMU may write values other than 0 and 1, which a `bool` of Rust may not have.
type Boolean = u8;

const FALSE: Boolean = 0;
const TRUE: Boolean = 1;

type Instantiate = unsafe extern "C" fn(
    *const c_char,
    *const c_char,
    *const c_char,
    Boolean,
    Boolean,
    Boolean,
    Boolean,
    *const c_uint,
    usize,
    *mut c_void,
    Logger,
    *const c_void,
) -> Component;
type Enter = unsafe extern "C" fn(Component, Boolean, f64, f64, Boolean, f64) -> c_int;
type Step =
    unsafe extern "C" fn(Component, f64, f64, Boolean, *mut Boolean, *mut Boolean, *mut Boolean, *mut f64) -> c_int;
type Simple = unsafe extern "C" fn(Component) -> c_int;

/// The functions of a library.
pub(super) struct Functions {
    instantiate: Instantiate,
    enter: Enter,
    exit: Simple,
    reset: Simple,
    terminate: Simple,
    free: unsafe extern "C" fn(Component),
    set: unsafe extern "C" fn(Component, *const c_uint, usize, *const f64, usize) -> c_int,
    get: unsafe extern "C" fn(Component, *const c_uint, usize, *mut f64, usize) -> c_int,
    step: Step,
}

// The functions below are unsafe for one reason: the component must be alive. They forbid nothing else.
impl Functions {
    /// # Safety
    /// The library's functions have the types of the standard.
    pub unsafe fn of(library: &Library) -> Result<Self, libloading::Error> {
        // SAFETY: as the caller promises.
        unsafe {
            Ok(Self {
                instantiate: *library.get("fmi3InstantiateCoSimulation")?,
                enter: *library.get("fmi3EnterInitializationMode")?,
                exit: *library.get("fmi3ExitInitializationMode")?,
                reset: *library.get("fmi3Reset")?,
                terminate: *library.get("fmi3Terminate")?,
                free: *library.get("fmi3FreeInstance")?,
                set: *library.get("fmi3SetFloat64")?,
                get: *library.get("fmi3GetFloat64")?,
                step: *library.get("fmi3DoStep")?,
            })
        }
    }

    /// # Safety
    /// The log at the address `environment` outlives the instance.
    pub unsafe fn create(&self, birth: &Birth, environment: *mut c_void) -> Component {
        let Birth { name, token, resources } = birth;
        // SAFETY: as the caller promises; the strings are copied by the FMU.
        unsafe {
            // Neither events, nor early returns, nor intermediate updates are wanted.
            (self.instantiate)(
                name.as_ptr(),
                token.as_ptr(),
                resources.as_ptr(),
                FALSE,
                TRUE,
                FALSE,
                FALSE,
                std::ptr::null(),
                0,
                environment,
                logger3,
                std::ptr::null(),
            )
        }
    }

    /// Sets parameters and initialises.
    ///
    /// # Safety
    /// The component is alive.
    pub unsafe fn initialise(
        &self,
        of: Component,
        time: f64,
        references: &[u32],
        values: &[f64],
    ) -> Result<(), Failed> {
        // SAFETY: as the caller promises.
        unsafe {
            if !references.is_empty() {
                self.set(of, references, values)?;
            }
            done("fmi3EnterInitializationMode", (self.enter)(of, FALSE, 0.0, time, FALSE, 0.0))?;
            done("fmi3ExitInitializationMode", (self.exit)(of))
        }
    }

    /// # Safety
    /// The component is alive.
    pub unsafe fn reset(&self, of: Component) -> Result<(), Failed> {
        // SAFETY: as the caller promises.
        done("fmi3Reset", unsafe { (self.reset)(of) })
    }

    /// # Safety
    /// The component is alive.
    pub unsafe fn set(&self, of: Component, references: &[u32], values: &[f64]) -> Result<(), Failed> {
        let (n, count) = (references.len(), values.len());
        // SAFETY: as the caller promises.
        done("fmi3SetFloat64", unsafe { (self.set)(of, references.as_ptr(), n, values.as_ptr(), count) })
    }

    /// # Safety
    /// The component is alive.
    pub unsafe fn get(&self, of: Component, references: &[u32], values: &mut [f64]) -> Result<(), Failed> {
        let (n, count) = (references.len(), values.len());
        // SAFETY: as the caller promises.
        done("fmi3GetFloat64", unsafe { (self.get)(of, references.as_ptr(), n, values.as_mut_ptr(), count) })
    }

    /// # Safety
    /// The component is alive.
    pub unsafe fn advance(&self, of: Component, time: f64, step: f64) -> Result<(), Failed> {
        let function = "fmi3DoStep";
        let (mut event, mut ended, mut early, mut reached) = (FALSE, FALSE, FALSE, time);
        // SAFETY: as the caller promises.
        let status = unsafe {
            (self.step)(of, time, step, TRUE, &raw mut event, &raw mut ended, &raw mut early, &raw mut reached)
        };
        done(function, status)?;
        let failed = |found: &str| Err(Failed { function, found: found.into(), fatal: false });
        match (ended != FALSE, early != FALSE) {
            (true, _) => failed("that it wants to end the simulation"),
            (_, true) => failed("before the end of the step"),
            _ => Ok(()),
        }
    }

    /// # Safety
    /// The component is alive, and is not used again.
    pub unsafe fn end(&self, of: Component, runs: bool) {
        // SAFETY: as the caller promises. What fails here can no longer matter.
        unsafe {
            if runs {
                let _ = (self.terminate)(of);
            }
            (self.free)(of);
        }
    }
}
