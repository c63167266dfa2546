//! SOG, zipped and loose, of both versions, and levels of detail.

use crate::common::{Folder, refused, splats};
use crate::seeds::Seed;
use glam::{Mat3, Vec3};
use image_webp::{ColorType, WebPEncoder};
use oblate_engine::{OpacityFilter, Splats, Strength};
use oblate_importers::{Note, OpenOptions, open};
use std::io::{Cursor, Write};

fn webp(width: u32, texels: &[[u8; 4]]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let height = texels.len() as u32 / width;
    WebPEncoder::new(&mut bytes).encode(texels.as_flattened(), width, height, ColorType::Rgba8).unwrap();
    bytes
}

/// The same without alpha.
fn webp_rgb(width: u32, texels: &[[u8; 4]]) -> Vec<u8> {
    let rgb: Vec<u8> = texels.iter().flat_map(|texel| texel[..3].to_vec()).collect();
    let mut bytes = Vec::new();
    let height = texels.len() as u32 / width;
    WebPEncoder::new(&mut bytes).encode(&rgb, width, height, ColorType::Rgb8).unwrap();
    bytes
}

/// Files of a scene of three splats in images of 2 × 2.
#[derive(Clone)]
struct Scene {
    meta: String,
    means: [Vec<u8>; 2],
    quats: Vec<u8>,
    scales: Vec<u8>,
    sh0: Vec<u8>,
    palette: Option<[Vec<u8>; 2]>,
}

/// Bounds of the logarithms: ln 4 is of 3, so that places are from −3 to 3 and 0 is the middle.
const MEANS: &str = r#""mins": [-1.3862943611198906, -1.3862943611198906, 0],
    "maxs": [1.3862943611198906, 1.3862943611198906, 1.3862943611198906], "files": ["means_l.webp", "means_u.webp"]"#;

/// Byte b of a codebook is (b − 128) / 64.
fn codebook() -> String {
    let entries: Vec<String> = (0..256).map(|b| f64::to_string(&(f64::from(b - 128) / 64.0))).collect();
    format!("[{}]", entries.join(","))
}

impl Scene {
    fn new(version: u8, palette: bool) -> Self {
        let (head, scales, colors, palettes) = if version == 2 {
            let coded = format!("\"codebook\": {}", codebook());
            let palette = format!(
                r#", "shN": {{"count": 65, "bands": 1, {coded}, "files": ["shN_centroids.webp", "shN_labels.webp"]}}"#
            );
            (r#""version": 2, "count": 3,"#, coded.clone(), coded, palette)
        } else {
            let scales = r#""mins": [-2, -2, -2], "maxs": [1.984375, 1.984375, 1.984375]"#.to_owned();
            let colors =
                r#""mins": [-2, -2, -2, -2], "maxs": [1.984375, 1.984375, 1.984375, 1.984375]"#.to_owned();
            let palette = r#", "shN": {"mins": -2, "maxs": 1.984375, "files": ["shN_centroids.webp", "shN_labels.webp"]}"#;
            ("", scales, colors, palette.to_owned())
        };
        let shape = if version == 2 { "" } else { r#""shape": [3, 3],"# };
        let palettes = if palette { palettes } else { String::new() };
        let meta = format!(
            r#"{{{head} "asset": {{"generator": "a test"}}, "means": {{{shape} {MEANS}}},
"scales": {{{scales}, "files": ["scales.webp"]}}, "quats": {{"files": ["quats.webp"]}},
"sh0": {{{colors}, "files": ["sh0.webp"]}}{palettes}}}"#
        );
        // The first at (3, −3, 0), the second where 16 bits say 0x80ff and 0x8000 in x and y, the third at (−3, −3, 3).
        let low = [[255, 0, 0, 255], [255, 0, 0, 255], [0, 0, 255, 255], [0; 4]];
        let high = [[255, 0, 0, 255], [128, 128, 0, 255], [0, 0, 255, 255], [0; 4]];
        // No turn; 180° about x; none, with y the largest of (½, ½, ½, ½): 0.5 √2 of 1 is byte 217.66.
        let quats = [[128, 128, 128, 252], [128, 128, 128, 253], [218, 218, 218, 254], [0; 4]];
        // Log scales 1, 0, −1.
        let scales = [[192, 128, 64, 255]; 4];
        let sh0 = [[192, 128, 64, 255], [128, 128, 128, 51], [128, 128, 128, 128], [0; 4]];
        let palette = palette.then(|| {
            let mut entries = vec![[128, 128, 128, 255]; 192 * 2];
            // Entry 1, second coefficient; entry 64, the first of the second row.
            entries[3 + 1] = [192, 128, 64, 255];
            entries[192] = [128, 160, 128, 255];
            [
                webp_rgb(192, &entries),
                webp(2, &[[1, 0, 0, 255], [64, 0, 0, 255], [0, 0, 0, 255], [9, 9, 9, 9]]),
            ]
        });
        Self {
            meta,
            means: [webp_rgb(2, &low), webp_rgb(2, &high)],
            quats: webp(2, &quats),
            scales: webp_rgb(2, &scales),
            sh0: webp(2, &sh0),
            palette,
        }
    }

