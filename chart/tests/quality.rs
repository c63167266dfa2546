//! How far the program's own scenes are from the references, beside the committed figures: none may get worse by more than rounding on
//! another processor explains.
//!
//! `OBLATE_RECORD=1 cargo test -p oblate-chart --test quality` writes `quality.json` anew.

use oblate_chart::measure::{Plan, Watch, measure};
use oblate_chart::scenes::{BUILT_IN, Scale};
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

#[test]
fn pictures_keep_to_their_tolerance() {
    // Few pixels, on the silhouette of a mesh: 3, 1 and 6 of the 1024 in the window, 3, 3 and 11 of the 10,558 of the picture that show
    // anything. Trials count those of the picture.
    let exceptions = [
        ("mixed", "tolerance 0.5/255", 1.6),
        ("mixed", "tolerance 4/255", 1.01),
        ("mixed", "tolerance 8/255", 3.2),
    ];
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/quality.json");
    let text = std::fs::read_to_string(path).expect("the figures are committed");
    let committed: Quality = serde_json::from_str(&text).expect("the figures are JSON");
    for (scene, ways) in &committed {
        // What 99.9 % of the pixels are off by, over the tolerance.
        let mut count = 0;
        for (way, figures) in ways {
            let levels = match way.strip_prefix("tolerance ").and_then(|rest| rest.strip_suffix("/255")) {
                _ if way == "default" => 1.0,
                Some(levels) => levels.parse::<f64>().expect("a number of levels"),
                None => continue,
            };
            let share = figures.p999[0] * 255.0 / levels;
            println!("{scene}, {way}: {share:.2} of the tolerance");
            let exception = exceptions.iter().find(|(name, own, _)| name == scene && own == way);
            let most = exception.map_or(1.0, |(.., most)| *most);
            assert!(share <= most, "{scene}, {way}: {share}");
            count += 1;
        }
        assert_eq!(count, 6, "{scene}: the default and five other tolerances");
    }
}
