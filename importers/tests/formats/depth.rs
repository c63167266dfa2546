//! Depth maps, photographs, poses and intrinsics.

use crate::common::Folder;
use crate::mutation::broken;
use crate::tiff::{LITTLE, fields};
use ::exr::image::write::layers::WritableLayers;
use ::exr::meta::attribute::Chromaticities;
use ::exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, Image, ImageAttributes,
    IntegerBounds, Layer, LayerAttributes, LineOrder, Vec2, WritableImage,
};
use glam::{DMat3, DVec3, dvec2};
use half::f16;
use image::{ExtendedColorType, ImageFormat};
use oblate_engine::color::srgb_to_linear;
use oblate_importers::depth::{
    ColorImage, DepthEncoding, DepthMap, Stamp, TimedPose, read_color, read_depth, read_intrinsics,
    read_poses,
};
use oblate_importers::{ImportError, Note};
use std::io::Cursor;

const MAX_MEMORY: u64 = 64 << 20;
const SIZE: [usize; 2] = [3, 2];
/// What six integers of 16 bits say in millimetres: 0 and the largest say nothing.
const STORED: [u16; 6] = [0, 1, 1000, 5000, 65534, 65535];

fn depth_as(bytes: &[u8], encoding: &DepthEncoding) -> Result<DepthMap, ImportError> {
    read_depth(Folder::new().write("depth", bytes), encoding, MAX_MEMORY)
}

#[track_caller]
fn depths(bytes: &[u8]) -> Vec<f32> {
    let map = depth_as(bytes, &DepthEncoding::Auto).unwrap();
    assert_eq!(map.size, SIZE);
    map.depths
}

fn color(bytes: &[u8]) -> Result<ColorImage, ImportError> {
    read_color(Folder::new().write("color", bytes), MAX_MEMORY)
}

fn poses(text: &str) -> Result<Vec<TimedPose>, ImportError> {
    read_poses(Folder::new().write("poses", text))
}

#[track_caller]
fn refused<T>(outcome: Result<T, ImportError>, parts: &[&str]) {
    let message = outcome.err().expect("the file should be refused").to_string();
    for part in parts {
        assert!(message.contains(part), "{message:?} should contain {part:?}");
    }
}

fn encoded(samples: &[u8], kind: ExtendedColorType, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image::write_buffer_with_format(&mut bytes, samples, 3, 2, kind, format).unwrap();
    bytes.into_inner()
}

fn png16(samples: &[u16]) -> Vec<u8> {
    let bytes: Vec<u8> = samples.iter().flat_map(|n| n.to_ne_bytes()).collect();
    encoded(&bytes, ExtendedColorType::L16, ImageFormat::Png)
}

fn pgm16(samples: &[u16]) -> Vec<u8> {
    let samples: Vec<u8> = samples.iter().flat_map(|n| n.to_be_bytes()).collect();
    [&b"P5\n# depths\n3 2\n65535\n"[..], &samples].concat()
}

fn words(magic: &str, white: u16, samples: &[u16]) -> Vec<u8> {
    let words: Vec<String> = samples.iter().map(u16::to_string).collect();
    format!("{magic}\n3 2\n{white}\n{}\n", words.join(" ")).into_bytes()
}

/// Rows are given from top to bottom.
fn pfm(scale: &str, rows: [[f32; 3]; 2]) -> Vec<u8> {
    let little = scale.starts_with('-');
    let samples = rows.iter().rev().flatten();
    let samples = samples.flat_map(|n| if little { n.to_le_bytes() } else { n.to_be_bytes() });
    format!("Pf\n3 2\n{scale}\n").into_bytes().into_iter().chain(samples).collect()
}