    fn with(mut self, from: &str, to: &str) -> Self {
        assert!(self.meta.contains(from), "{from}");
        self.meta = self.meta.replacen(from, to, 1);
        self
    }

    fn images(&self) -> Vec<(&'static str, Vec<u8>)> {
        let [low, high] = self.means.clone();
        let mut images = vec![
            ("means_l.webp", low),
            ("means_u.webp", high),
            ("quats.webp", self.quats.clone()),
            ("scales.webp", self.scales.clone()),
            ("sh0.webp", self.sh0.clone()),
        ];
        if let Some([entries, labels]) = self.palette.clone() {
            images.extend([("shN_centroids.webp", entries), ("shN_labels.webp", labels)]);
        }
        images
    }

    fn zip(&self, method: zip::CompressionMethod) -> Vec<u8> {
        let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let options = zip::write::SimpleFileOptions::default().compression_method(method);
        for (name, bytes) in self.images().into_iter().chain([("meta.json", self.meta.clone().into_bytes())])
        {
            archive.start_file(name, options).unwrap();
            archive.write_all(&bytes).unwrap();
        }
        archive.finish().unwrap().into_inner()
    }

    fn seed(&self) -> Seed {
        Seed { name: "meta.json", bytes: self.meta.clone().into(), beside: self.images() }
    }

    fn open(&self) -> Splats {
        splats(Folder::new().open("a.sog", self.zip(zip::CompressionMethod::Stored)))
    }

    #[track_caller]
    fn refused(&self, parts: &[&str]) {
        Folder::new().refused("a.sog", self.zip(zip::CompressionMethod::Stored), parts);
    }
}

/// A zip file, loose files of version 1 with a short text, levels of detail.
pub(crate) fn examples() -> Vec<Seed> {
    let small = Scene::new(1, false);
    let zipped = small.zip(zip::CompressionMethod::Deflated);
    let zipped = Seed { name: "a.sog", bytes: zipped, beside: Vec::new() };
    let levels = br#"{"lodLevels":2,"environment":null,"filenames":["a.sog"],"tree":{"children":[{"lods":
{"0":{"file":0,"offset":0,"count":2},"1":{"file":0,"offset":1,"count":1}}},{"lods":{"0":{"file":0,"offset":2,"count":1}}}]}}"#;
    let beside = vec![("a.sog", Scene::new(2, true).zip(zip::CompressionMethod::Stored))];
    vec![zipped, Scene::new(1, true).seed(), Seed { name: "lod-meta.json", bytes: levels.to_vec(), beside }]
}

fn at(splats: &Splats, center: Vec3) -> usize {
    let near = |other: &Vec3| other.abs_diff_eq(center, 1e-4);
    splats.centers.iter().position(near).unwrap_or_else(|| panic!("{center} in {:?}", splats.centers))
}

