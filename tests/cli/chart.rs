//! `oblate chart`.

use crate::place::Workplace;
use serde_json::{Value, json};

/// Pixels of `warp` with --quick.
const SIZE: [u32; 2] = [240, 180];

/// A file of one peer that drew `warp` grey, with its picture.
fn peers(place: &Workplace) -> Value {
    let grey = image::RgbImage::from_pixel(SIZE[0], SIZE[1], image::Rgb([128; 3]));
    grey.save(place.path("grey.png")).unwrap();
    image::RgbImage::new(4, 3).save(place.path("small.png")).unwrap();
    let peer = json!({
        "scene": "warp", "name": "Grey 1.0", "median_ms": 2.5, "spread_ms": [2.0, 4.0], "picture": "grey.png",
    });
    json!({ "format": 1, "machine": "a quiet one", "peers": [peer] })
}

#[test]
fn peers_have_rows_of_their_own() {
    let place = Workplace::new();
    place.write("peers.json", peers(&place).to_string());
    place.run(&["chart", "warp", "--quick", "--peers", "peers.json", "-o", "out", "-q"]);
    let chart: Value = serde_json::from_slice(&std::fs::read(place.path("out/chart.json")).unwrap()).unwrap();
    let rows = chart["subjects"][0]["rows"].as_array().unwrap();
    let of_peers: Vec<&Value> = rows.iter().filter(|row| row["family"] == "peer").collect();
    assert_eq!(of_peers.len(), 1, "{rows:?}");
    let row = of_peers[0];
    assert_eq!(
        (&row["method"], &row["median_ms"], &row["spread_ms"]),
        (&json!("Grey 1.0"), &json!(2.5), &json!([2.0, 4.0]))
    );
    // Grey is far from any picture of the room, and an error is at most that of black to white.
    let worst = row["errors"][1]["max"].as_f64().unwrap();
    assert!((0.1..=1.0).contains(&worst), "{worst}");
    assert_eq!(row["standing"], json!(["beaten", "beaten"]));
}

#[test]
fn wrong_peers_are_refused_in_one_message_that_names_the_file() {
    let place = Workplace::new();
    let good = peers(&place);
    let with = |pointer: &str, value: Value| {
        let mut wrong = good.clone();
        *wrong.pointer_mut(pointer).unwrap() = value;
        wrong.to_string()
    };
    let cases = [
        (with("/format", json!(2)), "peers.json: its format is 2; 1 is read"),
        (with("/peers/0/spread_ms", json!([2.6, 4.0])), "peers.json: Grey 1.0: times are [2.6, 2.5, 4.0]"),
        (with("/peers/0/median_ms", json!(4.5)), "peers.json: Grey 1.0: times are [2.0, 4.5, 4.0]"),
        (with("/peers/0/spread_ms", json!([0.0, 4.0])), "must be above 0"),
        (with("/peers/0/picture", json!("none.png")), "none.png"),
        (with("/peers/0/picture", json!("small.png")), "small.png: it is 4×3; warp is drawn with 240×180"),
        (with("/peers/0/picture", json!("peers.json")), "peers.json: neither a PNG nor an EXR picture"),
        (with("/peers/0", json!({ "scene": "warp" })), "peers.json: missing field"),
        ("nonsense".into(), "peers.json"),
    ];
    for (text, wanted) in cases {
        place.write("peers.json", text);
        let said = place.refusal(&["chart", "warp", "--quick", "--peers", "peers.json", "-o", "out", "-q"]);
        assert!(said.contains(wanted), "{wanted}: {said}");
        assert_eq!(said.matches("error:").count(), 1, "{said}");
        assert!(!place.path("out/chart.json").exists());
    }
    let said = place.refusal(&["chart", "warp", "--quick", "--peers", "missing.json", "-o", "out", "-q"]);
    assert!(said.contains("missing.json"), "{said}");
}
