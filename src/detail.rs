//! When a cloud gets levels of detail.

use crate::draw::Drawing;
use glam::DAffine3;
use oblate::engine::footprint::Lens;
use oblate::engine::{Camera, Cloud, Projection};

/// Splats that are looked at, in all places together; in one place at least and at most.
const LOOKED_AT: usize = 1 << 16;
const LOOKED_AT_IN_A_PLACE: [usize; 2] = [16, 1024];

/// The share of the pixel filter's σ below which a splat's own σ counts as small. A splat that stands for four of these is
/// about as large as the filter.
const SMALL: f64 = 0.5;

/// Drawings of the whole cloud that levels must be able to save.
const LEAST_GAIN: f64 = 3.0;

/// Whether making levels of a cloud that stands in these places, each a move from where it is, is worth it.
///
/// Making them takes about three times as long as drawing the cloud once (the engine volume's 0.39 s for 0.11 to 0.15). What they save is,
/// in each place and each picture, the drawing of splats so small that the picture can't tell four from one. So they are made where at
/// least three times as many small splats would be drawn in all as the cloud has: in many places, or in several pictures; and where a
/// budget can be kept by nothing else.
pub(crate) fn levels_pay(cloud: &Cloud, moves: &[DAffine3], camera: &Camera, drawing: &Drawing) -> bool {
    if drawing.reference.is_some() || drawing.settings.level_of_detail == 0.0 || cloud.is_empty() {
        return false;
    }
    if drawing.settings.budget.is_some() {
        return true;
    }
    let [least, most] = LOOKED_AT_IN_A_PLACE;
    let samples = (LOOKED_AT / moves.len().max(1)).clamp(least, most).min(cloud.len());
    let small: usize =
        moves.iter().map(|place| small_splats(cloud, *place, (camera, drawing), samples)).sum();
    let gain = drawing.pictures() as f64 * small as f64 / samples as f64;
    gain >= LEAST_GAIN
}

/// How many of so many splats, evenly from all of a cloud in one place, are in the picture and small there.
fn small_splats(
    cloud: &Cloud,
    place: DAffine3,
    (camera, drawing): (&Camera, &Drawing),
    samples: usize,
) -> usize {
    let settings = &drawing.settings;
    // With the power 0.8 of the tolerance most needs fall (`Cloud::with_levels_for`); the more is allowed, the coarser `settle` finds that
    // levels may be.
    let filter = settings.low_pass.sqrt() * (255.0 * settings.tolerance).powf(1.2);
    let lens = Lens::new(camera, settings.low_pass);
    let to_camera = camera.pose().world_to_camera * place * cloud.cloud_to_world();
    let size = camera.size().map(f64::from);
    let is_small = |index: &usize| {
        let center = to_camera.transform_point3(cloud.center(*index).as_dvec3());
        if center.z <= camera.near() {
            return false;
        }
        let scale = if lens.projection == Projection::Perspective { center.z.recip() } else { 1.0 };
        let seen = lens.focal * center.truncate() * scale + lens.principal;
        let inside = seen.cmpge(glam::DVec2::ZERO).all() && seen.cmple(size.into()).all();
        let factor = to_camera.matrix3 * cloud.factor(*index).as_dmat3();
        let squares = [factor.x_axis, factor.y_axis, factor.z_axis].map(|axis| axis.length_squared());
        // Root mean square of the half-axes, in pixels.
        let sigma = (squares.iter().sum::<f64>() / 3.0).sqrt() / camera.pixel_width_at(center.z);
        inside && sigma < SMALL * filter
    };
    (0..samples).map(|sample| sample * cloud.len() / samples).filter(is_small).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::description::PictureOptions;
    use glam::{DVec3, Mat3, Vec3};
    use oblate::engine::{Channels, Material, Pose, Shapes, Splats, Strength};

    /// Ten thousand kernels of σ = 0.1 in a cube of side 10 about the origin.
    fn cube() -> Cloud {
        let centers = (0..10_000_i16).map(|i| {
            let place = [i % 22, i / 22 % 22, i / 484].map(|n| f32::from(n) / 2.2 - 5.0);
            Vec3::from(place)
        });
        let splats = Splats {
            centers: centers.collect(),
            shapes: Shapes::Shared(Mat3::IDENTITY * 0.1),
            strength: Strength::Extinction { masses: vec![1.0; 10_000] },
            colors: vec![[0.5; 3]; 10_000],
            harmonics: None,
            normals: None,
            material: Material::default(),
        };
        Cloud::new(splats).unwrap()
    }

    fn pays(options: PictureOptions, distance: f64, moves: &[DVec3], measured: Option<usize>) -> bool {
        let pose = Pose::look_at(DVec3::Z * distance, DVec3::ZERO, DVec3::Y).unwrap();
        // 1000 pixels a unit of slope.
        let camera = Camera::perspective(pose, 2.0 * 0.5_f64.atan(), [1000, 1000]).unwrap();
        let mut drawing = Drawing::new(&options, Channels::Color).unwrap();
        drawing.measured = measured;
        let moves: Vec<_> = moves.iter().map(|to| DAffine3::from_translation(*to)).collect();
        levels_pay(&cube(), &moves, &camera, &drawing)
    }

    #[test]
    fn they_pay_where_splats_are_small() {
        let plain = PictureOptions::default;
        let here = [DVec3::ZERO];
        let three = Some(3);
        // σ is 100/distance pixels, small below 0.274.
        assert!(!pays(plain(), 300.0, &here, three));
        assert!(pays(plain(), 450.0, &here, three));
        // One picture is not worth it.
        assert!(!pays(plain(), 450.0, &here, None));
        assert!(!pays(PictureOptions { level_of_detail: Some(false), ..plain() }, 450.0, &here, three));
        assert!(pays(PictureOptions { budget: Some(9), ..plain() }, 50.0, &here, None));
        let tolerance = Some("9/255".parse().unwrap());
        assert!(pays(PictureOptions { tolerance, ..plain() }, 150.0, &here, three));
        // Beside or behind the camera they cost nothing either way.
        assert!(!pays(plain(), 450.0, &[DVec3::X * 1e3], three));
        assert!(!pays(plain(), 450.0, &[DVec3::Z * 1e3], three));
        // Several of many are enough, and a small part of one in many pictures.
        let row: Vec<DVec3> = (0..10).map(|i| DVec3::NEG_Z * 50.0 * f64::from(i)).collect();
        assert!(pays(plain(), 100.0, &row, None) && !pays(plain(), 100.0, &row[..5], None));
        assert!(!pays(plain(), 362.0, &here, three) && pays(plain(), 362.0, &here, Some(100)));
    }
}
