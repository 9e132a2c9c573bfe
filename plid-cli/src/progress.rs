//! The progress bar, and Ctrl-C.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{ProgressBar, ProgressStyle};
use plid::lab::run::Progress;

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// A bar on standard error, if that is a terminal.
pub struct Bar(ProgressBar);

impl Bar {
    /// Creates a bar, hidden if there is no terminal. From here on the first Ctrl-C requests an orderly end, and the
    /// second one ends the program immediately.
    pub fn new(quiet: bool) -> Self {
        // Without a handler, Ctrl-C ends the program as usual.
        let _ = ctrlc::set_handler(|| {
            if INTERRUPTED.swap(true, Ordering::SeqCst) {
                std::process::exit(130);
            }
        });
        let shown = !quiet && std::io::stderr().is_terminal();
        let bar = if shown { ProgressBar::new(0) } else { ProgressBar::hidden() };
        let style = ProgressStyle::with_template("{msg:<22} [{bar:36}] {pos}/{len}  {eta} left")
            .expect("the template is well formed")
            .progress_chars("=> ");
        bar.set_style(style);
        Self(bar)
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.0.finish_and_clear();
    }
}

impl Progress for Bar {
    fn stage(&self, name: &str) {
        self.0.reset();
        self.0.set_length(0);
        self.0.set_message(name.to_string());
    }

    fn advance(&self, done: usize, total: usize) {
        self.0.set_length(total as u64);
        self.0.set_position(done as u64);
    }

    fn interrupted(&self) -> bool {
        INTERRUPTED.load(Ordering::Relaxed)
    }
}

/// A line on standard error about the current work, whose length is not known in advance.
pub struct Spinner;

impl Spinner {
    /// Runs `work`, which reports on the line, and then removes the line. It is hidden if there is no terminal.
    pub fn during<T>(quiet: bool, work: impl FnOnce(&mut dyn FnMut(String)) -> T) -> T {
        let shown = !quiet && std::io::stderr().is_terminal();
        let line = if shown { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
        line.set_style(ProgressStyle::with_template("{spinner} {elapsed} {msg}").expect("the template is well formed"));
        line.enable_steady_tick(std::time::Duration::from_millis(200));
        let result = work(&mut |stage| line.set_message(stage));
        line.finish_and_clear();
        result
    }
}
