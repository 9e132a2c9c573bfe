//! What the program has allocated.

use std::sync::OnceLock;

static COUNTER: OnceLock<fn() -> usize> = OnceLock::new();

/// States how to read the number of bytes that all threads of this program have ever allocated. A program whose
/// allocator counts calls this before a study; the results of any other program have no allocations.
pub fn count_allocations_by(bytes: fn() -> usize) {
    COUNTER.get_or_init(|| bytes);
}

/// Returns the number of bytes that all threads have allocated so far, if the program counts them.
pub(super) fn allocated() -> Option<usize> {
    COUNTER.get().map(|bytes| bytes())
}
