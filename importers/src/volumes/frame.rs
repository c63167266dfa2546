//! Frames of grids from what files say of them.

use glam::{DMat3, DVec3};
use oblate_volumes::GridFrame;

/// The frame in which index (i, j, k) lies at `origin` + `edges` · (i, j, k): each column of `edges` is the step from
/// one sample to the next. Negative spacings turn the axis; steps that are not finite or 0 make a frame that no
/// volume accepts. The space is not named.
pub(crate) fn of_edges(origin: DVec3, edges: DMat3) -> GridFrame {
    let spacing = DVec3::new(edges.x_axis.length(), edges.y_axis.length(), edges.z_axis.length());
    // Divided, not multiplied with reciprocals: an axis of the world stays one.
    let direction =
        DMat3::from_cols(edges.x_axis / spacing.x, edges.y_axis / spacing.y, edges.z_axis / spacing.z);
    GridFrame { spacing, origin, direction, space: None }
}

/// First coordinate and step of an axis whose steps are all the same; `None` where they are not.
///
/// Steps may differ by 1e-4 of their mean and by `rounding`, the relative spacing of the number type that the
/// coordinates are written in, of the largest coordinate. A single coordinate has a step of 1.
pub(crate) fn steps(coordinates: &[f64], rounding: f64) -> Result<Option<(f64, f64)>, String> {
    let (Some(&first), Some(&last)) = (coordinates.first(), coordinates.last()) else {
        return Err("there are no coordinates".into());
    };
    if let Some(at) = coordinates.iter().position(|c| !c.is_finite()) {
        return Err(format!("coordinate {at} is {}", coordinates[at]));
    }
    if coordinates.len() == 1 {
        return Ok(Some((first, 1.0)));
    }
    let step = (last - first) / (coordinates.len() - 1) as f64;
    let steps = || coordinates.windows(2).map(|pair| pair[1] - pair[0]);
    if let Some(at) = steps().position(|s| s == 0.0 || s.signum() != step.signum()) {
        return Err(format!(
            "coordinates must rise or fall throughout, but {} follows {}",
            coordinates[at + 1],
            coordinates[at]
        ));
    }
    let tolerance = 1e-4 * step.abs() + rounding * first.abs().max(last.abs());
    Ok(steps().all(|s| (s - step).abs() <= tolerance).then_some((first, step)))
}
