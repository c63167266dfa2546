//! One thing in many places, through the binary.

use crate::place::{Workplace, levels};
use serde_json::Value;

/// A file of four trained splats of different greys.
const SPLATS: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nproperty float opacity\n\
    property float scale_0\nproperty float scale_1\nproperty float scale_2\n\
    property float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float rot_3\nend_header\n\
    0 0 0 1 0 0 2 -1 -1 -1 1 0 0 0\n1 0 0 0 1 0 2 -1 -2 -1 1 0 0 0\n\
    0 1 0 0 0 1 2 -2 -1 -1 1 0 0 0\n0 0 1 1 1 1 2 -1 -1 -2 1 0 0 0\n";

fn stats(out: &str) -> Value {
    serde_json::from_str(out).unwrap()
}

#[test]
fn instances_are_what_as_many_tables_are() {
    let place = Workplace::new();
    place.ball();
    // Presets are fitted to the size that a volume has in the world.
    place.write("pale.tf", "transfer 1\nstrength extinction\ncolor srgb\n0 0 0 0 0\n200 1 1 1 0.2\n");
    place.write("a.ply", SPLATS);
    let point = |i: usize| format!("{} {} {}\n", i % 12, i / 12, (i * i) % 5);
    place.write("a.xyz", (0..144).map(point).collect::<String>());
    let places = [
        "scale = 2\nrotate = [0, 30, 0]\ntranslate = [1, 0, 0]\n",
        "scale = [1, 2, 0.5]\ntranslate = [20, 9, -4]\n",
        "rotate = [100, 0, -20]\ntranslate = [-14, 2, 30]\n",
    ];
    for table in [
        "[[splats]]\npath = 'a.ply'\n",
        "[[points]]\npath = 'a.xyz'\n",
        "[[volume]]\npath = 'ball_16x16x16_uint8.raw'\niso = [150]\ntransfer = 'pale.tf'\n",
    ] {
        // Slabs go by the sizes of kernels, which a stretched instance is known by less well than a stretched volume.
        let of_volume = table.starts_with("[[volume]]");
        let places = places.map(|p| if of_volume { p.replace("[1, 2, 0.5]", "1.5") } else { p.to_owned() });
        let inline = places.each_ref().map(|p| format!("{{ {} }}", p.trim().replace('\n', ", ")));
        // All in the same view: what frames them is told elsewhere.
        let head =
            "version = 1\n[camera]\neye = [20, 30, 150]\ntarget = [4, 8, 10]\n[render]\nsize = [96, 64]\n";
        place.write("many.toml", format!("{head}{table}instances = [{}]\n", inline.join(",\n")));
        let tables = places.map(|place| format!("{table}{place}"));
        place.write("tables.toml", format!("{head}{}", tables.join("")));
        let draw = |scene: &str, picture: &str| {
            let [out, _] = place.run(&["render", scene, "-o", picture, "--stats", "-"]);
            stats(&out)["splats"].as_u64().unwrap()
        };
        assert_eq!(draw("many.toml", "many.png"), draw("tables.toml", "tables.png"), "{table}");
        // Transforms round another way; ramps of opacity make of that less than a level.
        let [many, tables] = ["many.png", "tables.png"].map(|name| levels(&place.path(name)));
        let apart = many.pixels().zip(tables.pixels()).flat_map(|(a, b)| (0..4).map(|c| a[c].abs_diff(b[c])));
        assert!(apart.max().unwrap() <= 1, "{table}");
        let shown = many.pixels().filter(|p| p.0 != [0x20, 0x20, 0x20, 0xff]).count();
        assert!(shown > 50, "{table}: {shown}");
    }
}

#[test]
fn a_large_mesh_leaves_a_small_one_what_it_wants() {
    let place = Workplace::new();
    place.cube();
    // Eight million times as large as the cube, most of it beside the picture.
    place.write(
        "floor.obj",
        "v -7000 -1 -7000\nv -7000 -1 7000\nv 7000 -1 7000\nv 7000 -1 -7000\nf 1 2 3\nf 1 3 4\n",
    );
    let splats = |files: &[&str]| {
        let view = ["render", "--eye", "0,20,4", "--target", "0,0,0", "--size", "64x64", "--stats", "-"];
        let [out, _] = place.run(&[&view, files].concat());
        stats(&out)["splats"].as_u64().unwrap()
    };
    let [cube, floor] = [splats(&["cube.obj"]), splats(&["floor.obj"])];
    assert!(cube > 100 && floor > 64 * 64);
    assert_eq!(splats(&["floor.obj", "cube.obj"]), cube + floor);
}

