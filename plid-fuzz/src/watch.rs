//! A thread that ends the process if a reader hangs.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Time after which a reader counts as hanging. It allows for a machine that is busy with other work.
const PATIENCE: Duration = Duration::from_secs(60);

/// The time at which the current reading began, and its input.
type Current = Arc<Mutex<Option<(Instant, Vec<u8>)>>>;

/// Watches the readings of one target.
pub(crate) struct Watch {
    current: Current,
    trace: Option<PathBuf>,
}

impl Watch {
    /// Starts the thread. The input of a reader that hangs is written to `file`.
    pub fn new(name: &'static str, file: &Path) -> Self {
        let current = Current::default();
        let (weak, file) = (Arc::downgrade(&current), file.to_path_buf());
        std::thread::spawn(move || {
            while let Some(current) = weak.upgrade() {
                let held = current.lock().expect("nobody panics while holding it").clone();
                if let Some((_, input)) = held.filter(|(since, _)| since.elapsed() > PATIENCE) {
                    let written = std::fs::write(&file, &input);
                    eprintln!("{name}: a reading takes longer than {PATIENCE:?}: {} {written:?}", file.display());
                    std::process::exit(101);
                }
                drop(current);
                std::thread::sleep(Duration::from_millis(200));
            }
        });
        Self { current, trace: std::env::var_os("PLID_FUZZ_TRACE").map(PathBuf::from) }
    }

    /// Notes that a reading begins.
    pub fn begin(&self, input: &[u8]) {
        if let Some(trace) = &self.trace {
            let _ = std::fs::write(trace, input);
        }
        let mut current = self.current.lock().expect("nobody panics while holding it");
        *current = Some((Instant::now(), input.to_vec()));
    }

    /// Notes that the reading has ended.
    pub fn end(&self) {
        *self.current.lock().expect("nobody panics while holding it") = None;
    }
}