type Channels = Vec<(&'static str, FlatSamples)>;

fn exr_layer(
    channels: Channels,
    compression: Compression,
    blocks: Blocks,
) -> Layer<AnyChannels<FlatSamples>> {
    exr_layer_of((3, 2), channels, Encoding { compression, blocks, line_order: LineOrder::Increasing })
}

fn exr_layer_of(
    size: (usize, usize),
    channels: Channels,
    encoding: Encoding,
) -> Layer<AnyChannels<FlatSamples>> {
    let list = channels.into_iter().map(|(name, samples)| AnyChannel::new(name, samples)).collect();
    Layer::new(size, LayerAttributes::default(), encoding, AnyChannels::sort(list))
}

/// So large and smooth that compression makes it smaller: chunks that it doesn't are stored as they are. The numbers are 1 to 16, each in two rows of 16.
fn smooth_exr(single: bool, compression: Compression, blocks: Blocks) -> Vec<u8> {
    let ramp = (0..16 * 32).map(|index| 1 + index / 32);
    let floats = || FlatSamples::F32(ramp.clone().map(|n| n as f32).collect());
    let samples = if single { floats() } else { FlatSamples::U32(ramp.clone().collect()) };
    let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
    written(&Image::from_layer(exr_layer_of((16, 32), vec![("Y", samples)], encoding)))
}

fn written<'a, L: WritableLayers<'a>>(image: &'a Image<L>) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

fn exr_as(channels: Channels, compression: Compression) -> Vec<u8> {
    written(&Image::from_layer(exr_layer(channels, compression, Blocks::ScanLines)))
}

fn exr(channels: Channels) -> Vec<u8> {
    exr_as(channels, Compression::ZIP16)
}

fn floats(values: [f32; 6]) -> FlatSamples {
    FlatSamples::F32(values.to_vec())
}

fn halves(values: [f32; 6]) -> FlatSamples {
    FlatSamples::F16(values.map(f16::from_f32).to_vec())
}

/// Pictures of every format, for tests that break them.
pub(crate) fn pictures() -> Vec<Vec<u8>> {
    let z = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5];
    let rgb = || vec![("R", halves(z)), ("G", halves(z)), ("B", floats(z)), ("A", halves(z))];
    let tiles = Blocks::Tiles(Vec2(9, 32));
    vec![
        png16(&STORED),
        encoded(&[7; 18], ExtendedColorType::Rgb8, ImageFormat::Png),
        encoded(&[7; 18], ExtendedColorType::Rgb8, ImageFormat::Jpeg),
        encoded(&[7; 24], ExtendedColorType::Rgba8, ImageFormat::WebP),
        pgm16(&STORED),
        words("P2", 65535, &STORED),
        words("P3", 300, &[3; 18]),
        [&b"P6 3 2 255\n"[..], &[9; 18]].concat(),
        LITTLE.file(&[(fields(SIZE, 16, 1), STORED.iter().flat_map(|n| n.to_le_bytes()).collect())], None),
        pfm("-1", [[0.5, 1.0, 1.5], [2.0, 2.5, f32::NAN]]),
        exr_as(vec![("Z", floats(z))], Compression::Uncompressed),
        exr(rgb()),
        smooth_exr(false, Compression::RLE, Blocks::ScanLines),
        smooth_exr(true, Compression::ZIP16, tiles),
        smooth_exr(false, Compression::PIZ, Blocks::ScanLines),
        smooth_exr(true, Compression::PXR24, Blocks::ScanLines),
        written(&Image::from_layer(exr_layer(vec![("Y", halves(z))], Compression::ZIP1, tiles))),
    ]
}

/// Poses and intrinsics of every format.
pub(crate) fn texts() -> Vec<Vec<u8>> {
    let matrix = "0 0 1 1\n0 1 0 2\n-1 0 0 3\n0 0 0 1\n";
    let trajectory = "# time tx ty tz qx qy qz qw\n1.5 1 2 3 0 0.70711 0 0.70711\n2 1 2 3 0 0 0 1\n";
    [
        matrix.into(),
        format!("0 0 1\n{matrix}1 1 2\n{matrix}"),
        trajectory.into(),
        camera("525,0,0,0,525,0,319.5,239.5,1"),
    ]
    .map(String::into_bytes)
    .into()
}

fn camera(matrix: &str) -> String {
    format!("{{\"width\": 640, \"height\": 480, \"intrinsic_matrix\": [{matrix}]}}")
}

#[test]
fn integers_are_millimetres() {
    let millimetres: Vec<f32> = [0, 1, 1000, 5000, 65534, 0].map(|n| (f64::from(n) * 0.001) as f32).into();
    let little = STORED.iter().flat_map(|n| n.to_le_bytes()).collect();
    let tiff = LITTLE.file(&[(fields(SIZE, 16, 1), little)], None);
    for bytes in [png16(&STORED), pgm16(&STORED), words("P2", 65535, &STORED), tiff] {
        assert_eq!(depths(&bytes), millimetres);
        let notes = depth_as(&bytes, &DepthEncoding::Auto).unwrap().notes;
        assert!(
            matches!(&notes[..], [Note::Assumed(what), Note::LeftOut(_)] if what.contains("millimetres"))
        );
        assert!(notes[1].to_string().contains("1 saturated"), "{notes:?}");
    }
    let tum = depth_as(&png16(&STORED), &DepthEncoding::Units(1.0 / 5000.0)).unwrap();
    assert_eq!((tum.depths[3], tum.notes.len()), (1.0, 1));
    let grey = encoded(&[0, 1, 100, 200, 254, 255], ExtendedColorType::L8, ImageFormat::Png);
    let eight = depth_as(&grey, &DepthEncoding::Units(0.01)).unwrap();
    assert_eq!(eight.depths, [0.0, 0.01, 1.0, 2.0, 2.54, 0.0]);
    assert!(
        depth_as(&png16(&[0; 6]), &DepthEncoding::Units(1.0)).unwrap().notes[0]
            .to_string()
            .contains("all pixels")
    );
}

#[test]
fn disparities() {
    // A baseline of 0.16 and a focal length of 500 pixels: a disparity of 10 pixels is 8 away.
    let of = |offset, scale| DepthEncoding::Disparity { baseline_focal: 80.0, offset, scale };
    let quarter =
        depth_as(&encoded(&[0, 40, 20, 255, 1, 4], ExtendedColorType::L8, ImageFormat::Png), &of(0.0, 4.0));
    let quarter = quarter.unwrap();
    assert_eq!(quarter.depths, [0.0, 8.0, 16.0, (80.0 / 63.75) as f32, 320.0, 80.0]);
    assert_eq!(quarter.notes, []);
    let rows = [[f32::INFINITY, 10.0, f32::NAN], [0.0, 6.0, -40.0]];
    let full = depth_as(&pfm("-1", rows), &of(4.0, 1.0)).unwrap();
    assert_eq!(full.depths, [0.0, (80.0_f64 / 14.0) as f32, 0.0, 0.0, 8.0, 0.0]);
}

#[test]
fn bits_of_data_sets() {
    let sun = depth_as(&png16(&[0, 8, 8000, 1, 65535, 16000]), &DepthEncoding::SunRgbd).unwrap();
    // One is 2¹³ when it is turned back.
    assert_eq!(sun.depths, [0.0, 0.001, 1.0, 8.192, 0.0, 2.0]);
    let nyu = depth_as(&pgm16(&[741, 1092, 1093, 2047, 0, 1].map(u16::swap_bytes)), &DepthEncoding::NyuRaw);
    let nyu = nyu.unwrap().depths;
    assert!(
        (nyu[0] - 1.0).abs() < 1e-3 && (nyu[1] - 702.6).abs() < 1e-3 && nyu[2..4] == [0.0, 0.0],
        "{nyu:?}"
    );
    let grey = encoded(&[7; 6], ExtendedColorType::L8, ImageFormat::Png);
    for encoding in [DepthEncoding::SunRgbd, DepthEncoding::NyuRaw] {
        refused(depth_as(&grey, &encoding), &["U8", "16 bits"]);
    }
}

#[test]
fn float_maps() {
    for scale in ["-1.0", "1", "-0.5"] {
        let map = depth_as(&pfm(scale, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), &DepthEncoding::Auto).unwrap();
        assert_eq!((map.size, map.depths), (SIZE, vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
        assert_eq!(map.notes.len(), usize::from(scale == "-0.5"));
    }
    let rows = [[f32::NAN, f32::INFINITY, -1.0], [1e10, f32::NEG_INFINITY, 1e-3]];
    let unknown = depth_as(&pfm("-1", rows), &DepthEncoding::Auto).unwrap();
    assert_eq!(unknown.depths, [0.0, 0.0, 0.0, 0.0, 0.0, 1e-3]);
    assert!(unknown.notes[0].to_string().contains("2 negative"), "{:?}", unknown.notes);
    let good = pfm("-1", [[1.0; 3]; 2]);
    let auto = |bytes: &[u8]| depth_as(bytes, &DepthEncoding::Auto);
    refused(auto(&good[..good.len() - 1]), &["byte 10", "23 bytes", "need 24"]);
    refused(auto(b"PF\n3 2\n-1\n"), &["PF", "one channel"]);
    refused(auto(b"Pf\n3 2\n0\n"), &["scale", "not 0"]);
    refused(auto(b"Pf\n3 -2\n1\n"), &["height above 0"]);
    refused(auto(b"Pf\n4000000000 4000000000\n1\n"), &["more than memory"]);
}

#[test]
fn channels_of_exr() {
    let z = [0.5, 1.0, 1.5, f32::INFINITY, 1e10, 2.5];
    let known = [0.5, 1.0, 1.5, 0.0, 0.0, 2.5];
    let other = || floats([9.0; 6]);
    for name in ["Z", "depth.Z", "Depth", "View Layer.Depth.Z", "Y"] {
        assert_eq!(depths(&exr(vec![(name, floats(z))])), known, "{name}");
        assert_eq!(depths(&exr(vec![(name, halves(z.map(|z| z.min(4e4))))]))[..3], known[..3], "{name}");
    }
    let own = vec![
        ("Z", floats(z)),
        ("expected.Z", other()),
        ("median.Z", other()),
        ("N.Z", other()),
        ("R", other()),
    ];
    assert_eq!(depths(&exr(own)), known);
    let integers = exr(vec![("Z", FlatSamples::U32(vec![0, 1, 2000, 4_000_000_000, u32::MAX, 5]))]);
    assert_eq!(depths(&integers), [0.0, 0.001, 2.0, 4e6, 0.0, 0.005]);
    // What follows is without loss for these numbers.
    use Compression::{PIZ, PXR24, RLE, Uncompressed, ZIP1, ZIP16};
    for compression in [Uncompressed, RLE, ZIP1, ZIP16, PIZ, PXR24] {
        assert_eq!(
            depths(&exr_as(vec![("Z", floats(z)), ("A", halves(known))], compression))[..4],
            known[..4]
        );
        let tiles = Blocks::Tiles(Vec2(2, 1));
        let layer = exr_layer(vec![("Z", halves(known))], compression, tiles);
        assert_eq!(depths(&written(&Image::from_layer(layer))), known, "{compression:?}");
    }
    for (single, compression) in [(false, RLE), (true, ZIP1), (true, ZIP16), (false, PIZ), (true, PXR24)] {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(9, 32))] {
            let bytes = smooth_exr(single, compression, blocks);
            assert!(bytes.len() < 16 * 32 * 4, "{compression:?} should make it smaller");
            let map = depth_as(&bytes, &DepthEncoding::Units(1.0)).unwrap();
            assert!(
                (0..16 * 32).all(|index| map.depths[index] == 1.0 + (index / 32) as f32),
                "{compression:?}"
            );
        }
    }
    // Depths in the second of two parts.
    let named = |name: &str, channels| {
        let layer = exr_layer(channels, Compression::ZIP16, Blocks::ScanLines);
        Layer { attributes: LayerAttributes::named(name), ..layer }
    };
    let attributes = || ImageAttributes::new(IntegerBounds::from_dimensions((3, 2)));
    let layers = vec![named("color", vec![("R", other())]), named("depth", vec![("Z", floats(z))])];
    assert_eq!(depths(&written(&Image::from_layers(attributes(), layers))), known);
    let refuses = |channels, parts: &[&str]| refused(depth_as(&exr(channels), &DepthEncoding::Auto), parts);
    refuses(vec![("R", other()), ("G", other()), ("B", other())], &["channels are B, G, R", "Z, depth.Z"]);
    refuses(vec![("a.Depth.Z", other()), ("b.Depth.Z", other())], &["a.Depth.Z, b.Depth.Z"]);
    refuses(vec![("Y", other()), ("A", other())], &["A, Y"]);
    let lossy = exr_as(vec![("Z", halves(known))], Compression::B44);
    refused(depth_as(&lossy, &DepthEncoding::Auto), &["b44", "ZIP"]);
    let mut crop = Image::from_layer(exr_layer(vec![("Z", other())], Compression::ZIP16, Blocks::ScanLines));
    crop.attributes.display_window = IntegerBounds::from_dimensions((6, 4));
    refused(depth_as(&written(&crop), &DepthEncoding::Auto), &["3x2 of 6x4", "cropped"]);
}

#[test]
fn colors_are_no_depths() {
    for (kind, format, said) in [
        (ExtendedColorType::Rgb8, ImageFormat::Png, "Rgb8"),
        (ExtendedColorType::Rgb8, ImageFormat::Jpeg, "JPEG smears"),
        (ExtendedColorType::Rgb8, ImageFormat::WebP, "WebP holds colours"),
    ] {
        refused(depth_as(&encoded(&[7; 18], kind, format), &DepthEncoding::Auto), &[said]);
    }
    let auto = |bytes: &[u8]| depth_as(bytes, &DepthEncoding::Auto);
    refused(auto(&[&b"P6 3 2 255\n"[..], &[9; 18]].concat()), &["PPM holds colours"]);
    refused(auto(b"ply\nformat ascii 1.0\n"), &["PLY, which is no depth map"]);
    refused(auto(b""), &["not recognised"]);
    refused(color(b"II*\0"), &["not recognised as a photograph"]);
}

#[test]
fn encodings_have_ranges() {
    let picture = png16(&STORED);
    for unit in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        refused(depth_as(&picture, &DepthEncoding::Units(unit)), &["above 0"]);
    }
    for (baseline_focal, offset, scale) in
        [(0.0, 0.0, 1.0), (1.0, f64::NAN, 1.0), (1.0, 0.0, 0.0), (f64::INFINITY, 0.0, 1.0)]
    {
        let encoding = DepthEncoding::Disparity { baseline_focal, offset, scale };
        refused(depth_as(&picture, &encoding), &["disparities"]);
    }
}

