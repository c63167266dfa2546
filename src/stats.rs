//! What a frame cost: the only clocks of the program.

use anyhow::Result;
use oblate::engine::simd::{Level, rewrite};
use oblate::engine::{Counts, Observer, Stage};
use serde::{Serialize, Serializer};
use std::cell::Cell;
use std::hint::black_box;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

thread_local! {
    /// When each stage began on this thread.
    static BEGUN: Cell<[Option<Instant>; Stage::ALL.len()]> = const { Cell::new([None; Stage::ALL.len()]) };
}

/// Measures the stages of one frame.
#[derive(Debug, Default)]
pub(crate) struct StageClock {
    nanos: [AtomicU64; Stage::ALL.len()],
    counts: Mutex<Counts>,
}

impl Observer for StageClock {
    fn begin(&self, stage: Stage) {
        BEGUN.with(|begun| {
            let mut times = begun.get();
            times[stage as usize] = Some(Instant::now());
            begun.set(times);
        });
    }

    fn end(&self, stage: Stage) {
        let now = Instant::now();
        let begun = BEGUN.with(|begun| {
            let mut times = begun.get();
            let time = times[stage as usize].take();
            begun.set(times);
            time
        });
        if let Some(begun) = begun {
            let nanos = u64::try_from((now - begun).as_nanos()).unwrap_or(u64::MAX);
            self.nanos[stage as usize].fetch_add(nanos, Ordering::Relaxed);
        }
    }

    fn counts(&self, counts: Counts) {
        *self.counts.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) = counts;
    }
}

impl StageClock {
    /// The frame's times and counts. Stages that run on all threads at once have their times summed and
    /// divided by the number of threads: with even work that is wall time.
    pub(crate) fn finish(self, frame: Duration, threads: usize) -> FrameTimes {
        let stages_ms = Stage::ALL.map(|stage| {
            let share = if stage.is_per_tile() { threads.max(1) as f64 } else { 1.0 };
            self.nanos[stage as usize].load(Ordering::Relaxed) as f64 / 1e6 / share
        });
        let counts = self.counts.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
        FrameTimes { frame_ms: milliseconds(frame), stages_ms, counts }
    }
}

/// What one frame took.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameTimes {
    pub(crate) frame_ms: f64,
    pub(crate) stages_ms: [f64; Stage::ALL.len()],
    pub(crate) counts: Counts,
}

/// `--stats`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Stats {
    /// Splats in the scene.
    pub(crate) splats: u64,
    /// Memory of the splats and their levels of detail in bytes; what instances share counts once.
    pub(crate) splat_bytes: usize,
    /// Splats, of whatever level of detail, that were not projected because they lie outside the picture; null when a reference
    /// drew it.
    pub(crate) culled: Option<u64>,
    /// Those that were not projected because they are hidden; null when a reference drew the picture.
    pub(crate) occluded: Option<u64>,
    /// Splats whose footprint touches the picture; null when a reference drew it.
    pub(crate) visible: Option<u64>,
    /// Those of them that stand for several; null when a reference drew the picture.
    pub(crate) merged: Option<u64>,
    /// Those of them in each form; null when a reference drew the picture.
    pub(crate) forms: Option<SplatForms>,
    /// Pixels that were evaluated, summed over the splats; null when a reference drew it.
    pub(crate) fragments: Option<u64>,
    /// Those of kernels that came too late for the window of `--order per-pixel`, after one that lies behind them; 0 in
    /// other orders, null when a reference drew it.
    pub(crate) late: Option<u64>,
    /// The least time in which so many fragments can be blended one by one: 32 bytes each, read and written back in the
    /// first-level cache on all threads, measured here. A yardstick: pixels stay in registers while many splats are
    /// blended. Null when a reference drew it.
    pub(crate) store_bound_ms: Option<f64>,
    pub(crate) threads: usize,
    #[serde(serialize_with = "rounded")]
    pub(crate) frame_ms: f64,
    /// By stage; empty when a reference drew the picture.
    #[serde(serialize_with = "as_map")]
    pub(crate) stages_ms: Vec<(&'static str, f64)>,
    #[serde(serialize_with = "rounded")]
    pub(crate) load_ms: f64,
    #[serde(serialize_with = "rounded")]
    pub(crate) build_ms: f64,
    /// The order of kernels and the form of footprints that were used; null when a reference drew it.
    pub(crate) way: Option<String>,
    /// Trying ways to draw, before the first picture; null when a reference drew it.
    pub(crate) settle_ms: Option<f64>,
    /// Largest resident size of the process; null where the system doesn't tell.
    pub(crate) peak_mib: Option<f64>,
}

