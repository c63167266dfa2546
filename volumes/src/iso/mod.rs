//! Volumes to surfels of the surface at a value.
//!
//! An [`IsoExtractor`] knows the smallest and largest values in bricks of a volume and finds the surfels at one value after
//! another; [`iso_surfels`] makes one, and a cloud, of one value. From bricks to surfels: `window` has the samples of up to sixteen as
//! numbers above the value; `crossed` tells which cells have samples on both sides, `cells` goes through them, and `sheets` says what goes through each; `stencil` puts what is
//! around a cell beside that of others, so that from there on cells are as many as lanes of SIMD, four registers of them; `polygon` has areas,
//! `interpolant` and `descent` places, `surfel` normals and half-axes, and `block` is where surfels stay.

mod block;
mod cells;
mod crossed;
mod descent;
mod ends;
mod extractor;
mod hierarchy;
mod interpolant;
mod lanes;
mod polygon;
mod sheets;
mod slab;
mod spline;
mod stencil;
mod streaming;
mod surfel;
mod surfels;
mod window;

use thiserror::Error;

use oblate_engine::{Cloud, CloudError, Material};

pub use extractor::IsoExtractor;
pub use streaming::{Grid, stream_iso_surfels};
pub use surfel::{Interpolation, IsoSurfel, SURFEL_BLUR};
pub use surfels::IsoSurfels;

use crate::volume::{Volume, VolumeError};

/// The least summed coverage of iso-surfels on planes and on surfaces whose radius of curvature is at least five of the
/// grid's longest steps, three radii away from borders. The worst planes have 0.89, by polygons' third moments, and so have spheres, though
/// flat surfels lack about 3σ²/r² there. What is left is for rough places, such as those of a scanned head.
pub const ISO_COVERAGE_FLOOR: f32 = 0.865;

/// The least summed coverage of iso-surfels of irregular volumes on planes, where steps double from one cell to the next along all axes at once.
pub const IRREGULAR_COVERAGE_FLOOR: f32 = 0.7;

/// How [`iso_surfels`] makes surfels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IsoSettings {
    /// Linear Rec. 709 colour of the surface.
    pub color: [f32; 3],
    /// Opacity of the surface from 0 to 1.
    pub opacity: f32,
    /// Radius over thickness of a surfel: from 1 (round) to infinity (flat).
    pub flattening: f32,
    /// How the surface answers light.
    pub material: Material,
    /// How the field continues between samples.
    pub interpolation: Interpolation,
}

/// Light grey, opaque, flat, trilinear.
impl Default for IsoSettings {
    fn default() -> Self {
        Self {
            color: [0.6; 3],
            opacity: 1.0,
            flattening: f32::INFINITY,
            material: Material::default(),
            interpolation: Interpolation::default(),
        }
    }
}

impl IsoSettings {
    fn check(&self) -> Result<(), IsoError> {
        let opaque = (0.0..=1.0).contains(&self.opacity);
        check("the opacity", self.opacity, opaque, "it is from 0 to 1")?;
        check("the flattening", self.flattening, self.flattening >= 1.0, "it is at least 1")
    }
}

fn check(what: &'static str, value: f32, right: bool, expected: &'static str) -> Result<(), IsoError> {
    if right { Ok(()) } else { Err(IsoError::Setting { what, value, expected }) }
}

/// Why there are no iso-surfels.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum IsoError {
    /// A setting is outside its range.
    #[error("{what} is {value}; {expected}")]
    Setting {
        /// Which.
        what: &'static str,
        /// What it is.
        value: f32,
        /// What would be right.
        expected: &'static str,
    },
    /// Single precision has no room for the grid's lengths or areas.
    #[error("the longest step is {step} and the grid reaches {extent} far; {expected}")]
    Extent {
        /// World units.
        step: f64,
        /// World units.
        extent: f64,
        /// What would be right.
        expected: &'static str,
    },
    /// Another number of samples than was asked for.
    #[error("{found} samples were read; {expected} are expected")]
    Slices {
        /// How many were asked for.
        expected: usize,
        /// How many came.
        found: usize,
    },
    /// The samples do not make a volume.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// The surfels do not make a cloud.
    #[error(transparent)]
    Cloud(#[from] CloudError),
}

/// Surfels of the surface at which the volume's interpolant is `iso`; empty if it nowhere is.
///
/// In each cell of eight samples of which some are inside (value ≥ `iso`) and some are not, every polygon of
/// edge crossings becomes a surfel (Co, Hamann, Joy, *Iso-splatting: A Point-based Alternative to Isosurface
/// Visualization*, 2003, with areas so that summed coverage is 1: Zwicker et al., *EWA Volume Splatting*,
/// 2001, section 5):
/// - its centre goes from the polygon's centroid onto the surface along the gradient;
/// - its area is the polygon's in the world;
/// - its normal is that of the grid's central differences, interpolated, and points to lower values; see [`Interpolation`];
/// - its kernel has the covariance of the polygon blurred by [`SURFEL_BLUR`], in index space's measure, so that
///   summed coverage is as even for every spacing and direction.
///
/// Cells with a sample that is not finite hold no surface. The surface is open if it ends there; where the body inside
/// it reaches faces of the grid it is closed from this side of them ([`Closed`](oblate_engine::Closed)), and else from everywhere; a translucent one is open. Polygons of less than a millionth of a cell's face are left out. The cloud's space has the world's
/// axes and its origin at sample (0, 0, 0); surfels are in Morton order of bricks of 8×8×8 cells, and in
/// these cube by cube of 2×2×2.
///
/// # Errors
/// When `iso` is not finite, a setting is outside its range, single precision has no room for the grid's lengths or areas, or
/// there are 2³² surfels or more.
pub fn iso_surfels(volume: &Volume, iso: f32, settings: &IsoSettings) -> Result<Cloud, IsoError> {
    settings.check()?;
    IsoExtractor::new(volume).extract(iso, settings.interpolation)?.cloud(settings)
}