#[test]
fn memory_is_limited() {
    // 60000² pixels in a few bytes: the sizes of PNG are at byte 16.
    let mut bomb = png16(&STORED);
    bomb.splice(16..24, [60_000_u32.to_be_bytes(), 60_000_u32.to_be_bytes()].concat());
    assert!(color(&bomb).is_err() && depth_as(&bomb, &DepthEncoding::Auto).is_err());
    let wide = exr_as(vec![("Z", floats([1.0; 6]))], Compression::ZIP16);
    for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        assert!(wide.windows(name.len()).any(|window| window == name));
    }
    let grown = |right: i32, bottom: i32| {
        let mut bytes = wide.clone();
        for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
            let at = bytes.windows(name.len()).position(|window| window == name).unwrap() + name.len() + 12;
            bytes.splice(at..at + 8, [right.to_le_bytes(), bottom.to_le_bytes()].concat());
        }
        bytes
    };
    for (right, bottom) in [(i32::MAX - 1, 1), (2, i32::MAX - 1), (i32::MAX - 1, i32::MAX - 1), (1 << 20, 15)]
    {
        refused(depth_as(&grown(right, bottom), &DepthEncoding::Auto), &[]);
    }
    refused(depth_as(&grown(1 << 29, 15), &DepthEncoding::Auto), &["cannot hold"]);
    for bytes in pictures() {
        let path = Folder::new();
        let path = path.write("a", &bytes);
        // Six pixels take a few bytes more than this, whatever they are.
        assert!(read_color(&path, 12).is_err());
        assert!(read_depth(&path, &DepthEncoding::Auto, 8).is_err());
    }
}

