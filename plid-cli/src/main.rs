//! The `plid` program.

use std::process::ExitCode;

use cap::Cap;
use mimalloc::MiMalloc;

/// An allocator that counts, so that `plid bench speed` can state what a step allocates.
#[global_allocator]
static ALLOCATOR: Cap<MiMalloc> = Cap::new(MiMalloc, usize::MAX);

fn main() -> ExitCode {
    plid_bench::speed::count_allocations_by(|| ALLOCATOR.total_allocated());
    plid_cli::main()
}
