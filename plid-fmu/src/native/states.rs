//! The functions that store an FMU's state. Those of both versions of the standard differ only in their names.

use std::collections::BTreeMap;
use std::ffi::{c_int, c_void};

use libloading::Library;

use super::{Failed, done};

type Component = *mut c_void;
type State = *mut c_void;

/// Names of the functions that get, set and free a state.
pub(super) type Names = [&'static str; 3];

/// The functions of a library.
pub(super) struct Functions {
    names: Names,
    get: unsafe extern "C" fn(Component, *mut State) -> c_int,
    set: unsafe extern "C" fn(Component, State) -> c_int,
    free: unsafe extern "C" fn(Component, *mut State) -> c_int,
}

impl Functions {
    /// # Safety
    /// The library's functions have the types of the standard.
    pub unsafe fn of(library: &Library, names: Names) -> Result<Self, libloading::Error> {
        let [get, set, free] = names;
        // SAFETY: as the caller promises.
        unsafe { Ok(Self { names, get: *library.get(get)?, set: *library.get(set)?, free: *library.get(free)? }) }
    }
}

/// The states of an instance, by their slots.
#[derive(Default)]
pub(super) struct States(BTreeMap<usize, State>);

// The functions below are unsafe for one reason: the component must be alive, and it is always the same.
impl States {
    /// Stores the present state.
    ///
    /// # Safety
    /// The component is alive.
    pub unsafe fn save(&mut self, functions: &Functions, of: Component, slot: usize) -> Result<(), Failed> {
        // The FMU overwrites an existing state.
        let state = self.0.entry(slot).or_insert(std::ptr::null_mut());
        // SAFETY: as the caller promises.
        done(functions.names[0], unsafe { (functions.get)(of, state) })
    }

    /// Returns to a stored state, and returns whether there is one.
    ///
    /// # Safety
    /// The component is alive.
    pub unsafe fn restore(&self, functions: &Functions, of: Component, slot: usize) -> Result<bool, Failed> {
        let Some(state) = self.0.get(&slot).filter(|state| !state.is_null()) else { return Ok(false) };
        // SAFETY: as the caller promises; the state is one of this component.
        done(functions.names[1], unsafe { (functions.set)(of, *state) })?;
        Ok(true)
    }

    /// Frees all states.
    ///
    /// # Safety
    /// The component is alive.
    pub unsafe fn clear(&mut self, functions: &Functions, of: Component) {
        while let Some((_, mut state)) = self.0.pop_first() {
            if !state.is_null() {
                // SAFETY: as the caller promises. What fails here can no longer matter.
                let _ = unsafe { (functions.free)(of, &raw mut state) };
            }
        }
    }
}