#[test]
fn the_nearest_instance_says_how_many_surfels() {
    let place = Workplace::new();
    place.cube();
    let splats = |instances: &str| {
        place.write(
            "scene.toml",
            format!(
                "version = 1\n[camera]\neye = [0, 0, 20]\ntarget = [0, 0, 0]\n[render]\nsize = [64, 64]\n\
                 [[mesh]]\npath = 'cube.obj'\ninstances = [{instances}]\n"
            ),
        );
        let [out, _] = place.run(&["render", "scene.toml", "--stats", "-"]);
        stats(&out)["splats"].as_u64().unwrap()
    };
    let (near, far) = ("{ translate = [0, 0, 12] }", "{ translate = [2, 0, -60] }");
    // All around, as others may show other sides.
    let whole = |instance: &str| splats(&format!("{instance}, {instance}")) / 2;
    let alone = whole(near);
    assert!(alone > 4 * whole(far));
    assert_eq!(splats(&format!("{far}, {near}")), 2 * alone);
    assert_eq!(splats(&format!("{near}, {far}, {far}")), 3 * alone);
    // One that the picture doesn't show, however near, has no say.
    assert_eq!(splats(&format!("{{ translate = [0, 4, 20] }}, {far}")), 2 * whole(far));
    // A large one far away is as near as a small one.
    let large = "{ translate = [0, 0, -60], scale = 10 }";
    assert_eq!(splats(&format!("{far}, {large}")), 2 * whole(large));
    // In one place a cube seen along an axis has one face of six, within a row of surfels along its edges.
    let seen = splats(near) as f64 / (alone as f64 / 6.0);
    assert!((seen - 1.0).abs() < 0.1, "{seen}");
}

#[test]
fn instances_are_kept_once_and_framed_together() {
    let place = Workplace::new();
    place.cube();
    let instances = (0..1000).map(|i| format!("{{ translate = [{}, {}, 0] }},\n", i % 40 * 4, i / 40 * 4));
    place.write(
        "scene.toml",
        format!(
            "version = 1\n[[mesh]]\npath = 'cube.obj'\nsurfels = 20000\ninstances = [\n{}]\n",
            instances.collect::<String>()
        ),
    );
    // One of them fills the picture; the others are beside it.
    let view = ["--eye", "80,48,7", "--target", "80,48,0", "--fov", "20", "--size", "32x32", "--stats", "-"];
    let [out, _] = place.run(&[&["render", "scene.toml"], &view[..]].concat());
    let one = stats(&out);
    let splats = one["splats"].as_f64().unwrap();
    assert!((splats / 20e6 - 1.0).abs() < 0.1, "{one}");
    // Once the cloud, with a third more for its levels.
    assert!(one["splat_bytes"].as_f64().unwrap() < 20e3 * 200.0, "{one}");
    if cfg!(target_os = "linux") {
        // 20 million of 60 bytes or more would be 1.2 GB.
        assert!(one["peak_mib"].as_f64().unwrap() < 400.0, "{one}");
    }
    // All of them fill the frame.
    place.run(&["render", "scene.toml", "--surfels", "60", "--size", "120x80", "--up", "0,0,1"]);
    let picture = levels(&place.path("oblate.png"));
    let shown = |x: u32, y: u32| picture.get_pixel(x, y).0 != [0x20, 0x20, 0x20, 0xff];
    let columns: Vec<u32> = (0..120).filter(|x| (0..80).any(|y| shown(*x, y))).collect();
    let rows: Vec<u32> = (0..80).filter(|y| (0..120).any(|x| shown(x, *y))).collect();
    let [width, height] = [&columns, &rows].map(|list| list[list.len() - 1] - list[0]);
    assert!(width > 100 || height > 66, "{width}×{height}");
    assert!(columns[0] > 0 && columns[columns.len() - 1] < 119 && rows[0] > 0 && rows[rows.len() - 1] < 79);

    let many = (0..65_536).map(|_| "{},").collect::<String>();
    place.write("many.toml", format!("version = 1\n[[mesh]]\npath = 'cube.obj'\ninstances = [{many}]\n"));
    let message = place.refusal(&["render", "many.toml", "--size", "8x8"]);
    assert!(message.contains("65536 instances; at most 65535"), "{message}");
}

/// Whatever is drawn, in one place or in several.
#[test]
fn planes_that_miss_change_nothing() {
    let place = Workplace::new();
    place.ball();
    place.cube();
    place.write("a.ply", SPLATS);
    let point = |i: usize| format!("{} {} {}\n", i % 12, i / 12, (i * i) % 5);
    place.write("a.xyz", (0..144).map(point).collect::<String>());
    for table in [
        "[[mesh]]\npath = 'cube.obj'\n",
        "[[splats]]\npath = 'a.ply'\n",
        "[[points]]\npath = 'a.xyz'\n",
        "[[volume]]\npath = 'ball_16x16x16_uint8.raw'\niso = [150]\ntransfer = 'amber'\n",
    ] {
        let draw = |scene: &str, clip: &[&str]| {
            place.write("a.toml", format!("version = 1\n{table}{scene}"));
            let args = ["render", "a.toml", "-o", "a.png", "--size", "64x48", "--stats", "-", "-q"];
            let [out, _] = place.run(&[&args[..], clip].concat());
            let splats = stats(&out)["splats"].as_u64().unwrap();
            (splats, std::fs::read(place.path("a.png")).unwrap())
        };
        for places in ["", "instances = [{}, { translate = [20, 0, 3], rotate = [20, 50, 0] }]\n"] {
            let whole = draw(places, &[]);
            let around = draw(places, &["--clip-box=-99,-99,-99,99,99,99", "--clip-plane=-1,0,0.5,-120"]);
            assert!(whole == around, "{table}{places}: {} splats and {}", whole.0, around.0);
            assert!(whole != draw(places, &["--clip-plane=1,0,0,0.25"]), "{table}{places}");
        }
    }
}
