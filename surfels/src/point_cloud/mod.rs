//! Point clouds to surfels: a disc for each point, in the plane that its neighbours lie about.

mod color;
mod lines;
mod surfels;
mod tangent;

pub use color::{point_range, point_values};
pub use surfels::{POINT_COVERAGE_FLOOR, point_surfels};

use glam::{DVec3, Vec3};
use oblate_engine::CloudError;
use oblate_engine::cloud::Material;
use thiserror::Error;

/// Points sampled from surfaces, as scanners and photogrammetry give them. Each array has an entry for each point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Added to all positions: coordinates of maps are too large for single precision.
    pub origin: DVec3,
    /// Relative to the origin.
    pub positions: Vec<Vec3>,
    /// Linear Rec. 709.
    pub colors: Option<Vec<[f32; 3]>>,
    /// Strengths of the returned light, in any unit.
    pub intensities: Option<Vec<f32>>,
    /// Of any length; zero where unknown.
    pub normals: Option<Vec<Vec3>>,
    /// Radii of the discs that the points are; 0 or less where unknown.
    pub radii: Option<Vec<f32>>,
    /// Where the scanner stood, in the frame of origin + position.
    pub viewpoint: Option<DVec3>,
}

/// What points are coloured by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PointColor {
    /// The colours, if there are any and not all are black, as files write that have none; else the intensities, if there
    /// are any and they differ; else the height.
    #[default]
    Auto,
    /// The colours.
    Rgb,
    /// The intensities, as display-encoded grey over [`PointSettings::range`].
    Intensity,
    /// The coordinate along [`PointSettings::up`], over [`PointSettings::range`], in the colours of *viridis* (Smith,
    /// van der Walt, 2015).
    Height,
}

/// How points become surfels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointSettings {
    /// What they are coloured by.
    pub color: PointColor,
    /// How many nearest neighbours tell a point's plane and area, from 3 to 64. Default 12: fewer keep finer detail,
    /// more even out more noise.
    pub neighbors: usize,
    /// Heights grow along it; surfels that nothing orients face it. Any length but 0; default +Z, as scanners' files have it.
    pub up: Vec3,
    /// The values, of those that [`point_values`] gives, that the ends of the colours stand for; by default their 1st and 99th
    /// percentile, which [`point_range`] finds of several clouds together.
    pub range: Option<[f64; 2]>,
    /// How the surface answers light.
    pub material: Material,
}

impl Default for PointSettings {
    fn default() -> Self {
        Self {
            color: PointColor::Auto,
            neighbors: 12,
            up: Vec3::Z,
            range: None,
            material: Material::default(),
        }
    }
}

/// Why points do not become surfels.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum PointError {
    /// Nothing is there.
    #[error("the point cloud has no points")]
    Empty,
    /// More points than ids can name.
    #[error("{0} points; at most 4294967294 can be named")]
    Count(usize),
    /// An array does not have one entry for each point.
    #[error("{found} {array} for {positions} points; there must be one for each")]
    Length {
        /// The name of the array.
        array: &'static str,
        /// Its length.
        found: usize,
        /// How many points there are.
        positions: usize,
    },
    /// A number is infinite or not a number.
    #[error("{what} {index} is not finite")]
    NotFinite {
        /// Which of the arrays.
        what: &'static str,
        /// The entry.
        index: usize,
    },
    /// The wanted colour is not there.
    #[error("the point cloud has no {0} to be coloured by")]
    Color(&'static str),
    /// A setting is outside its range.
    #[error("{what} is {value}; it must be {expected}")]
    Setting {
        /// Which.
        what: &'static str,
        /// Its value.
        value: String,
        /// What would be right.
        expected: &'static str,
    },
    /// Surfels whose areas single precision cannot hold.
    #[error(
        "surfels of radius {0:e} have areas beyond single precision; scale the points to between 1e-15 and 1e15"
    )]
    Size(f32),
    /// The surfels are not a cloud.
    #[error("the surfels cannot be drawn: {0}")]
    Cloud(#[from] CloudError),
}

impl PointCloud {
    /// Checks every number that [`point_surfels`] reads.
    fn check(&self) -> Result<(), PointError> {
        let Self { origin, positions, colors, intensities, normals, radii, viewpoint } = self;
        if positions.is_empty() {
            return Err(PointError::Empty);
        }
        if positions.len() >= u32::MAX as usize {
            return Err(PointError::Count(positions.len()));
        }
        let places = [*origin, viewpoint.unwrap_or_default()];
        for (what, place) in ["origin", "viewpoint"].into_iter().zip(&places) {
            finite(what, std::slice::from_ref(place), |place| place.is_finite())?;
        }
        finite("position", positions, |p| p.is_finite())?;
        self.check_array(("colours", "colour"), colors, |c| c.iter().all(|c| c.is_finite()))?;
        self.check_array(("intensities", "intensity"), intensities, |i| i.is_finite())?;
        self.check_array(("normals", "normal"), normals, |n| n.is_finite())?;
        self.check_array(("radii", "radius"), radii, |r| r.is_finite())
    }

    fn check_array<T>(
        &self,
        (array, what): (&'static str, &'static str),
        values: &Option<Vec<T>>,
        is_finite: impl Fn(&T) -> bool,
    ) -> Result<(), PointError> {
        let Some(values) = values else { return Ok(()) };
        let (found, positions) = (values.len(), self.positions.len());
        if found != positions {
            return Err(PointError::Length { array, found, positions });
        }
        finite(what, values, is_finite)
    }
}

fn finite<T>(what: &'static str, values: &[T], is_finite: impl Fn(&T) -> bool) -> Result<(), PointError> {
    let wrong = values.iter().position(|value| !is_finite(value));
    wrong.map_or(Ok(()), |index| Err(PointError::NotFinite { what, index }))
}

impl PointSettings {
    fn check(&self) -> Result<(), PointError> {
        let fails = |what, value, expected| Err(PointError::Setting { what, value, expected });
        if !(3..=64).contains(&self.neighbors) {
            return fails("the number of neighbours", self.neighbors.to_string(), "from 3 to 64");
        }
        if !self.up.is_finite() || self.up == Vec3::ZERO {
            return fails("the upward direction", self.up.to_string(), "finite and not zero");
        }
        if let Some([low, high]) = self.range.filter(|[low, high]| !(low <= high && (high - low).is_finite()))
        {
            return fails("the range of colours", format!("{low} to {high}"), "finite, the lower end first");
        }
        Ok(())
    }
}
