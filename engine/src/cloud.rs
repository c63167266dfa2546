//! Clouds of splats: structure of arrays, one strength for all splats of a cloud.

mod checks;

pub(crate) use checks::{check_material, check_names, check_surface, wrong};

use crate::camera::{Camera, Projection};
use crate::closed::Closed;
use crate::columns::{Columns, Kind};
use crate::levels::{self, Level};
use checks::validate;
use glam::{DAffine3, DMat3, Mat3, Vec3};
use std::sync::Arc;
use thiserror::Error;

/// The covariances of a cloud's splats, each as a factor **F** with **Σ = F Fᵀ**.
///
/// The columns of F are half-axes: a e₁, b e₂, c e₃ with e₁ × e₂ = e₃. A surfel's normal is e₃ and its
/// third column is zero when it is perfectly flat; Σ⁻¹ is never formed, so that is an ordinary value.
#[derive(Clone, Debug, PartialEq)]
pub enum Shapes {
    /// One factor for every splat, as in a regular grid.
    Shared(Mat3),
    /// A factor for each splat.
    Each(Vec<Mat3>),
}

impl Shapes {
    /// The factor of splat `index`, in cloud space.
    pub fn factor(&self, index: usize) -> Mat3 {
        match self {
            Self::Shared(factor) => *factor,
            Self::Each(factors) => factors[index],
        }
    }
}

/// What the amplitude of a cloud's kernels means.
#[derive(Clone, Debug, PartialEq)]
pub enum Strength {
    /// Extinction kernels. The mass is ∫ extinction dV = κ (2π)^{3/2} |Σ|^{1/2}, in squared world units,
    /// for peak extinction κ; at least 0.
    Extinction {
        /// A mass for each splat.
        masses: Vec<f32>,
    },
    /// Kernels with a peak opacity in [0, 1], the same from every side, as in trained Gaussian scenes. What the near plane cuts off is missing: of
    /// one that reaches to the eye the rest is less opaque.
    Opacity {
        /// A peak opacity for each splat.
        peaks: Vec<f32>,
        /// What they are where the pixel's low-pass filter widens a splat.
        filter: OpacityFilter,
        /// Kernels end where their opacity falls below this, in [0, 1], before the filter dims it: [`LEAST_OF_TRAINED`](Self::LEAST_OF_TRAINED), or
        /// 0 for whole Gaussians.
        least: f32,
    },
    /// Surface samples.
    Surface(Surface),
}

impl Strength {
    /// What rasterizers of trained scenes leave out: α below 1/255. It is a part of what was trained. Kerbl, Kopanas, Leimkühler, Drettakis,
    /// *3D Gaussian Splatting for Real-Time Radiance Field Rendering*, 2023, appendix C, as their programs and gsplat have it.
    pub const LEAST_OF_TRAINED: f32 = 1.0 / 255.0;
}

/// Whether the pixel's low-pass filter dims a kernel of given peak opacity that it widens. Trained opacities are right with
/// what they were trained with; for kernels of many pixels both are the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OpacityFilter {
    /// Peaks stay: however small it is, a kernel covers a pixel or two with its whole opacity. Kerbl, Kopanas,
    /// Leimkühler, Drettakis, *3D Gaussian Splatting for Real-Time Radiance Field Rendering*, 2023, whose programs
    /// add 0.3 px² to the projected variances.
    Classic,
    /// Peaks fall by √(|V| / |V'|), with V the covariance in the picture and V' the widened one, so that opacity times
    /// area stays. Yu, Chen, Huang, Sattler, Geiger, *Mip-Splatting: Alias-free 3D Gaussian Splatting*, 2024:
    /// its 2D Mip filter.
    Compensated,
}

/// What makes a cloud's splats samples of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// The surface area that each splat stands for, in squared world units.
    pub areas: Vec<f32>,
    /// Opacity of the surface at each splat in [0, 1]; `None` is opaque.
    pub opacities: Option<Vec<f32>>,
    /// Samples of one pixel within this depth (world units) of the first belong to one layer: one to two surfel radii. With too little
    /// of it creases fall apart into layers; with too much sheets that are as near each other become one.
    pub depth_tolerance: f32,
    /// The floor w₀ of the summed coverage that the sampler guarantees away from borders, in (0, 1]; its mean is 1, since the areas add
    /// up to the surface's. The pixels' filter raises it towards 0.96, as √a where it dims a surfel to a share a;
    /// of surfels that stand for others as it does these.
    pub coverage_floor: f32,
    /// From where splats are dropped whose normal points away from the camera: of closed surfaces, whose backs nobody outside
    /// sees, and of those whose backs are not to be seen, from everywhere. Of others, whether neighbours face the same way.
    pub closed: Closed,
}

