//! Meshes, volumes and trained splats to a scene of splats and the view that shows it.

use crate::content::{Body, Item};
use crate::description::{CameraOptions, Look};
use crate::framing::View;
use crate::progress::Console;
use crate::transfer;
use anyhow::{Context, Result, ensure};
use glam::DVec3;
use oblate::engine::{Camera, Cloud, Light, Scene};
use oblate::surfels::{
    Density, Mesh, PointCloud, PointColor, PointSettings, SamplerSettings, point_surfels, sample,
    view_spacing,
};
use oblate::volumes::{IsoSettings, KernelSettings, Volume, iso_surfels, to_kernels};

/// Surfels of all meshes together, where their number follows the view: in all and for each pixel of the
/// picture. The nearest place sets the density of the whole, and beyond some surfels a pixel nobody sees more.
const MOST_SURFELS: f64 = 4e6;
const MOST_SURFELS_A_PIXEL: f64 = 16.0;

/// Surfels of a mesh that may be asked for: about 8 GiB.
const MOST_ASKED: usize = 100_000_000;

/// A scene ready to be drawn.
pub(crate) struct Assembled {
    pub(crate) scene: Scene,
    pub(crate) camera: Camera,
    pub(crate) view: View,
}

/// Turns items into splats. Volumes and what is splats already come first: they don't depend on the view, the
/// view is framed on what they show, and the number of surfels of a mesh follows the view.
pub(crate) fn assemble(
    items: Vec<Item>,
    camera: &CameraOptions,
    size: [u32; 2],
    lights: Vec<Light>,
    console: Console,
) -> Result<Assembled> {
    // A volume's axes are named in its file; what is up in others is custom.
    let first = items.iter().find(|item| matches!(item.body, Body::Volume(_))).or(items.first());
    let up = first.map_or(DVec3::Y, |item| item.up);
    let (mut clouds, mut meshes) = (Vec::new(), Vec::new());
    for Item { name, body, look, .. } in items {
        match body {
            Body::Mesh(mesh) => meshes.push((name, mesh, look)),
            Body::Splats { cloud, .. } => clouds.push(cloud),
            Body::Points(points, placement) => {
                let _task = console.task(format!("surfels of {name}"));
                let cloud = point_cloud(&points, &look).with_context(|| name.clone())?;
                clouds.push(cloud.transformed(placement));
            }
            Body::Volume(volume) => {
                let _task = console.task(format!("splats of {name}"));
                let shown = volume_clouds(&volume, &look).with_context(|| name.clone())?;
                if shown.iter().all(Cloud::is_empty) {
                    let range = volume
                        .value_range()
                        .map_or("no finite value".into(), |[a, b]| format!("values {a} to {b}"));
                    console.say(format_args!("{name}: nothing in it is visible ({range})"));
                }
                clouds.extend(shown);
            }
        }
    }

    let points = |see: &mut dyn FnMut(DVec3)| {
        for cloud in &clouds {
            let to_world = cloud.cloud_to_world();
            (0..cloud.len()).for_each(|i| see(to_world.transform_point3(cloud.center(i).as_dvec3())));
        }
        for (_, mesh, _) in &meshes {
            for part in &mesh.primitives {
                let to_world = part.primitive_to_mesh;
                part.positions.iter().for_each(|p| see(to_world.transform_point3(p.as_dvec3())));
            }
        }
    };
    let view = View::complete(camera, &points, up, size)?;
    let camera = view.camera(size)?;

    let most = MOST_SURFELS.min(MOST_SURFELS_A_PIXEL * f64::from(size[0]) * f64::from(size[1]));
    let whole: f64 = meshes.iter().map(|(_, mesh, _)| mesh.area()).sum();
    for (name, mesh, look) in &meshes {
        let _task = console.task(format!("surfels of {name}"));
        // The meshes share the limit by their areas.
        let share = (most * mesh.area() / whole) as usize;
        clouds.push(surfels(mesh, look, &camera, share).with_context(|| name.clone())?);
    }
    Ok(Assembled { scene: Scene { clouds, lights }, camera, view })
}

/// As many surfels as asked for; else one a pixel, at most `most`.
fn surfels(mesh: &Mesh, look: &Look, camera: &Camera, most: usize) -> Result<Cloud> {
    if look.surfels.is_some() || look.surfel_spacing.is_some() {
        return asked_surfels(mesh, look);
    }
    let density = Density::Spacing(view_spacing(camera, mesh.bounds().unwrap_or_default()));
    let max_surfels = most.max(1);
    Ok(sample(mesh, density, &SamplerSettings { max_surfels, ..SamplerSettings::default() })?)
}

/// As many surfels as asked for.
pub(crate) fn asked_surfels(mesh: &Mesh, look: &Look) -> Result<Cloud> {
    let (density, asked) = match (look.surfels, look.surfel_spacing) {
        (None, Some(spacing)) => (Density::Spacing(spacing), mesh.area() / (spacing * spacing)),
        (count, _) => (Density::Count(count.unwrap_or(1)), count.unwrap_or(1) as f64),
    };
    ensure!(asked <= MOST_ASKED as f64, "{asked:.0} surfels are asked for; at most {MOST_ASKED} are made");
    Ok(sample(mesh, density, &SamplerSettings { max_surfels: MOST_ASKED, ..SamplerSettings::default() })?)
}

/// A surfel for each point.
pub(crate) fn point_cloud(points: &PointCloud, look: &Look) -> Result<Cloud> {
    let settings = PointSettings {
        color: look.point_color.map_or(PointColor::Auto, Into::into),
        ..PointSettings::default()
    };
    Ok(point_surfels(points, &settings)?)
}

/// Iso-surfaces, then the inside: what was asked for, or the inside where nothing was.
pub(crate) fn volume_clouds(volume: &Volume, look: &Look) -> Result<Vec<Cloud>> {
    let mut clouds = Vec::new();
    let mut settings = IsoSettings::default();
    if let Some(color) = look.iso_color {
        let [r, g, b, _] = color.0;
        settings.color = [r, g, b];
    }
    for iso in look.iso.iter().flatten() {
        clouds.push(iso_surfels(volume, *iso, &settings)?);
    }
    if look.transfer.is_some() || clouds.is_empty() {
        let function = transfer::resolve(look.transfer.as_ref(), volume)?;
        clouds.push(to_kernels(volume, &function, &KernelSettings::default())?);
    }
    Ok(clouds)
}
