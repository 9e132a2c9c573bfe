//! FMI 2.0.

use std::ffi::{c_char, c_int, c_uint, c_void};

use libloading::Library;

use super::log::plid_fmu_logger;
use super::{Birth, Failed, done};

type Component = *mut c_void;
type Logger = unsafe extern "C" fn(*mut c_void, *const c_char, c_int, *const c_char, *const c_char, ...);

const CO_SIMULATION: c_int = 1;
const FALSE: c_int = 0;
const TRUE: c_int = 1;

/// `fmi2CallbackFunctions`.
#[repr(C)]
pub(super) struct Callbacks {
    logger: Logger,
    allocate: unsafe extern "C" fn(usize, usize) -> *mut c_void,
    free: unsafe extern "C" fn(*mut c_void),
    /// The function for the end of asynchronous steps, which are not used.
    step_finished: Option<unsafe extern "C" fn(*mut c_void, c_int)>,
    environment: *mut c_void,
}

unsafe extern "C" {
    fn calloc(count: usize, size: usize) -> *mut c_void;
    fn free(address: *mut c_void);
}

impl Callbacks {
    /// Returns the callbacks of an instance whose log is at this address.
    pub fn of(environment: *mut c_void) -> Self {
        Self { logger: plid_fmu_logger, allocate: calloc, free, step_finished: None, environment }
    }
}

type Instantiate = unsafe extern "C" fn(
    *const c_char,
    c_int,
    *const c_char,
    *const c_char,
    *const Callbacks,
    c_int,
    c_int,
) -> Component;
type Experiment = unsafe extern "C" fn(Component, c_int, f64, f64, c_int, f64) -> c_int;
type Simple = unsafe extern "C" fn(Component) -> c_int;

/// The functions of a library.
pub(super) struct Functions {
    instantiate: Instantiate,
    experiment: Experiment,
    enter: Simple,
    exit: Simple,
    reset: Simple,
    terminate: Simple,
    free: unsafe extern "C" fn(Component),
    set: unsafe extern "C" fn(Component, *const c_uint, usize, *const f64) -> c_int,
    get: unsafe extern "C" fn(Component, *const c_uint, usize, *mut f64) -> c_int,
    step: unsafe extern "C" fn(Component, f64, f64, c_int) -> c_int,
}

// The functions below are unsafe for one reason: the component must be alive. They forbid nothing else.
impl Functions {
    /// # Safety
    /// The library's functions have the types of the standard.
    pub unsafe fn of(library: &Library) -> Result<Self, libloading::Error> {
        // SAFETY: as the caller promises.
        unsafe {
            Ok(Self {
                instantiate: *library.get("fmi2Instantiate")?,
                experiment: *library.get("fmi2SetupExperiment")?,
                enter: *library.get("fmi2EnterInitializationMode")?,
                exit: *library.get("fmi2ExitInitializationMode")?,
                reset: *library.get("fmi2Reset")?,
                terminate: *library.get("fmi2Terminate")?,
                free: *library.get("fmi2FreeInstance")?,
                set: *library.get("fmi2SetReal")?,
                get: *library.get("fmi2GetReal")?,
                step: *library.get("fmi2DoStep")?,
            })
        }
    }

    /// # Safety
    /// The callbacks outlive the instance.
    pub unsafe fn create(&self, birth: &Birth, callbacks: &Callbacks) -> Component {
        let Birth { name, token, resources } = birth;
        // SAFETY: as the caller promises; the strings are copied by the FMU.
        unsafe {
            (self.instantiate)(name.as_ptr(), CO_SIMULATION, token.as_ptr(), resources.as_ptr(), callbacks, FALSE, TRUE)
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
            done("fmi2SetupExperiment", (self.experiment)(of, FALSE, 0.0, time, FALSE, 0.0))?;
            if !references.is_empty() {
                self.set(of, references, values)?;
            }
            done("fmi2EnterInitializationMode", (self.enter)(of))?;
            done("fmi2ExitInitializationMode", (self.exit)(of))
        }
    }

    /// # Safety
    /// The component is alive.
    pub unsafe fn reset(&self, of: Component) -> Result<(), Failed> {
        // SAFETY: as the caller promises.
        done("fmi2Reset", unsafe { (self.reset)(of) })
    }

    /// # Safety
    /// The component is alive.
    pub unsafe fn set(&self, of: Component, references: &[u32], values: &[f64]) -> Result<(), Failed> {
        // SAFETY: as the caller promises.
        done("fmi2SetReal", unsafe { (self.set)(of, references.as_ptr(), references.len(), values.as_ptr()) })
    }

    /// # Safety
    /// The component is alive.
    pub unsafe fn get(&self, of: Component, references: &[u32], values: &mut [f64]) -> Result<(), Failed> {
        // SAFETY: as the caller promises.
        done("fmi2GetReal", unsafe { (self.get)(of, references.as_ptr(), references.len(), values.as_mut_ptr()) })
    }

    /// # Safety
    /// The component is alive.
    pub unsafe fn advance(&self, of: Component, time: f64, step: f64) -> Result<(), Failed> {
        // SAFETY: as the caller promises.
        done("fmi2DoStep", unsafe { (self.step)(of, time, step, TRUE) })
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