/// Splats by the form of their footprint.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct SplatForms {
    point: u64,
    affine: u64,
    exact: u64,
}

impl SplatForms {
    /// Of [`Counts::forms`].
    pub(crate) fn new([point, affine, exact]: [u64; 3]) -> Self {
        Self { point, affine, exact }
    }
}

/// Milliseconds that it takes to read and write back 32 bytes for each of so many fragments, on all threads.
pub(crate) fn store_bound_ms(fragments: u64) -> f64 {
    /// 16 KiB: they stay in the first-level cache.
    const LANES: usize = 512;
    const ROUNDS: usize = 1000;
    let mut lanes = [[1.0; 8]; LANES];
    let level = Level::best();
    let time = || {
        let begun = Instant::now();
        rewrite(level, black_box(&mut lanes), ROUNDS);
        begun.elapsed()
    };
    let quickest = std::iter::repeat_with(time).take(20).min().unwrap_or_default();
    let bytes_a_millisecond = (LANES * 32 * 2 * ROUNDS) as f64 / milliseconds(quickest).max(1e-9);
    fragments as f64 * 32.0 / bytes_a_millisecond / rayon::current_num_threads() as f64
}

/// To microseconds.
pub(crate) fn round_micro(ms: f64) -> f64 {
    (ms * 1e3).round() / 1e3
}

pub(crate) fn rounded<S: Serializer>(ms: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64(round_micro(*ms))
}

fn as_map<S: Serializer>(stages: &[(&'static str, f64)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(stages.iter().map(|(name, ms)| (name, round_micro(*ms))))
}

pub(crate) fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// The middle of the values, or the mean of the two middle ones; 0 without any.
pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => 0.0,
        n if n % 2 == 1 => values[n / 2],
        n => (values[n / 2 - 1] + values[n / 2]) / 2.0,
    }
}

/// The largest resident size so far in MiB, where Linux tells it.
pub(crate) fn peak_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some((kib / 1024.0 * 10.0).round() / 10.0)
}

/// What work gives, and how long it takes.
pub(crate) fn timed<T>(work: impl FnOnce() -> Result<T>) -> Result<(T, Duration)> {
    let begun = Instant::now();
    Ok((work()?, begun.elapsed()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians() {
        assert_eq!(median(vec![]), 0.0);
        assert_eq!(median(vec![3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(vec![4.0, 1.0, 2.0, 3.0]), 2.5);
    }

    #[test]
    fn per_tile_stages_are_shared_among_threads() {
        let clock = StageClock::default();
        clock.nanos[Stage::Order as usize].store(6_000_000, Ordering::Relaxed);
        clock.nanos[Stage::Composite as usize].store(6_000_000, Ordering::Relaxed);
        let times = clock.finish(Duration::from_millis(9), 3);
        assert_eq!(times.stages_ms[Stage::Order as usize], 6.0);
        assert_eq!(times.stages_ms[Stage::Composite as usize], 2.0);
        assert_eq!(times.frame_ms, 9.0);
    }

    #[test]
    fn a_clock_counts_pairs_alone() {
        let clock = StageClock::default();
        clock.end(Stage::Cull);
        assert_eq!(clock.nanos[Stage::Cull as usize].load(Ordering::Relaxed), 0);
        clock.begin(Stage::Cull);
        std::hint::black_box((0..10_000).sum::<u64>());
        clock.end(Stage::Cull);
        assert!(clock.nanos[Stage::Cull as usize].load(Ordering::Relaxed) > 0);
    }
}
