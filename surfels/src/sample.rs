//! From meshes to clouds of surfels.

use crate::appearance::{Appearance, Textures};
use crate::cells::{Found, LONGEST_EXTENT, Rule, surfels};
use crate::error::SampleError;
use crate::facets::Facets;
use crate::grading::{Grading, side};
use crate::measure::Extent;
use crate::mesh::Mesh;
use crate::share::Surfel;
use crate::sight::{Sight, nearest_depth};
use crate::view::spacing_at;
use glam::{DAffine3, DVec3};
use oblate_engine::cloud::{Material, Shapes, Splats, Strength, Surface};
use oblate_engine::{Camera, Closed, Cloud, Projection};
use rayon::prelude::*;

/// How many surfels a mesh gets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Density {
    /// The distance between neighbours in mesh units, above 0: the square root of the area that a surfel
    /// stands for.
    Spacing(f64),
    /// About this many, above 0: of hundreds and more within a tenth where the surface is smooth, of fewer within a quarter or a few more; more where parts or faces are
    /// smaller than a surfel, since each gets one of its own.
    Count(usize),
}

/// What else there is to say about surfels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SamplerSettings {
    /// Never more surfels than this, at least 1; the spacing grows instead. Default 4 million.
    pub max_surfels: usize,
    /// How the surface answers light, unless all of the mesh is [`unlit`](crate::Primitive::unlit).
    pub material: Material,
}

impl Default for SamplerSettings {
    fn default() -> Self {
        Self { max_surfels: 4_000_000, material: Material::default() }
    }
}

/// The standard deviation of the Gaussian that blurs what surfels own, as a share of a cell.
///
/// A surfel has the covariance of the piece of surface that it owns and this blur. Whatever the pieces are, the sum over surfels is
/// then the area on the surface smoothed by one kernel, up to third moments.
const BLUR: f64 = 0.4;

/// The longest extent of surfels that are evenly wide, in spacings: single-precision positions don't resolve more.
const MOST_SPACINGS: f64 = (1_u32 << 20) as f64;

/// The radius of a mesh's surfels in spacings, by which distances from borders and the depth tolerance go: a sixth more than the mean
/// standard deviation of their Gaussians.
pub const MESH_SURFEL_RADIUS: f32 = 0.7;

/// The floor w₀ of the summed coverage that [`sample`] keeps three radii away from borders and creases.
pub const MESH_COVERAGE_FLOOR: f32 = 0.86;

/// Surfels of a cell from which on other parts of the mesh join those that there are.
const MOST_SHEETS: usize = 8;

/// Pieces that a mesh may be parted into, for each surfel it may have and for each of its triangles.
const MOST_PIECES: [f64; 2] = [64.0, 2.0];

/// Where the lattices begin before the bounds, in cells of the highest level: what is aligned with the axes or has its edges along
/// diagonals lies clear of their planes and edges. However often they are doubled, thirds and fifths are no whole numbers, nor alike.
const MARGINS: DVec3 = DVec3::new(1.0 / 3.0, 2.0 / 3.0, 1.0 / 5.0);

/// The cosine of the angle at which two sheets in a cell are apart.
const APART: f64 = 0.5;

/// Spreads surfels evenly over a mesh, through its primitives' transforms.
///
/// The cloud's space is the mesh's, moved so that the middle of the surfels' bounds is its origin; `cloud_to_world`
/// moves it back. Surfels are flat, along a Morton curve; what they look like is the mean over the area that they own:
/// - area, in squared mesh units: they sum to [`Mesh::area`];
/// - the disc faces the mean of the triangles' normals, outwards: a triangle's outside is where its corners
///   are seen counter-clockwise, and a mirroring transform leaves outside what was outside;
/// - the normal for shading, from the mesh's normals where it has them;
/// - colour: factor × vertex colour × texture, filtered in linear light. A texture needs coordinates; without
///   them it is left out;
/// - opacity: the colour's alpha, if it is below 1 anywhere.
///
/// The depth tolerance is two radii (2 [`MESH_SURFEL_RADIUS`] spacings: at one, creases fall apart), the coverage
/// floor [`MESH_COVERAGE_FLOOR`]. Triangles without area are left out. The spacing grows where it must: beyond
/// [`SamplerSettings::max_surfels`], and below a millionth of the bounds, which single-precision positions do not resolve.
///
/// A mesh that is opaque everywhere shows both sides; one that is not drops its backs if nothing in it is
/// [`double_sided`](crate::Primitive::double_sided). [`Surface::closed`] says that backs are dropped, which they also
/// are where the mesh is opaque and [`Mesh::is_closed`], since nobody outside sees them.
///
/// # Errors
/// When the mesh has no area, an array of it is inconsistent, a number is not finite (but for normals: a triangle has its own then), the density is not
/// above 0, or sizes are beyond single precision.
pub fn sample(mesh: &Mesh, density: Density, settings: &SamplerSettings) -> Result<Cloud, SampleError> {
    mesh.check()?;
    let extent = Extent::of(mesh, None).ok_or(SampleError::Empty)?;
    if extent.area == 0.0 {
        return Err(SampleError::NoArea);
    }
    let spacing = match density {
        Density::Spacing(value) if value > 0.0 && value.is_finite() => value,
        Density::Spacing(value) => return Err(SampleError::Density { what: "spacing", value }),
        Density::Count(0) => return Err(SampleError::Density { what: "number of surfels", value: 0.0 }),
        Density::Count(count) => (extent.area / count as f64).sqrt(),
    };
    let [low, high] = extent.bounds;
    let least = fewest_spacing(extent, settings).max((high - low).max_element() / MOST_SPACINGS);
    let clouds = spread((mesh, mesh.closed()), (extent, spacing.max(least)), None, settings)?;
    // Of one level.
    clouds.into_iter().next().ok_or(SampleError::NoArea)
}

