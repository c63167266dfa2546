use crate::common::{Folder, TEXELS, base64, png, refused};
use glam::{DVec3, Vec2, Vec3, Vec4};
use oblate_importers::{Note, OpenOptions};
use oblate_surfels::{Filter, Texture, Wrap};

/// Bytes of numbers.
macro_rules! le {
    ($type:ty: $($value:expr),* $(,)?) => { [$(<$type>::to_le_bytes($value)),*].concat() };
}
pub(crate) use le;

/// Four corners of a unit square; the views of the example's buffer.
fn buffer() -> Vec<u8> {
    let mut bytes = le!(f32: 0., 0., 0., 1., 0., 0., 1., 1., 0., 0., 1., 0.); // view 0: 48 bytes
    bytes.extend(le!(u16: 0, 1, 2, 0, 2, 3)); // view 1: 12 bytes
    bytes.extend(le!(f32: 0., 0., 1., 0., 0., 1., 0., 0., 1., 0., 0., 1.)); // view 2: 48 bytes
    bytes.extend(le!(u16: 0, 0, 65535, 0, 65535, 65535, 0, 65535)); // view 3: 16 bytes
    bytes.extend([255, 0, 51, 0, 0, 255, 0, 0, 0, 0, 255, 0, 102, 102, 102, 255]); // view 4: 16 bytes
    bytes.extend(png()); // view 5
    bytes
}

/// A square with everything on it under two nodes. `place` says where the buffer is, `image` the image.
fn json(place: &str, image: &str) -> String {
    let (buffer, image_bytes) = (buffer().len(), png().len());
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}],
"nodes": [{{"children": [1], "translation": [1, 2, 3]}},
 {{"mesh": 0, "rotation": [0, 0, 0.70710678, 0.70710678], "scale": [2, 3, 4]}}, {{"mesh": 0}}],
"meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0, "NORMAL": 2, "TEXCOORD_1": 3, "COLOR_0": 4}},
 "indices": 1, "material": 0, "mode": 4}}, {{"attributes": {{"POSITION": 0}}, "mode": 0}}]}}],
"materials": [{{"alphaMode": "BLEND", "pbrMetallicRoughness": {{"baseColorFactor": [0.5, 1, 1, 0.25],
 "baseColorTexture": {{"index": 0, "texCoord": 1}}}}}}],
"textures": [{{"source": 0, "sampler": 0}}], "samplers": [{{"wrapS": 33071, "wrapT": 33648}}],
"images": [{image}],
"accessors": [
 {{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}},
 {{"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}},
 {{"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC3"}},
 {{"bufferView": 3, "componentType": 5123, "count": 4, "type": "VEC2", "normalized": true}},
 {{"bufferView": 4, "componentType": 5121, "count": 4, "type": "VEC4", "normalized": true}}],
"bufferViews": [{{"buffer": 0, "byteLength": 48}}, {{"buffer": 0, "byteOffset": 48, "byteLength": 12}},
 {{"buffer": 0, "byteOffset": 60, "byteLength": 48, "byteStride": 12}},
 {{"buffer": 0, "byteOffset": 108, "byteLength": 16}}, {{"buffer": 0, "byteOffset": 124, "byteLength": 16}},
 {{"buffer": 0, "byteOffset": 140, "byteLength": {image_bytes}}}],
"buffers": [{{{place} "byteLength": {buffer}}}]}}"#
    )
}

pub(crate) fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut binary = binary.to_vec();
    binary.resize(binary.len().next_multiple_of(4), 0);
    let total = 12 + 8 + json.len() + 8 + binary.len();
    let header = [*b"glTF", 2_u32.to_le_bytes(), (total as u32).to_le_bytes()].concat();
    let chunk =
        |kind: &[u8; 4], bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes(), &kind[..], bytes].concat();
    [header, chunk(b"JSON", &json), chunk(b"BIN\0", &binary)].concat()
}

const EMBEDDED: &str = r#"{"bufferView": 5, "mimeType": "image/png"}"#;

pub(crate) fn example_glb() -> Vec<u8> {
    glb(&json("", EMBEDDED), &buffer())
}

