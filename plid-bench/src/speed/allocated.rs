//! The number of bytes that the program has allocated.

use std::sync::OnceLock;

static COUNTER: OnceLock<fn() -> usize> = OnceLock::new();

/// Registers the function that reads the number of bytes that all threads of this program have ever allocated. A
/// program whose allocator counts bytes calls it before a study. The results of any other program contain no
/// allocations.
pub fn count_allocations_by(bytes: fn() -> usize) {
    COUNTER.get_or_init(|| bytes);
}

/// Returns the number of bytes that all threads have allocated so far, if the program counts them.
pub(super) fn allocated() -> Option<usize> {
    COUNTER.get().map(|bytes| bytes())
}
