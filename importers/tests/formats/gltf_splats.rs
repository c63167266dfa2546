use crate::common::{Folder, splats};
use crate::gltf::{glb, le};
use glam::{DAffine3, DMat3, DQuat, DVec3, Mat3, Vec3};
use oblate_engine::{
    Blend, Camera, Cloud, Frame, OpacityFilter, Pose, RenderSettings, Scene, Shapes, Splats, Strength, render,
};
use oblate_importers::{Content, Note, Opened};

/// Two splats: centres, quaternions (i8), σ (u8), opacities (u16), harmonics of degree 0 and 1.
fn buffer() -> Vec<u8> {
    let mut bytes = le!(f32: 1., 2., 3., -1., 0.5, 4.); // view 0: 24 bytes
    bytes.extend(le!(i8: 0, 0, 0, 127, 90, 0, 0, -90)); // view 1: 8 bytes
    bytes.extend([1, 2, 3, 99, 4, 0, 2, 99]); // view 2: 8 bytes, 4 apart
    bytes.extend(le!(u16: 65535, 13107)); // view 3: 4 bytes
    bytes.extend(le!(f32: 1., -1., 0., 0.5, 0.25, -9.)); // view 4: 24 bytes
    bytes.extend(le!(f32: 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)); // view 5: 24 bytes
    bytes.extend(le!(f32: -0.7, 0.1, 0.2, 0.8, -0.3, 0.1)); // view 6: 24 bytes
    bytes.extend(le!(f32: 0.3, 0.2, -0.5, 0.4, 0.9, 0.7)); // view 7: 24 bytes
    bytes
}

fn json() -> String {
    r#"{"asset":{"version":"2.0"},"extensionsUsed":["KHR_gaussian_splatting"],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"KHR_gaussian_splatting:ROTATION":1,"KHR_gaussian_splatting:SCALE":2,
"KHR_gaussian_splatting:OPACITY":3,"KHR_gaussian_splatting:SH_DEGREE_0_COEF_0":4,"KHR_gaussian_splatting:SH_DEGREE_1_COEF_0":5,
"KHR_gaussian_splatting:SH_DEGREE_1_COEF_1":6,"KHR_gaussian_splatting:SH_DEGREE_1_COEF_2":7},
"mode":0,"extensions":{"KHR_gaussian_splatting":{"kernel":"ellipse","colorSpace":"srgb_rec709_display"}}}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":2,"type":"VEC3"},
{"bufferView":1,"componentType":5120,"count":2,"type":"VEC4","normalized":true},
{"bufferView":2,"componentType":5121,"count":2,"type":"VEC3"},
{"bufferView":3,"componentType":5123,"count":2,"type":"SCALAR","normalized":true},
{"bufferView":4,"componentType":5126,"count":2,"type":"VEC3"},{"bufferView":5,"componentType":5126,"count":2,"type":"VEC3"},
{"bufferView":6,"componentType":5126,"count":2,"type":"VEC3"},{"bufferView":7,"componentType":5126,"count":2,"type":"VEC3"}],
"bufferViews":[{"buffer":0,"byteLength":24},{"buffer":0,"byteOffset":24,"byteLength":8},
{"buffer":0,"byteOffset":32,"byteLength":8,"byteStride":4},{"buffer":0,"byteOffset":40,"byteLength":4},
{"buffer":0,"byteOffset":44,"byteLength":24},{"buffer":0,"byteOffset":68,"byteLength":24},
{"buffer":0,"byteOffset":92,"byteLength":24},{"buffer":0,"byteOffset":116,"byteLength":24}],
"buffers":[{"byteLength":140}]}"#
        .into()
}

pub(crate) fn example_glb() -> Vec<u8> {
    glb(&json(), &buffer())
}