/// Blinn–Phong coefficients of a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Share of its colour that it sends whatever light there is.
    pub emission: f32,
    /// Share of ambient light returned.
    pub ambient: f32,
    /// Share of the light returned diffusely.
    pub diffuse: f32,
    /// Share of the light returned in the highlight, uncoloured.
    pub specular: f32,
    /// Exponent of the highlight.
    pub exponent: f32,
}

impl Default for Material {
    fn default() -> Self {
        Self { emission: 0.0, ambient: 0.3, diffuse: 0.7, specular: 0.2, exponent: 20.0 }
    }
}

impl Material {
    /// Shows the colours as they are, whatever the lights.
    pub const UNLIT: Self = Self { emission: 1.0, ambient: 0.0, diffuse: 0.0, specular: 0.0, exponent: 1.0 };
}

/// The arrays of a cloud before they are checked. All have one length, in the same order.
#[derive(Clone, Debug, PartialEq)]
pub struct Splats {
    /// Centres in cloud space.
    pub centers: Vec<Vec3>,
    /// Covariance factors in cloud space.
    pub shapes: Shapes,
    /// What the amplitudes mean.
    pub strength: Strength,
    /// Linear Rec. 709 colours, not premultiplied.
    pub colors: Vec<[f32; 3]>,
    /// How the colours change with the direction they are seen from.
    pub harmonics: Option<Harmonics>,
    /// Unit normals for shading in cloud space; a zero vector, or `None` for all, is a splat without one,
    /// which returns ambient light alone, or, on a surface, takes the normal of its shape.
    pub normals: Option<Vec<Vec3>>,
    /// How the splats answer light; [`Material::UNLIT`] of trained splats, whose colours have their light in them.
    pub material: Material,
}

/// Real spherical harmonics from degree 1 on, by which trained scenes let colours depend on the view.
///
/// They are added to the display-encoded colour, where such scenes are trained, and the sum is cut off at 0.
/// Directions point from the eye to the splat, in cloud space. Basis and signs are those of Kerbl, Kopanas,
/// Leimkühler, Drettakis, *3D Gaussian Splatting for Real-Time Radiance Field Rendering*, 2023.
#[derive(Clone, Debug, PartialEq)]
pub struct Harmonics {
    /// The highest degree, from 1 to 3.
    pub degree: u8,
    /// For each splat 3, 8 or 15 colours, by degree and then order.
    pub coefficients: Vec<[f32; 3]>,
}

impl Harmonics {
    /// Coefficients of each channel of a splat.
    pub(crate) const fn count(degree: u8) -> usize {
        (degree as usize + 1) * (degree as usize + 1) - 1
    }

    /// Colours for each splat.
    pub fn per_splat(&self) -> usize {
        Self::count(self.degree)
    }
}

/// Splats that can be drawn: every number finite, every array of one length.
///
/// A clone shares the splats: a cloud can stand in many places of a scene, by [`Cloud::transformed`], and takes its memory once.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    /// The splats, and levels of fewer and fewer that stand for them; at least the first.
    levels: Arc<Vec<Level>>,
    cloud_to_world: DAffine3,
}

/// Why arrays do not make a cloud.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum CloudError {
    /// Two arrays differ in length.
    #[error("{array} has {found} entries where the cloud's centres ask for {expected}")]
    Length {
        /// The name of the array.
        array: &'static str,
        /// Its length.
        found: usize,
        /// What would fit the number of centres.
        expected: usize,
    },
    /// A number is outside its range.
    #[error("splat {index}: {what} is {value}; {expected}")]
    Value {
        /// The splat.
        index: usize,
        /// Which number.
        what: &'static str,
        /// What it is.
        value: String,
        /// What would be right.
        expected: &'static str,
    },
    /// More splats than a 32-bit id can name.
    #[error("{0} splats; at most 4294967294 can be named")]
    Count(usize),
}

