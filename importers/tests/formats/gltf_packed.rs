//! Buffer views under EXT_meshopt_compression and KHR_meshopt_compression.

use crate::common::Folder;
use crate::gltf::glb;

/// A packed view: elements, bytes of each, and what else its extension says.
type View<'v> = (usize, usize, &'v str);

const EXT: &str = "EXT_meshopt_compression";
const KHR: &str = "KHR_meshopt_compression";

/// A square of packed views: positions, corners, normals, colours. What they unpack to is nowhere.
fn square(name: &str, views: [View<'_>; 4], streams: &[Vec<u8>; 4]) -> Vec<u8> {
    let (mut at, mut unpacked_at) = (0, 0);
    let mut text = Vec::new();
    for ((count, stride, rest), stream) in views.into_iter().zip(streams) {
        let (size, length) = (count * stride, stream.len());
        let of_attributes =
            if rest.contains("ATTRIBUTES") { format!(r#""byteStride":{stride},"#) } else { String::new() };
        text.push(format!(
            r#"{{"buffer":1,"byteOffset":{unpacked_at},"byteLength":{size},{of_attributes}"extensions":{{"{name}":{{"buffer":0,"byteOffset":{at},"byteLength":{length},"byteStride":{stride},"count":{count},{rest}}}}}}}"#
        ));
        (at, unpacked_at) = (at + length, unpacked_at + size);
    }
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"extensionsRequired":["{name}","KHR_mesh_quantization"],"nodes":[{{"mesh":0}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"NORMAL":2,"COLOR_0":3}},"indices":1}}]}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}},{{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}},
{{"bufferView":2,"componentType":5120,"count":4,"type":"VEC3","normalized":true}},
{{"bufferView":3,"componentType":5121,"count":4,"type":"VEC4","normalized":true}}],
"bufferViews":[{}],"buffers":[{{"byteLength":{at}}},{{"byteLength":{unpacked_at},"extensions":{{"{name}":{{"fallback":true}}}}}}]}}"#,
        text.join(",")
    );
    glb(&json, &streams.concat())
}