#[test]
fn both_versions_alike() {
    for version in [1, 2] {
        let splats = Scene::new(version, true).open();
        assert_eq!(splats.centers.len(), 3);
        let corner = at(&splats, Vec3::new(3.0, -3.0, 0.0));
        // 33023 and 32768 of 65535, of logarithms from −ln 4 to ln 4.
        let place = |of: f64| f64::exp_m1((of / 65535.0 * 2.0 - 1.0) * 4_f64.ln()) as f32;
        let middle = at(&splats, Vec3::new(place(33023.0), place(32768.0), 0.0));
        let last = at(&splats, Vec3::new(-3.0, -3.0, 3.0));
        // Half a step of a component is √½/255 = 0.0028; an entry of a matrix moves by twice the sum of four components
        // of ½ as much, and half-axes are e long at most.
        let e = std::f32::consts::E;
        let own = Vec3::new(e, 1.0, 1.0 / e);
        let close = |index: usize, turn: Mat3| {
            let factor = splats.shapes.factor(index);
            assert!(factor.abs_diff_eq(turn * Mat3::from_diagonal(own), 0.031), "{factor}");
        };
        close(corner, Mat3::IDENTITY);
        close(middle, Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0)));
        // (½, ½, ½, ½) is a third of a turn: x to y to z to x.
        close(last, Mat3::from_cols(Vec3::Y, Vec3::Z, Vec3::X));
        let Strength::Opacity { peaks, filter, .. } = &splats.strength else { panic!() };
        assert_eq!(*filter, OpacityFilter::Classic);
        let logit = |logit: f32| 1.0 / (1.0 + (-logit).exp());
        let expected =
            if version == 2 { [1.0, 0.2] } else { [logit(1.984_375), logit((51.0 - 128.0) / 64.0)] };
        assert!((peaks[corner] - expected[0]).abs() < 1e-6 && (peaks[middle] - expected[1]).abs() < 1e-6);
        // Coefficients 1, 0, −1: 0.5 ± 0.28209 display-encoded; sRGB's 0.78209 is 0.57337 linear.
        let [r, g, b] = splats.colors[corner];
        let linear = [0.573_37, 0.214_04, 0.038_9];
        assert!([r, g, b].iter().zip(linear).all(|(a, b)| (a - b).abs() < 1e-3), "{r} {g} {b}");
        let harmonics = splats.harmonics.as_ref().unwrap();
        assert_eq!(harmonics.degree, 1);
        let zero = [0.0; 3];
        let of = |index: usize| &harmonics.coefficients[3 * index..][..3];
        let near = |index: usize, expected: [[f32; 3]; 3]| {
            let all = of(index)
                .as_flattened()
                .iter()
                .zip(expected.as_flattened())
                .all(|(a, b)| (a - b).abs() < 1e-5);
            assert!(all, "{:?}", of(index));
        };
        near(corner, [zero, [1.0, 0.0, -1.0], zero]);
        near(middle, [[0.0, 0.5, 0.0], zero, zero]);
        near(last, [zero; 3]);
    }
}

#[test]
fn zipped_and_loose_alike() {
    let scene = Scene::new(2, true);
    let folder = Folder::new();
    for (name, bytes) in scene.images() {
        folder.write(name, bytes);
    }
    let loose = splats(folder.open("meta.json", &scene.meta));
    assert_eq!(loose, scene.open());
    let marked = Scene { meta: format!("\u{feff}{}", scene.meta), ..scene.clone() };
    assert_eq!(splats(folder.open("meta.json", &marked.meta)), loose);
    assert_eq!(marked.open(), loose);
    let deflated = scene.zip(zip::CompressionMethod::Deflated);
    // Content tells, not the name.
    assert_eq!(splats(folder.open("b", deflated)), loose);
}

