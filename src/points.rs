//! Point clouds to surfels: colours count over all clouds of a scene.

use crate::content::{Body, Item};
use crate::description::Look;
use anyhow::{Context, Result};
use glam::DVec3;
use oblate::engine::Cloud;
use oblate::surfels::{PointCloud, PointColor, PointSettings, point_range, point_surfels, point_values};

/// How the points of a cloud by itself become surfels.
fn settings(look: &Look) -> PointSettings {
    PointSettings { color: look.point_color.map_or(PointColor::Auto, Into::into), ..PointSettings::default() }
}

/// A surfel for each point.
pub(crate) fn point_cloud(points: &PointCloud, look: &Look) -> Result<Cloud> {
    Ok(point_surfels(points, &settings(look))?)
}

/// How the points of a scene's clouds become surfels.
pub(crate) struct Placed {
    /// In the first of some places, or in one.
    pub(crate) settings: PointSettings,
    by: Option<PointColor>,
    /// What one of its heights is in the world, and what is added.
    heights: [f64; 2],
}

/// Of each point cloud, in order, how its points become surfels where `up` is up in the world: in all its places, or, where
/// heights colour it, in each. All that is coloured by intensity shares a range, and all by height.
pub(crate) fn placed_settings(items: &[Item], up: DVec3) -> Result<Vec<Vec<Placed>>> {
    let up = up.normalize_or(DVec3::Z);
    let (mut intensities, mut heights, mut clouds) = (Vec::new(), Vec::new(), Vec::new());
    for item in items {
        let Body::Points(points) = &item.body else { continue };
        let mut in_places = Vec::new();
        for place in &item.places {
            // up · (M p + t) = (Mᵀ up) · p + up · t
            let own_up = place.matrix3.transpose() * up;
            let settings =
                PointSettings { up: own_up.normalize_or(DVec3::Z).as_vec3(), ..settings(&item.look) };
            let [scale, offset] = [own_up.length(), place.translation.dot(up)];
            let values = point_values(points, &settings).with_context(|| item.name.clone())?;
            let by = values.as_ref().map(|(by, _)| *by);
            in_places.push(Placed { settings, by, heights: [scale, offset] });
            match values {
                Some((PointColor::Height, own)) => {
                    heights.extend(own.iter().map(|height| scale * height + offset));
                    continue;
                }
                Some((_, own)) => intensities.extend(own),
                None => {}
            }
            break;
        }
        clouds.push(in_places);
    }
    let [intensities, heights] = [intensities, heights].map(point_range);
    for Placed { settings, by, heights: [scale, offset] } in clouds.iter_mut().flatten() {
        settings.range = match by {
            Some(PointColor::Height) if *scale > 0.0 => {
                heights.map(|ends| ends.map(|end| (end - *offset) / *scale))
            }
            Some(PointColor::Intensity) => intensities,
            _ => None,
        };
    }
    Ok(clouds)
}
