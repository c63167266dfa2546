//! How fast a file of splats loads and how much memory that takes at most.
//!
//! `cargo bench --bench loading -- [FILE] [THREADS]`; without FILE a PLY file of a million splats with harmonics up to
//! degree 3 is made, 248 MB, and taken away again.

use oblate::engine::{Harmonics, Shapes, Splats};
use oblate::importers::{Content, OpenOptions, open};
use std::error::Error;
use std::fs;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1).filter(|argument| !argument.starts_with("--"));
    let file = arguments.next();
    if let Some(threads) = arguments.next() {
        rayon::ThreadPoolBuilder::new().num_threads(threads.parse()?).build_global()?;
    }
    if let Some(file) = file {
        return load(file.as_ref());
    }
    let folder = tempfile::tempdir()?;
    let made = folder.path().join("made.ply");
    write(&made, 1_000_000)?;
    load(&made)
}

fn load(path: &Path) -> Result<(), Box<dyn Error>> {
    let (threads, size) = (rayon::current_num_threads(), fs::metadata(path)?.len() as f64);
    let start = Instant::now();
    let opened = open(path, &OpenOptions::default())?;
    let seconds = start.elapsed().as_secs_f64();
    let Content::Splats { splats, .. } = &opened.content else { return Err("not a file of splats".into()) };
    let rate = size / 1e6 / seconds;
    println!("{} splats in {seconds:.2} s: {rate:.0} MB/s", splats.centers.len());
    println!("{:.0} MB/s for each of {threads} threads", rate / threads as f64);
    // Linux alone tells the peak.
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    if let Some(peak) = status.lines().find_map(|line| line.strip_prefix("VmHWM:")) {
        let peak = 1024.0 * peak.trim_end_matches("kB").trim().parse::<f64>()?;
        let loaded = loaded(splats);
        println!(
            "{:.0} MB of memory at most, {:.2} × the {:.0} MB of splats",
            peak / 1e6,
            peak / loaded,
            loaded / 1e6
        );
    }
    opened.notes.iter().for_each(|note| println!("{note}"));
    Ok(())
}

/// Bytes of the arrays.
fn loaded(splats: &Splats) -> f64 {
    let per_splat = splats.harmonics.as_ref().map_or(0, Harmonics::per_splat);
    let shape = if matches!(splats.shapes, Shapes::Each(_)) { 36 } else { 0 };
    (splats.centers.len() * (12 + shape + 4 + 12 + 12 * per_splat)) as f64
}

fn write(path: &Path, count: u32) -> Result<(), Box<dyn Error>> {
    let mut out = BufWriter::new(fs::File::create(path)?);
    write!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {count}\n")?;
    let names = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2".split(' ').map(String::from);
    let names = names.chain((0..45).map(|i| format!("f_rest_{i}")));
    let after = "opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3".split(' ').map(String::from);
    let names: Vec<String> = names.chain(after).collect();
    names.iter().try_for_each(|name| writeln!(out, "property float {name}"))?;
    writeln!(out, "end_header")?;
    // A linear congruential generator: places have no order, as after training.
    let mut state = 1_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    };
    for _ in 0..count {
        for name in &names {
            let scale = if name.starts_with("scale") { -4.0 } else { 0.0 };
            out.write_all(&(scale + random()).to_le_bytes())?;
        }
    }
    Ok(())
}