pub(crate) fn example_gltf() -> Vec<u8> {
    let place = format!("\"uri\": \"data:application/octet-stream;base64,{}\",", base64(&buffer()));
    json(&place, r#"{"uri": "a.png"}"#).into_bytes()
}

#[test]
fn the_same_from_every_place() {
    let folder = Folder::new();
    let embedded = folder.mesh("a.glb", example_glb());
    folder.write("a.png", png());
    assert_eq!(folder.mesh("a.gltf", example_gltf()), embedded);
    // Content tells, not the name.
    assert_eq!(folder.mesh("b", example_gltf()), embedded);
    folder.write("a buffer.bin", buffer());
    let outside = json(
        r#""uri": "a%20buffer.bin","#,
        &format!(r#"{{"uri": "data:image/png;base64,{}"}}"#, base64(&png())),
    );
    assert_eq!(folder.mesh("a.gltf", outside), embedded);
}

#[test]
fn everything_on_a_square() {
    let primitive = Folder::new().primitive("a.glb", example_glb());
    assert_eq!(primitive.positions, [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y]);
    assert_eq!(primitive.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(primitive.normals.unwrap(), [Vec3::Z; 4]);
    // (0, 0) is top left in the file as in a texture.
    assert_eq!(primitive.tex_coords.unwrap(), [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y]);
    // Vertex colours are linear.
    assert_eq!(primitive.colors.unwrap()[0], Vec4::new(1.0, 0.0, 0.2, 0.0));
    assert_eq!(primitive.material.factor, Vec4::new(0.5, 1.0, 1.0, 0.25));
    let expected = Texture {
        width: 2,
        height: 2,
        texels: TEXELS.to_vec(),
        wrap: [Wrap::Clamp, Wrap::Mirror],
        filter: Filter::Linear,
    };
    assert_eq!(*primitive.material.texture.unwrap(), expected);
    // Scaled, a quarter turn around z, moved: x becomes 2 y, y becomes -3 x.
    let to_mesh = primitive.primitive_to_mesh;
    let close = |a: DVec3, b: DVec3| assert!((a - b).length() < 1e-6, "{a} {b}");
    close(to_mesh.transform_point3(DVec3::ZERO), DVec3::new(1.0, 2.0, 3.0));
    close(to_mesh.transform_vector3(DVec3::X), DVec3::new(0.0, 2.0, 0.0));
    close(to_mesh.transform_vector3(DVec3::Y), DVec3::new(-3.0, 0.0, 0.0));
    close(to_mesh.transform_vector3(DVec3::Z), DVec3::new(0.0, 0.0, 4.0));
}

fn changed(pairs: &[(&str, &str)]) -> Vec<u8> {
    let mut text = json("", EMBEDDED);
    for (from, to) in pairs {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    glb(&text, &buffer())
}

#[test]
fn scenes_and_matrices() {
    let folder = Folder::new();
    // Without a default scene all nodes count, the one without parent by itself.
    let all = folder.mesh("a.glb", changed(&[("\"scene\": 0,", "")]));
    assert_eq!(all.primitives.len(), 2);
    assert_eq!(all.primitives[1].primitive_to_mesh, glam::DAffine3::IDENTITY);
    let matrix = r#""matrix": [0, 2, 0, 0, -3, 0, 0, 0, 0, 0, 4, 0, 5, 6, 7, 1]"#;
    let node = r#""rotation": [0, 0, 0.70710678, 0.70710678], "scale": [2, 3, 4]"#;
    let to_mesh = folder.primitive("a.glb", changed(&[(node, matrix)])).primitive_to_mesh;
    assert_eq!(
        to_mesh.transform_point3(DVec3::ONE),
        DVec3::new(1.0 - 3.0 + 5.0, 2.0 + 2.0 + 6.0, 3.0 + 4.0 + 7.0)
    );
    folder.refused("a.glb", changed(&[(node, &matrix.replace("7, 1]", "7, 2]"))]), &["node 1", "affine"]);
    folder.refused(
        "a.glb",
        changed(&[("[0, 0, 0.70710678, 0.70710678]", "[0, 0, 0, 0]")]),
        &["node 1", "finite"],
    );
    folder.refused(
        "a.glb",
        changed(&[("[2, 3, 4]", "[1e38, 3, 4], \"children\": [0]")]),
        &["node 0", "ancestor"],
    );
    folder.refused("a.glb", changed(&[("\"nodes\": [0]", "\"nodes\": [0, 1]")]), &["node 1", "two parents"]);
    folder.refused("a.glb", changed(&[("\"nodes\": [0]", "\"nodes\": [9]")]), &["node 9", "not there"]);
    folder.refused("a.glb", changed(&[("\"scene\": 0", "\"scene\": 1")]), &["scene 1"]);
    folder.refused("a.glb", changed(&[("\"nodes\": [0]", "\"nodes\": []")]), &["no triangles"]);
}

#[test]
fn modes() {
    let folder = Folder::new();
    let triangles = |pairs: &[(&str, &str)]| folder.primitive("a.glb", changed(pairs)).triangles;
    let four = ("\"count\": 6", "\"count\": 4");
    assert_eq!(triangles(&[("\"mode\": 4", "\"mode\": 5")]), [[0, 1, 2], [1, 0, 2], [2, 0, 2], [0, 3, 2]]);
    // Indices 0 1 2 0.
    assert_eq!(triangles(&[("\"mode\": 4", "\"mode\": 6"), four]), [[0, 1, 2], [0, 2, 0]]);
    // Without indices: positions in turn.
    assert_eq!(
        triangles(&[("\"indices\": 1, ", ""), ("\"mode\": 4", "\"mode\": 6")]),
        [[0, 1, 2], [0, 2, 3]]
    );
    assert_eq!(
        triangles(&[("\"indices\": 1, ", ""), ("\"mode\": 4", "\"mode\": 5")]),
        [[0, 1, 2], [1, 3, 2]]
    );
    folder.refused("a.glb", changed(&[four]), &["mesh 0, primitive 0", "1 corners too many"]);
    folder.refused("a.glb", changed(&[("\"mode\": 4", "\"mode\": 1")]), &["no triangles"]);
    folder.refused("a.glb", changed(&[("\"mode\": 4", "\"mode\": 44")]), &["mode must be 0 to 6"]);
}

#[test]
fn quantized_and_sparse() {
    let folder = Folder::new();
    let mut bytes = buffer();
    let at = bytes.len().next_multiple_of(4);
    bytes.resize(at, 0);
    bytes.extend(le!(i16: 0, 0, 0, 99, 7, 0, 0, 99, 7, 7, 0, 99, -32768, 32767, 0, 99));
    bytes.extend([1, 3]);
    let view = format!(
        "\"bufferViews\": [{{\"buffer\": 0, \"byteOffset\": {at}, \"byteLength\": 34, \"byteStride\": 8}},"
    );
    let required = ("\"asset\"", "\"extensionsRequired\": [\"KHR_mesh_quantization\"], \"asset\"");
    let length = format!("\"byteLength\": {}}}]}}", buffer().len());
    let text = |normalized: &str| {
        let mut text =
            json("", EMBEDDED).replace("\"bufferViews\": [", &view).replace(required.0, required.1);
        for view in (0..6).rev() {
            text =
                text.replace(&format!("\"bufferView\": {view},"), &format!("\"bufferView\": {},", view + 1));
        }
        text.replace(&length, &format!("\"byteLength\": {}}}]}}", bytes.len())).replacen(
            "{\"bufferView\": 1, \"componentType\": 5126,",
            &format!("{{\"bufferView\": 0, {normalized} \"componentType\": 5122,"),
            1,
        )
    };
    let positions = |text: &str| folder.primitive("a.glb", glb(text, &bytes)).positions;
    assert_eq!(
        positions(&text(""))[1..],
        [Vec3::new(7., 0., 0.), Vec3::new(7., 7., 0.), Vec3::new(-32768., 32767., 0.)]
    );
    assert_eq!(positions(&text("\"normalized\": true,"))[3], Vec3::new(-1.0, 1.0, 0.0));
    // Positions 1 and 3 replaced by the first two of the quantized view's.
    let indices =
        format!("\"bufferViews\": [{{\"buffer\": 0, \"byteOffset\": {}, \"byteLength\": 2}},", at + 32);
    let sparse = |extra: &str| {
        let mut text = json("", EMBEDDED).replace("\"bufferViews\": [", &indices);
        for view in (0..6).rev() {
            text =
                text.replace(&format!("\"bufferView\": {view},"), &format!("\"bufferView\": {},", view + 1));
        }
        let sparse = r#""sparse": {"count": 2, "indices": {"bufferView": 0, "componentType": 5121},
            "values": {"bufferView": 3, "byteOffset": 0}}, "#;
        text.replace(&length, &format!("\"byteLength\": {}}}]}}", bytes.len())).replacen(
            "{\"bufferView\": 1, \"comp",
            &format!("{{{extra}{sparse}\"comp"),
            1,
        )
    };
    assert_eq!(
        positions(&sparse("\"bufferView\": 1, ")),
        [Vec3::ZERO, Vec3::Z, Vec3::new(1.0, 1.0, 0.0), Vec3::Z]
    );
    assert_eq!(positions(&sparse("")), [Vec3::ZERO, Vec3::Z, Vec3::ZERO, Vec3::Z]);
    let beyond = sparse("").replacen("\"count\": 4", "\"count\": 3", 1);
    folder.refused("a.glb", glb(&beyond, &bytes), &["accessor 0", "sparse index 3"]);
    let huge = sparse("").replacen("\"count\": 4", "\"count\": 99999999999", 1);
    folder.refused("a.glb", glb(&huge, &bytes), &["accessor 0", "99999999999"]);
    // However many sparse ones are declared: these must be there.
    let declared = |count: u64, sparse_count: u64| {
        let text = sparse("").replacen("\"count\": 4", &format!("\"count\": {count}"), 1);
        glb(
            &text.replacen(
                "\"sparse\": {\"count\": 2",
                &format!("\"sparse\": {{\"count\": {sparse_count}"),
                1,
            ),
            &bytes,
        )
    };
    folder.refused("a.glb", declared(u64::MAX, u64::MAX), &["accessor 0", "go beyond bufferView"]);
    folder.refused("a.glb", declared(1 << 50, 1 << 40), &["accessor 0", "go beyond bufferView"]);
    folder.refused("a.glb", declared(1, 2), &["accessor 0", "sparse.count is 2, but there are 1 elements"]);
}

/// A buffer that names a file takes memory for it, each time.
#[test]
fn files_of_buffers_count() {
    let folder = Folder::new();
    folder.write("b.bin", vec![0; 100_000]);
    let buffers = vec![r#"{"uri": "b.bin", "byteLength": 100000}"#; 40].join(", ");
    let views: Vec<String> = (0..40).map(|i| format!(r#"{{"buffer": {i}, "byteLength": 36}}"#)).collect();
    let accessors: Vec<String> = (0..40)
        .map(|i| format!(r#"{{"bufferView": {i}, "componentType": 5126, "count": 3, "type": "VEC3"}}"#))
        .collect();
    let primitives: Vec<String> =
        (0..40).map(|i| format!(r#"{{"attributes": {{"POSITION": {i}}}}}"#)).collect();
    let json = format!(
        r#"{{"asset": {{"version": "2.0"}}, "nodes": [{{"mesh": 0}}], "meshes": [{{"primitives": [{}]}}],
"accessors": [{}], "bufferViews": [{}], "buffers": [{buffers}]}}"#,
        primitives.join(", "),
        accessors.join(", "),
        views.join(", ")
    );
    assert_eq!(folder.mesh("a.gltf", &json).primitives.len(), 40);
    let options = OpenOptions { max_memory: 2_000_000, ..OpenOptions::default() };
    refused(folder.open_with("a.gltf", &json, &options), "a.gltf", &["buffer", "more than 2000000 bytes"]);
}

/// KHR_mesh_quantization: all its types, for positions, normals and texture coordinates.
#[test]
fn quantized_attributes() {
    let folder = Folder::new();
    // The type, and bytes of low, high and one half of it.
    let types = [
        (5120, [vec![0x81], vec![127], vec![64]], [-127.0_f32, 127.0, 64.0], 127.0_f32),
        (5121, [vec![0], vec![255], vec![51]], [0.0, 255.0, 51.0], 255.0),
        (5122, [le!(i16: -32768), le!(i16: 32767), le!(i16: 7)], [-32768.0, 32767.0, 7.0], 32767.0),
        (5123, [le!(u16: 0), le!(u16: 65535), le!(u16: 3)], [0.0, 65535.0, 3.0], 65535.0),
    ];
    for (code, words, numbers, largest) in types {
        for normalized in [false, true] {
            let stride = 4 * words[0].len();
            // Three elements of three numbers each, moved on by one: low, high, middle.
            let mut element: Vec<Vec<u8>> = Vec::new();
            for first in 0..3 {
                let mut bytes: Vec<u8> = (first..first + 3).flat_map(|n| words[n % 3].clone()).collect();
                bytes.resize(stride, 99);
                element.push(bytes);
            }
            let binary = element.concat();
            let accessor = |kind: &str| {
                format!(
                    r#"{{"bufferView":0,"componentType":{code},"count":3,"type":"{kind}","normalized":{normalized}}}"#
                )
            };
            let json = format!(
                r#"{{"asset":{{"version":"2.0"}},"extensionsRequired":["KHR_mesh_quantization"],"nodes":[{{"mesh":0}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":0,"TEXCOORD_0":1}},"material":0}}]}}],
"materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],"textures":[{{"source":0}}],
"images":[{{"uri":"data:image/png;base64,{}"}}],"accessors":[{},{}],
"bufferViews":[{{"buffer":0,"byteLength":{length},"byteStride":{stride}}}],"buffers":[{{"byteLength":{length}}}]}}"#,
                base64(&png()),
                accessor("VEC3"),
                accessor("VEC2"),
                length = binary.len(),
            );
            let primitive = folder.primitive("a.glb", glb(&json, &binary));
            let number =
                |n: usize| if normalized { (numbers[n % 3] / largest).max(-1.0) } else { numbers[n % 3] };
            let wanted =
                [0, 1, 2].map(|first| Vec3::new(number(first), number(first + 1), number(first + 2)));
            assert_eq!(primitive.positions, wanted, "{code} {normalized}");
            assert_eq!(primitive.normals.unwrap(), wanted);
            assert_eq!(primitive.tex_coords.unwrap(), wanted.map(|v| v.truncate()));
        }
    }
}

#[test]
fn nearest_samplers_and_unlit_materials() {
    let folder = Folder::new();
    let filter = |said: &str| {
        let sampler = format!("{{{said}\"wrapS\"");
        folder.primitive("a.glb", changed(&[("{\"wrapS\"", &sampler)])).material.texture.unwrap().filter
    };
    assert_eq!(filter("\"magFilter\": 9728, "), Filter::Nearest);
    assert_eq!(filter("\"magFilter\": 9729, \"minFilter\": 9728, "), Filter::Linear);

    let unlit = "\"extensions\": {\"KHR_materials_unlit\": {}}, \"emissiveFactor\": [1, 1, 1], \"alphaMode\"";
    let points = ", {\"attributes\": {\"POSITION\": 0}, \"mode\": 0}";
    let all = folder.open("a.glb", changed(&[("\"alphaMode\"", unlit), (points, "")])).unwrap();
    assert_eq!(all.notes, []);
    assert!(folder.primitive("a.glb", changed(&[("\"alphaMode\"", unlit)])).unlit);
    assert!(!folder.primitive("a.glb", example_glb()).unlit);
    // One beside another that is not.
    let shaded = ", {\"attributes\": {\"POSITION\": 0}, \"indices\": 1}";
    let some = folder.open("a.glb", changed(&[("\"alphaMode\"", unlit), (points, shaded)])).unwrap();
    let text = "KHR_materials_unlit of 1 primitive, shaded as the others are";
    assert_eq!(some.notes, [Note::LeftOut(text.into())]);
}

#[test]
fn what_is_not_shown_is_noted_once() {
    let folder = Folder::new();
    let notes = |pairs: &[(&str, &str)]| folder.open("a.glb", changed(pairs)).unwrap().notes;
    assert_eq!(notes(&[]), [Note::LeftOut("1 primitive of points or lines".into())]);
    assert_eq!(notes(&[(", {\"attributes\": {\"POSITION\": 0}, \"mode\": 0}", "")]), []);
    let emissive = |factor: &str| format!("\"emissiveFactor\": {factor}, \"alphaMode\"");
    assert_eq!(notes(&[("\"alphaMode\"", &emissive("[0, 0, 0]"))]), notes(&[]));
    assert_eq!(
        notes(&[("\"alphaMode\"", &emissive("[0, 0.5, 0]"))]),
        [Note::LeftOut("the emission of 1 material, 1 primitive of points or lines".into())]
    );
    let required = "\"extensionsRequired\": [\"KHR_materials_ior\", \"KHR_materials_variants\"], \"asset\"";
    assert_eq!(
        notes(&[("\"asset\"", required)]),
        [Note::LeftOut("1 primitive of points or lines, KHR_materials_ior, which it requires".into())]
    );
    // Of materials that nothing has nothing is said.
    let emission = emissive("[0, 0.5, 0]");
    assert_eq!(notes(&[("\"alphaMode\"", &emission), ("\"material\": 0, ", "")]), notes(&[]));
    let more = r#""cameras": [{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}},
        {"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}],
        "animations": [{"channels": [], "samplers": []}], "extensionsUsed": ["KHR_lights_punctual"], "asset""#;
    let instances = r#""extensions": {"EXT_mesh_gpu_instancing": {"attributes": {}}}, "mesh": 0, "rot"#;
    let text = "1 animation, 2 cameras, lights, 1 primitive of points or lines, \
        instances of 1 mesh (EXT_mesh_gpu_instancing), shown once";
    assert_eq!(
        notes(&[("\"asset\"", more), ("\"mesh\": 0, \"rot", instances)]),
        [Note::LeftOut(text.into())]
    );
}

#[test]
fn images_of_extensions() {
    let folder = Folder::new();
    let mut webp = std::io::Cursor::new(Vec::new());
    let (color, format) = (image::ExtendedColorType::Rgba8, image::ImageFormat::WebP);
    image::write_buffer_with_format(&mut webp, &TEXELS.concat(), 2, 2, color, format).unwrap();
    let uri = format!("{{\"uri\": \"data:image/webp;base64,{}\"}}", base64(webp.get_ref()));
    let file = |texture: &str| {
        let text = json("", &format!("{EMBEDDED}, {uri}")).replace("{\"source\": 0, ", texture).replace(
            "\"asset\"",
            "\"extensionsRequired\": [\"EXT_texture_webp\", \"KHR_texture_basisu\"], \"asset\"",
        );
        glb(&text, &buffer())
    };
    let wanted = folder.mesh("a.glb", example_glb());
    assert_eq!(folder.mesh("a.glb", file(r#"{"extensions": {"EXT_texture_webp": {"source": 1}}, "#)), wanted);
    // What every program reads comes first.
    let both = r#"{"extensions": {"KHR_texture_basisu": {"source": 7}}, "source": 0, "#;
    assert_eq!(folder.mesh("a.glb", file(both)), wanted);
    let alone = r#"{"extensions": {"KHR_texture_basisu": {"source": 1}}, "#;
    folder.refused("a.glb", file(alone), &["texture 0", "KHR_texture_basisu", "PNG, JPEG and WebP"]);
}

/// Small files that come to much: what is set as a limit is one.
#[test]
fn memory_is_limited() {
    let folder = Folder::new();
    let refuse = |bytes: Vec<u8>, max_memory: u64, parts: &[&str]| {
        let options = OpenOptions { max_memory, ..OpenOptions::default() };
        refused(folder.open_with("a.glb", bytes, &options), "a.glb", parts);
    };
    let nodes = |count: usize| {
        let nodes = vec![r#"{"mesh": 0}"#; count].join(", ");
        changed(&[(r#", {"mesh": 0}]"#, &format!(", {nodes}]")), ("\"scene\": 0,", "")])
    };
    assert_eq!(folder.mesh("a.glb", nodes(100)).primitives.len(), 101);
    refuse(nodes(100), 200_000, &["unpacks to more than 200000 bytes"]);
    refuse(nodes(10_000), 1 << 20, &["JSON", "unpacks to more than 1048576 bytes"]);
    refuse(example_glb(), 100, &["JSON", "100 bytes"]);
}

#[test]
fn alpha_and_moved_textures() {
    let folder = Folder::new();
    let opaque = folder.primitive("a.glb", changed(&[("BLEND", "OPAQUE")]));
    assert_eq!(opaque.material.factor.w, 1.0);
    assert!(opaque.colors.iter().flatten().all(|color| color.w == 1.0));
    assert!(opaque.material.texture.unwrap().texels.iter().all(|texel| texel[3] == 255));
    let blended = folder.primitive("a.glb", example_glb());
    let alphas = blended.colors.iter().flatten().map(|color| color.w);
    assert_eq!(alphas.collect::<Vec<_>>(), [0.0, 0.0, 0.0, 1.0]);
    assert_eq!((opaque.alpha_cutoff, blended.alpha_cutoff), (None, None));
    // The alphas stay as they are: the sampler compares them.
    for (mode, cutoff) in [("MASK\", \"alphaCutoff\": 0.2, \"name\": \"x", 0.2), ("MASK", 0.5)] {
        let masked = folder.primitive("a.glb", changed(&[("BLEND", mode)]));
        assert_eq!(masked.alpha_cutoff, Some(cutoff));
        assert_eq!((&masked.material, &masked.colors), (&blended.material, &blended.colors));
    }
    let moved = r#""texCoord": 1, "extensions": {"KHR_texture_transform": {"offset": [0.5, 0], "scale": [2, 3], "rotation": 1.57079633}}"#;
    let uvs = folder.primitive("a.glb", changed(&[("\"texCoord\": 1", moved)])).tex_coords.unwrap();
    // Scaled, then a quarter turn that takes v to u and u to -v, then moved.
    assert!(
        (uvs[1] - Vec2::new(0.5, -2.0)).length() < 1e-5 && (uvs[3] - Vec2::new(3.5, 0.0)).length() < 1e-5,
        "{uvs:?}"
    );
    // The transform may name other coordinates than the texture.
    let elsewhere =
        r#""texCoord": 7, "extensions": {"KHR_texture_transform": {"texCoord": 1, "offset": [0.25, 0.5]}}"#;
    let uvs = folder.primitive("a.glb", changed(&[("\"texCoord\": 1", elsewhere)])).tex_coords.unwrap();
    assert_eq!(uvs[2], Vec2::new(1.25, 1.5));
    folder.refused(
        "a.glb",
        changed(&[("\"texCoord\": 1", "\"texCoord\": 0")]),
        &["primitive 0", "TEXCOORD_0"],
    );
}

#[test]
fn sides() {
    let folder = Folder::new();
    let double_sided = |pairs: &[(&str, &str)]| folder.primitive("a.glb", changed(pairs)).double_sided;
    assert!(!double_sided(&[]));
    assert!(!double_sided(&[("\"material\": 0, ", "")]));
    for (said, expected) in [("true", true), ("false", false)] {
        let said = format!("\"doubleSided\": {said}, \"alphaMode\"");
        assert_eq!(double_sided(&[("\"alphaMode\"", &said)]), expected);
    }
}

#[test]
fn what_is_wrong_is_said() {
    let folder = Folder::new();
    let refuse =
        |from: &str, to: &str, parts: &[&str]| drop(folder.refused("a.glb", changed(&[(from, to)]), parts));
    let required = "\"extensionsRequired\": [\"KHR_draco_mesh_compression\"], \"asset\"";
    let instances = required.replace("KHR_draco_mesh_compression", "EXT_mesh_gpu_instancing");
    refuse("\"asset\"", &instances, &["EXT_mesh_gpu_instancing", "not supported"]);
    refuse("\"asset\"", required, &["KHR_draco_mesh_compression", "not supported", "save it without Draco"]);
    refuse("\"2.0\"", "\"1.0\"", &["version 2"]);
    for (least, parts) in [
        ("2.1", &["asset", "needs glTF 2.1 (minVersion)", "version 2.0 is supported"][..]),
        ("3.0", &["asset", "needs glTF 3.0 (minVersion)", "version 2.0 is supported"][..]),
        ("2", &["asset", "minVersion \"2\" must be two numbers"][..]),
    ] {
        refuse("\"2.0\"", &format!("\"2.0\", \"minVersion\": \"{least}\""), parts);
    }
    for least in ["2.0", "1.1"] {
        let older = changed(&[("\"2.0\"", &format!("\"2.0\", \"minVersion\": \"{least}\""))]);
        assert_eq!(folder.mesh("a.glb", older), folder.mesh("a.glb", example_glb()));
    }
    refuse("\"mesh\": 0, \"rot", "\"mesh\": 5, \"rot", &["mesh 5", "not there"]);
    refuse("\"mesh\": 0, \"rot", "\"skin\": 0, \"mesh\": 0, \"rot", &["node 1", "skin"]);
    refuse("\"mesh\": 0, \"rot", "\"weights\": [1], \"mesh\": 0, \"rot", &["node 1", "morph"]);
    refuse("\"primitives\"", "\"weights\": [1], \"primitives\"", &["mesh 0", "morph"]);
    // A node's weights take the place of its mesh's.
    let at_rest = [
        ("\"primitives\"", "\"weights\": [1], \"primitives\""),
        ("\"mesh\": 0, \"rot", "\"weights\": [0], \"mesh\": 0, \"rot"),
    ];
    assert_eq!(folder.mesh("a.glb", changed(&at_rest)), folder.mesh("a.glb", example_glb()));
    refuse("\"POSITION\": 0, \"N", "\"POSITION\": 9, \"N", &["accessor 9"]);
    refuse("\"POSITION\": 0, \"N", "\"N", &["primitive 0", "POSITION"]);
    refuse("\"POSITION\": 0, \"N", "\"POSITION\": 1, \"N", &["accessor 1", "Scalar"]);
    refuse("\"NORMAL\": 2", "\"NORMAL\": 4", &["accessor 4", "Vec4"]);
    refuse("\"indices\": 1", "\"indices\": 0", &["accessor 0"]);
    refuse("\"indices\": 1", "\"indices\": 77", &["accessor 77"]);
    refuse("5123, \"count\": 6", "5123, \"count\": 7", &["accessor 1", "7 elements", "bufferView 1"]);
    refuse("5123, \"count\": 6", "5123, \"count\": 18446744073709551615", &["accessor 1", "go beyond"]);
    refuse("5123, \"count\": 6", "5127, \"count\": 6", &["accessor 1", "componentType"]);
    refuse(
        "5126, \"count\": 4, \"type\": \"VEC3\"}",
        "5126, \"count\": 3, \"type\": \"VEC3\"}",
        &["accessor 2", "4 positions"],
    );
    refuse("\"byteStride\": 12", "\"byteStride\": 5", &["accessor 2", "byteStride"]);
    refuse("\"byteOffset\": 60", "\"byteOffset\": 18446744073709551615", &["bufferView 2", "go beyond"]);
    refuse("\"material\": 0", "\"material\": 3", &["material 3"]);
    refuse("\"index\": 0", "\"index\": 3", &["texture 3"]);
    refuse("\"sampler\": 0", "\"sampler\": 3", &["texture 0", "sampler"]);
    refuse("\"source\": 0, ", "", &["texture 0", "PNG, JPEG and WebP"]);
    refuse("{\"bufferView\": 5,", "{", &["image 0", "neither"]);
    refuse("{\"bufferView\": 5,", "{\"bufferView\": 0,", &["image 0", "PNG, JPEG or WebP"]);
    refuse("[0.5, 1, 1, 0.25]", "[0.5, 1, 7, 0.25]", &["material 0", "[0, 1]"]);
    refuse("\"BLEND\"", "\"BLUR\"", &["material 0", "OPAQUE"]);
    refuse("\"version\"", "\"version", &["JSON line 1"]);
    folder.refused("a.gltf", json("", EMBEDDED), &["buffer 0", "neither"]);
    folder.refused("a.gltf", json(r#""uri": "gone.bin","#, EMBEDDED), &["buffer 0", "gone.bin"]);
    folder.refused("a.gltf", json(r#""uri": "https://x/y.bin","#, EMBEDDED), &["buffer 0", "https"]);
    folder.refused(
        "a.gltf",
        json(r#""uri": "data:;base64,AAAA","#, EMBEDDED),
        &["buffer 0", "there are 3 bytes"],
    );
    folder.refused("a.gltf", example_gltf(), &["image 0", "a.png"]);
    folder.refused("a.gltf", "", &["JSON"]);
}

#[test]
fn numbers_must_be_finite_and_indices_within() {
    let folder = Folder::new();
    let patched = |at: usize, bytes: &[u8]| {
        let mut buffer = buffer();
        buffer[at..at + bytes.len()].copy_from_slice(bytes);
        glb(&json("", EMBEDDED), &buffer)
    };
    folder.refused("a.glb", patched(16, &f32::NAN.to_le_bytes()), &["accessor 0", "POSITION 1", "finite"]);
    folder.refused("a.glb", patched(60, &f32::INFINITY.to_le_bytes()), &["accessor 2", "NORMAL 0"]);
    folder.refused("a.glb", patched(52, &4_u16.to_le_bytes()), &["accessor 1", "index 2 is 4", "below 4"]);
    // A triangle without area is kept.
    assert_eq!(folder.primitive("a.glb", patched(48, &[1, 0, 1, 0, 1, 0])).triangles[0], [1, 1, 1]);
}

#[test]
fn cut_short_anywhere() {
    let folder = Folder::new();
    let whole = example_glb();
    for length in 0..whole.len() {
        refused(folder.open("a.glb", &whole[..length]), "a.glb", &[]);
    }
    // A length that doesn't cover its own header.
    for length in [0_u32, 11, 12, 19] {
        let mut short = whole.clone();
        short[8..12].copy_from_slice(&length.to_le_bytes());
        if let Ok(opened) = folder.open("a.glb", short) {
            panic!("{length}: {opened:?}");
        }
    }
}