/// Spreads surfels over what a camera sees of a mesh that stands in the world, one a pixel everywhere.
///
/// As [`sample`], but there is a cloud for each octave of depths, of which surfels are of one size within a factor of two: a half to
/// one pixel apart, as wide as a pixel; where pixels are wider than an eighth of their depth, as wide as that. Triangles are left out that the picture doesn't show: those more than 16 pixels beside it and,
/// of an opaque mesh that is [closed](Mesh::is_closed), all that face away from a camera outside of its bounds. Where nothing is seen there is no cloud. In this picture, and
/// with filters of less than four pixels, it looks as the whole mesh does. Beyond [`SamplerSettings::max_surfels`] all surfels are as
/// many more pixels apart.
///
/// # Errors
/// Those of [`sample`].
pub fn sample_seen(
    mesh: &Mesh,
    camera: &Camera,
    settings: &SamplerSettings,
) -> Result<Vec<Cloud>, SampleError> {
    mesh.check()?;
    let whole = Extent::of(mesh, None).ok_or(SampleError::Empty)?;
    if whole.area == 0.0 {
        return Err(SampleError::NoArea);
    }
    // Whoever is in a body sees its backs.
    let is_outside = camera.is_outside(&DAffine3::IDENTITY, whole.bounds);
    let closed = match mesh.closed() {
        Closed::Within(_) if !is_outside => Closed::Sided,
        closed => closed,
    };
    let drops_backs = closed.is_everywhere() && (mesh.is_single_sided() || mesh.is_opaque());
    let Some(mut nearest) = nearest_depth(mesh, camera) else { return Ok(Vec::new()) };
    let mut pixels = 1.0;
    loop {
        let Some(Seen { sight, extent, spacing }) = Seen::new(mesh, drops_backs, camera, (nearest, pixels))
        else {
            return Ok(Vec::new());
        };
        let longest = (extent.bounds[1] - extent.bounds[0]).max_element();
        let fewest = fewest_spacing(extent, settings);
        match camera.projection() {
            // What is nearer than this gets surfels of several pixels.
            Projection::Perspective if spacing < longest / LONGEST_EXTENT => {
                nearest *= 1.01 * longest / LONGEST_EXTENT / spacing;
            }
            Projection::Orthographic if spacing < longest / MOST_SPACINGS => {
                pixels *= 1.01 * longest / MOST_SPACINGS / spacing;
            }
            _ if spacing < fewest => pixels *= 1.01 * fewest / spacing,
            _ => return spread((mesh, closed), (extent, spacing), Some(&sight), settings),
        }
    }
}

/// About how many surfels [`sample_seen`] spreads, backs included, where there may be as many as it takes; 0 where nothing is seen.
pub fn seen_count(mesh: &Mesh, camera: &Camera) -> f64 {
    let seen = nearest_depth(mesh, camera).and_then(|nearest| Seen::new(mesh, false, camera, (nearest, 1.0)));
    seen.map_or(0.0, |Seen { extent, spacing, .. }| extent.area / (spacing * spacing))
}

/// What a camera sees of a mesh.
struct Seen {
    sight: Sight,
    extent: Extent,
    spacing: f64,
}

impl Seen {
    /// With surfels as many pixels apart from a depth on; nothing if there is no area to be seen.
    fn new(mesh: &Mesh, drops_backs: bool, camera: &Camera, (nearest, pixels): (f64, f64)) -> Option<Self> {
        let spacing = pixels * spacing_at(camera, nearest);
        let sight = Sight::new(camera, (nearest, spacing), drops_backs);
        let extent = Extent::of(mesh, Some(&sight)).filter(|extent| extent.area > 0.0)?;
        Some(Self { sight, extent, spacing })
    }
}

/// The spacing of as many surfels as there may be of some extent.
fn fewest_spacing(extent: Extent, settings: &SamplerSettings) -> f64 {
    // A little below the cap, so that the count's spread seldom takes it beyond.
    let most = 0.9 * settings.max_surfels.max(1) as f64;
    (extent.area / most).sqrt()
}