#[test]
fn colors_are_linear() {
    let samples: Vec<u8> = (0..18).map(|n| n * 15).collect();
    let linear = |n: f32, white: f32| srgb_to_linear(n / white);
    let expected: Vec<[f32; 3]> =
        samples.as_chunks::<3>().0.iter().map(|texel| texel.map(|n| linear(f32::from(n), 255.0))).collect();
    let rgb = ExtendedColorType::Rgb8;
    let ppm = [&b"P6 3 2 255\n"[..], &samples].concat();
    let wide: Vec<u16> = samples.iter().map(|&n| u16::from(n) * 257).collect();
    let bytes: Vec<u8> = wide.iter().flat_map(|n| n.to_ne_bytes()).collect();
    for bytes in [
        encoded(&samples, rgb, ImageFormat::Png),
        encoded(&samples, rgb, ImageFormat::WebP),
        encoded(&bytes, ExtendedColorType::Rgb16, ImageFormat::Png),
        ppm,
        words("P3", 65535, &wide),
    ] {
        let picture = color(&bytes).unwrap();
        assert_eq!((picture.size, &picture.notes[..]), (SIZE, &[][..]));
        // 257 n / 65535 and n / 255 are one number, rounded once each.
        for (found, right) in picture.colors.iter().flatten().zip(expected.iter().flatten()) {
            assert!((found - right).abs() <= 4.0 * f32::EPSILON * right, "{found} {right}");
        }
    }
    let jpeg = color(&encoded(&[128; 18], rgb, ImageFormat::Jpeg)).unwrap();
    assert!(jpeg.colors.iter().flatten().all(|c| (c - linear(128.0, 255.0)).abs() < 0.02));
    let grey = color(&encoded(&samples[..6], ExtendedColorType::L8, ImageFormat::Png)).unwrap();
    assert_eq!(grey.colors[5], [linear(75.0, 255.0); 3]);
    assert_eq!(color(&words("P2", 100, &[0, 20, 40, 60, 80, 100])).unwrap().colors[5], [1.0; 3]);
    refused(color(&words("P2", 100, &[0, 20, 40, 60, 80, 101])), &["sample 5", "101", "white is 100"]);
    let clear: Vec<u8> = samples.as_chunks::<3>().0.iter().flat_map(|[r, g, b]| [*r, *g, *b, *g]).collect();
    let clear = color(&encoded(&clear, ExtendedColorType::Rgba8, ImageFormat::Png)).unwrap();
    assert_eq!(clear.colors, expected);
    assert!(clear.notes[0].to_string().contains("opacities of 6 pixels"));
}

