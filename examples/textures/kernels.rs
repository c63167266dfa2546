//! Texels as kernels: elliptical ones, round ones, and points.

use crate::texture::{SIGMA, Texels};
use crate::view::{LEFT, Picture};
use glam::{DMat3, DVec2, DVec3, Mat3, Vec3};
use oblate::engine::{
    Camera, Channels, Closed, Cloud, CloudError, Counts, Material, Observer, Order, RenderSettings, Scene,
    SceneError, Shapes, Splats, Strength, Surface, render,
};
use std::sync::{Mutex, PoisonError};

/// What a texel is drawn as.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    /// A surfel.
    Surface,
    /// A kernel of a slab with this σ across, in sides of the square, and an optical depth of 8 from above.
    Slab(f64),
}

/// The optical depth of a slab: e^{−8} of the light passes.
const OPAQUE: f64 = 8.0;

/// Kernels as wide as their texels are apart on the plane: Zwicker, Pfister, van Baar, Gross, *EWA Volume Splatting*, 2001.
pub(crate) fn elliptical(texels: &Texels, kind: Kind) -> Result<Cloud, CloudError> {
    let across = if let Kind::Slab(sigma) = kind { sigma } else { 0.0 };
    let factor = DMat3::from_diagonal((SIGMA * texels.step()).extend(across));
    cloud(texels, kind, |_| (factor, 1.0))
}

/// Points without an extent of their own, of which the pixels' filter is seen, where texels are less than `pixels` apart in the
/// picture along u; kernels elsewhere. Yuan, Chen et al., *Hybrid Forward Resampling and Volume Rendering*, 2003, section 4.1.
pub(crate) fn hybrid(texels: &Texels, camera: &Camera, pixels: f64) -> Result<Cloud, CloudError> {
    let factor = DMat3::from_diagonal((SIGMA * texels.step()).extend(0.0));
    cloud(texels, Kind::Surface, |center| {
        let z = camera.pose().world_to_camera.transform_point3(center).z;
        let is_point = texels.step().x < pixels * camera.pixel_width_at(z);
        // A factor of zero would say nothing about where the surface faces.
        (factor * if is_point { 1e-3 } else { 1.0 }, 1.0)
    })
}

/// Uniform scaling: Swan, Mueller, Möller, Shareef, Crawfis, Yagel, *An Anti-Aliasing Technique for Splatting*, 1997. To be
/// drawn without a low-pass filter. As much is seen of each kernel as of the one in [`elliptical`].
pub(crate) fn uniform(texels: &Texels, kind: Kind, camera: &Camera) -> Result<Cloud, CloudError> {
    let along = if kind == Kind::Surface { 0.0 } else { 1.0 };
    let forward = camera.pose().forward();
    cloud(texels, kind, |center| {
        let ray = center - camera.pose().eye();
        // A surfel that faces the viewer has the area that is seen of the texel.
        let area = (ray.z / ray.dot(forward)).abs();
        (round(texels, center, camera) * DMat3::from_diagonal(DVec3::new(1.0, 1.0, along)), area)
    })
}

/// The factor of a kernel that is a circle in the picture, and as long towards the viewer: as wide as those of texels that are as
/// far apart there as these are along the wider axis of the grid, and at least as wide as those of texels a pixel apart.
pub(crate) fn round(texels: &Texels, center: DVec3, camera: &Camera) -> DMat3 {
    let to_camera = camera.pose().world_to_camera;
    let place = to_camera.transform_point3(center);
    let radius = SIGMA * texels.step().max_element().max(camera.pixel_width_at(place.z));
    to_camera.matrix3.transpose() * DMat3::from_cols(DVec3::X, DVec3::Y, place / place.z) * radius
}

/// A cloud of a splat for each texel: its factor, and its area in texels, which only surfels have.
fn cloud(texels: &Texels, kind: Kind, shape: impl Fn(DVec3) -> (DMat3, f64)) -> Result<Cloud, CloudError> {
    let count = texels.colors.len();
    let places = (0..count).map(|i| (texels.place(i) + DVec2::new(LEFT, 0.0)).extend(0.0));
    let centers: Vec<Vec3> = places.clone().map(|place| place.as_vec3()).collect();
    let (factors, areas): (Vec<Mat3>, Vec<f32>) =
        places.map(shape).map(|(factor, area)| (factor.as_mat3(), (area / count as f64) as f32)).unzip();
    let strength = match kind {
        // The plane is one layer, whichever way its surfels are turned.
        Kind::Surface => Strength::Surface(Surface {
            areas,
            opacities: None,
            depth_tolerance: 1.0,
            coverage_floor: 0.98,
            closed: Closed::Nowhere,
        }),
        Kind::Slab(_) => Strength::Extinction { masses: vec![(OPAQUE / count as f64) as f32; count] },
    };
    let (shapes, colors, material) = (Shapes::Each(factors), texels.colors.clone(), Material::UNLIT);
    let splats = Splats { centers, shapes, strength, colors, harmonics: None, normals: None, material };
    Cloud::new(splats.in_morton_order())
}

/// Colours as they are. Kernels of a slab all add up, as those of one sheet do in the papers.
pub(crate) fn one_sheet() -> RenderSettings {
    let order = Order::Slabs { thickness: 1e6 };
    RenderSettings { shade: false, channels: Channels::Color, order, ..RenderSettings::default() }
}

/// The same without a low-pass filter.
pub(crate) fn unfiltered() -> RenderSettings {
    RenderSettings { low_pass: 0.0, ..one_sheet() }
}

/// Draws a cloud.
pub(crate) fn draw(cloud: &Cloud, camera: &Camera, settings: &RenderSettings) -> Result<Picture, SceneError> {
    draw_watched(cloud, (camera, settings), &())
}

/// Draws a cloud and says how many of its kernels are points, affine and exact ones.
pub(crate) fn forms(
    cloud: &Cloud,
    camera: &Camera,
    settings: &RenderSettings,
) -> Result<[u64; 3], SceneError> {
    let counted = Counted::default();
    draw_watched(cloud, (camera, settings), &counted)?;
    Ok(counted.0.into_inner().unwrap_or_else(PoisonError::into_inner).forms)
}

/// Keeps the counts of a frame.
#[derive(Default)]
struct Counted(Mutex<Counts>);

impl Observer for Counted {
    fn counts(&self, counts: Counts) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = counts;
    }
}

fn draw_watched(
    cloud: &Cloud,
    (camera, settings): (&Camera, &RenderSettings),
    observer: &dyn Observer,
) -> Result<Picture, SceneError> {
    let scene = Scene { clouds: vec![cloud.clone()], lights: Vec::new() };
    let frame = render(&scene, camera, settings, observer)?;
    let colors = frame.color.iter().map(|[red, green, blue, _]| [*red, *green, *blue]).collect();
    Ok(Picture { size: [frame.width, frame.height], colors })
}
