//! What the program says while it works: messages and progress bars, on standard error alone.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::fmt::Display;
use std::io::Write;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// Work that is shorter than this shows no bar.
const PATIENCE: Duration = Duration::from_secs(1);

/// Writes a line to standard error; where nobody can read it, nothing is to be done.
pub(crate) fn complain(message: impl Display) {
    let _ = writeln!(std::io::stderr(), "{message}");
}

/// Where messages go.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Console {
    pub(crate) quiet: bool,
}

impl Console {
    /// Says something unless the user wants quiet.
    pub(crate) fn say(self, message: impl Display) {
        if !self.quiet {
            complain(message);
        }
    }

    /// A task whose bar appears when it takes longer than a second; dropped, it is over.
    pub(crate) fn task(self, name: impl Into<String>) -> Task {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden()).with_message(name.into());
        if self.quiet {
            return Task { bar, watch: None };
        }
        let (over, wait) = channel::<()>();
        let shown = bar.clone();
        let thread = std::thread::spawn(move || {
            if wait.recv_timeout(PATIENCE) != Err(RecvTimeoutError::Timeout) {
                return;
            }
            // Draws nothing where standard error is no terminal.
            shown.set_draw_target(ProgressDrawTarget::stderr());
            while wait.recv_timeout(Duration::from_millis(100)) == Err(RecvTimeoutError::Timeout) {
                let template = match shown.length() {
                    Some(_) => "{msg} {wide_bar} {percent:>3} % {elapsed}",
                    None => "{spinner} {msg} {elapsed}",
                };
                if let Ok(style) = ProgressStyle::with_template(template) {
                    shown.set_style(style);
                }
                shown.tick();
            }
        });
        Task { bar, watch: Some((over, thread)) }
    }
}

/// Work in progress.
pub(crate) struct Task {
    bar: ProgressBar,
    watch: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Task {
    /// Says what is being done.
    pub(crate) fn says(&self, what: &str) {
        if self.bar.message() != what {
            self.bar.set_message(what.to_owned());
        }
    }

    /// Says how much of how much is done.
    pub(crate) fn at(&self, done: u64, of: u64) {
        self.bar.set_length(of);
        self.bar.set_position(done);
    }
}

impl Drop for Task {
    fn drop(&mut self) {
        if let Some((over, thread)) = self.watch.take() {
            drop(over);
            // A watcher that panicked has shown its last; the work itself is unharmed.
            let _ = thread.join();
        }
        self.bar.finish_and_clear();
    }
}
