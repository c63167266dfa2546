//! `oblate pick`.

use crate::place::Workplace;
use exr::prelude::FlatSamples;
use serde_json::Value;

fn lines(out: &str) -> Vec<Value> {
    out.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn what_is_picked_is_what_pictures_have_ids_of() {
    let place = Workplace::new();
    place.cube();
    place.write(
        "scene.toml",
        // Where one splat stands for several, pictures have its id.
        "version = 1\n[camera]\neye = [3, 4, 20]\ntarget = [0, 0, 0]\n\
         [render]\nsize = [40, 30]\nlevel-of-detail = false\n\
         [[mesh]]\npath = 'cube.obj'\nsurfels = 900\ninstances = [{}, { translate = [3, 0, 0], scale = 0.5 }]\n",
    );
    place.run(&["render", "scene.toml", "-o", "e.exr", "--footprint", "exact"]);
    let file = exr::prelude::read_first_flat_layer_from_file(place.path("e.exr")).unwrap();
    let channel = |name: &str| file.layer_data.channel_data.list.iter().find(|c| c.name == *name).unwrap();
    let z: Vec<f32> = channel("Z").sample_data.values_as_f32().collect();
    let FlatSamples::U32(ids) = &channel("id").sample_data else { panic!("ids are numbers") };

    let at = (0..1200).step_by(7).map(|i| format!("--at={}.5,{}.5", i % 40, i / 40));
    let at: Vec<String> = at.collect();
    let at: Vec<&str> = at.iter().map(String::as_str).collect();
    let [out, err] = place.run(&[&["pick", "scene.toml"], &at[..]].concat());
    assert!(err.contains("camera: --eye 3,4,20"), "{err}");
    let picked = lines(&out);
    assert_eq!(picked.len(), at.len());
    let mut found = [0; 2];
    for (line, pixel) in picked.iter().zip((0..1200).step_by(7)) {
        assert_eq!(line["at"][0].as_f64().unwrap(), (pixel % 40) as f64 + 0.5);
        let Some(own) = line["picked"].as_object() else {
            assert!(z[pixel] == f32::INFINITY, "{line}");
            continue;
        };
        // Along the silhouette the first surface may be less than half of what is seen.
        let depth = own["depth"].as_f64().unwrap();
        if (depth - f64::from(z[pixel])).abs() < 1e-3 {
            assert_eq!(own["id"].as_u64().unwrap(), u64::from(ids[pixel]), "{line}");
            found[own["instance"].as_u64().unwrap() as usize] += 1;
        }
        assert_eq!(own["source"], "cube.obj");
        assert_eq!(own["cloud"], own["instance"]);
    }
    println!("{found:?} of the two cubes");
    assert!(found[0] > 10 && found[1] > 3, "{found:?}");
}

#[test]
fn a_point_by_itself_is_the_middle_and_may_show_nothing() {
    let place = Workplace::new();
    place.ball();
    let ball = ["pick", "ball_16x16x16_uint8.raw", "--iso", "100", "--size", "64x64", "--quiet"];
    let [out, err] = place.run(&[&ball[..], &["--eye", "7.5,-40,7.5", "--target", "7.5,7.5,7.5"]].concat());
    assert_eq!(err, "");
    let [line] = &lines(&out)[..] else { panic!("{out}") };
    // A surface of radius 4 about the middle, within a tenth of a voxel or so (see `render`).
    let position: Vec<f64> =
        line["picked"]["position"].as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect();
    assert!((position[0] - 7.5).abs() < 1e-6 && (position[2] - 7.5).abs() < 1e-6, "{line}");
    assert!((position[1] - 3.5).abs() < 0.15, "{line}");
    assert!((line["picked"]["depth"].as_f64().unwrap() - (position[1] + 40.0)).abs() < 1e-6);
    let [out, _] = place.run(&[&ball[..], &["--at", "1,1", "--at", "-100,3"]].concat());
    assert!(lines(&out).iter().all(|line| line["picked"].is_null()) && out.lines().count() == 2, "{out}");
    assert!(place.refusal(&[&ball[..], &["--at", "1"]].concat()).contains("320,240.5"));
    assert!(place.refusal(&[&ball[..], &["--low-pass", "-1"]].concat()).contains("--low-pass is -1"));
}
