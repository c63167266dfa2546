//! How far the program's own scenes are from the references, beside the committed figures: none may get worse by more than rounding on
//! another processor explains.
//!
//! `OBLATE_RECORD=1 cargo test -p oblate-chart --test quality` writes `quality.json` anew.

use oblate_chart::measure::{Plan, Watch, measure};
use oblate_chart::scenes::{BUILT_IN, Scale, Subject};
use oblate_engine::color::linear_to_srgb;
use oblate_engine::{Blend, FootprintForm, Order, RenderSettings, Scene, render, settle};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

/// Figures of a way of drawing: PSNR in dB and the error that 99.9 % of the pixels keep to, to each reference.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Serialize)]
struct Figures {
    psnr_db: [f64; 2],
    p999: [f64; 2],
}

/// By scene and way.
type Quality = BTreeMap<String, BTreeMap<String, Figures>>;

/// A way may be off by this share more than it was, or by this much: levels of instructions differ by a few roundings, 10⁻⁵, and an edge
/// that falls on the other side of a pixel's centre moves a percentile.
const SHARE: f64 = 0.05;
const ROUNDING: f64 = 5e-5;

/// Equal pictures.
const MOST_DB: f64 = 150.0;

struct Nobody;

impl Watch for Nobody {
    fn now(&self) -> Duration {
        Duration::ZERO
    }
    fn at(&self, _work: &str, _share: f64) {}
}

fn found() -> Quality {
    let plan = Plan { frames: 1, ..Plan::new(Scale::Quick) };
    let scene = |built_in: &oblate_chart::scenes::BuiltIn| {
        let subject = (built_in.make)(Scale::Quick).expect("the program's own scenes can be made");
        let measured = measure(&subject, &plan, &Nobody).expect("the program's own scenes can be drawn");
        let figures = |row: &oblate_chart::measure::Row| {
            let of = |which: usize| {
                row.errors[which]
                    .map_or([MOST_DB, 0.0], |e| [e.psnr_db.unwrap_or(MOST_DB).min(MOST_DB), e.p999])
            };
            let [first, second] = [of(0), of(1)];
            Figures { psnr_db: [first[0], second[0]], p999: [first[1], second[1]] }
        };
        let rows = measured.rows.iter().map(|row| (row.method.clone(), figures(row))).collect();
        (built_in.name.to_string(), rows)
    };
    BUILT_IN.iter().map(scene).collect()
}

#[test]
fn no_figure_is_worse_than_the_committed_one() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/quality.json");
    let found = found();
    if std::env::var_os("OBLATE_RECORD").is_some() {
        let text = serde_json::to_string_pretty(&found).expect("figures are finite") + "\n";
        std::fs::write(&path, text).expect("the folder can be written to");
        return;
    }
    let text = std::fs::read_to_string(&path).expect("the figures are committed");
    let committed: Quality = serde_json::from_str(&text).expect("the figures are JSON");
    let mut worse = Vec::new();
    for (scene, ways) in &committed {
        for (way, before) in ways {
            let Some(now) = found.get(scene).and_then(|ways| ways.get(way)) else {
                worse.push(format!("{scene}, {way}: it is gone"));
                continue;
            };
            for which in 0..2 {
                let most = before.p999[which] * (1.0 + SHARE) + ROUNDING;
                let least_db = before.psnr_db[which].min(100.0) - 0.5;
                if now.p999[which] > most || now.psnr_db[which] < least_db {
                    worse.push(format!("{scene}, {way}: {now:?}, committed {before:?}"));
                }
            }
        }
    }
    let count: usize = found.values().map(BTreeMap::len).sum();
    println!("{count} ways of drawing {} scenes", found.len());
    assert!(worse.is_empty(), "{}\n{} figures are worse", worse.join("\n"), worse.len());
}

const TOLERANCES: [f64; 6] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0];

#[test]
fn pictures_keep_to_their_tolerance() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/quality.json");
    let text = std::fs::read_to_string(path).expect("the figures are committed");
    let committed: Quality = serde_json::from_str(&text).expect("the figures are JSON");
    for (scene, ways) in &committed {
        for levels in TOLERANCES {
            let way = if levels == 1.0 { "default".into() } else { format!("tolerance {levels}/255") };
            // What 99.9 % of the pixels are off by, over the tolerance.
            let share = ways[&way].p999[0] * 255.0 / levels;
            println!("{scene}, {way}: {share:.2} of the tolerance");
            assert!(share <= 1.0, "{scene}, {way}: {share}");
        }
    }
}

/// Beside the finest way, which R1's windows confirm, the whole picture can be looked at.
#[test]
fn whole_pictures_keep_to_their_tolerance() {
    keep_to_their_tolerance(Scale::Quick);
}

#[test]
#[ignore = "takes several minutes"]
fn whole_pictures_of_full_size_keep_to_their_tolerance() {
    keep_to_their_tolerance(Scale::Full);
}

/// All built-in scenes at all tolerances.
fn keep_to_their_tolerance(scale: Scale) {
    for built_in in &BUILT_IN {
        let Subject { scene, camera, settings, .. } =
            (built_in.make)(scale).expect("the program's own scenes can be made");
        let draw = |scene: &Scene, settings: &RenderSettings| {
            let frame = render(scene, &camera, settings, &()).expect("the program's own scenes can be drawn");
            // In the space in which the scene is blended.
            let encoded = |[r, g, b, a]: [f32; 4]| match settings.blend {
                Blend::Display if a > 0.0 => {
                    let [r, g, b] = [r, g, b].map(|c| a * linear_to_srgb(c / a));
                    [r, g, b, a]
                }
                _ => [r, g, b, a],
            };
            frame.color.into_iter().map(encoded).collect::<Vec<_>>()
        };
        let settled = |levels: f64| {
            let asked = RenderSettings { tolerance: levels / 255.0, ..settings };
            settle(&scene, &camera, &asked).expect("the program's own scenes can be drawn")
        };
        // Opacities are ordered by their centres by definition; what is before them in a slab asks for thinner ones.
        let order = match built_in.name {
            "trained" => Order::Centers,
            "staged" => Order::Slabs { thickness: 0.0625 },
            _ => Order::Slabs { thickness: 0.25 },
        };
        let (footprint, tolerance) = (FootprintForm::Exact, 1e-6);
        let finest = draw(&scene, &RenderSettings { order, footprint, cutoff: 30.0, tolerance, ..settings });
        let empty = draw(&Scene::default(), &settings)[0];
        for levels in TOLERANCES {
            let found = draw(&scene, &settled(levels));
            let shown = finest.iter().zip(&found).filter(|(a, b)| **a != empty || **b != empty);
            let largest =
                |(a, b): (&[f32; 4], &[f32; 4])| (0..4).map(|i| (a[i] - b[i]).abs()).fold(0.0, f32::max);
            let mut errors: Vec<f32> = shown.map(largest).collect();
            errors.sort_by(f32::total_cmp);
            let rank = (errors.len() as f64 * 0.999).ceil() as usize;
            let share = f64::from(errors[rank - 1]) * 255.0 / levels;
            let name = built_in.name;
            println!("{name}, {levels}/255: {share:.2} of the tolerance in {} pixels", errors.len());
            assert!(share <= 1.0, "{name}, {levels}: {share}");
        }
    }
}