/// Surfels on what is seen of a checked mesh, with what is known of its sides; a cloud for each level, near ones first.
fn spread(
    (mesh, closed): (&Mesh, Closed),
    (extent, mut spacing): (Extent, f64),
    sight: Option<&Sight>,
    settings: &SamplerSettings,
) -> Result<Vec<Cloud>, SampleError> {
    let max = settings.max_surfels.max(1);
    let [low, high] = extent.bounds;
    let middle = (low + high) / 2.0;
    let textures = Textures::new(mesh);
    let grading = sight.map_or(Grading::EVEN, |sight| sight.grading);
    let (mut least_cosine, mut most_sheets) = (APART, MOST_SHEETS);
    loop {
        // A plane goes through as many cells as its shadows along the axes have areas.
        let cell = spacing * (extent.shadows / extent.area).sqrt();
        if !((cell * cell) as f32).is_normal() {
            return Err(SampleError::Size(spacing));
        }
        let most = MOST_PIECES[0] * max as f64 + MOST_PIECES[1] * extent.triangles as f64;
        if extent.pieces(cell) > most.min(f64::from(u32::MAX)) {
            spacing *= 1.5; // Slivers: their pieces go by length and not by area.
            continue;
        }
        let facets = Facets::new(mesh, (middle, cell), sight);
        if facets.facets.is_empty() {
            return Err(SampleError::NoArea);
        }
        let grading = grading.in_units((middle, cell));
        let margins = MARGINS * side(extent.level);
        let shift = (middle - low) / cell + margins;
        let end = (high - low) / cell + 2.0 * margins;
        let rule =
            Rule { shift, end, grading, level: extent.level, least_cosine, most_sheets, blur: BLUR * BLUR };
        let found = surfels((&facets, &Appearance::new(&facets, &textures)), sight, rule);
        let count: usize = found.iter().map(Found::count).sum();
        if count > max {
            if cell > (high - low).max_element() {
                // Few are wanted of what faces everywhere, and of all parts.
                (least_cosine, most_sheets) = (-1.0, 1);
            }
            spacing *= 1.01 * (count as f64 / max as f64).sqrt();
            continue;
        }
        let of_level = |found: &Found| {
            let cell = cell * side(found.level);
            let (origin, width) = found.middle_and_width(grading);
            let sizes = (cell, spacing * width);
            let splats = splats((&found.blocks, origin), sizes, (mesh, &closed), settings);
            Ok(Cloud::new(splats)?.transformed(DAffine3::from_translation(middle + origin * cell)))
        };
        return found.iter().filter(|found| found.count() > 0).map(of_level).collect();
    }
}

/// Surfels that are a spacing apart, from lengths in cells of a side; `origin` becomes theirs.
fn splats(
    (blocks, origin): (&[Vec<Surfel>], DVec3),
    (cell, spacing): (f64, f64),
    (mesh, closed): (&Mesh, &Closed),
    settings: &SamplerSettings,
) -> Splats {
    let translucent = blocks.par_iter().flatten_iter().any(|surfel| surfel.color.w < 1.0 - 1e-6);
    let centers = || column(blocks, |surfel| ((surfel.center - origin) * cell).as_vec3());
    let factors = || column(blocks, |surfel| surfel.factor * cell as f32);
    let areas = || column(blocks, |surfel| (f64::from(surfel.area) * cell * cell) as f32);
    let opacities = || translucent.then(|| column(blocks, |surfel| surfel.color.w.clamp(0.0, 1.0)));
    let normals = || column(blocks, |surfel| surfel.normal);
    let colors = || {
        column(blocks, |surfel| {
            let alpha = surfel.color.w;
            if alpha > 0.0 { (surfel.color.truncate() / alpha).to_array() } else { [0.0; 3] }
        })
    };
    let ((factors, areas), (centers, (normals, (colors, opacities)))) = rayon::join(
        || (factors(), areas()),
        || rayon::join(centers, || rayon::join(normals, || (colors(), opacities()))),
    );
    Splats {
        centers,
        shapes: Shapes::Each(factors),
        strength: Strength::Surface(Surface {
            areas,
            opacities,
            depth_tolerance: 2.0 * MESH_SURFEL_RADIUS * spacing as f32,
            coverage_floor: MESH_COVERAGE_FLOOR,
            closed: match (translucent, mesh.is_single_sided()) {
                (true, true) => Closed::OneSided,
                (true, false) if *closed != Closed::Nowhere => Closed::Sided,
                _ => closed.clone(),
            },
        }),
        colors,
        harmonics: None,
        normals: Some(normals),
        material: if mesh.is_unlit() { Material::UNLIT } else { settings.material },
    }
}

/// A value of each surfel.
fn column<T>(blocks: &[Vec<Surfel>], value: impl Fn(&Surfel) -> T) -> Vec<T> {
    let mut values = Vec::with_capacity(blocks.iter().map(Vec::len).sum());
    values.extend(blocks.iter().flatten().map(value));
    values
}
