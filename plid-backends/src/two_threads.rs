//! The plain loops on two threads.

use std::marker::PhantomData;

use plid_core::kernels::Kernels;
use plid_core::{Backend, Dense};

/// The default kernels over a `Vec`, divided between two threads of rayon's pool. The results are bit-identical to
/// those of [`Plain`](crate::Plain).
///
/// A half is handed over within a microsecond or two only if the step itself runs on a thread of the pool; see
/// [`on_threads`].
#[derive(Clone, Copy, Debug)]
pub struct TwoThreads<S>(PhantomData<S>);

impl<S: Kernels> Backend for TwoThreads<S> {
    type Scalar = S;
    type Matrix = Dense<S>;

    fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
        rayon::join(a, b)
    }
}

/// Runs `work`, a loop of steps for example, on a separate pool of `threads` threads. `started` is called first on
/// each of them with its number from 0, for example to pin it to a core.
///
/// # Errors
/// Returns an error if the system cannot provide the threads.
pub fn on_threads<R: Send>(
    threads: usize,
    started: impl Fn(usize) + Send + Sync + 'static,
    work: impl FnOnce() -> R + Send,
) -> Result<R, rayon::ThreadPoolBuildError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).start_handler(started).build()?;
    Ok(pool.install(work))
}