fn changed(pairs: &[(&str, &str)]) -> Vec<u8> {
    let mut text = json();
    for (from, to) in pairs {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    glb(&text, &buffer())
}

const NODE: &str = r#"{"mesh":0}"#;
const DEGREE_1: &str = r#","KHR_gaussian_splatting:SH_DEGREE_1_COEF_0":5,
"KHR_gaussian_splatting:SH_DEGREE_1_COEF_1":6,"KHR_gaussian_splatting:SH_DEGREE_1_COEF_2":7"#;
const SRGB: &str = "srgb_rec709_display";

fn opened(pairs: &[(&str, &str)]) -> Opened {
    Folder::new().open("a.glb", changed(pairs)).unwrap()
}

/// The splats by their opacity: 1, then 0.2.
fn read(pairs: &[(&str, &str)]) -> Vec<Splats> {
    let all = splats(Ok(opened(pairs)));
    let Strength::Opacity { peaks, .. } = &all.strength else { panic!("opacities are expected") };
    let mut order: Vec<usize> = (0..peaks.len()).collect();
    order.sort_by(|a, b| peaks[*b].total_cmp(&peaks[*a]));
    order.into_iter().map(|index| one(&all, index)).collect()
}

fn one(all: &Splats, index: usize) -> Splats {
    let mut one = all.clone();
    one.centers = vec![all.centers[index]];
    one.shapes = Shapes::Each(vec![all.shapes.factor(index)]);
    if let Strength::Opacity { peaks, .. } = &mut one.strength {
        *peaks = vec![peaks[index]];
    }
    one.colors = vec![all.colors[index]];
    if let Some(harmonics) = &mut one.harmonics {
        let count = harmonics.per_splat();
        harmonics.coefficients = harmonics.coefficients[index * count..][..count].to_vec();
    }
    one
}

fn covariance(splats: &Splats) -> DMat3 {
    let factor = splats.shapes.factor(0).as_dmat3();
    factor * factor.transpose()
}

#[test]
fn numbers_arrive_where_the_extension_says() {
    let file = opened(&[]);
    assert_eq!(file.notes, []);
    assert!(matches!(file.content, Content::Splats { blend: Blend::Display, .. }));
    let [first, second] = <[Splats; 2]>::try_from(read(&[])).unwrap();
    assert_eq!((first.centers[0], second.centers[0]), (Vec3::new(1.0, 2.0, 3.0), Vec3::new(-1.0, 0.5, 4.0)));
    assert!(first.shapes.factor(0).abs_diff_eq(Mat3::from_diagonal(Vec3::new(1.0, 2.0, 3.0)), 1e-6));
    // x = −w: a quarter turn back about x takes y to −z and z to y; σ of 0 stays flat.
    let expected = Mat3::from_cols(Vec3::X * 4.0, Vec3::ZERO, Vec3::Y * 2.0);
    assert!(second.shapes.factor(0).abs_diff_eq(expected, 1e-6), "{}", second.shapes.factor(0));
    let filter = OpacityFilter::Classic;
    assert_eq!(
        second.strength,
        Strength::Opacity { peaks: vec![0.2], filter, least: Strength::LEAST_OF_TRAINED }
    );
    // 0.5 + 0.2820948 · (1, −1, 0), decoded.
    let decoded = |display: f32| ((display + 0.055) / 1.055).powf(2.4);
    for (found, display) in first.colors[0].iter().zip([0.782_094_8, 0.217_905_2, 0.5]) {
        assert!((found - decoded(display)).abs() < 1e-6, "{:?}", first.colors);
    }
    assert_eq!(first.harmonics.unwrap().coefficients, [[0.1, 0.2, 0.3], [-0.7, 0.1, 0.2], [0.3, 0.2, -0.5]]);
    assert_eq!(second.harmonics.unwrap().coefficients, [[0.4, 0.5, 0.6], [0.8, -0.3, 0.1], [0.4, 0.9, 0.7]]);
}

/// The same splats turned by the engine, which evaluates harmonics in the cloud's own space, make the same picture.
#[test]
fn a_turned_node_is_a_turned_cloud() {
    let draw = |splats: Splats, to_world: DAffine3| {
        let pose = Pose::look_at(DVec3::new(3.0, 5.0, 40.0), DVec3::ZERO, DVec3::Y).unwrap();
        let camera = Camera::perspective(pose, 0.6, [24, 24]).unwrap();
        let clouds = vec![Cloud::new(splats).unwrap().transformed(to_world)];
        let settings = RenderSettings { blend: Blend::Display, ..RenderSettings::default() };
        render(&Scene { clouds, lights: Vec::new() }, &camera, &settings, &()).unwrap()
    };
    let difference = |a: &Frame, b: &Frame| {
        let pairs = a.color.as_flattened().iter().zip(b.color.as_flattened());
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    // Accessors may be shared: degree 2 and 3 take their coefficients from those of degree 1.
    let names = (4..16_usize).map(|n| (n.isqrt(), n - n.isqrt().pow(2), 5 + n % 3));
    let more = names
        .map(|(l, m, accessor)| format!(",\"KHR_gaussian_splatting:SH_DEGREE_{l}_COEF_{m}\":{accessor}"));
    let degree_3 = DEGREE_1.to_owned() + &more.collect::<String>();
    let rotation = DQuat::from_xyzw(0.5, -0.1, 0.7, 0.5).normalize();
    let DQuat { x, y, z, w } = rotation;
    for mirror in [1.0, -1.0] {
        let node = format!(r#"{{"mesh":0,"rotation":[{x},{y},{z},{w}],"scale":[2,2,{}]}}"#, 2.0 * mirror);
        let to_world =
            DAffine3::from_quat(rotation) * DAffine3::from_scale(DVec3::new(2.0, 2.0, 2.0 * mirror));
        let plain = splats(Ok(opened(&[(DEGREE_1, &degree_3)])));
        assert_eq!(plain.harmonics.as_ref().unwrap().degree, 3);
        let wanted = draw(plain.clone(), to_world);
        let placed = splats(Ok(opened(&[(DEGREE_1, &degree_3), (NODE, &node)])));
        let found = draw(placed.clone(), DAffine3::IDENTITY);
        // Clouds keep coefficients to 16 bits: 15 of up to 0.9, each to 2⁻¹², times functions of at most 1.5, are right to
        // 0.005; decoding makes that at most twice as much where display values are below 0.9.
        assert!(difference(&found, &wanted) < 0.01, "{}", difference(&found, &wanted));
        let unturned = Splats { harmonics: plain.harmonics, ..placed };
        assert!(difference(&draw(unturned, DAffine3::IDENTITY), &wanted) > 0.05);
    }
}

#[test]
fn stretched_nodes_stretch_covariances() {
    let plain = read(&[]);
    // Columns: x to 2 y, y to −3 x, z to 4 z − y: turned, stretched and sheared; and mirrored.
    for mirror in [1.0, -1.0] {
        let node = format!(r#"{{"mesh":0,"matrix":[0,2,0,0,-3,0,0,0,0,-1,{},0,5,6,7,1]}}"#, 4.0 * mirror);
        let matrix = DMat3::from_cols(
            DVec3::new(0.0, 2.0, 0.0),
            DVec3::new(-3.0, 0.0, 0.0),
            DVec3::new(0.0, -1.0, 4.0 * mirror),
        );
        for (placed, plain) in read(&[(NODE, &node)]).iter().zip(&plain) {
            let center = matrix * plain.centers[0].as_dvec3() + DVec3::new(5.0, 6.0, 7.0);
            assert!((placed.centers[0].as_dvec3() - center).length() < 1e-5);
            let wanted = matrix * covariance(plain) * matrix.transpose();
            // Entries up to 16 · 9, from half-axes rounded to 2⁻²⁴ of themselves.
            assert!(covariance(placed).abs_diff_eq(wanted, 1e-4), "{} {wanted}", covariance(placed));
            // Half-axes: orthogonal, and right-handed.
            let factor = placed.shapes.factor(0).as_dmat3();
            let (a, b, c) = (factor.x_axis, factor.y_axis, factor.z_axis);
            assert!(a.dot(b).abs() + a.dot(c).abs() + b.dot(c).abs() < 1e-5, "{factor}");
            assert!(factor.determinant() >= 0.0);
        }
    }
}

/// Nodes that take space to a plane or a line, by themselves or by their parent.
#[test]
fn maps_without_an_inverse_make_flat_splats() {
    let plain = read(&[]);
    let rotation = DQuat::from_xyzw(0.1, 0.2, 0.3, 0.9).normalize();
    let DQuat { x, y, z, w } = rotation;
    let turn = format!(r#""rotation":[{x},{y},{z},{w}]"#);
    let turned = read(&[(NODE, &format!(r#"{{"mesh":0,{turn}}}"#))]);
    // What rounding leaves of 0 would be far below e⁻⁴⁰ with these.
    for (scale, zeros) in [(DVec3::new(1e-4, 2e-4, 0.0), 1), (DVec3::new(0.0, 2e-4, 0.0), 2)] {
        let stretch = format!(r#""scale":[{},{},{}]"#, scale.x, scale.y, scale.z);
        let (rotate, stretched) = (DMat3::from_quat(rotation), DMat3::from_diagonal(scale));
        let own = format!(r#"{{"mesh":0,{turn},{stretch}}}"#);
        let of_parent = format!(r#"{{"mesh":0,{turn}}},{{"children":[0],{stretch}}}"#);
        let between =
            format!(r#"{{"mesh":0,{turn}}},{{"children":[0],{stretch}}},{{"children":[1],{turn}}}"#);
        for (node, matrix, turns) in [
            (own, rotate * stretched, 1),
            (of_parent, stretched * rotate, 1),
            (between, rotate * stretched * rotate, 2),
        ] {
            assert_eq!(opened(&[(NODE, &node)]).notes, []);
            let found = read(&[(NODE, &node)]);
            assert_eq!(found.len(), 2);
            for ((found, plain), turned) in found.iter().zip(&plain).zip(&turned) {
                let factor = found.shapes.factor(0);
                let axes = [factor.x_axis, factor.y_axis, factor.z_axis];
                assert_eq!(axes.iter().filter(|axis| **axis == Vec3::ZERO).count(), zeros, "{factor}");
                let wanted = matrix * covariance(plain) * matrix.transpose();
                // Of single precision are the node, the half-axes before and after, and these twice.
                let largest =
                    wanted.to_cols_array().iter().fold(0.0, |most: f64, entry| most.max(entry.abs()));
                assert!(covariance(found).abs_diff_eq(wanted, 4e-6 * largest), "{factor} {wanted}");
                // A plane that is turned turns its splats' colours, a line leaves them.
                let as_plain = (zeros == 2).then_some(plain);
                if let Some(known) = as_plain.or((turns == 1).then_some(turned)) {
                    let (found, turned) =
                        (found.harmonics.as_ref().unwrap(), known.harmonics.as_ref().unwrap());
                    let pairs =
                        found.coefficients.as_flattened().iter().zip(turned.coefficients.as_flattened());
                    pairs.for_each(|(found, turned)| {
                        assert!((found - turned).abs() < 1e-6, "{found} {turned}")
                    });
                }
            }
        }
    }
}

#[test]
fn component_types_are_those_of_the_extension() {
    let folder = Folder::new();
    let refuse =
        |from: &str, to: &str, parts: &[&str]| drop(folder.refused("a.glb", changed(&[(from, to)]), parts));
    let rotation = r#""componentType":5120,"count":2,"type":"VEC4","normalized":true"#;
    let must = "it must have floats, or normalized signed bytes or shorts";
    refuse(
        rotation,
        &rotation.replace("5120", "5121"),
        &["accessor 1: ROTATION has normalized unsigned bytes", must],
    );
    let unnormalized = rotation.replace("true", "false");
    refuse(rotation, &unnormalized, &["accessor 1: ROTATION has unnormalized signed bytes", must]);
    let scale = r#""bufferView":2,"componentType":5121"#;
    let must = "it must have floats, or unsigned bytes or shorts";
    refuse(scale, &scale.replace("5121", "5120"), &["accessor 2: SCALE has unnormalized signed bytes", must]);
    let opacity = r#""componentType":5123,"count":2,"type":"SCALAR","normalized":true"#;
    let must = "it must have floats, or normalized unsigned bytes or shorts";
    refuse(
        opacity,
        &opacity.replace("5123", "5122"),
        &["accessor 3: OPACITY has normalized signed shorts", must],
    );
    let unnormalized = opacity.replace("true", "false");
    refuse(opacity, &unnormalized, &["accessor 3: OPACITY has unnormalized unsigned shorts", must]);
    for (accessor, name) in [(4, "SH_DEGREE_0_COEF_0"), (6, "SH_DEGREE_1_COEF_1")] {
        let floats = format!(r#""bufferView":{accessor},"componentType":5126"#);
        let said =
            format!("accessor {accessor}: {name} has unnormalized unsigned shorts; it must have floats");
        refuse(&floats, &floats.replace("5126", "5123"), &[&said]);
    }
    // Positions of glTF are floats; an extension has more.
    let position = r#""bufferView":0,"componentType":5126"#;
    let must = "it must have floats, or bytes or shorts where the file has KHR_mesh_quantization";
    let shorts = position.replace("5126", "5123");
    refuse(position, &shorts, &["accessor 0: POSITION has unnormalized unsigned shorts", must]);
    let names = r#""extensionsUsed":["KHR_gaussian_splatting""#;
    let more = format!(r#"{names},"KHR_mesh_quantization""#);
    let ints = changed(&[(position, &position.replace("5126", "5125")), (names, &more)]);
    folder.refused("a.glb", ints, &["accessor 0: POSITION has unnormalized unsigned ints", must]);
    // 1.0 as two shorts of which the first is 0 (16256 is the other), 2.0 as well (16384).
    let positions = splats(Ok(opened(&[(position, &shorts), (names, &more)]))).centers;
    let mut positions = positions.iter().map(|center| center.to_array()).collect::<Vec<_>>();
    positions.sort_by(|a, b| a[1].total_cmp(&b[1]));
    assert_eq!(positions, [[16384.0, 0.0, 16448.0], [0.0, 16256.0, 0.0]]);
    // All types that it has.
    let turns = r#""bufferView":7,"componentType":5122,"count":2,"type":"VEC4","normalized":true"#;
    let first = r#""bufferView":1,"#.to_owned() + rotation;
    assert_eq!(opened(&[(&first, turns)]).notes, []);
    let shares = opened(&[(scale, &format!(r#"{scale},"normalized":true"#))]);
    let found = splats(Ok(shares)).shapes;
    let longest =
        [0, 1].map(|index| found.factor(index).to_cols_array().iter().fold(0.0, |a: f32, b| a.max(b.abs())));
    assert!(longest.iter().any(|longest| (longest * 255.0 - 4.0).abs() < 1e-5), "{longest:?}");
    let opacities = opened(&[(opacity, &opacity.replace("5123", "5121"))]);
    let Strength::Opacity { peaks, .. } = splats(Ok(opacities)).strength else {
        panic!("opacities are expected")
    };
    assert_eq!(peaks, [1.0, 1.0]);
}

#[test]
fn nodes_and_degrees_come_together() {
    let both = r#"{"mesh":0},{"mesh":0,"translation":[10,0,0]}"#;
    let found = read(&[(NODE, both)]);
    assert_eq!(found.len(), 4);
    let mut xs: Vec<f32> = found.iter().map(|splat| splat.centers[0].x).collect();
    xs.sort_by(f32::total_cmp);
    assert_eq!(xs, [-1.0, 1.0, 9.0, 11.0]);
    // A second primitive without harmonics of degree 1 has those of zeros.
    let primitive = json();
    let start = primitive.find("{\"attributes\"").unwrap();
    let end = primitive.find("]}],\n\"accessors\"").unwrap();
    let primitive = primitive[start..end].to_owned();
    let second = format!("{primitive},{}", primitive.replace(DEGREE_1, ""));
    let found = read(&[(&primitive, &second)]);
    let zeros =
        |splat: &Splats| splat.harmonics.as_ref().unwrap().coefficients.iter().all(|c| *c == [0.0; 3]);
    assert_eq!(found.iter().filter(|splat| zeros(splat)).count(), 2);
    assert!(found.iter().all(|splat| splat.harmonics.as_ref().unwrap().degree == 1));
    let other = second.replacen(SRGB, "lin_rec709_display", 2).replacen("lin_rec709_display", SRGB, 1);
    Folder::new().refused("a.glb", changed(&[(&primitive, &other)]), &["both colour spaces"]);
}

#[test]
fn linear_colours() {
    let linear = opened(&[(SRGB, "lin_rec709_display"), (DEGREE_1, "")]);
    let Content::Splats { splats, blend, .. } = linear.content else { panic!("splats are expected") };
    assert_eq!(blend, Blend::Linear);
    let bright = splats.colors.iter().find(|color| color[0] > 0.7).unwrap();
    for (found, wanted) in bright.iter().zip([0.782_094_8, 0.217_905_2, 0.5]) {
        assert!((found - wanted).abs() < 1e-6, "{bright:?}");
    }
    // 0.5 − 9 · 0.28 is cut off.
    assert!(splats.colors.iter().any(|color| color[2] == 0.0));
    let with_harmonics = changed(&[(SRGB, "lin_rec709_display")]);
    Folder::new().refused(
        "a.glb",
        with_harmonics,
        &["mesh 0, primitive 0", "lin_rec709_display", "SH_DEGREE_1"],
    );
}

#[test]
fn what_is_drawn_otherwise_is_noted() {
    let notes = |pairs: &[(&str, &str)]| opened(pairs).notes;
    let said = [("\"ellipse\"", "\"cube\",\"projection\":\"fisheye\",\"sortingMethod\":\"zDepth\"")];
    let expected = [("kernel", "cube"), ("projection", "fisheye"), ("sortingMethod", "zDepth")];
    let found = notes(&said);
    assert_eq!(found.len(), 3);
    for (note, (key, value)) in found.iter().zip(expected) {
        assert!(matches!(note, Note::Assumed(text) if text.contains(key) && text.contains(value)), "{note}");
    }
    // Also when two nodes use it.
    assert_eq!(notes(&[said[0], (NODE, r#"{"mesh":0},{"mesh":0}"#)]).len(), 3);
    let triangles = r#""meshes":[{"primitives":[{"attributes":{"POSITION":0}},"#;
    let found = notes(&[(r#""meshes":[{"primitives":["#, triangles)]);
    assert!(
        matches!(&found[..], [Note::LeftOut(text)] if text.contains("1 primitives that are no splats")),
        "{found:?}"
    );
    let camera = r#"{"mesh":0}],"cameras":[{"type":"perspective","perspective":{"yfov":1,"znear":1}}"#;
    assert_eq!(notes(&[(NODE, camera)]), [Note::LeftOut("1 camera".into())]);
    // Colours for programs that draw points stand in where harmonics are missing.
    let fallback = opened(&[(DEGREE_1, ""), ("KHR_gaussian_splatting:SH_DEGREE_0_COEF_0", "COLOR_0")]);
    assert!(
        matches!(&fallback.notes[..], [Note::Assumed(text)] if text.contains("COLOR_0")),
        "{:?}",
        fallback.notes
    );
    let colors = splats(Ok(fallback)).colors;
    assert!(
        colors.iter().any(|[r, g, b]| (r - 0.5).abs() + (g - 0.25).abs() < 1e-6 && *b == 0.0),
        "{colors:?}"
    );
}

#[test]
fn what_is_wrong_is_said() {
    let folder = Folder::new();
    let refuse =
        |from: &str, to: &str, parts: &[&str]| drop(folder.refused("a.glb", changed(&[(from, to)]), parts));
    let here = "mesh 0, primitive 0";
    refuse("\"mode\":0,", "", &[here, "mode must be 0"]);
    refuse("\"colorSpace\"", "\"x\"", &[here, "needs a colorSpace"]);
    refuse(SRGB, "acescg", &[here, "\"acescg\" is not supported"]);
    refuse("\"POSITION\":0,", "", &[here, "no POSITION"]);
    for name in ["ROTATION", "SCALE", "OPACITY", "SH_DEGREE_0_COEF_0"] {
        refuse(&format!("KHR_gaussian_splatting:{name}"), "_X", &[here, &format!("no {name}")]);
    }
    refuse("SH_DEGREE_1_COEF_1", "SH_DEGREE_1_COEF_7", &[here, "no SH_DEGREE_1_COEF_1"]);
    refuse(
        "SH_DEGREE_1_COEF_0",
        "SH_DEGREE_2_COEF_0",
        &[here, "SH_DEGREE_1_COEF_1, but no SH_DEGREE_1_COEF_0"],
    );
    refuse("5123,\"count\":2", "5123,\"count\":1", &["accessor 3", "OPACITY has 1", "2 positions"]);
    refuse(
        "5121,\"count\":2,\"type\":\"VEC3\"",
        "5121,\"count\":2,\"type\":\"VEC2\"",
        &["accessor 2", "Vec2"],
    );
    let spz =
        r#""kernel":"ellipse","extensions":{"KHR_gaussian_splatting_compression_spz_2":{"bufferView":0}}"#;
    let packed = changed(&[("\"kernel\":\"ellipse\"", spz), ("KHR_gaussian_splatting:ROTATION", "_X")]);
    folder.refused("a.glb", packed, &[here, "KHR_gaussian_splatting_compression_spz_2", "not supported"]);
    let required = "\"extensionsRequired\":[\"KHR_gaussian_splatting_compression_spz_2\"],\"extensionsUsed\"";
    refuse("\"extensionsUsed\"", required, &["KHR_gaussian_splatting_compression_spz_2", "not supported"]);
    // One row is no splat, or none is.
    let mut bytes = buffer();
    bytes[24..28].fill(0);
    let opened = folder.open("a.glb", glb(&json(), &bytes)).unwrap();
    assert!(
        opened.notes[0]
            .to_string()
            .contains("1 of 2 splats: 1 with a quaternion of zeros (the first is splat 0)")
    );
    bytes[28..32].fill(0);
    folder.refused("a.glb", glb(&json(), &bytes), &["2 of 2 splats"]);
    refuse("\"count\":2", "\"count\":0", &["0 rows"]);
}