#[test]
fn models() {
    let filter = |scene: &Scene| {
        let Strength::Opacity { filter, .. } = scene.open().strength else { panic!() };
        filter
    };
    let scene = Scene::new(2, false);
    let model = |text: &str| scene.clone().with(r#""count": 3,"#, &format!(r#""count": 3, {text},"#));
    assert_eq!(filter(&model(r#""model": "antialiased""#)), OpacityFilter::Compensated);
    assert_eq!(filter(&model(r#""antialias": true"#)), OpacityFilter::Compensated);
    assert_eq!(filter(&model(r#""model": "default""#)), OpacityFilter::Classic);
    let flat = model(r#""model": "2dgs""#).open();
    assert!((0..3).all(|i| flat.shapes.factor(i).z_axis == Vec3::ZERO && flat.shapes.factor(i).x_axis != Vec3::ZERO));
    let unknown = model(r#""model": "x""#);
    let opened = Folder::new().open("a.sog", unknown.zip(zip::CompressionMethod::Stored)).unwrap();
    assert!(matches!(&opened.notes[..], [Note::Assumed(what)] if what.contains("\"x\"")));
}

#[test]
fn codebooks_with_gaps() {
    // Without its first entry, which is −2, a codebook continues to −127/64 − 254/64/255.
    let mut scene = Scene::new(2, false).with("[-2,", "[null,");
    scene.scales = webp(2, &[[0, 128, 64, 255]; 4]);
    let opened = Folder::new().open("a.sog", scene.zip(zip::CompressionMethod::Stored)).unwrap();
    assert!(
        matches!(&opened.notes[..], [Note::Assumed(what)] if what.contains("scales")),
        "{:?}",
        opened.notes
    );
    let length = splats(Ok(opened)).shapes.factor(0).x_axis.length();
    assert!((length - (-2.0_f32).exp()).abs() < 1e-4, "{length}");
    // Entries that are not there, and alphas that name no component, are no splats.
    let mut scene = Scene::new(2, false).with(&codebook(), "[0, 0.5]");
    scene.scales = webp(2, &[[1, 1, 1, 255], [2, 1, 1, 255], [1, 1, 1, 255], [1, 1, 1, 255]]);
    scene.quats = webp(2, &[[128, 128, 128, 252], [128, 128, 128, 252], [128, 128, 128, 251], [0; 4]]);
    let opened = Folder::new().open("a.sog", scene.zip(zip::CompressionMethod::Stored)).unwrap();
    let said =
        "2 of 3 splats: 2 with a number that is NaN, infinite or out of its range (the first is splat 1)";
    assert_eq!(opened.notes, [Note::LeftOut(said.into())]);
}

#[test]
fn what_is_refused() {
    let scene = || Scene::new(2, true);
    scene().with("\"version\": 2", "\"version\": 3").refused(&["meta.json", "version 3", "1 and 2"]);
    scene().with("\"count\": 3", "\"number\": 3").refused(&["meta.json", "no count"]);
    scene().with("\"count\": 3", "\"count\": 5").refused(&["means_l.webp", "2 × 2 texels", "5 entries"]);
    scene().with("\"count\": 3", "\"count\": 18446744073709551615").refused(&["means_l.webp"]);
    scene().with("\"count\": 3", "\"count\": 0").refused(&["no splats"]);
    scene().with("\"means\"", "\"mean\"").refused(&["meta.json", "missing field `means`"]);
    scene().with("{", "[").refused(&["meta.json"]);
    scene().with("quats.webp", "gone.webp").refused(&["gone.webp", "not found"]);
    scene().with(&codebook(), "[]").refused(&["scales", "0 entries", "1 to 256"]);
    scene().with("\"codebook\"", "\"book\"").refused(&["scales needs a codebook"]);
    scene().with("\"bands\": 1", "\"bands\": 2").refused(&["degree 2", "192 texels wide"]);
    scene().with("\"bands\": 1", "\"bands\": 4").refused(&["degree 4"]);
    scene().with("\"count\": 65", "\"count\": 129").refused(&["129 entries", "room for 128"]);
    scene().with("\"count\": 65", "\"count\": 64").refused(&["splat 1 has entry 64 of a palette of 64"]);
    Scene::new(1, true).with("\"shape\": [3, 3],", "").refused(&["no means.shape"]);
    Scene::new(1, true).with("\"mins\": [-2, -2, -2]", "\"mins\": [-2]").refused(&["scales", "3 channels"]);
    Scene { quats: crate::common::png(), ..scene() }.refused(&["quats.webp"]);
    let cut = scene().sh0;
    Scene { sh0: cut[..cut.len() - 4].to_vec(), ..scene() }.refused(&["sh0.webp"]);

    let folder = Folder::new();
    folder.refused("a.sog", "PK\x03\x04 not a zip file", &["zip"]);
    let zipped = scene().zip(zip::CompressionMethod::Stored);
    folder.refused("a.sog", &zipped[..zipped.len() - 30], &["zip"]);
    folder.refused("meta.json", &scene().meta, &["means_l.webp", "cannot be read"]);
    let options = OpenOptions { max_memory: 100, ..OpenOptions::default() };
    refused(folder.open_with("a.sog", zipped, &options), "a.sog", &["the limit that is set"]);
    // A black image of 16383 × 16383 in some 50 bytes: 3 GB.
    let mut huge = webp(1, &[[0, 0, 0, 255]]);
    huge[21..25].copy_from_slice(&((16382_u32 << 14 | 16382) | 1 << 28).to_le_bytes());
    let bomb = Scene { scales: huge, ..scene() }.zip(zip::CompressionMethod::Stored);
    let options = OpenOptions { max_memory: 1 << 30, ..OpenOptions::default() };
    refused(folder.open_with("a.sog", bomb, &options), "a.sog", &["scales.webp", "16383 × 16383", "limit"]);
}

#[test]
fn levels_of_detail() {
    let folder = Folder::new();
    let Seed { name, bytes, beside } = examples().remove(2);
    for (name, bytes) in &beside {
        folder.write(name, bytes);
    }
    let text = String::from_utf8(bytes).unwrap();
    let path = folder.write(name, &text);
    let level = |level| open(&path, &OpenOptions { level, ..OpenOptions::default() });
    let finest = level(None).unwrap();
    assert_eq!(finest.notes, [Note::LeftOut("the other 1 of 2 levels of detail; this is 0".into())]);
    assert_eq!(splats(Ok(finest)), Scene::new(2, true).open());
    let coarse = splats(level(Some(1)));
    assert_eq!(coarse.centers.len(), 1);
    assert!(coarse.centers[0].y > 0.0 && coarse.centers[0].y < 0.01, "{}", coarse.centers[0]);
    refused(level(Some(2)), name, &["no level 2", "there are 2"]);
    // An environment belongs to all levels.
    let options = OpenOptions { level: Some(1), ..OpenOptions::default() };
    let with = text.replace("null", "\"a.sog\"");
    assert_eq!(splats(folder.open_with(name, with, &options)).centers.len(), 4);

    let refuse = |from: &str, to: &str, parts: &[&str]| {
        assert!(text.contains(from));
        folder.refused(name, text.replacen(from, to, 1), parts);
    };
    refuse("\"offset\":2", "\"offset\":1", &["two nodes of level 0", "splat 1 of file 0"]);
    refuse("\"offset\":2", "\"offset\":3", &["a.sog has 3 splats", "wants 1 from 3"]);
    refuse("\"count\":2", "\"count\":18446744073709551615", &["level 0"]);
    refuse("\"file\":0", "\"file\":1", &["file 1; there are 1"]);
    refuse("a.sog", "gone.sog", &["gone.sog"]);
    refuse("\"lodLevels\":2", "\"version\":2,\"lodLevels\":2", &["version 2"]);
    refuse("\"tree\"", "\"wood\"", &["tree"]);
    refuse("\"0\"", "\"3\"", &["level 3; there are 2"]);
}
