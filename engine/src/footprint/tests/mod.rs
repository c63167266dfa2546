//! The wide projection against its specification, splat by splat.

mod compare;
mod merged;
mod setups;

use super::*;
use crate::camera::Projection;
use crate::cloud::OpacityFilter;
use crate::columns::LANES;
use crate::cull::find_affordable;
use crate::scene::{RenderSettings, Scene};
use compare::compare;
use glam::Vec3;
use proptest::prelude::*;
use setups::{Seen, Setup, camera, cloud, seen, setup};

/// Splats of a test, and as many more.
const PLACES: usize = 64;

/// What the wide projection makes of a range: as many records, or an octet of surfels with its rectangles.
struct Wide {
    len: usize,
    records: [Record; PLACES],
    rects: [Rect; PLACES],
    distances: [AtomicU32; PLACES],
    octet: Octet,
    own_rects: [Rect; LANES],
}

impl Wide {
    fn new(level: Level, projector: &Projector, range: &VisibleRange) -> Self {
        let mut records = [Record::BLANK; PLACES];
        let mut rects = [Rect::default(); PLACES];
        let mut distances = [const { AtomicU32::new(0) }; PLACES];
        let mut octets = [Octet::NONE];
        let mut own_rects = [[Rect::NONE; LANES]];
        let (mut run, mut tally) = (Run::new(0), Tally::default());
        let mut places = Places {
            records: &mut records,
            octets: &mut octets,
            own_rects: &mut own_rects,
            rects: &mut rects,
            distances: &mut distances,
            run: &mut run,
            tally: &mut tally,
        };
        let wide = WideProjector::new(projector);
        let blocks = wide.blocks(level, range);
        wide.project(level, (range, &blocks), &mut places);
        let ([octet], [own_rects]) = (octets, own_rects);
        Self { len: run.len, records, rects, distances, octet, own_rects }
    }
}

/// The splats of a range that the wide projection shows, each at its number.
fn wide(level: Level, projector: &Projector, range: &VisibleRange) -> Vec<Option<Projected>> {
    let mut before = 0;
    (1..=projector.columns.len)
        .map(|count| {
            // The splats up to this one: if there is one more than without it, it is the last.
            let mut range = range.clone();
            range.splats = 0..count;
            let Wide { len, records, rects, mut distances, octet, own_rects } =
                Wide::new(level, projector, &range);
            if range.is_surface {
                let (record, sample) = octet.get(count - 1).filter(|_| len > 0)?;
                return Some(Projected { record, rect: own_rects[count - 1], distance: 0.0, sample });
            }
            let is_new = len > std::mem::replace(&mut before, len);
            is_new.then(|| {
                let last = len - 1;
                let distance = f32::from_bits(*distances[last].get_mut());
                let sample = SurfaceSample::default();
                Projected { record: records[last], rect: rects[last], distance, sample }
            })
        })
        .collect()
}

