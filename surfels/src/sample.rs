//! From meshes to clouds of surfels.

use crate::appearance::{Appearance, Textures};
use crate::error::SampleError;
use crate::facets::Facets;
use crate::grid::LONGEST_EXTENT;
use crate::mesh::Mesh;
use crate::points::Points;
use crate::relax::{Voronoi, relax, scatter};
use glam::{DAffine3, DVec3, DVec4, Vec3, Vec4};
use oblate_engine::Cloud;
use oblate_engine::cloud::{Material, Shapes, Splats, Strength, Surface, oblate_factor};
use rayon::prelude::*;

/// How many surfels a mesh gets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Density {
    /// The distance between neighbours in mesh units, above 0: the square root of the area that a surfel
    /// stands for.
    Spacing(f64),
    /// About this many, above 0: within a tenth where the surface is smooth; more where parts or faces are
    /// smaller than a surfel, since each gets one of its own.
    Count(usize),
}

/// What else there is to say about surfels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SamplerSettings {
    /// Never more surfels than this, at least 1; the spacing grows instead. Default 4 million.
    pub max_surfels: usize,
    /// How the surface answers light.
    pub material: Material,
}

impl Default for SamplerSettings {
    fn default() -> Self {
        Self { max_surfels: 4_000_000, material: Material::default() }
    }
}

/// The radius of every surfel of a mesh, as a share of the spacing: the standard deviation of its Gaussian.
///
/// All surfels share it, whatever their areas: then the summed coverage is the area on the surface smoothed
/// by one kernel, and a surfel that owns less counts less. Measured on a plane with 0.8 spacings, Σw is within
/// 0.95–1.05; with a width from each surfel's own area 0.86–1.18, with a shape from the moments of what it
/// owns 0.81–1.25. Widths of 0.5, 0.6, 0.7 and 0.8 spacings give 0.76–1.34, 0.87–1.15, 0.92–1.09 and
/// 0.95–1.06: this is the sharpest that keeps clear of the floor also where surfaces bend.
pub const KERNEL_SIGMA: f32 = 0.7;

/// The floor w₀ of the summed coverage that [`sample`] keeps three radii away from borders and creases.
pub const COVERAGE_FLOOR: f32 = 0.85;

/// Points that a mesh may become, for each surfel it may have and for each of its triangles.
const MOST_POINTS: [usize; 2] = [64, 2];

/// Spreads surfels evenly over a mesh, through its primitives' transforms.
///
/// The cloud's space is the mesh's, moved so that the middle of the bounds is its origin; `cloud_to_world`
/// moves it back. Surfels are flat discs, along a Morton curve; what they look like is the mean over the area that they own:
/// - area, in squared mesh units: they sum to [`Mesh::area`];
/// - the disc faces the mean of the triangles' normals, outwards: a triangle's outside is where its corners
///   are seen counter-clockwise, and a mirroring transform leaves outside what was outside;
/// - the normal for shading, from the mesh's normals where it has them;
/// - colour: factor × vertex colour × texture, filtered in linear light. A texture needs coordinates; without
///   them it is left out;
/// - opacity: the colour's alpha, if it is below 1 anywhere.
///
/// The depth tolerance is two radii (2 [`KERNEL_SIGMA`] spacings: at one, creases fall apart), the coverage
/// floor [`COVERAGE_FLOOR`]. Triangles without area are left out. The spacing grows where it must: beyond
/// [`SamplerSettings::max_surfels`], and below a millionth of the bounds, which single-precision positions do not resolve.
///
/// A mesh that is opaque everywhere shows both sides; one that is not drops its backs if nothing in it is
/// [`double_sided`](crate::Primitive::double_sided). [`Surface::closed`] says that backs are dropped, which they also
/// are where the mesh is opaque and [`Mesh::is_closed`], since nobody outside sees them.
///
/// # Errors
/// When the mesh has no area, an array of it is inconsistent, a number is not finite, the density is not
/// above 0, or sizes are beyond single precision.
pub fn sample(mesh: &Mesh, density: Density, settings: &SamplerSettings) -> Result<Cloud, SampleError> {
    mesh.check()?;
    let area = mesh.area();
    let [low, high] = mesh.bounds().ok_or(SampleError::Empty)?;
    if area == 0.0 {
        return Err(SampleError::NoArea);
    }
    let max = settings.max_surfels.max(1);
    let wanted = match density {
        Density::Spacing(value) if value > 0.0 && value.is_finite() => value,
        Density::Spacing(value) => return Err(SampleError::Density { what: "spacing", value }),
        Density::Count(0) => return Err(SampleError::Density { what: "number of surfels", value: 0.0 }),
        Density::Count(count) => (area / count as f64).sqrt(),
    };
    // A little below the cap, so that the count's spread seldom takes it beyond.
    let least = (area / (0.95 * max as f64)).sqrt().max((high - low).max_element() / LONGEST_EXTENT);
    let middle = (low + high) / 2.0;
    let mut spacing = wanted.max(least);
    loop {
        if !((spacing * spacing) as f32).is_normal() {
            return Err(SampleError::Size(spacing));
        }
        let facets = Facets::new(mesh, middle, spacing);
        if facets.facets.is_empty() {
            return Err(SampleError::NoArea);
        }
        let counts: Vec<usize> = facets.facets.par_iter().map(|f| Points::count(&facets, f)).collect();
        let most = MOST_POINTS[0].saturating_mul(max).saturating_add(MOST_POINTS[1] * counts.len());
        if counts.iter().sum::<usize>() > most.min(u32::MAX as usize) {
            spacing *= 1.5; // Slivers: their points go by length and not by area.
            continue;
        }
        let points = Points::new(&facets, &counts);
        let chosen = scatter(&points);
        if chosen.len() > max {
            spacing *= 1.01 * (chosen.len() as f64 / max as f64).sqrt();
            continue;
        }
        let cells = relax(&points, &chosen);
        let textures = Textures::new(&facets);
        let look = Appearance::new(&facets, &textures);
        let surfel = |sample| Surfel::new(&points, &cells, &look, sample);
        let surfels: Vec<Surfel> = (0..cells.samples.len()).into_par_iter().filter_map(surfel).collect();
        let splats = splats(mesh, &surfels, spacing, settings).in_morton_order();
        return Ok(Cloud::new(splats)?.transformed(DAffine3::from_translation(middle)));
    }
}