#[test]
fn colors_of_exr() {
    let values = [0.0, 0.5, 1.0, 2.0, -0.25, 8.0];
    let rgb = |r: FlatSamples| vec![("R", r), ("G", floats([0.5; 6])), ("B", halves(values))];
    let expected: Vec<[f32; 3]> = values.map(|v| [v, 0.5, v]).into();
    assert_eq!(
        color(&exr(rgb(halves(values)))).unwrap(),
        ColorImage { size: SIZE, colors: expected, notes: vec![] }
    );
    assert_eq!(color(&exr(vec![("Y", floats(values))])).unwrap().colors[3], [2.0; 3]);
    let with_a = [rgb(floats(values)), vec![("A", floats(values))]].concat();
    assert_eq!(color(&exr(with_a)).unwrap().notes.len(), 1);
    refused(color(&exr(vec![("Z", floats(values))])), &["channels are Z", "R, G and B"]);
    let broken = [0.0, 0.0, 0.0, 0.0, f32::NAN, 0.0];
    refused(color(&exr(rgb(floats(broken)))), &["pixel (1, 1)", "finite"]);
    let primaries = |red| {
        let layer = exr_layer(rgb(floats(values)), Compression::ZIP16, Blocks::ScanLines);
        let mut image = Image::from_layer(layer);
        let (green, blue, white) = (Vec2(0.3, 0.6), Vec2(0.15, 0.06), Vec2(0.3127, 0.329));
        image.attributes.chromaticities = Some(Chromaticities { red, green, blue, white });
        color(&written(&image))
    };
    assert!(primaries(Vec2(0.64, 0.33)).is_ok());
    refused(primaries(Vec2(0.708, 0.292)), &["chromaticities", "Rec. 709"]);
}