fn check(setup: &Setup, splats: &[Seen]) -> Result<(), TestCaseError> {
    let camera = camera(setup);
    let cloud = cloud(setup, splats, &camera);
    let scene = Scene { clouds: vec![cloud], lights: Vec::new() };
    let lights = Lights::new(&scene, &camera);
    let view = SceneView { scene: &scene, camera: &camera, settings: &setup.settings };
    let projectors = SceneProjector {
        view,
        lights: &lights,
        closing: Closing::Centers { alike: 0.0 },
        looked: None,
        tile_side: 16,
        level: Level::Baseline,
    };
    let mut whole = VisibleRange::whole(0..0, Vec3::ZERO, false);
    whole.hides_backs = scene.clouds[0].is_closed_for(&camera);
    let projector = projectors.of(&whole);
    let cloud = projector.columns;
    let middle = (0..cloud.len).map(|i| cloud.center(i)).sum::<Vec3>() / cloud.len as f32;
    // As it is culled; what is culled whole shows nothing.
    let mut visible = Vec::new();
    find_affordable(view, &mut visible);
    visible.iter_mut().for_each(|range| range.center = middle);
    let scale =
        projector.cloud_to_camera.matrix3.to_cols_array().iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    for level in Level::ALL.into_iter().filter(|level| level.is_available()) {
        let nothing = || (0..cloud.len).map(|_| None).collect();
        let shown = visible.first().map_or_else(nothing, |range| wide(level, &projector, range));
        for (index, found) in shown.iter().enumerate() {
            let splat = CameraSplat {
                center: projector.cloud_to_camera.transform_point3(cloud.center(index).as_dvec3()),
                factor: projector.cloud_to_camera.matrix3 * cloud.factor(index).as_dmat3(),
            };
            // What is rounded on the way to the centre.
            let from_middle = f64::from((cloud.center(index) - middle).length()) * scale;
            let extent =
                splat.center.length() + from_middle + f64::from(cloud.center(index).length()) * scale;
            let expected = projector.project_splat(index);
            compare(&(setup, &projector, splat, extent), index, found.as_ref(), expected.as_ref())
                .map_err(|error| TestCaseError::fail(format!("{level:?}, splat {index}: {error}")))?;
        }
    }
    Ok(())
}

#[test]
fn what_is_fainter_than_the_tolerance_is_not_drawn() {
    let setup = Setup {
        projection: Projection::Perspective,
        kind: 1,
        filter: OpacityFilter::Compensated,
        least: 0.0,
        shared: false,
        transform: 0,
        degree: 0,
        near: 0.0,
        settings: RenderSettings { tolerance: 0.05, ..RenderSettings::default() },
    };
    let splat = Seen {
        place: [0.0; 2],
        log_depth: 0.0,
        log_pixels: 0.0,
        stretch: 1.0,
        flattening: 1.0,
        normal: [0.0; 3],
        edge_on: false,
        strength: 0.001,
        color: [0.5; 3],
        shading: [0.0; 3],
    };
    let camera = camera(&setup);
    let scene = Scene { clouds: vec![cloud(&setup, &[splat], &camera)], lights: Vec::new() };
    let lights = Lights::new(&scene, &camera);
    let settings = &setup.settings;
    let view = SceneView { scene: &scene, camera: &camera, settings };
    let projectors = SceneProjector {
        view,
        lights: &lights,
        closing: Closing::Centers { alike: 0.0 },
        looked: None,
        tile_side: 16,
        level: Level::Baseline,
    };
    let projector = projectors.of(&VisibleRange::whole(0..0, Vec3::ZERO, false));
    let middle = projector.columns.center(0);
    let range = VisibleRange::whole(0..1, middle, false);
    assert!(wide(Level::Baseline, &projector, &range)[0].is_none(), "the wide projection shows it");
    if let Some(shown) = projector.project_splat(0) {
        panic!("the scalar projection shows it in {:?}", shown.rect);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn eight_splats_are_projected_as_one_is(setup in setup(), splats in prop::collection::vec(seen(), 1..=LANES)) {
        check(&setup, &splats)?;
    }
}

/// The floors of discs that are seen exactly edge-on go by the root of what rounding makes of their attenuation, which is 0.
#[test]
fn discs_are_projected_as_one_is_edge_on() {
    for (step, transform) in (0..200).flat_map(|step| [(step, 0), (step, 3)]) {
        let setup = Setup {
            projection: Projection::Orthographic,
            kind: 2,
            filter: OpacityFilter::Classic,
            least: 0.0,
            shared: false,
            transform,
            degree: 0,
            near: 0.0,
            settings: RenderSettings { shade: false, ..RenderSettings::default() },
        };
        let disc = Seen {
            place: [0.0; 2],
            log_depth: 0.0,
            log_pixels: 0.78 + 0.005 * f64::from(step),
            stretch: 1.0,
            flattening: f64::INFINITY,
            normal: [0.739, 0.950_4, 0.0],
            edge_on: true,
            strength: 0.001,
            color: [0.0; 3],
            shading: [0.0; 3],
        };
        check(&setup, &[disc]).unwrap();
    }
}
