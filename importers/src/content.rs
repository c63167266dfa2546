//! What a file holds.

use oblate_engine::{Blend, Splats};
use oblate_surfels::Mesh;
use oblate_volumes::Volume;
use std::fmt;

/// What a file holds, and what is to be said of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Opened {
    /// What it holds.
    pub content: Content,
    /// What the reader did not take as it stands.
    pub notes: Vec<Note>,
}

/// What files hold.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Content {
    /// Triangles.
    Mesh(Mesh),
    /// Voxels.
    Volume(Volume),
    /// Splats: trained Gaussians with peak opacities, or surfels.
    Splats {
        /// The splats.
        splats: Splats,
        /// The space in which their colours are meant to mix.
        blend: Blend,
    },
}

/// What a reader or writer did not take as it stands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Note {
    /// Something was left out.
    LeftOut(String),
    /// Numbers were rounded, or cut off at what a format can say.
    Rounded(String),
    /// Something that the file does not say was assumed, or what it says is doubtful.
    Assumed(String),
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LeftOut(what) => write!(f, "left out: {what}"),
            Self::Rounded(what) => write!(f, "rounded: {what}"),
            Self::Assumed(what) => write!(f, "assumed: {what}"),
        }
    }
}

impl Opened {
    /// Content of which there is something to be said.
    pub(crate) fn noting(content: Content, notes: Vec<Note>) -> Self {
        Self { content, notes }
    }
}

/// Content as it stands in the file.
impl From<Content> for Opened {
    fn from(content: Content) -> Self {
        Self { content, notes: Vec::new() }
    }
}

impl From<Mesh> for Opened {
    fn from(mesh: Mesh) -> Self {
        Content::Mesh(mesh).into()
    }
}

impl From<Volume> for Opened {
    fn from(volume: Volume) -> Self {
        Content::Volume(volume).into()
    }
}
