//! Ranges of the choices, the same for options and for keys of scene files.

use crate::description::{CameraOptions, FileOptions, Look, PictureOptions};
use crate::notation::Tolerance;
use std::fmt;

/// Beyond this, coordinates leave no room for sizes in single precision; what is scaled by less than its
/// inverse neither.
pub(crate) const FARTHEST: f64 = 1e15;

/// About 16 GiB while a picture is drawn and written.
const MOST_PIXELS: u64 = 1 << 28;

/// A choice that cannot be made.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Wrong {
    /// Its option without dashes, which is its key too.
    pub(crate) key: &'static str,
    /// What follows the key in a message.
    pub(crate) problem: String,
}

impl Wrong {
    /// The message for the command line.
    pub(crate) fn option(self) -> anyhow::Error {
        anyhow::anyhow!("--{} {}", self.key, self.problem)
    }
}

fn ensure(
    key: &'static str,
    value: impl fmt::Display,
    right: bool,
    expected: impl fmt::Display,
) -> Result<(), Wrong> {
    if right { Ok(()) } else { Err(Wrong { key, problem: format!("is {value}; it must be {expected}") }) }
}

/// That of two choices which are one only one is made.
fn one_of(key: &'static str, has: bool, other: &str, has_other: bool) -> Result<(), Wrong> {
    if !(has && has_other) {
        return Ok(());
    }
    Err(Wrong { key, problem: format!("and {other} are two answers to one question; give one") })
}

fn above_zero(key: &'static str, value: Option<f64>) -> Result<(), Wrong> {
    value.map_or(Ok(()), |v| ensure(key, v, v > 0.0 && v.is_finite(), "finite and above 0"))
}

/// A place or direction.
pub(crate) fn coordinates(key: &'static str, values: Option<[f64; 3]>) -> Result<(), Wrong> {
    let bad = values.into_iter().flatten().find(|v| !(-FARTHEST..=FARTHEST).contains(v));
    bad.map_or(Ok(()), |v| ensure(key, v, false, format!("finite and within ±{FARTHEST:e}")))
}

impl CameraOptions {
    pub(crate) fn check(&self) -> Result<(), Wrong> {
        coordinates("eye", self.eye)?;
        coordinates("target", self.target)?;
        coordinates("up", self.up)?;
        if let Some(fov) = self.fov {
            ensure("fov", fov, fov > 0.0 && fov < 180.0, "between 0 and 180 degrees")?;
        }
        above_zero("orthographic", self.orthographic)?;
        one_of("orthographic", self.orthographic.is_some(), "fov", self.fov.is_some())
    }
}

impl PictureOptions {
    pub(crate) fn check(&self) -> Result<(), Wrong> {
        if let Some([width, height]) = self.size {
            let size = format!("{width}x{height}");
            let sides = [width, height].iter().all(|side| (1..=65_535).contains(side));
            ensure("size", &size, sides, "1 to 65535 pixels on each side")?;
            let pixels = u64::from(width) * u64::from(height);
            ensure("size", &size, pixels <= MOST_PIXELS, format!("at most {MOST_PIXELS} pixels"))?;
        }
        if let Some(variance) = self.low_pass {
            let right = (0.0..=1e6).contains(&variance);
            ensure("low-pass", variance, right, "at least 0 and at most 1e6 square pixels")?;
        }
        if let Some(thickness) = self.slab_thickness {
            let right = (1e-3..=1e6).contains(&thickness);
            ensure("slab-thickness", thickness, right, "from 0.001 to 1e6")?;
        }
        if let Some(Tolerance(tolerance)) = self.tolerance {
            ensure("tolerance", tolerance, (0.0..=1.0).contains(&tolerance), "from 0 to 1, such as 2/255")?;
        }
        self.budget.map_or(Ok(()), |n| ensure("budget", n, n > 0, "at least 1"))?;
        self.samples.map_or(Ok(()), |n| ensure("samples", n, (1..=65_536).contains(&n), "from 1 to 65536"))
    }
}

/// What options were of use for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Uses {
    pub(crate) mesh: bool,
    pub(crate) volume: bool,
    /// A volume without a header.
    pub(crate) raw: bool,
    /// A part took the texture given.
    pub(crate) texture: bool,
    pub(crate) points: bool,
    /// A grid in two files.
    pub(crate) flow: bool,
    /// Splats in several levels of detail.
    pub(crate) level: bool,
}

