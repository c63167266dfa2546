//! Contents to files.
//!
//! | format | holds |
//! |---|---|
//! | [`Target::SurfelPly`] | splats of any kind, with all that oblate knows of them |
//! | [`Target::GaussianPly`], [`Target::Splat`], [`Target::Spz`], [`Target::Glb`] | Gaussians with peak opacities |
//! | [`Target::Nrrd`], [`Target::Vti`] | volumes |
//!
//! Surfels go to formats of Gaussians as flat Gaussians whose peak opacity is the surface's: with σ = 0.7 spacings
//! what shines through between them is below 3 %. Kernels with extinctions don't: their opacity differs from side
//! to side.

mod gaussian_ply;
mod gltf;
mod nrrd;
mod records;
mod samples;
mod splat;
mod spz;
mod surfel_ply;
#[cfg(test)]
mod tests;
mod vti;

use crate::{Content, Note};
use glam::DVec3;
use oblate_engine::cloud::Surface;
use oblate_engine::{Blend, Material, OpacityFilter, Splats, Strength};
use samples::Packing;
use std::borrow::Cow;
use std::io::{self, Write};
use std::path::Path;
pub use surfel_ply::SurfelWriter;
use thiserror::Error;

/// What a file is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// oblate's own PLY of splats.
    SurfelPly,
    /// PLY as training programs write it.
    GaussianPly,
    /// `.splat`: 32 bytes a splat, no harmonics.
    Splat,
    /// `.spz`, version 3.
    Spz,
    /// Binary glTF with KHR_gaussian_splatting.
    Glb,
    /// NRRD with attached samples.
    Nrrd,
    /// VTK ImageData.
    Vti,
}

/// Why contents are not written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The format does not hold such contents.
    #[error("{0}")]
    Unsuited(String),
    /// No format has such a name's ending.
    #[error("{0:?} tells no format that is written; .ply, .splat, .spz, .glb, .nrrd and .vti do")]
    Unknown(String),
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] io::Error),
}

impl Target {
    /// All targets, each with its name.
    pub const ALL: [(Self, &'static str); 7] = [
        (Self::SurfelPly, "surfel-ply"),
        (Self::GaussianPly, "gaussian-ply"),
        (Self::Splat, "splat"),
        (Self::Spz, "spz"),
        (Self::Glb, "glb"),
        (Self::Nrrd, "nrrd"),
        (Self::Vti, "vti"),
    ];

    /// What a file of this name is written as; `.ply` holds Gaussians as trained where `trained`, else surfels.
    ///
    /// # Errors
    /// When the name's ending tells no format.
    pub fn of(path: &Path, trained: bool) -> Result<Self, ExportError> {
        check_name(path)?;
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        Ok(match extension.as_str() {
            "ply" if trained => Self::GaussianPly,
            "ply" => Self::SurfelPly,
            "splat" => Self::Splat,
            "spz" => Self::Spz,
            "glb" => Self::Glb,
            "nrrd" => Self::Nrrd,
            "vti" => Self::Vti,
            _ => return Err(ExportError::Unknown(path.display().to_string())),
        })
    }

    /// Its name, as in [`Target::ALL`].
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(target, _)| *target == self).map_or("", |(_, name)| name)
    }

    /// What is up by custom in such a file of this content, as [`crate::Opened::up`] has it when it is read.
    pub fn up(self, content: &Content) -> DVec3 {
        match self {
            Self::GaussianPly | Self::Splat | Self::Spz => DVec3::NEG_Y,
            Self::SurfelPly => content.up(),
            Self::Glb => DVec3::Y,
            Self::Nrrd | Self::Vti => DVec3::Z,
        }
    }

    /// Whether it holds volumes; else it holds splats.
    pub fn holds_volumes(self) -> bool {
        matches!(self, Self::Nrrd | Self::Vti)
    }
}

/// Refuses names that tell a format which is read, but not written.
///
/// # Errors
/// When this one does.
pub fn check_name(path: &Path) -> Result<(), ExportError> {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_ascii_lowercase();
    if name.ends_with(".compressed.ply") {
        let problem = "packed PLY is read, but not written; .ply, .spz and .splat are";
        return Err(ExportError::Unsuited(format!("{}: {problem}", path.display())));
    }
    Ok(())
}

/// Writes a volume or splats in which `up` is up; says what the format has no room for. Of all targets GLB turns them upright.
///
/// # Errors
/// When the format does not hold such contents, or `out` fails.
pub fn save(
    content: &Content,
    up: DVec3,
    target: Target,
    out: &mut dyn Write,
) -> Result<Vec<Note>, ExportError> {
    match (content, target) {
        (Content::Volume(volume), Target::Nrrd) => nrrd::write(volume, Packing::Deflated, out),
        (Content::Volume(volume), Target::Vti) => vti::write(volume, Packing::Deflated, out),
        (Content::Splats { splats, blend, origin }, Target::SurfelPly) => {
            surfel_ply::write(splats, (*blend, *origin), out)
        }
        (Content::Splats { splats, blend, origin }, target) if !target.holds_volumes() => {
            let mut notes = save_splats(splats, (*blend, up), target, out)?;
            if *origin != DVec3::ZERO {
                let DVec3 { x, y, z } = origin;
                notes.push(Note::LeftOut(format!("the place {x},{y},{z}, which centres are relative to")));
            }
            Ok(notes)
        }
        (Content::Irregular(_), target) if target.holds_volumes() => Err(ExportError::Unsuited(format!(
            "{} holds regular grids; the samples of this one lie elsewhere",
            target.name()
        ))),
        _ if target.holds_volumes() => {
            Err(ExportError::Unsuited(format!("{} holds volumes; this is none", target.name())))
        }
        _ => Err(ExportError::Unsuited(format!(
            "{} holds splats; make surfels or kernels first",
            target.name()
        ))),
    }
}

fn save_splats(
    splats: &Splats,
    (blend, up): (Blend, DVec3),
    target: Target,
    out: &mut dyn Write,
) -> Result<Vec<Note>, ExportError> {
    let (gaussians, assumed) = match &splats.strength {
        Strength::Opacity { .. } => (Cow::Borrowed(splats), None),
        Strength::Surface(surface) => {
            let note = "surfels are written as flat Gaussians with the surface's opacity, in their own colours without light";
            (Cow::Owned(flat_gaussians(splats, surface)), Some(Note::Assumed(note.into())))
        }
        Strength::Extinction { .. } => {
            let problem = format!(
                "{} holds opacities, but these kernels have extinctions, whose opacity depends on the side that is \
                 seen; surfel-ply holds them",
                target.name()
            );
            return Err(ExportError::Unsuited(problem));
        }
    };
    let notes = match target {
        Target::GaussianPly => gaussian_ply::write(&gaussians, blend, out),
        Target::Splat => splat::write(&gaussians, blend, out),
        Target::Spz => spz::write(&gaussians, blend, out),
        _ => gltf::write(&gaussians, (blend, up), out),
    }?;
    Ok(assumed.into_iter().chain(notes).collect())
}

/// Surfels as Gaussians of peak opacity.
fn flat_gaussians(splats: &Splats, surface: &Surface) -> Splats {
    let peaks = surface.opacities.clone().unwrap_or_else(|| vec![1.0; splats.centers.len()]);
    Splats {
        strength: Strength::Opacity {
            peaks,
            filter: OpacityFilter::Classic,
            least: Strength::LEAST_OF_TRAINED,
        },
        normals: None,
        material: Material::UNLIT,
        ..splats.clone()
    }
}
