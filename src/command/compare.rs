//! `oblate compare`.

use super::print;
use crate::output::Output;
use crate::picture::{Format, Picture, Unit, write_levels};
use crate::progress::complain;
use anyhow::{Result, ensure};
use clap::Args;
use oblate::chart::rgba::compare_rgba;
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
    /// Writes the absolute differences of colours as a PNG, scaled so that the largest is white; if no colour differs,
    /// those of alpha as grey
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
        let output = Output::begin(path)?;
        output.ensure_unread(&[&args.a, &args.b])?;
        Ok(output)
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

    let metrics = compare_rgba([a.width, a.height], &a.values, &b.values)?;

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
        let levels = differences(&a.values, &b.values);
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

/// Of colours, or of alpha as grey where all colours are the same, scaled so that the largest is 255.
fn differences(a: &[[f32; 4]], b: &[[f32; 4]]) -> Vec<[u8; 3]> {
    let apart = |channels: [usize; 3]| -> Vec<[f64; 3]> {
        a.iter().zip(b).map(|(p, q)| channels.map(|c| (f64::from(p[c]) - f64::from(q[c])).abs())).collect()
    };
    let largest = |apart: &[[f64; 3]]| apart.as_flattened().iter().copied().fold(0.0, f64::max);
    let mut shown = apart([0, 1, 2]);
    if largest(&shown) == 0.0 {
        shown = apart([3; 3]);
    }
    let white = largest(&shown);
    let scale = if white > 0.0 { 255.0 / white } else { 0.0 };
    shown.iter().map(|pixel| pixel.map(|apart| (apart * scale).round() as u8)).collect()
}

#[cfg(test)]
mod tests {
    use super::differences;

    #[test]
    fn differences_are_scaled_by_what_is_shown() {
        let a = [[0.5, 0.5, 0.5, 1.0]; 2];
        // Alpha differs most, but is not shown beside colours.
        let colors = [[1.0, 0.5, 0.4, 0.1], [0.5, 0.5, 0.5, 1.0]];
        assert_eq!(differences(&a, &colors), [[255, 0, 51], [0; 3]]);
        let alpha = [[0.5, 0.5, 0.5, 0.9], [0.5, 0.5, 0.5, 0.5]];
        assert_eq!(differences(&a, &alpha), [[51; 3], [255; 3]]);
        assert_eq!(differences(&a, &a), [[0; 3]; 2]);
    }
}
