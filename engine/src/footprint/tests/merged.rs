//! Surfels that stand for others: the wide projection against its specification.

use super::*;
use crate::camera::{Camera, Pose};
use crate::closed::Closed;
use crate::cloud::{Cloud, Material, Shapes, Splats, Strength, Surface, oblate_factor};
use crate::scene::FootprintForm;
use glam::{DVec3, Mat3};
use setups::transform;
use std::sync::LazyLock;

/// What a body may be: closed, of which no backs are seen; open, with sides; of which nothing is known.
const KINDS: [Closed; 3] = [Closed::EVERYWHERE, Closed::Sided, Closed::Nowhere];

/// A ball of radius 1 with bumps of each kind, with levels.
static BODIES: LazyLock<[Cloud; 3]> = LazyLock::new(|| KINDS.map(body));

fn body(closed: Closed) -> Cloud {
    let count = 20_000_i16;
    let point = |i: i16| {
        let z = 1.0 - (2.0 * f32::from(i) + 1.0) / f32::from(count);
        let (sin, cos) = (f32::from(i) * 2.399_963_2).sin_cos();
        let across = (1.0 - z * z).sqrt();
        Vec3::new(across * cos, across * sin, z)
    };
    let normal = |i: i16| point(i) + 0.2 * (point(i) * 7.0).map(f32::sin);
    let splats = Splats {
        centers: (0..count).map(point).collect(),
        shapes: Shapes::Each((0..count).map(|i| oblate_factor(normal(i), 0.02, f32::INFINITY)).collect()),
        strength: Strength::Surface(Surface {
            areas: vec![6e-4; count as usize],
            opacities: None,
            depth_tolerance: 0.02,
            coverage_floor: 0.9,
            closed,
        }),
        colors: vec![[0.5; 3]; count as usize],
        harmonics: None,
        normals: None,
        material: Material::default(),
    };
    Cloud::new(splats.in_morton_order()).unwrap().with_levels()
}

/// The coverage of a surfel if all of its normals faced the eye, over its floor at most.
fn whole(projector: &Projector, index: usize) -> f64 {
    let splat = CameraSplat {
        center: projector.cloud_to_camera.transform_point3(projector.columns.center(index).as_dvec3()),
        factor: projector.cloud_to_camera.matrix3 * projector.columns.factor(index).as_dmat3(),
    };
    let footprint = Footprint::new(&splat, &projector.view.lens).unwrap();
    let axes = projector.normal_to_camera;
    let scale =
        [axes.x_axis, axes.y_axis, axes.z_axis].map(|axis| axis.length()).into_iter().fold(0.0, f64::max);
    f64::from(projector.columns.strength(index)) * scale * footprint.unit_integral / 0.9
}

/// Where a viewer is, and which block of which level is seen.
#[derive(Debug)]
struct Case {
    /// Of [`KINDS`].
    kind: usize,
    place: usize,
    is_parallel: bool,
    above: usize,
    /// Of how many blocks it comes after.
    block: f64,
    direction: [f64; 3],
}

fn is_projected_as_one_is(case: &Case) -> Result<(), TestCaseError> {
    let &Case { kind, place, is_parallel, above, block, direction } = case;
    let cloud = BODIES[kind].clone().transformed(transform(place));
    let target = cloud.cloud_to_world().translation;
    let eye = target + 12.0 * DVec3::from(direction).try_normalize().unwrap_or(DVec3::X);
    let pose = Pose::look_at(eye, target, DVec3::new(0.3, 0.2, 0.9)).unwrap();
    let camera = if is_parallel {
        Camera::orthographic(pose, 6.0, [64; 2]).unwrap()
    } else {
        Camera::perspective(pose, 0.5, [64; 2]).unwrap()
    };
    let settings = RenderSettings::default();
    let scene = Scene { clouds: vec![cloud], lights: Vec::new() };
    let lights = Lights::new(&scene, &camera);
    let view = SceneView { scene: &scene, camera: &camera, settings: &settings };
    let projectors = SceneProjector {
        view,
        lights: &lights,
        closing: Closing::Centers { alike: 0.0 },
        looked: None,
        tile_side: 16,
        level: Level::Baseline,
    };
    let columns = &scene.clouds[0].levels()[above].columns;
    let first = LANES * (block * (columns.len / LANES) as f64) as usize;
    let mut range = VisibleRange::whole(first..first + LANES, columns.center(first), true);
    (range.level, range.hides_backs) = (above, kind == 0);
    let projector = projectors.of(&range);
    // Places in the body, at most 2.5 times as large, are rounded, and so are directions from the eye, which is not nearer than it is wide.
    const ROUNDING: f64 = 200.0 * f32::EPSILON as f64;
    // Of the latter, across themselves: coordinates of the eye and of its differences from places, each rounded by 4 ε at a distance of 12, √3
    // times as much in all three; the rest is the cosine's own.
    const OF_DIRECTIONS: f64 = 2.0 * f32::EPSILON as f64;
    for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
        let Wide { octet, .. } = Wide::new(level, &projector, &range);
        for lane in 0..LANES {
            let (found, expected) = (octet.get(lane), projector.project_splat(first + lane));
            let whole = whole(&projector, first + lane);
            let (Some((record, sample)), Some(expected)) = (&found, &expected) else {
                let shown =
                    found.map_or_else(|| expected.map(|splat| splat.record), |(record, _)| Some(record));
                // One alone is next to nothing.
                let amplitude = shown.map_or(0.0, |record| f64::from(record.amplitude));
                prop_assert!(amplitude.abs() < ROUNDING * whole, "{level:?}, {lane}: {amplitude}");
                continue;
            };
            let numbers = |record: &Record| {
                let [x, y] = record
                    .amplitude_slope_or_slabs
                    .map(|slope| f64::from(slope) * camera.intrinsics().focal.x);
                DVec3::new(x, y, f64::from(record.amplitude))
            };
            // Slopes go by the vector area, a gradient that changes by 1/w per direction where both sides are in view, and no more than w is seen
            // there.
            let seen = f64::from(expected.record.amplitude).abs() / whole;
            let told = (seen * ROUNDING / OF_DIRECTIONS).min(1.0);
            let error = (numbers(record) - numbers(&expected.record)) * DVec3::new(told, told, 1.0);
            prop_assert!(
                error.length() < ROUNDING * whole,
                "{level:?}, {lane}: {record:?}, {:?}",
                expected.record
            );
            // Means by what is seen change as fast as 1 over it.
            let turned = (Vec3::from(sample.normal) - Vec3::from(expected.sample.normal)).length();
            prop_assert!(
                f64::from(turned) * seen < ROUNDING,
                "{level:?}, {lane}: {sample:?}, {:?}",
                expected.sample
            );
        }
    }
    Ok(())
}

