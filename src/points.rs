//! Point clouds to surfels: colours count over all clouds of a scene.

use crate::content::{Body, Item};
use crate::description::Look;
use anyhow::{Context, Result};
use glam::DVec3;
use oblate::engine::Cloud;
use oblate::surfels::{PointCloud, PointColor, PointSettings, point_range, point_surfels, point_values};
use std::collections::HashMap;

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
    pub(crate) settings: PointSettings,
    /// In which of its places.
    pub(crate) places: Vec<usize>,
    by: Option<PointColor>,
    /// What one of its heights is in the world, and what is added.
    heights: [f64; 2],
}

/// Heights of a cloud that stands at several of them, at most, that say what all range over.
const HEIGHTS: usize = 1 << 16;

/// Of each point cloud, in order, how its points become surfels where `up` is up in the world: in all its places, or, where
/// heights colour it, in those at one height. All that is coloured by intensity shares a range, and all by height.
pub(crate) fn placed_settings(items: &[Item], up: DVec3) -> Result<Vec<Vec<Placed>>> {
    let up = up.normalize_or(DVec3::Z);
    let (mut intensities, mut heights, mut clouds) = (Vec::new(), Vec::new(), Vec::new());
    for item in items {
        let Body::Points(points) = &item.body else { continue };
        let mut in_places: Vec<Placed> = Vec::new();
        let mut known = HashMap::new();
        for (number, place) in item.places.iter().enumerate() {
            // up · (M p + t) = (Mᵀ up) · p + up · t
            let own_up = place.matrix3.transpose() * up;
            let settings =
                PointSettings { up: own_up.normalize_or(DVec3::Z).as_vec3(), ..settings(&item.look) };
            let [scale, offset] = [own_up.length(), place.translation.dot(up)];
            let key = [own_up.x, own_up.y, own_up.z, offset].map(f64::to_bits);
            if let Some(same) = known.get(&key) {
                let Placed { places, .. }: &mut Placed = &mut in_places[*same];
                places.push(number);
                continue;
            }
            known.insert(key, in_places.len());
            let values = point_values(points, &settings).with_context(|| item.name.clone())?;
            let by = values.as_ref().map(|(by, _)| *by);
            let placed = Placed { settings, places: vec![number], by, heights: [scale, offset] };
            in_places.push(placed);
            match values {
                Some((PointColor::Height, own)) => {
                    let step = if item.places.len() > 1 { own.len().div_ceil(HEIGHTS).max(1) } else { 1 };
                    heights.extend(own.iter().step_by(step).map(|height| scale * height + offset));
                    continue;
                }
                Some((_, own)) => intensities.extend(own),
                None => {}
            }
            in_places[0].places = (0..item.places.len()).collect();
            break;
        }
        clouds.push(in_places);
    }
    let [intensities, heights] = [intensities, heights].map(point_range);
    for Placed { settings, by, heights: [scale, offset], .. } in clouds.iter_mut().flatten() {
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
