//! `oblate compare`.

use super::print;
use crate::output::Output;
use crate::picture::{Format, Picture, Unit, write_levels};
use crate::progress::complain;
use anyhow::{Result, ensure};
use clap::Args;
use oblate::engine::metrics::{Pixels, compare};
use std::path::PathBuf;
use std::process::ExitCode;

/// Says how far two pictures are apart: PSNR, SSIM, largest and 99.9 % error.
///
/// PNG is compared in 8-bit levels (0 to 255), EXR in linear light. Alpha counts where a picture has any
/// that is not opaque.
#[derive(Args)]
pub(crate) struct CompareArgs {
    /// A PNG or EXR picture
    a: PathBuf,
    /// Another of the same kind and size
    b: PathBuf,
    /// Exits with 1 if the largest error is beyond this, in levels for PNG, linear for EXR
    #[arg(long, value_name = "E", allow_hyphen_values = true)]
    max: Option<f64>,
    /// Writes the absolute differences as a PNG, scaled so that the largest is white
    #[arg(long, value_name = "FILE")]
    diff: Option<PathBuf>,
}

pub(crate) fn run(args: &CompareArgs) -> Result<ExitCode> {
    if let Some(max) = args.max {
        ensure!(max >= 0.0, "--max is {max}; it must be at least 0");
    }
    let diff = args.diff.as_deref().map(|path| {
        let format = Format::of(path, None)?;
        ensure!(format == Format::Png8, "{}: differences are written as .png", path.display());
        Output::begin(path)
    });
    let diff = diff.transpose()?;
    let (a, b) = (Picture::read(&args.a)?, Picture::read(&args.b)?);
    let names = format!("{} and {}", args.a.display(), args.b.display());
    ensure!(a.unit == b.unit, "{names}: a PNG and an EXR have different units; compare like with like");
    let size = |p: &Picture| format!("{}×{}", p.width, p.height);
    ensure!(
        (a.width, a.height) == (b.width, b.height),
        "{names}: sizes {} and {} differ",
        size(&a),
        size(&b)
    );

    let opaque = |p: &Picture| p.values.iter().all(|v| v[3] == 1.0);
    let channels = if opaque(&a) && opaque(&b) { 3 } else { 4 };
    let [a_values, b_values] =
        [&a, &b].map(|p| p.values.iter().flat_map(|v| v[..channels].to_vec()).collect::<Vec<f32>>());
    let pixels = |values| Pixels { width: a.width, height: a.height, channels, values };
    let metrics = compare(pixels(&a_values), pixels(&b_values))?;

    let (shown, unit): (fn(f64) -> f32, _) = match a.unit {
        // 16 bits resolve 1/257 of a level; what is finer comes from levels as f32.
        Unit::Levels => (|e| (e * 255.0 * 1e4).round() as f32 / 1e4, "levels"),
        Unit::Linear => (|e| e as f32, "linear"),
    };
    let largest = shown(metrics.max_error);
    print(&format!(
        "PSNR {:.2} dB\nSSIM {:.6}\nlargest error {largest} {unit}\n99.9 % error {} {unit}\n\
         mean error {} {unit}\n",
        metrics.psnr_db,
        metrics.ssim,
        shown(metrics.p999_error),
        shown(metrics.mean_error),
    ))?;
    if let Some(output) = diff {
        let white = if metrics.max_error > 0.0 { metrics.max_error as f32 } else { 1.0 };
        let levels: Vec<[u8; 3]> = a
            .values
            .iter()
            .zip(&b.values)
            .map(|(p, q)| [0, 1, 2].map(|c| ((p[c] - q[c]).abs() / white * 255.0).round() as u8))
            .collect();
        output.finish(|file| write_levels([a.width, a.height], &levels, file))?;
    }
    match args.max {
        Some(max) if f64::from(largest) > max => {
            complain(format_args!("the largest error, {largest} {unit}, is beyond {max}"));
            Ok(ExitCode::from(1))
        }
        _ => Ok(ExitCode::SUCCESS),
    }
}