/// A camera at (1, 2, 3) that looks along +x with +y down, in three formats.
#[test]
fn poses_of_every_format() {
    let [matrix, log, trajectory, _] = texts().try_into().unwrap();
    let read = |bytes: Vec<u8>| poses(str::from_utf8(&bytes).unwrap()).unwrap();
    let (matrix, log, trajectory) = (read(matrix), read(log), read(trajectory));
    assert_eq!(matrix.iter().map(|p| p.stamp).collect::<Vec<_>>(), [Stamp::Unsaid]);
    assert_eq!(log.iter().map(|p| p.stamp).collect::<Vec<_>>(), [Stamp::Frame(0), Stamp::Frame(1)]);
    assert_eq!(trajectory.iter().map(|p| p.stamp).collect::<Vec<_>>(), [Stamp::Time(1.5), Stamp::Time(2.0)]);
    for TimedPose { pose, .. } in [matrix[0], log[0], log[1], trajectory[0]] {
        let to_world = pose.world_to_camera.inverse();
        let near = |a: DVec3, b: DVec3| assert!((a - b).length() < 1e-12, "{a} {b}");
        near(pose.world_to_camera.transform_point3(DVec3::new(1.0, 2.0, 3.0)), DVec3::ZERO);
        near(to_world.transform_vector3(DVec3::Z), DVec3::X);
        near(to_world.transform_vector3(DVec3::Y), DVec3::Y);
        near(to_world.transform_vector3(DVec3::X), DVec3::NEG_Z);
    }
    assert_eq!(trajectory[1].pose.world_to_camera.matrix3, DMat3::IDENTITY);
    let twice = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n\n1 0 0 5\r\n0 1 0 0\r\n0 0 1 0\r\n0 0 0 1\r\n";
    assert_eq!(poses(&format!("\u{feff}# a mark\n{twice}")).unwrap(), poses(twice).unwrap());
    assert_eq!(poses(&format!("\u{feff}{twice}")).unwrap(), poses(twice).unwrap());
    let twice = poses(twice).unwrap();
    assert_eq!((twice.len(), twice[1].pose.world_to_camera.translation.x), (2, -5.0));
}