/// Surfels at right angles to the view, a thousandth of which is seen.
#[test]
fn merged_surfels_seen_edge_on_are_projected_as_one_is() {
    is_projected_as_one_is(&Case {
        kind: 2,
        place: 0,
        is_parallel: false,
        above: 1,
        block: 0.451_2,
        direction: [-0.413_571_388_190_545_73, -0.391_844_229_261_570_1, -0.898_970_909_286_997_4],
    })
    .unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn eight_merged_surfels_are_projected_as_one_is(
        (kind, place, is_parallel) in (0..KINDS.len(), 0..4_usize, any::<bool>()),
        (above, block) in (1..3_usize, 0.0..1.0_f64),
        direction in prop::array::uniform3(-1.0..1.0_f64),
    ) {
        is_projected_as_one_is(&Case { kind, place, is_parallel, above, block, direction })?;
    }
}

/// Kernels that no filter dims, four to a merged one, as points and of a hundredth of the distance between them, from where these four are a hundredth of
/// a pixel wide to where they are ten. Far away a merged one shows the sum of four opacities.
#[test]
fn merged_kernels_that_no_filter_dims_are_projected_as_one_is() {
    let count = 10_000_u16;
    let numbers = |i: u16| [0.754_877_7, 0.569_840_3, 0.438_579_2].map(|step| (f32::from(i) * step).fract());
    let centers: Vec<Vec3> = (0..count).map(|i| 2.0 * Vec3::from(numbers(i)) - 1.0).collect();
    for size in [0.0, 1e-30, 4e-18, 4e-3] {
        let splats = Splats {
            centers: centers.clone(),
            shapes: Shapes::Shared(Mat3::IDENTITY * size),
            strength: Strength::Opacity {
                peaks: vec![0.02; count.into()],
                filter: OpacityFilter::Classic,
                least: 0.0,
            },
            colors: vec![[0.5; 3]; count.into()],
            harmonics: None,
            normals: None,
            material: Material::UNLIT,
        };
        let cloud = Cloud::new(splats.in_morton_order()).unwrap().with_levels();
        let scene = Scene { clouds: vec![cloud], lights: Vec::new() };
        for distance in [4000.0, 40.0, 4.0] {
            let pose = Pose::look_at(DVec3::new(0.3, 0.5, 0.8) * distance, DVec3::ZERO, DVec3::Z).unwrap();
            let camera = Camera::perspective(pose, 0.9, [64; 2]).unwrap();
            for footprint in [FootprintForm::Point, FootprintForm::Affine, FootprintForm::Exact] {
                let settings = RenderSettings { footprint, ..RenderSettings::default() };
                let view = SceneView { scene: &scene, camera: &camera, settings: &settings };
                let projectors = SceneProjector {
                    view,
                    lights: &Lights::new(&scene, &camera),
                    closing: Closing::Centers { alike: 0.0 },
                    looked: None,
                    tile_side: 16,
                    level: Level::Baseline,
                };
                let mut range = VisibleRange::whole(0..LANES, Vec3::ZERO, false);
                range.level = 1;
                let projector = projectors.of(&range);
                for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
                    let Wide { len, records, .. } = Wide::new(level, &projector, &range);
                    assert_eq!(len, LANES);
                    for (index, found) in records[..len].iter().enumerate() {
                        let [found, one] =
                            [found.amplitude, projector.project_splat(index).unwrap().record.amplitude];
                        assert!((found / one - 1.0).abs() < 1e-4, "{level:?}, {index}: {found}, not {one}");
                        let is_far = distance == 4000.0;
                        assert!(!is_far || (one - 0.08).abs() < 8e-4, "{index} of {size}: {one}");
                    }
                }
            }
        }
    }
}