#[cfg(not(feature = "meshopt"))]
#[test]
fn how_to_read_it_is_said() {
    let views = [(4, 12, r#""mode":"ATTRIBUTES""#); 4];
    for name in [EXT, KHR] {
        let file = square(name, views, &[vec![0; 8], vec![], vec![], vec![]]);
        Folder::new().refused("a.glb", file, &[name, "cargo feature `meshopt`"]);
        // Also where a file forgets to say that it is required.
        let text =
            String::from_utf8_lossy(&square(name, views, &[vec![0; 8], vec![], vec![], vec![]])).into_owned();
        let (start, end) = (text.find('{').unwrap(), text.rfind('}').unwrap() + 1);
        let text = text[start..end].replace(&format!("\"{name}\",\"KHR_m"), "\"KHR_m");
        Folder::new().refused("a.glb", glb(&text, &[0; 8]), &["bufferView 0", "cargo feature `meshopt`"]);
    }
}

#[cfg(feature = "meshopt")]
pub(crate) use unpacked::example_glb;

#[cfg(feature = "meshopt")]
mod unpacked {
    use super::*;
    use glam::{Vec3, Vec4};
    use meshopt::encoding::{
        EncodeExpMode, encode_filter_color, encode_filter_exp, encode_filter_oct, encode_index_buffer,
        encode_index_sequence, encode_vertex_buffer_level,
    };

    const POSITIONS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, -0.5], [1.0, 1.0, 0.25], [0.0, 1.0, 2.0]];
    const CORNERS: [u32; 6] = [0, 1, 2, 2, 1, 3];
    const COLORS: [[u8; 4]; 4] = [[255, 0, 0, 255], [0, 255, 0, 0], [10, 20, 30, 40], [1, 2, 3, 4]];

    fn packed<T>(elements: &[T], version: i32) -> Vec<u8> {
        encode_vertex_buffer_level(elements, 2, Some(version)).unwrap()
    }

    fn normals() -> [[f32; 4]; 4] {
        [Vec3::Z, Vec3::NEG_X, Vec3::new(0.6, 0.0, -0.8), Vec3::ONE.normalize()]
            .map(|n| n.extend(0.0).to_array())
    }

    const ATTRIBUTES: &str = r#""mode":"ATTRIBUTES""#;
    const VIEWS: [View<'_>; 4] = [
        (4, 12, ATTRIBUTES),
        (6, 2, r#""mode":"TRIANGLES""#),
        (4, 4, r#""mode":"ATTRIBUTES","filter":"OCTAHEDRAL""#),
        (4, 4, ATTRIBUTES),
    ];

    fn streams(version: i32) -> [Vec<u8>; 4] {
        let normals = encode_filter_oct::<i8>(&normals(), 8);
        [
            packed(&POSITIONS, version),
            encode_index_buffer(&CORNERS, 4).unwrap(),
            packed(&normals, version),
            packed(&COLORS, version),
        ]
    }

    pub(crate) fn example_glb() -> Vec<u8> {
        square(EXT, VIEWS, &streams(0))
    }

    fn check(file: Vec<u8>) -> oblate_surfels::Primitive {
        let primitive = Folder::new().primitive("a.glb", file);
        assert_eq!(primitive.positions, POSITIONS.map(Vec3::from_array));
        // Triangles may begin at another corner.
        let turned = |[a, b, c]: [u32; 3]| [[a, b, c], [b, c, a], [c, a, b]];
        assert!(turned([0, 1, 2]).contains(&primitive.triangles[0]), "{:?}", primitive.triangles);
        assert!(turned([2, 1, 3]).contains(&primitive.triangles[1]), "{:?}", primitive.triangles);
        for (found, wanted) in primitive.normals.as_ref().unwrap().iter().zip(normals()) {
            // Two coordinates and the result in 8 bits each: half a step of 1/127, thrice.
            assert!(
                (*found - Vec4::from_array(wanted).truncate()).abs().max_element() < 0.012,
                "{found} {wanted:?}"
            );
        }
        primitive
    }

    #[test]
    fn views_are_unpacked() {
        for (name, version) in [(EXT, 0), (KHR, 0), (KHR, 1)] {
            let colors = check(square(name, VIEWS, &streams(version))).colors.unwrap();
            // Opaque without a material.
            assert_eq!(colors[2], Vec4::new(10.0 / 255.0, 20.0 / 255.0, 30.0 / 255.0, 1.0));
        }
        // Corners in order, and filters of numbers and colours.
        let mut streams = streams(1);
        let exponential = encode_filter_exp::<3>(&POSITIONS, 15, EncodeExpMode::Separate);
        streams[0] = packed(&exponential, 1);
        streams[1] = encode_index_sequence(&CORNERS, 4).unwrap();
        streams[3] =
            packed(&encode_filter_color::<u8>(&COLORS.map(|c| c.map(|c| f32::from(c) / 255.0)), 8), 1);
        let views = [
            (4, 12, r#""mode":"ATTRIBUTES","filter":"EXPONENTIAL""#),
            (6, 2, r#""mode":"INDICES""#),
            VIEWS[2],
            (4, 4, r#""mode":"ATTRIBUTES","filter":"COLOR""#),
        ];
        let primitive = check(square(KHR, views, &streams));
        assert_eq!(primitive.triangles, [[0, 1, 2], [2, 1, 3]]);
        let found = primitive.colors.unwrap()[2] * 255.0;
        assert!((found.truncate() - Vec3::new(10.0, 20.0, 30.0)).abs().max_element() <= 2.0, "{found}");
    }

    #[test]
    fn what_is_wrong_is_said() {
        let folder = Folder::new();
        let refuse = |index: usize, view: View<'static>, parts: &[&str]| {
            let mut views = VIEWS;
            views[index] = view;
            let mut parts = parts.to_vec();
            let place = format!("bufferView {index}");
            parts.push(&place);
            folder.refused("a.glb", square(EXT, views, &streams(0)), &parts);
        };
        refuse(0, (4, 10, ATTRIBUTES), &["byteStride is 10", "multiple of 4"]);
        refuse(0, (4, 260, ATTRIBUTES), &["byteStride is 260", "to 256"]);
        refuse(0, (4, 0, ATTRIBUTES), &["byteStride is 0"]);
        refuse(0, (4, 12, r#""mode":"ZIP""#), &["ZIP"]);
        refuse(0, (4, 12, r#""mode":"ATTRIBUTES","filter":"QUATERNION""#), &["byteStride is 12", "[8]"]);
        let text = square(EXT, VIEWS, &streams(0));
        let at = text.windows(15).position(|w| w == br#""byteStride":12"#).unwrap() + 13;
        let mut other = text;
        other[at..at + 2].copy_from_slice(b"16");
        folder.refused("a.glb", other, &["bufferView 0", "byteStride is 12, but the view's is 16"]);
        refuse(0, (99, 12, ATTRIBUTES), &["broken"]);
        refuse(0, (1 << 40, 12, ATTRIBUTES), &["cannot hold"]);
        refuse(1, (7, 2, r#""mode":"TRIANGLES""#), &["count is 7", "multiple of 3"]);
        refuse(1, (6, 3, r#""mode":"TRIANGLES""#), &["byteStride is 3", "[2, 4]"]);
        refuse(1, (6, 2, r#""mode":"INDICES","filter":"COLOR""#), &["no filter"]);
        refuse(1, (6, 2, r#""mode":"INDICES""#), &["broken"]);
        let mut strange = streams(0);
        strange[3] = packed(&[[0_u8, 0, 0, 0x7f]; 4], 0);
        let mut views = VIEWS;
        views[3].2 = r#""mode":"ATTRIBUTES","filter":"EXPONENTIAL""#;
        folder.refused("a.glb", square(EXT, views, &strange), &["exponent of number 0", "-100 to 100"]);
        strange[3] = packed(&[[0_u8; 4]; 4], 0);
        views[3].2 = r#""mode":"ATTRIBUTES","filter":"COLOR""#;
        folder.refused("a.glb", square(EXT, views, &strange), &["element 0 has no scale"]);
        // Colours have no unit in their third number.
        refuse(3, (4, 4, r#""mode":"ATTRIBUTES","filter":"OCTAHEDRAL""#), &["element 0 has no scale"]);
    }

    /// Strides that are not a type's are decoded all the same.
    #[test]
    fn all_strides() {
        macro_rules! stride {
            ($($words:literal)*) => {$(
                let elements: Vec<[u8; 4 * $words]> =
                    (0..4_usize).map(|i| std::array::from_fn(|b| if b < 12 { POSITIONS[i][b / 4].to_le_bytes()[b % 4] } else { (i * 7 + b) as u8 })).collect();
                let mut packed_streams = streams(0);
                packed_streams[0] = packed(&elements, 0);
                let mut views = VIEWS;
                views[0].1 = 4 * $words;
                check(square(EXT, views, &packed_streams));
            )*};
        }
        stride!(3 4 7 16 33 63 64);
    }
}