impl Default for Cloud {
    /// Nothing.
    fn default() -> Self {
        Self::of_columns(Columns::default())
    }
}

impl Cloud {
    /// Checks the arrays and makes them a cloud whose space is the world.
    ///
    /// # Errors
    /// When arrays differ in length or a number is not finite or outside its documented range.
    pub fn new(splats: Splats) -> Result<Self, CloudError> {
        validate(&splats)?;
        Ok(Self::of_columns(Columns::new(splats)))
    }

    /// The cloud of checked numbers.
    pub(crate) fn of_columns(columns: Columns) -> Self {
        let levels = Arc::new(vec![Level::of_splats(columns)]);
        Self { levels, cloud_to_world: DAffine3::IDENTITY }
    }

    /// The same cloud with levels of detail: splats that stand for four of the level below each, down to the cloud's own. A
    /// renderer draws them where the picture can't tell. Splats are put in another order, which ids follow, among those of
    /// each run of 4096, or up to 262,144 of large surfaces; they should be in an order that keeps neighbours together, as [`Splats::in_morton_order`] does.
    #[must_use]
    pub fn with_levels(self) -> Self {
        self.with_levels_for(1.0 / 255.0)
    }

    /// As [`Self::with_levels`], which is for a tolerance of 1/255, for pictures of another one; below 1e-6 for 1e-6. Which errors fade soon
    /// and which slowly differs from splat to splat: in a picture of another tolerance than levels are for, filters count as wider by the
    /// root of how much larger that is, or as narrower as it is smaller, so that it is kept to with more splats than levels for it have.
    #[must_use]
    pub fn with_levels_for(self, tolerance: f64) -> Self {
        if self.levels.len() > 1 {
            return self;
        }
        let levels = Arc::try_unwrap(self.levels).unwrap_or_else(|shared| shared.as_ref().clone());
        Self { levels: Arc::new(levels::with_coarser(levels, tolerance.max(1e-6))), ..self }
    }

    /// The same cloud elsewhere: `outer` is applied after the transform that the cloud already has.
    /// Masses scale with its determinant, areas by their own factor.
    #[must_use]
    pub fn transformed(mut self, outer: DAffine3) -> Self {
        self.cloud_to_world = outer * self.cloud_to_world;
        self
    }

    /// Whether the splats are samples of a surface.
    pub fn is_surface(&self) -> bool {
        matches!(self.columns().kind, Kind::Surface(_))
    }

    /// Whether there are splats with extinctions.
    pub(crate) fn is_medium(&self) -> bool {
        matches!(self.columns().kind, Kind::Extinction) && !self.is_empty()
    }

    /// Whether it is a surface of which a camera sees no backs: see [`Closed`].
    pub(crate) fn is_closed_for(&self, camera: &Camera) -> bool {
        let Kind::Surface(surface) = &self.columns().kind else { return false };
        let cloud_to_camera = camera.pose().world_to_camera * self.cloud_to_world;
        let is_perspective = camera.projection() == Projection::Perspective;
        let is_before_ends = surface.closed.is_for(&cloud_to_camera.inverse(), is_perspective);
        if !is_before_ends || surface.closed == Closed::OneSided {
            return is_before_ends;
        }
        self.levels[0].bounds.is_none_or(|corners| {
            let body = surface.closed.around(corners.map(Vec3::as_dvec3));
            camera.is_outside(&self.cloud_to_world, body)
        })
    }

    /// Whether renderers have levels of detail to choose from.
    pub fn has_levels(&self) -> bool {
        self.levels.len() > 1
    }

    /// The number of splats.
    pub fn len(&self) -> usize {
        self.columns().len
    }