impl std::ops::BitOr for Uses {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self {
            mesh: self.mesh | other.mesh,
            volume: self.volume | other.volume,
            raw: self.raw | other.raw,
            texture: self.texture | other.texture,
            points: self.points | other.points,
            flow: self.flow | other.flow,
            level: self.level | other.level,
        }
    }
}

/// Refuses the first of some choices, each with whether it was made.
fn useless(choices: &[(&'static str, bool)], problem: &str) -> Result<(), Wrong> {
    let made = choices.iter().find(|(_, made)| *made);
    made.map_or(Ok(()), |(key, _)| Err(Wrong { key, problem: problem.into() }))
}

impl FileOptions {
    /// Refuses what was of no use.
    pub(crate) fn check_use(&self, uses: Uses) -> Result<(), Wrong> {
        let raw = [
            ("dims", self.dims.is_some()),
            ("type", self.sample_type.is_some()),
            ("endian", self.endian.is_some()),
        ];
        let spacing = [("spacing", self.spacing.is_some())];
        let texture = [("texture", self.texture.is_some())];
        if !uses.volume {
            useless(&raw, "is for volumes; none is given")?;
            useless(&spacing, "is for volumes; none is given")?;
        } else if !uses.raw {
            useless(&raw, "is for raw files; the volume has a header")?;
        }
        if !uses.mesh {
            useless(&texture, "is for meshes; none is given")?;
        } else if !uses.texture {
            let problem = "is used by no part: it is for parts of OBJ and PLY meshes that have texture \
                           coordinates and no texture of their own";
            useless(&texture, problem)?;
        }
        if !uses.flow {
            useless(&[("flow", self.flow.is_some())], "is for PLOT3D grids; none is given")?;
        }
        if !uses.level {
            useless(&[("level", self.level.is_some())], "is for splats in several levels; none is given")?;
        }
        Ok(())
    }

    pub(crate) fn check(&self) -> Result<(), Wrong> {
        for &n in self.dims.iter().flatten() {
            ensure("dims", n, n > 0, "at least 1 along each axis")?;
        }
        let right = |s: f64| s > 0.0 && s <= FARTHEST;
        let bad = self.spacing.into_iter().flatten().find(|&s| !right(s));
        bad.map_or(Ok(()), |s| ensure("spacing", s, false, format!("above 0 and at most {FARTHEST:e}")))
    }
}

impl Look {
    /// Refuses what was of no use.
    pub(crate) fn check_use(&self, uses: Uses) -> Result<(), Wrong> {
        if !uses.volume {
            let choices = [
                ("iso", self.iso.is_some()),
                ("iso-color", self.iso_color.is_some()),
                ("transfer", self.transfer.is_some()),
                ("refine", self.refine.is_some()),
                ("flatten", self.flatten.is_some()),
                ("color-by", self.color_by.is_some()),
            ];
            useless(&choices, "is for volumes; none is given")?;
        }
        if !uses.mesh {
            let choices =
                [("surfels", self.surfels.is_some()), ("surfel-spacing", self.surfel_spacing.is_some())];
            useless(&choices, "is for meshes; none is given")?;
        }
        if !uses.points {
            useless(&[("point-color", self.point_color.is_some())], "is for point clouds; none is given")?;
        }
        Ok(())
    }

    pub(crate) fn check(&self) -> Result<(), Wrong> {
        if let Some(values) = &self.iso {
            ensure("iso", "empty", !values.is_empty(), "one value or more")?;
            let bad = values.iter().find(|v| !v.is_finite());
            bad.map_or(Ok(()), |v| ensure("iso", v, false, "finite"))?;
        }
        if let Some(times) = self.refine {
            ensure("refine", times, (1..=16).contains(&times), "from 1 to 16")?;
        }
        if let Some(count) = self.surfels {
            ensure("surfels", count, count > 0, "above 0")?;
        }
        above_zero("surfel-spacing", self.surfel_spacing)?;
        one_of("surfel-spacing", self.surfel_spacing.is_some(), "surfels", self.surfels.is_some())
    }
}