/// A surfel in units of the spacing.
struct Surfel {
    center: Vec3,
    /// Its plane's outward normal.
    facing: Vec3,
    area: f32,
    /// For shading.
    normal: Vec3,
    /// Linear, premultiplied.
    color: Vec4,
}

impl Surfel {
    fn new(points: &Points, cells: &Voronoi, look: &Appearance, index: usize) -> Option<Self> {
        let sample = &cells.samples[index];
        let (mut area, mut color, mut normal) = (0.0, DVec4::ZERO, DVec3::ZERO);
        for &member in cells.members(index) {
            let share = f64::from(points.areas[member as usize]);
            let (here, up) = look.at(points, member as usize);
            area += share;
            color += here.as_dvec4() * share;
            normal += up.as_dvec3() * share;
        }
        (area > 0.0).then(|| Self {
            center: sample.position,
            facing: sample.normal,
            area: area as f32,
            normal: normal.try_normalize().map_or(sample.normal, DVec3::as_vec3),
            color: (color / area).as_vec4(),
        })
    }
}

fn splats(mesh: &Mesh, surfels: &[Surfel], spacing: f64, settings: &SamplerSettings) -> Splats {
    let length = spacing as f32;
    let radius = KERNEL_SIGMA * length;
    let map = |surfel: &Surfel| surfel.center * length;
    let factor = |surfel: &Surfel| oblate_factor(surfel.facing, radius, f32::INFINITY);
    let color = |surfel: &Surfel| {
        let alpha = surfel.color.w;
        if alpha > 0.0 { (surfel.color.truncate() / alpha).to_array() } else { [0.0; 3] }
    };
    let translucent = surfels.iter().any(|surfel| surfel.color.w < 1.0 - 1e-6);
    let opacities = || surfels.par_iter().map(|surfel| surfel.color.w.clamp(0.0, 1.0)).collect();
    let area = |surfel: &Surfel| (f64::from(surfel.area) * spacing * spacing) as f32;
    Splats {
        centers: surfels.par_iter().map(map).collect(),
        shapes: Shapes::Each(surfels.par_iter().map(factor).collect()),
        strength: Strength::Surface(Surface {
            areas: surfels.par_iter().map(area).collect(),
            opacities: translucent.then(opacities),
            depth_tolerance: 2.0 * radius,
            coverage_floor: COVERAGE_FLOOR,
            closed: if translucent { mesh.is_single_sided() } else { mesh.is_closed() },
        }),
        colors: surfels.par_iter().map(color).collect(),
        harmonics: None,
        normals: Some(surfels.par_iter().map(|surfel| surfel.normal).collect()),
        material: settings.material,
    }
}
