//! What a glTF file says of alpha and sides, in the picture.

use crate::place::Workplace;
use glam::{DVec2, Vec4};
use oblate::surfels::{Primitive, primitives};

/// One step of a picture with 8 bits.
const STEP: f32 = 1.0 / 255.0;

/// Pixels of a side, of which 20 are one unit of the world.
const SIZE: usize = 48;

/// A square of side 2 with its texture's top left corner at the picture's, as `write` and `from_front` place it.
fn square(alphas_of_vertices: Option<[f32; 4]>) -> Primitive {
    let colors = alphas_of_vertices.map(|alphas| alphas.map(|alpha| Vec4::ONE.with_w(alpha)).to_vec());
    Primitive { colors, ..primitives::plane(1) }
}

/// Writes `a.gltf` with one material, whose texture, if it names one, is `a.png`.
fn write(place: &Workplace, shape: &Primitive, material: &str) {
    let (mut bytes, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    let mut array = |kind: &str, component: u32, data: &[u8], count: usize| {
        let (start, length, view) = (bytes.len(), data.len(), views.len());
        views.push(format!(r#"{{"buffer": 0, "byteOffset": {start}, "byteLength": {length}}}"#));
        accessors.push(format!(
            r#"{{"bufferView": {view}, "componentType": {component}, "count": {count}, "type": "{kind}"}}"#
        ));
        bytes.extend(data);
        view
    };
    let bytes_of =
        |values: &mut dyn Iterator<Item = f32>| values.flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    let count = shape.positions.len();
    let positions = bytes_of(&mut shape.positions.iter().flat_map(|p| p.to_array()));
    let mut attributes = format!(r#""POSITION": {}"#, array("VEC3", 5126, &positions, count));
    if let Some(coords) = &shape.tex_coords {
        let coords = bytes_of(&mut coords.iter().flat_map(|c| c.to_array()));
        attributes += &format!(r#", "TEXCOORD_0": {}"#, array("VEC2", 5126, &coords, count));
    }
    if let Some(colors) = &shape.colors {
        let colors = bytes_of(&mut colors.iter().flat_map(|c| c.to_array()));
        attributes += &format!(r#", "COLOR_0": {}"#, array("VEC4", 5126, &colors, count));
    }
    let corners: Vec<u8> = shape.triangles.iter().flatten().flat_map(|corner| corner.to_le_bytes()).collect();
    let indices = array("SCALAR", 5125, &corners, corners.len() / 4);
    place.write("a.bin", &bytes);
    let (length, views, accessors) = (bytes.len(), views.join(", "), accessors.join(", "));
    place.write(
        "a.gltf",
        format!(
            r#"{{"asset": {{"version": "2.0"}}, "nodes": [{{"mesh": 0}}],
"meshes": [{{"primitives": [{{"attributes": {{{attributes}}}, "indices": {indices}, "material": 0}}]}}],
"materials": [{{{material}}}], "textures": [{{"source": 0, "sampler": 0}}],
"samplers": [{{"wrapS": 33071, "wrapT": 33071}}], "images": [{{"uri": "a.png"}}],
"buffers": [{{"uri": "a.bin", "byteLength": {length}}}],
"bufferViews": [{views}], "accessors": [{accessors}]}}"#
        ),
    );
}

/// A texture of `size` × `size` texels.
fn texture(place: &Workplace, size: u32, texel: impl Fn(u32, u32) -> [u8; 4]) {
    image::RgbaImage::from_fn(size, size, |x, y| image::Rgba(texel(x, y))).save(place.path("a.png")).unwrap();
}

const TEXTURE: &str = r#""baseColorTexture": {"index": 0}"#;

/// Linear premultiplied red, green, blue and alpha of each pixel, row by row, seen from y = 4 or y = −4 along
/// parallel rays, x to the right.
fn draw(place: &Workplace, eye: &str, options: &[&str]) -> Vec<[f32; 4]> {
    let fixed =
        ["render", "a.gltf", "--size", "48x48", "--orthographic", "2.4", "--target", "0,0,0", "--eye", eye];
    let up = if eye.contains('-') { "0,0,1" } else { "0,0,-1" };
    let look = ["--up", up, "--background", "00000000", "-o", "a.exr"];
    place.run(&[&fixed[..], &look, options].concat());
    let file = exr::prelude::read_first_flat_layer_from_file(place.path("a.exr")).unwrap();
    let [r, g, b, a] = ["R", "G", "B", "A"].map(|name| {
        let channel = file.layer_data.channel_data.list.iter().find(|c| c.name == *name).unwrap();
        channel.sample_data.values_as_f32().collect::<Vec<f32>>()
    });
    (0..SIZE * SIZE).map(|i| [r[i], g[i], b[i], a[i]]).collect()
}

fn from_front(place: &Workplace) -> Vec<[f32; 4]> {
    draw(place, "0,4,0", &[])
}

fn from_behind(place: &Workplace) -> Vec<[f32; 4]> {
    draw(place, "0,-4,0", &[])
}

/// Checks alpha at the pixels whose centres, from −1.2 to 1.2, are `within`.
fn assert_alpha(picture: &[[f32; 4]], expected: f32, within: impl Fn(DVec2) -> bool) {
    let centre = |i: usize| DVec2::new((i % SIZE) as f64 + 0.5, (i / SIZE) as f64 + 0.5) / 20.0 - 1.2;
    let pixels: Vec<usize> = (0..picture.len()).filter(|&i| within(centre(i))).collect();
    assert!(pixels.len() > 20, "only {} pixels", pixels.len());
    for i in pixels {
        let alpha = picture[i][3];
        assert!((alpha - expected).abs() <= STEP, "{alpha}, not {expected}, at {}", centre(i));
    }
}

/// Four pixels away from the border of the square: surfels reach three spacings, and these are pixels.
fn inner(at: DVec2) -> bool {
    at.abs().max_element() < 0.8
}

#[test]
fn a_double_sided_sphere_shows_its_far_wall_through_its_near_one() {
    let place = Workplace::new();
    // Where the sphere's surface leans by less than a third.
    let middle = |at: DVec2| at.length() < 0.3;
    for (alpha, sides, walls) in [(0.4, "true", 2), (0.4, "false", 1), (0.9, "true", 2), (1.0, "true", 1)] {
        let material = format!(
            r#""alphaMode": "BLEND", "doubleSided": {sides}, "pbrMetallicRoughness": {{"baseColorFactor": [1, 1, 1, {alpha}]}}"#
        );
        write(&place, &primitives::sphere(96), &material);
        let expected = 1.0 - (1.0_f32 - alpha).powi(walls);
        let picture = from_front(&place);
        assert_alpha(&picture, expected, middle);
        let reference = draw(&place, "0,4,0", &["--reference", "r1"]);
        assert_alpha(&reference, expected, middle);
        let errors = picture.iter().zip(&reference).map(|(a, b)| (a[3] - b[3]).abs());
        println!("alpha {alpha}, double-sided {sides}: {} from r1", errors.fold(0.0, f32::max));
    }
}

#[test]
fn blending_multiplies_factor_texture_and_vertex_colours() {
    let place = Workplace::new();
    // Upper half 0.8, lower half 0.2.
    texture(&place, 64, |_, y| [255, 255, 255, if y < 32 { 204 } else { 51 }]);
    for sides in ["true", "false"] {
        let material = format!(
            r#""alphaMode": "BLEND", "doubleSided": {sides}, "pbrMetallicRoughness": {{"baseColorFactor": [1, 1, 1, 0.5], {TEXTURE}}}"#
        );
        for (vertices, factor) in [(None, 0.5), (Some([0.6; 4]), 0.3)] {
            write(&place, &square(vertices), &material);
            let picture = from_front(&place);
            assert_alpha(&picture, 0.8 * factor, |at| inner(at) && at.y < -0.25);
            assert_alpha(&picture, 0.2 * factor, |at| inner(at) && at.y > 0.25);
            // Seen from behind, turned about x.
            let [upper, lower] = if sides == "true" { [0.2 * factor, 0.8 * factor] } else { [0.0; 2] };
            let picture = from_behind(&place);
            assert_alpha(&picture, upper, |at| inner(at) && at.y < -0.25);
            assert_alpha(&picture, lower, |at| inner(at) && at.y > 0.25);
        }
    }
    // Alpha means nothing without an alphaMode; what is opaque shows both sides.
    write(&place, &square(Some([0.3; 4])), &format!(r#""pbrMetallicRoughness": {{{TEXTURE}}}"#));
    assert_alpha(&from_front(&place), 1.0, inner);
    assert_alpha(&from_behind(&place), 1.0, inner);
}

#[test]
fn a_mask_shows_what_is_there_and_nothing_of_what_is_not() {
    let place = Workplace::new();
    let material = |cutoff: f32, factor: f32| {
        format!(
            r#""alphaMode": "MASK", "alphaCutoff": {cutoff}, "doubleSided": true,
"pbrMetallicRoughness": {{"baseColorFactor": [1, 1, 1, {factor}], {TEXTURE}}}"#
        )
    };
    // Red on the left with alpha 0.6, green on the right with 0.4; texels from a quarter of a pixel to twenty pixels.
    for size in [160, 64, 8, 2] {
        texture(&place, size, |x, _| if x < size / 2 { [255, 0, 0, 153] } else { [0, 255, 0, 102] });
        for (cutoff, factor, left, right) in
            [(0.5, 1.0, 1.0, 0.0), (0.3, 0.7, 1.0, 0.0), (0.3, 1.0, 1.0, 1.0), (0.7, 1.0, 0.0, 0.0)]
        {
            write(&place, &square(None), &material(cutoff, factor));
            let picture = from_front(&place);
            // Four pixels from the mask's edge, however large its texels are.
            assert_alpha(&picture, left, |at| inner(at) && at.x < -0.2);
            assert_alpha(&picture, right, |at| inner(at) && at.x > 0.2);
            if left > right {
                let [mut shown, mut green] = [0; 2];
                for [r, g, _, alpha] in &picture {
                    shown += usize::from(*alpha > 0.1 && *alpha < 0.9);
                    green += usize::from(*g > 0.01 + 0.5 * r);
                }
                assert!(shown > 20 && green == 0, "texels {size}: {shown} pixels partly, {green} green");
            }
        }
    }
}

#[test]
fn a_mask_compares_vertex_colours_and_the_factor() {
    let place = Workplace::new();
    // Alpha falls from 1 to 0 along x: half of it is above 0.4 / 0.8, three tenths of it above 0.4 / 0.5714.
    for (factor, edge) in [(0.8, 0.0), (0.5714, -0.4)] {
        let material = format!(
            r#""alphaMode": "MASK", "alphaCutoff": 0.4, "pbrMetallicRoughness": {{"baseColorFactor": [1, 1, 1, {factor}]}}"#
        );
        write(&place, &square(Some([1.0, 0.0, 1.0, 0.0])), &material);
        let picture = from_front(&place);
        assert_alpha(&picture, 1.0, |at| inner(at) && at.x < edge - 0.2);
        assert_alpha(&picture, 0.0, |at| inner(at) && at.x > edge + 0.2);
        // It is not opaque and one-sided.
        assert_alpha(&from_behind(&place), 0.0, |_| true);
    }
    write(
        &place,
        &square(None),
        r#""alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.4]}"#,
    );
    assert_alpha(&from_front(&place), 0.0, |_| true);
}
