//! What each stage costs, on one thread and on two, as a Markdown table.
//!
//! `cargo bench --bench stages -- [NAME] [FRAMES]` draws every frame whose name contains NAME, FRAMES times (5), and
//! gives medians. Nanoseconds are of one core: wall time times threads, whether or not all of them had work. A splat
//! is one of the scene's for `footprint` and one that is drawn for `order` and `bin`; a pixel is one that was evaluated
//! for `fragments` and one of the picture for `resolve`. CPU 2:1 is the processor's time on two threads over that on one.

mod common;
#[path = "../src/stats.rs"]
#[expect(dead_code, unused_imports, reason = "the program's report says more, and has tests")]
mod stats;

use oblate::engine::{Renderer, Scene, Stage};
use rayon::{ThreadPool, ThreadPoolBuilder};
use stats::{FrameTimes, StageClock, median};
use std::cell::LazyCell;
use std::time::Instant;

const HEADER: &str = "\
| frame | threads | splats | drawn | evaluated | frame | cull | footprint | a core | order | bin | fragments | resolve | CPU 2:1 |
|---|---|---|---|---|---|---|---|---|---|---|---|---|---|
|  |  |  |  | M px | ms | ms | ns/splat | M splats/s | ns/splat | ns/splat | ns/px | ns/px | |";

fn main() {
    let mut arguments = std::env::args().skip(1).filter(|argument| !argument.starts_with("--"));
    let name = arguments.next().unwrap_or_default();
    let frames = arguments.next().map_or(5, |count| count.parse().expect("FRAMES is a number"));
    let pools = [1, 2].map(|threads| {
        ThreadPoolBuilder::new().num_threads(threads).build().expect("two threads can be had")
    });
    println!("{HEADER}");
    for work in common::works().into_iter().filter(common::Work::is_available) {
        let scene = LazyCell::new(work.scene);
        for frame in &work.frames {
            let title = format!("{} {}", work.name, frame.name);
            if title.contains(&name) {
                let drawn = pools.each_ref().map(|pool| draw(pool, &scene, frame, frames));
                for (measured, pool) in drawn.iter().zip(&pools) {
                    let ratio = match (drawn[0].cpu, measured.cpu) {
                        (Some(one), Some(cpu)) if pool.current_num_threads() > 1 => {
                            format!("{:.2}", cpu / one)
                        }
                        _ => String::new(),
                    };
                    println!("| {title} | {} | {ratio} |", row(measured, pool.current_num_threads(), frame));
                }
            }
        }
    }
}

/// Some frames.
struct Measured {
    times: Vec<FrameTimes>,
    /// Seconds of the processor, where Linux tells them.
    cpu: Option<f64>,
}

fn draw(pool: &ThreadPool, scene: &Scene, frame: &common::Frame, frames: usize) -> Measured {
    let mut renderer = Renderer::new();
    let mut draw = || {
        let (clock, begun) = (StageClock::default(), Instant::now());
        pool.install(|| {
            renderer.render(scene, &frame.camera, &frame.settings, &clock).expect("it can be drawn");
        });
        clock.finish(begun.elapsed(), pool.current_num_threads())
    };
    // The first frame makes the buffers.
    draw();
    let before = cpu_seconds();
    let times = (0..frames).map(|_| draw()).collect();
    let cpu = before.and_then(|before| Some(cpu_seconds()? - before));
    Measured { times, cpu }
}

/// Time that the process's threads ran.
fn cpu_seconds() -> Option<f64> {
    let of_thread = |entry: std::io::Result<std::fs::DirEntry>| -> Option<f64> {
        let text = std::fs::read_to_string(entry.ok()?.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse().ok()
    };
    let nanos: Option<f64> = std::fs::read_dir("/proc/self/task").ok()?.map(of_thread).sum();
    Some(nanos? / 1e9)
}

fn row(Measured { times, .. }: &Measured, threads: usize, frame: &common::Frame) -> String {
    let milliseconds = |stages: &[Stage]| {
        let of_frame = |times: &FrameTimes| stages.iter().map(|stage| times.stages_ms[*stage as usize]).sum();
        median(times.iter().map(of_frame).collect())
    };
    let each =
        |stages: &[Stage], count: u64| milliseconds(stages) * 1e6 * threads as f64 / count.max(1) as f64;
    let counts = times.first().map(|times| times.counts).unwrap_or_default();
    let [width, height] = frame.camera.size().map(u64::from);
    let footprint = each(&[Stage::Footprint], counts.splats);
    let cells = [
        threads.to_string(),
        counts.splats.to_string(),
        counts.visible.to_string(),
        format!("{:.1}", counts.fragments as f64 / 1e6),
        format!("{:.1}", median(times.iter().map(|times| times.frame_ms).collect())),
        format!("{:.2}", milliseconds(&[Stage::Cull])),
        format!("{footprint:.2}"),
        format!("{:.0}", 1e3 / footprint),
        format!("{:.2}", each(&[Stage::Order], counts.visible)),
        format!("{:.2}", each(&[Stage::Bin], counts.visible)),
        format!("{:.3}", each(&[Stage::Layers, Stage::Composite], counts.fragments)),
        format!("{:.2}", each(&[Stage::Resolve], width * height)),
    ];
    cells.join(" | ")
}