#[test]
fn rounded_rotations_become_nearest_ones() {
    let turn = DMat3::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 2.0);
    let noise = [0.4, -0.3, 0.2, 0.5, -0.5, 0.1, -0.2, 0.3, 0.4].map(|n| n * 1e-3);
    let rows: Vec<String> = (0..3)
        .map(|r| {
            (0..3).map(|c| format!("{:.9} ", turn.row(r)[c] + noise[3 * r + c])).collect::<String>() + "0\n"
        })
        .collect();
    let text = rows.concat() + "0 0 0 1\n";
    let found = poses(&text).unwrap()[0].pose.world_to_camera.matrix3;
    let off = (found * found.transpose() - DMat3::IDENTITY).to_cols_array();
    assert!(off.iter().all(|o| o.abs() < 1e-14), "{off:?}");
    assert!((found.determinant() - 1.0).abs() < 1e-14);
    // The nearest rotation is no farther than the noise, √(Σ n²) = 1.02e-3, from the matrix, so at most twice that from the turn.
    let moved = (found.transpose() - turn).to_cols_array().iter().map(|o| o * o).sum::<f64>().sqrt();
    assert!(moved < 2.1e-3, "{moved}");
}

#[test]
fn poses_that_are_none() {
    let rest = "0 0 0 1\n";
    let of = |first: &str| poses(&format!("# a\n{first}\n0 1 0 0\n0 0 1 0\n{rest}"));
    assert!(of("1 0 0 0").is_ok());
    refused(of("nan 0 0 0"), &["line 2", "\"nan\"", "finite"]);
    refused(of("1 0 0 INF"), &["line 2", "\"INF\""]);
    refused(of("-1.#IND 0 0 0"), &["line 2", "is no finite number"]);
    refused(of("1.01 0 0 0"), &["line 2", "no rotation", "1.0100"]);
    refused(of("1 0.01 0 0"), &["line 2", "off the identity"]);
    refused(of("0 0 0 0"), &["line 2", "no rotation"]);
    refused(of("-1 0 0 0"), &["line 2", "mirrors"]);
    refused(of("1 0 0"), &["line 2", "between 1 and 0"]);
    refused(of("1 0 0 0 0"), &["line 2", "5 numbers"]);
    refused(poses("1 0 0 0\n0 1 0 0\n0 0 1\n"), &["line 3", "3 numbers"]);
    refused(poses("1 0 0 0\n0 1 0 0\n0 0 1 0\n"), &["after 3 of four lines"]);
    refused(poses("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 2\n"), &["line 4", "0 0 0 1"]);
    refused(poses("0 1 5\n1 0 0 0\n"), &["line 1", "between 0 and 1"]);
    refused(poses("0.5 0.5 1\n1 0 0 0\n"), &["line 1", "number of a frame"]);
    refused(poses("0 0 1\n"), &["line 1", "ends here"]);
    refused(poses("1 0 0 0 0 0 0 1.01\n"), &["line 1", "length 1.01"]);
    refused(poses("1 0 0 0 0 0 0 1\n1 0 0 0\n"), &["line 2", "begin with 8"]);
    refused(poses("# nothing\n\n"), &["at least one"]);
}