    /// Whether there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        self.columns().len == 0
    }

    /// Memory of the splats and their levels of detail in bytes, which clones share.
    pub fn bytes(&self) -> usize {
        self.levels.iter().map(Level::bytes).sum()
    }

    /// Where the splats are kept: the same for clones alone.
    pub(crate) fn address(&self) -> usize {
        Arc::as_ptr(&self.levels).addr()
    }

    /// A copy of the arrays, in the order of ids; coefficients of harmonics as they were rounded to 16 bits.
    pub fn splats(&self) -> Splats {
        self.columns().splats()
    }

    /// The centre of splat `index` in cloud space.
    pub fn center(&self, index: usize) -> Vec3 {
        self.columns().center(index)
    }

    /// The covariance factor of splat `index` in cloud space.
    pub fn factor(&self, index: usize) -> Mat3 {
        self.columns().factor(index)
    }

    /// How the splats answer light.
    pub fn material(&self) -> Material {
        self.columns().material
    }

    /// The numbers of its splats, or nothing where clones share them.
    pub(crate) fn into_columns(self) -> Columns {
        let levels = Arc::try_unwrap(self.levels).unwrap_or_default();
        levels.into_iter().next().map_or_else(Columns::default, |level| level.columns)
    }

    pub(crate) fn columns(&self) -> &Columns {
        &self.levels[0].columns
    }

    /// The splats, and those that stand for them, ever fewer.
    pub(crate) fn levels(&self) -> &[Level] {
        &self.levels
    }

    /// The median over the kernels of a level of √(3/tr Σ⁻¹) in the world, exact where the transform keeps proportions: 1/σ²
    /// along a ray in the mean over all directions. So it doesn't depend on the view. `None` of surfaces, and without any.
    pub(crate) fn median_sigma(&self, level: usize) -> Option<f64> {
        let scale = self.cloud_to_world.matrix3.determinant().abs().cbrt();
        Some(f64::from(self.levels[level].median_sigma?) * scale).filter(|sigma| *sigma > 0.0)
    }

    /// The transform from cloud space to the world.
    pub fn cloud_to_world(&self) -> DAffine3 {
        self.cloud_to_world
    }

    /// The smallest and largest corner of the centres in the world; `None` for an empty cloud.
    pub fn bounds(&self) -> Option<[glam::DVec3; 2]> {
        let mut corners: Option<[glam::DVec3; 2]> = None;
        for index in 0..self.len() {
            let p = self.cloud_to_world.transform_point3(self.center(index).as_dvec3());
            corners = Some(corners.map_or([p, p], |[low, high]| [low.min(p), high.max(p)]));
        }
        corners
    }
}

/// The factor F of a flattened splat (Σ = F Fᵀ) with its normal along `normal`, radius `radius` and
/// thickness `radius / flattening`; `flattening` is from 1 (round) to infinity (a surfel). A zero normal gives
/// the z axis.
pub fn oblate_factor(normal: Vec3, radius: f32, flattening: f32) -> Mat3 {
    let normal = normal.try_normalize().unwrap_or(Vec3::Z);
    let (tangent, _) = normal.any_orthonormal_pair();
    let bitangent = normal.cross(tangent);
    Mat3::from_cols(tangent * radius, bitangent * radius, normal * (radius / flattening))
}

/// The linear part of a transform as it acts on areas of a plane with the given half-axes.
pub(crate) fn area_scale(linear: DMat3, factor: Mat3) -> f64 {
    let (a, b) = (factor.x_axis.as_dvec3(), factor.y_axis.as_dvec3());
    let before = a.cross(b).length();
    if before > 0.0 { (linear * a).cross(linear * b).length() / before } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    #[test]
    fn bytes_are_those_of_what_differs() {
        let count = 800;
        let scene = |masses: Vec<f32>, copies: usize| {
            let splats = Splats {
                centers: (0..count).map(|i| Vec3::splat(i as f32)).collect(),
                shapes: Shapes::Shared(Mat3::IDENTITY),
                strength: Strength::Extinction { masses },
                colors: vec![[0.5; 3]; count],
                harmonics: None,
                normals: None,
                material: Material::default(),
            };
            let cloud = Cloud::new(splats).expect("the numbers are finite");
            Scene { clouds: vec![cloud; copies], lights: Vec::new() }.bytes()
        };
        let alike = scene(vec![1.0; count], 1);
        // Three coordinates each, and a block for all masses and one for all colours; the rest are clusters.
        let clusters = alike - (count * 12 + 32 + 96);
        assert!(clusters > 0 && clusters < 8 * count, "{clusters}");
        let masses: Vec<f32> = (0..count).map(|i| i as f32).collect();
        assert_eq!(scene(masses.clone(), 1), alike + count * 4 - 32);
        assert_eq!(scene(masses.clone(), 5), scene(masses, 1));
    }
}
