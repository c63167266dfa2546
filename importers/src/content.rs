//! What a file holds.

use glam::DVec3;
use oblate_engine::{Blend, Splats, Strength};
use oblate_surfels::{Mesh, PointCloud};
use oblate_volumes::{IrregularVolume, Volume};
use std::fmt;

/// What a file holds, and what is to be said of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Opened {
    /// The name of its format.
    pub format: &'static str,
    /// What is up in it by the custom of its format and kind: a unit vector along an axis.
    pub up: DVec3,
    /// What it holds.
    pub content: Content,
    /// What the reader did not take as it stands.
    pub notes: Vec<Note>,
}

/// What files hold.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// Triangles.
    Mesh(Mesh),
    /// Voxels.
    Volume(Volume),
    /// Samples on no regular grid.
    Irregular(IrregularVolume),
    /// Points of surfaces.
    Points(PointCloud),
    /// Splats: trained Gaussians with peak opacities, or surfels.
    Splats {
        /// The splats.
        splats: Splats,
        /// The space in which their colours are meant to mix.
        blend: Blend,
        /// Where in the world the origin of their space lies, in world units: centres in single precision have no room for places on a map.
        origin: DVec3,
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

impl Content {
    /// What is up by custom where a format has none of its own.
    pub(crate) fn up(&self) -> DVec3 {
        match self {
            // Reconstructions keep the axes of their first camera: y points down.
            Self::Splats { splats, .. } if matches!(splats.strength, Strength::Opacity { .. }) => {
                DVec3::NEG_Y
            }
            Self::Volume(_) | Self::Irregular(_) | Self::Points(_) => DVec3::Z,
            _ => DVec3::Y,
        }
    }
}

impl Opened {
    /// Content of which there is something to be said.
    pub(crate) fn noting(content: Content, notes: Vec<Note>) -> Self {
        Self { format: "", up: content.up(), content, notes }
    }
}

/// Content as it stands in the file.
impl From<Content> for Opened {
    fn from(content: Content) -> Self {
        Self::noting(content, Vec::new())
    }
}

impl From<Mesh> for Opened {
    fn from(mesh: Mesh) -> Self {
        Content::Mesh(mesh).into()
    }
}

impl From<PointCloud> for Opened {
    fn from(points: PointCloud) -> Self {
        Content::Points(points).into()
    }
}

impl From<Volume> for Opened {
    fn from(volume: Volume) -> Self {
        Content::Volume(volume).into()
    }
}