#[test]
fn intrinsics_of_open3d() {
    let read = |text: &str| read_intrinsics(Folder::new().write("camera.json", text));
    let (size, found) = read(&camera("525, 0, 0, 0, 520, 0, 319.5, 239.5, 1")).unwrap();
    assert_eq!((size, found.focal, found.center), ([640, 480], dvec2(525.0, 520.0), dvec2(320.0, 240.0)));
    let marked = format!("\u{feff}{}", camera("525, 0, 0, 0, 520, 0, 319.5, 239.5, 1"));
    assert_eq!(read(&marked).unwrap(), (size, found));
    refused(read(&camera("525,0,319.5,0,525,239.5,0,0,1")), &["intrinsic_matrix", "column by column"]);
    refused(read(&camera("525,0,0,2,525,0,1,1,1")), &["skew is 2"]);
    refused(read(&camera("525,0,0,0,-525,0,1,1,1")), &["above 0"]);
    refused(read(&camera("1,2,3")), &["line 1", "PinholeCameraIntrinsic"]);
    refused(read("{\"width\": 0, \"height\": 1, \"intrinsic_matrix\": [1,0,0,0,1,0,0,0,1]}"), &["0 and 1"]);
    refused(read("{}"), &["width"]);
}

/// What opened keeps its promises.
fn check(folder: &Folder, bytes: &[u8]) {
    let path = folder.write("a", bytes);
    // Six pixels, or a few hundred, need less.
    let max_memory = 1 << 20;
    let disparity = DepthEncoding::Disparity { baseline_focal: 1.0, offset: -3.0, scale: 1.0 };
    if let Ok(map) = read_depth(&path, &disparity, max_memory) {
        assert_eq!(map.depths.len(), map.size[0] * map.size[1]);
        assert!(map.depths.iter().all(|depth| depth.is_finite() && *depth >= 0.0));
    }
    if let Ok(picture) = read_color(&path, max_memory) {
        assert_eq!(picture.colors.len(), picture.size[0] * picture.size[1]);
        assert!(picture.colors.iter().flatten().all(|c| c.is_finite()));
    }
}

#[test]
fn broken_pictures() {
    let folder = Folder::new();
    for bytes in pictures() {
        broken(&bytes, |bytes| check(&folder, bytes));
    }
}

#[test]
fn broken_texts() {
    let folder = Folder::new();
    for bytes in texts() {
        broken(&bytes, |bytes| {
            let path = folder.write("a", bytes);
            for TimedPose { pose, .. } in read_poses(&path).unwrap_or_default() {
                assert!(pose.world_to_camera.is_finite());
                assert!((pose.world_to_camera.matrix3.determinant() - 1.0).abs() < 1e-12);
            }
            if let Ok((_, intrinsics)) = read_intrinsics(&path) {
                assert!(intrinsics.focal.is_finite() && intrinsics.center.is_finite());
            }
        });
    }
}
