//! Files that others wrote. Without `OBLATE_DATA` or `../shared/data` these tests skip, unless
//! `OBLATE_REQUIRE_DATA=1`.

use crate::common::{Folder, irregular, mesh, points, refused, splats, volume};
use glam::{DAffine3, DMat3, DVec2, DVec3, Vec3};
use oblate_engine::color::linear_to_srgb;
use oblate_engine::{Blend, Intrinsics, OpacityFilter, Splats, Strength};
use oblate_importers::depth::{
    DepthEncoding, DepthMap, Stamp, read_color, read_depth, read_intrinsics, read_poses,
};
use oblate_importers::{Content, Endian, OpenOptions, RawLayout, SampleType, open};
use oblate_surfels::{Mesh, Primitive};
use oblate_volumes::{GridFrame, Partition, Residual, Space, Volume, Voxels};
use std::io::Read;
use std::path::PathBuf;

fn data(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("OBLATE_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")),
        PathBuf::from,
    );
    let path = root.join(name);
    if path.exists() {
        return Some(path);
    }
    let required = std::env::var_os("OBLATE_REQUIRE_DATA").is_some_and(|value| value == "1");
    assert!(!required, "{} is required", path.display());
    println!("skipped: {} is not there", path.display());
    None
}

fn open_volume(name: &str) -> Option<Volume> {
    data(name).map(|path| volume(open(path, &OpenOptions::default())))
}

fn open_mesh(name: &str) -> Option<Mesh> {
    data(name).map(|path| mesh(open(path, &OpenOptions::default())))
}

fn only(mesh: Option<Mesh>) -> Option<Primitive> {
    let mut mesh = mesh?;
    assert_eq!(mesh.primitives.len(), 1);
    mesh.primitives.pop()
}

fn range(volume: &Volume) -> (f32, f32) {
    let values = (0..volume.voxels().len()).map(|i| volume.voxels().get(i));
    values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

fn bounds(primitive: &Primitive) -> (Vec3, Vec3) {
    let fold = |f: fn(Vec3, Vec3) -> Vec3| primitive.positions.iter().copied().reduce(f).unwrap();
    (fold(Vec3::min), fold(Vec3::max))
}

#[test]
fn engine_is_the_same_through_two_formats() {
    let Some(vti) = open_volume("volumes/engine.vti") else { return };
    let Some(raw) = open_volume("volumes/engine_256x256x128_uint8.raw.gz") else { return };
    assert_eq!(vti.dims(), [256, 256, 128]);
    assert_eq!(range(&vti), (0.0, 255.0));
    assert!(vti == raw, "voxels and frame should be equal");
}

#[test]
fn raw_gzip_by_name() {
    for name in ["aneurism", "bonsai"] {
        let Some(volume) = open_volume(&format!("volumes/{name}_256x256x256_uint8.raw.gz")) else { return };
        assert_eq!(volume.dims(), [256; 3]);
        assert_eq!(range(&volume), (0.0, 255.0));
    }
}

#[test]
fn head_is_big_endian() {
    let Some(path) = data("volumes/CThead_256x256x113_uint16be.raw.gz") else { return };
    let spacing = DVec3::new(1.0, 1.0, 2.0);
    let head = volume(open(path, &OpenOptions { spacing: Some(spacing), ..OpenOptions::default() }));
    assert_eq!(head.dims(), [256, 256, 113]);
    assert!(matches!(head.voxels(), Voxels::U16(_)));
    assert_eq!(range(&head), (0.0, 3272.0));
    assert_eq!(head.frame().spacing, spacing);
}

/// Density of two flows and what a solver left of a room's air, as grids of hexahedra.
#[test]
fn irregular_grids() {
    for (name, dims, range) in [
        ("bluntfinxyz.bin", [40, 32, 32], [0.1926, 4.9775]),
        ("bluntfinq.bin", [40, 32, 32], [0.1926, 4.9775]),
        ("combxyz.bin", [57, 33, 25], [0.197_813_1, 0.710_419_24]),
        ("office.binary.vtk", [21, 20, 20], [-3.869_559, 0.718_560_3]),
    ] {
        let Some(path) = data(&format!("irregular/{name}")) else { return };
        let volume = irregular(open(path, &OpenOptions::default()));
        assert_eq!(volume.samples().dims(), dims, "{name}");
        assert_eq!(volume.samples().value_range(), Some(range), "{name}");
        let Residual { range, rms, before } = Partition::new(&volume).residual();
        println!(
            "{name}: kernels add up to {range:.3?}, rms {rms:.4}; before {:.3?}, rms {:.4}",
            before.0, before.1
        );
        assert!(rms < 0.2 * before.1, "{name}");
    }
}

/// As the data set is handed out: 113 files of one slice.
#[test]
fn head_in_slices_is_the_same() {
    let Some(path) = data("volumes/CThead_256x256x113_uint16be.raw.gz") else { return };
    let head = volume(open(&path, &OpenOptions::default()));
    let folder = Folder::new();
    let mut bytes = Vec::new();
    flate2::read::GzDecoder::new(&std::fs::read(path).unwrap()[..]).read_to_end(&mut bytes).unwrap();
    for (index, slice) in bytes.chunks(2 * 256 * 256).enumerate() {
        folder.write(&format!("CThead.{}", index + 1), slice);
    }
    let layout = RawLayout { dims: [256, 256, 1], sample_type: SampleType::U16, endian: Endian::Big };
    let options = OpenOptions { raw: Some(layout), ..OpenOptions::default() };
    assert!(volume(open(folder.path(), &options)) == head, "voxels and frame should be equal");
}

#[test]
fn tooth_is_nrrd() {
    let Some(tooth) = open_volume("volumes/tooth.nrrd") else { return };
    assert_eq!(tooth.dims(), [103, 94, 161]);
    assert!(matches!(tooth.voxels(), Voxels::U8(_)));
    assert_eq!(tooth.frame(), GridFrame { space: Some(Space::Lps), ..GridFrame::default() });
    // The file's first bytes of samples, as a hex dump shows them behind the header of 300 bytes.
    let bytes = std::fs::read(data("volumes/tooth.nrrd").unwrap()).unwrap();
    assert_eq!(tooth.voxels().len() + 300, bytes.len());
    assert_eq!(tooth.value([102, 93, 160]), f32::from(*bytes.last().unwrap()));
}

#[test]
fn chest_is_inline_zlib() {
    let Some(chest) = open_volume("volumes/LIDC2.vti") else { return };
    assert_eq!(chest.dims(), [256, 256, 133]);
    assert_eq!(chest.frame().spacing, DVec3::new(1.40625, 1.40625, 2.5));
    assert_eq!(range(&chest), (0.0, 255.0));
}

#[test]
fn head_is_nifti() {
    let Some(head) = open_volume("volumes/mricron_ch2better.nii.gz") else { return };
    assert_eq!(head.dims(), [301, 370, 316]);
    assert!(matches!(head.voxels(), Voxels::U8(_)));
    assert_eq!(range(&head), (0.0, 130.0));
    assert_eq!(head.frame().spacing, DVec3::splat(0.5));
    assert_eq!(head.frame().origin, DVec3::new(-75.0, -107.0, -69.5));
    assert_eq!(head.frame().direction, glam::DMat3::IDENTITY);
    // What nibabel reads.
    assert_eq!((head.value([150, 185, 158]), head.value([100, 200, 150])), (62.0, 103.0));
    let Voxels::U8(values) = head.voxels() else { unreachable!() };
    assert_eq!(values.iter().map(|&v| u64::from(v)).sum::<u64>(), 1_222_013_263);
}

#[test]
fn hydrogen_is_f32() {
    let Some(hydrogen) = open_volume("volumes/vtk_hydrogen.vti") else { return };
    assert_eq!(hydrogen.dims(), [64; 3]);
    assert!(matches!(hydrogen.voxels(), Voxels::F32(_)));
    // RangeMin and RangeMax of the file.
    assert_eq!(range(&hydrogen), (0.0, 1.0));
}

#[test]
fn ply_meshes() {
    if let Some(bunny) = only(open_mesh("meshes/bunny.ply")) {
        assert_eq!((bunny.positions.len(), bunny.triangles.len()), (35947, 69451));
        let (low, high) = bounds(&bunny);
        // The scan is 15 to 16 cm tall and stands on y = 0.033.
        assert!((high.y - low.y - 0.154).abs() < 0.001 && (low.y - 0.033).abs() < 0.001, "{low} {high}");
    }
    if let Some(lucy) = only(open_mesh("meshes/lucy.ply")) {
        assert_eq!((lucy.positions.len(), lucy.triangles.len()), (49987, 99970));
    }
}

#[test]
fn obj_meshes() {
    if let Some(armadillo) = only(open_mesh("meshes/armadillo.obj")) {
        assert_eq!((armadillo.positions.len(), armadillo.triangles.len()), (43243, 86482));
        // The file's first vertex; positions come in the order in which faces use them.
        assert!(armadillo.positions.contains(&Vec3::new(-0.354446, 0.351858, 0.219842)));
    }
    if let Some(fuze) = only(open_mesh("meshes/fuze_wood/fuze.obj")) {
        assert_eq!(fuze.triangles.len(), 1000);
        assert!(fuze.normals.is_some() && fuze.tex_coords.is_some());
        let texture = fuze.material.texture.expect("fuze has a texture");
        assert_eq!((texture.width, texture.height), (1024, 1024));
        // Tr 1.0 beside it does not make the bottle invisible.
        assert_eq!(fuze.material.factor, glam::Vec4::ONE);
    }
}

#[test]
fn spot_takes_the_texture_that_it_is_given() {
    let (Some(path), Some(image)) =
        (data("meshes/spot/spot_triangulated.obj"), data("meshes/spot/spot_texture.png"))
    else {
        return;
    };
    let options = OpenOptions { texture: Some(image), ..OpenOptions::default() };
    let spot = only(Some(mesh(open(&path, &options)))).unwrap();
    assert_eq!(spot.triangles.len(), 5856);
    // 3225 texture coordinates for 2930 vertices: each corner that differs is a position of its own.
    assert_eq!(spot.positions.len(), 3225);
    assert!(spot.material.texture.is_some());
    let quads = only(open_mesh("meshes/spot/spot_quadrangulated.obj")).unwrap();
    assert_eq!(quads.triangles.len(), 2 * 2928);
    assert!(quads.material.texture.is_none());
}

#[test]
fn binary_gltf() {
    if let Some(helmet) = only(open_mesh("meshes/DamagedHelmet.glb")) {
        assert_eq!((helmet.positions.len(), helmet.triangles.len()), (14556, 15452));
        assert!(helmet.normals.is_some() && helmet.tex_coords.is_some());
        let texture = helmet.material.texture.as_ref().expect("the helmet has a texture");
        assert_eq!((texture.width, texture.height), (2048, 2048));
    }
    if let Some(duck) = only(open_mesh("meshes/Duck.glb")) {
        assert_eq!((duck.positions.len(), duck.triangles.len()), (2399, 4212));
        let texture = duck.material.texture.as_ref().expect("the duck has a texture");
        assert_eq!((texture.width, texture.height), (512, 512));
        // Its root node scales by a hundredth.
        assert!((duck.primitive_to_mesh.matrix3.x_axis.length() - 0.01).abs() < 1e-6);
    }
}

fn open_splats(name: &str, level: Option<u32>) -> Option<Splats> {
    data(name).map(|path| splats(open(path, &OpenOptions { level, ..OpenOptions::default() })))
}

/// The mean and the standard deviation of numbers.
fn spread(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / count;
    (mean, (values.map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt())
}

fn opacities(splats: &Splats) -> &[f32] {
    let Strength::Opacity { peaks, .. } = &splats.strength else { panic!("opacities are expected") };
    peaks
}

#[test]
fn biker_stands_as_its_ply_does() {
    let Some(biker) = open_splats("splats/biker.spz", None) else { return };
    assert_eq!(biker.centers.len(), 152_746);
    let low = biker.centers.iter().copied().reduce(Vec3::min).unwrap();
    let high = biker.centers.iter().copied().reduce(Vec3::max).unwrap();
    // From biker.compressed.ply, unpacked by hand in double precision; its steps are below a thousandth, those of
    // .spz 1/4096. y is down: the wheels are at 0.
    let expected = [Vec3::new(-0.621_256, -3.180_076, -0.532_257), Vec3::new(0.414_404, 0.0, 0.613_281)];
    assert!(low.abs_diff_eq(expected[0], 1e-3) && high.abs_diff_eq(expected[1], 1e-3), "{low} {high}");
    let columns = [(-0.048_573, 0.195_885), (-1.605_046, 0.807_815), (0.002_286, 0.297_980)];
    for (axis, (mean, deviation)) in columns.into_iter().enumerate() {
        let found = spread(biker.centers.iter().map(|center| f64::from(center[axis])));
        assert!((found.0 - mean).abs() < 1e-4 && (found.1 - deviation).abs() < 1e-4, "{axis}: {found:?}");
    }
    // Both files have the same 8 bits.
    let mean = opacities(&biker).iter().map(|opacity| f64::from(*opacity)).sum::<f64>() / 152_746.0;
    assert!((mean - 0.296_625).abs() < 1e-6, "{mean}");
}

#[test]
fn small_spz_and_ksplat() {
    // At x and z of −1 or 0, in the later versions 1 or 0, on the file's axes, of which z turns.
    for (name, z) in [("raw", 2.0), ("v2", 2.0), ("v3", -2.0), ("v4", -2.0)] {
        let Some(splats) = open_splats(&format!("splats/fixtures/minimal-{name}.spz"), None) else { return };
        assert_eq!(splats.centers.len(), 4, "{name}");
        assert_eq!(splats.centers.iter().copied().sum::<Vec3>(), Vec3::new(-2.0, 0.0, z), "{name}");
        assert!(opacities(&splats).iter().all(|opacity| (opacity - 0.9).abs() < 0.01), "{name}");
    }
    let Some(ksplat) = open_splats("splats/fixtures/minimal.ksplat", None) else { return };
    assert_eq!(ksplat.centers.iter().copied().sum::<Vec3>(), Vec3::new(-2.0, 0.0, -2.0));
    assert!(ksplat.shapes.factor(0).x_axis.abs_diff_eq(Vec3::new(-0.1, 0.0, 0.0), 1e-6));
}

#[test]
fn playbot_in_all_its_levels() {
    let counts = [500_000, 250_000, 125_000, 31_000, 8406, 3000, 1873];
    let mut finest = None;
    for (level, count) in counts.into_iter().enumerate() {
        let Some(path) = data("splats/playbot/lod-meta.json") else { return };
        let options = OpenOptions { level: Some(level as u32), ..OpenOptions::default() };
        let opened = open(path, &options).unwrap();
        let note = format!("left out: the other 6 of 7 levels of detail; this is {level}");
        assert_eq!(opened.notes.iter().map(ToString::to_string).collect::<Vec<_>>(), [note]);
        let whole = splats(Ok(opened));
        assert_eq!(whole.centers.len(), count);
        if level > 2 {
            let alone = open_splats(&format!("splats/playbot/{level}_0/meta.json"), None).unwrap();
            assert!(alone == whole, "the tree has all of level {level}");
        }
        let low = whole.centers.iter().copied().reduce(Vec3::min).unwrap();
        let high = whole.centers.iter().copied().reduce(Vec3::max).unwrap();
        let (low_finest, high_finest) = *finest.get_or_insert((low, high));
        // Some 2 units in size.
        assert!(
            low.abs_diff_eq(low_finest, 0.08) && high.abs_diff_eq(high_finest, 0.08),
            "{level}: {low} {high}"
        );
        let opaque = opacities(&whole).iter().filter(|opacity| **opacity > 0.1).count();
        assert!(
            opaque > count / 3 && opacities(&whole).iter().any(|opacity| *opacity > 0.9),
            "{opaque} of {count}"
        );
        // The bounds that lod-meta.json gives, of the splats with their σ, are some wider.
        assert!(low.min_element() > -1.084 && high.max_element() < 1.043, "{level}: {low} {high}");
    }
}

#[test]
fn levels_that_are_not_there() {
    let Some(path) = data("splats/playbot/lod-meta.json") else { return };
    let options = OpenOptions { level: Some(7), ..OpenOptions::default() };
    refused(open(path, &options), "lod-meta.json", &["no level 7", "there are 7, of which 0 is the finest"]);
}

#[test]
fn packed_splats() {
    let Some(path) = data("splats/biker.compressed.ply") else { return };
    let opened = open(path, &OpenOptions::default()).unwrap();
    assert_eq!(opened.notes, []);
    let Content::Splats { splats, blend: Blend::Display, .. } = opened.content else {
        panic!("splats are expected")
    };
    let count = 152_746;
    assert_eq!(splats.centers.len(), count);
    assert!(splats.harmonics.is_none());
    let Strength::Opacity { peaks, filter: OpacityFilter::Classic, .. } = &splats.strength else {
        panic!("opacities are expected")
    };
    let fold = |f: fn(Vec3, Vec3) -> Vec3| splats.centers.iter().copied().reduce(f).unwrap();
    let (low, high) = (fold(Vec3::min), fold(Vec3::max));
    // Computed from the file's bytes by a program that shares nothing with the reader; y points down.
    let close = |found: Vec3, x: f32, y: f32, z: f32| found.abs_diff_eq(Vec3::new(x, y, z), 1e-5);
    assert!(close(low, -0.621_256, -3.180_076, -0.532_257), "{low}");
    assert!(close(high, 0.414_404, 0.0, 0.613_281), "{high}");
    let mean =
        |value: &dyn Fn(usize) -> f32| (0..count).map(|i| f64::from(value(i))).sum::<f64>() / count as f64;
    let center = Vec3::from([0, 1, 2].map(|axis| mean(&|i| splats.centers[i][axis]) as f32));
    assert!(close(center, -0.048_573, -1.605_046, 0.002_286), "{center}");
    let sigma =
        Vec3::from([0, 1, 2].map(|axis| mean(&|i| splats.shapes.factor(i).col(axis).length()) as f32));
    assert!(close(sigma, 0.005_239, 0.010_744, 0.005_766), "{sigma}");
    let (peak, red) = (mean(&|i| peaks[i]), mean(&|i| linear_to_srgb(splats.colors[i][0])));
    assert!((peak - 0.296_625).abs() < 1e-5 && (red - 0.318_888).abs() < 1e-5, "{peak} {red}");
}

#[test]
fn splats_of_a_grid() {
    let Some(path) = data("splats/fixtures/minimal.splat") else { return };
    let splats = splats(open(path, &OpenOptions::default()));
    // As a hex dump shows them: a square of σ = 0.1 in y = 0.
    let corners = [[-1.0, 0.0, -1.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]];
    assert_eq!(splats.centers, corners.map(Vec3::from));
    for index in 0..4 {
        let factor = splats.shapes.factor(index);
        let covariance = factor * factor.transpose();
        assert!(covariance.abs_diff_eq(glam::Mat3::from_diagonal(Vec3::splat(0.01)), 1e-8), "{covariance}");
    }
    let Strength::Opacity { peaks, .. } = &splats.strength else { panic!("opacities are expected") };
    assert_eq!(peaks[..], [230.0 / 255.0; 4]);
}

/// Counts, ranges and sums of intensities of two scans as another reader has them.
#[test]
fn laser_scans() {
    for (name, count, intensities, [low, high]) in [
        (
            "pointclouds/autzen_trim.las",
            110_000,
            11_220_547.0,
            [DVec3::new(636_001.76, 848_935.20, 406.26), DVec3::new(637_179.22, 849_497.90, 520.51)],
        ),
        (
            "pointclouds/lone-star.laz",
            518_862,
            562_919_835.0,
            [
                DVec3::new(515_368.602_25, 4_918_340.364, 2_322.896_25),
                DVec3::new(515_401.043, 4_918_381.123_75, 2_338.575_5),
            ],
        ),
    ] {
        let Some(path) = data(name) else { continue };
        let cloud = points(open(path, &OpenOptions::default()));
        assert_eq!(cloud.positions.len(), count, "{name}");
        let place = |position: &Vec3| cloud.origin + position.as_dvec3();
        let found_low = cloud.positions.iter().map(place).reduce(DVec3::min).unwrap();
        let found_high = cloud.positions.iter().map(place).reduce(DVec3::max).unwrap();
        // Positions are up to 1200 units from the origin: they are rounded by 6e-5.
        assert!((found_low - low).abs().max_element() < 1e-4, "{name}: {found_low}");
        assert!((found_high - high).abs().max_element() < 1e-4, "{name}: {found_high}");
        let sum = cloud.intensities.iter().flatten().map(|&intensity| f64::from(intensity)).sum::<f64>();
        assert_eq!(sum, intensities, "{name}");
        assert_eq!(cloud.colors.is_some(), name.ends_with("las"));
    }
}

fn depth_map(name: &str, encoding: &DepthEncoding) -> Option<DepthMap> {
    data(&format!("rgbd/{name}")).map(|path| read_depth(path, encoding, OpenOptions::MAX_MEMORY).unwrap())
}

/// Columns, rows, largest depth, unknown ones and the sum: what Python's own decoding of the same files gives.
#[test]
fn depth_maps() {
    let units = DepthEncoding::Units;
    for (name, encoding, largest, unknown, sum) in [
        ("open3d_livingroom/depth/00000.png", DepthEncoding::Auto, 2.702, 40071, 479_199.333),
        ("7scenes/frame-000000.depth.png", DepthEncoding::Auto, 3.493, 33257, 526_822.367),
        ("open3d_livingroom/other_formats/TUM_depth.png", units(1.0 / 5000.0), 9.331, 58950, 614_943.263),
        ("open3d_livingroom/other_formats/SUN_depth.png", DepthEncoding::SunRgbd, 9.870, 56012, 794_985.691),
    ] {
        let Some(map) = depth_map(name, &encoding) else { return };
        assert_eq!(map.size, [640, 480], "{name}");
        assert_eq!(map.depths.iter().filter(|depth| **depth == 0.0).count(), unknown, "{name}");
        assert_eq!(map.depths.iter().copied().fold(0.0, f32::max), largest, "{name}");
        // Each depth is rounded by at most half a unit in the 24th binary digit.
        let found: f64 = map.depths.iter().map(|depth| f64::from(*depth)).sum();
        assert!((found - sum).abs() < 6e-8 * sum, "{name}: {found}");
    }
    let Some(map) = depth_map("open3d_livingroom/other_formats/NYU_depth.pgm", &DepthEncoding::NyuRaw) else {
        return;
    };
    // 839 is the least that the Kinect measured, 1000 a depth of 3.8 metres; a map read in the wrong order has most pixels nearer than a metre.
    let known: Vec<f32> = map.depths.iter().copied().filter(|depth| *depth > 0.0).collect();
    assert_eq!(known.iter().copied().fold(f32::INFINITY, f32::min), (351.3 / 253.5) as f32);
    assert!(
        known.len() > 200_000 && known.iter().filter(|depth| **depth < 10.0).count() > known.len() * 99 / 100
    );
}

#[test]
fn photographs() {
    for (name, size, pixel, srgb) in [
        ("open3d_livingroom/other_formats/TUM_color.png", [640, 480], 240 * 640 + 320, [252, 252, 250]),
        ("open3d_livingroom/other_formats/NYU_color.ppm", [640, 480], 240 * 640 + 320, [98, 102, 112]),
        ("middlebury2003_teddy/im2.png", [450, 375], 187 * 450 + 225, [217, 211, 200]),
    ] {
        let Some(path) = data(&format!("rgbd/{name}")) else { return };
        let picture = read_color(path, OpenOptions::MAX_MEMORY).unwrap();
        assert_eq!((picture.size, picture.notes), (size, vec![]), "{name}");
        let found = picture.colors[pixel].map(|c| (255.0 * linear_to_srgb(c)).round());
        assert_eq!(found, srgb.map(|c| c as f32), "{name}");
    }
    for name in ["other_formats/SUN_color.jpg", "color/00000.jpg"] {
        let Some(path) = data(&format!("rgbd/open3d_livingroom/{name}")) else { return };
        assert_eq!(read_color(path, OpenOptions::MAX_MEMORY).unwrap().size, [640, 480], "{name}");
    }
}

/// A pixel that one camera sees has, in the other picture, the same disparity where it is not hidden.
#[test]
fn disparities_of_two_cameras_agree() {
    let encoding = DepthEncoding::Disparity { baseline_focal: 1.0, offset: 0.0, scale: 4.0 };
    let Some(left) = depth_map("middlebury2003_teddy/disp2.pgm", &encoding) else { return };
    let Some(right) = depth_map("middlebury2003_teddy/disp6.pgm", &encoding) else { return };
    assert_eq!((left.size, left.depths[0]), ([450, 375], (4.0_f64 / 89.0) as f32));
    assert_eq!(left.depths.iter().filter(|depth| **depth == 0.0).count(), 3406);
    let (mut compared, mut agreeing) = (0, 0);
    for (index, depth) in left.depths.iter().enumerate().filter(|(_, depth)| **depth > 0.0) {
        let disparity = 1.0 / depth;
        let column = (index % 450) as f32 - disparity;
        if column >= 0.0 {
            let other = right.depths[index - index % 450 + column.round() as usize];
            compared += 1;
            agreeing += usize::from((1.0 / other - disparity).abs() <= 1.0);
        }
    }
    println!("{agreeing} of {compared} disparities agree");
    assert!(agreeing * 10 > compared * 8);
}

/// What one camera sees lies, by both poses and the intrinsics, where another camera sees it: half a second apart, so that little is hidden.
#[test]
fn depths_of_two_poses_agree() {
    let scenes = Intrinsics { focal: DVec2::splat(585.0), center: DVec2::new(320.5, 240.5) };
    let Some(camera) = data("rgbd/open3d_livingroom/camera_primesense.json") else { return };
    let (size, room) = read_intrinsics(camera).unwrap();
    assert_eq!((size, room.focal, room.center), ([640, 480], DVec2::splat(525.0), DVec2::new(320.0, 240.0)));
    let Some(log) = data("rgbd/open3d_livingroom/trajectory.log") else { return };
    let log = read_poses(log).unwrap();
    assert!(log.iter().enumerate().all(|(index, timed)| timed.stamp == Stamp::Frame(index as u64)));
    let scene = |frame: &str| {
        let path = data(&format!("rgbd/7scenes/frame-{frame}.pose.txt"))?;
        Some(read_poses(path).unwrap()[0].pose)
    };
    let Some((first, second)) = scene("000000").zip(scene("000020")) else { return };
    let png = |frame: &str| format!("7scenes/frame-{frame}.depth.png");
    for (names, poses, intrinsics) in [
        ([png("000000"), png("000020")], [first, second], scenes),
        (
            [0, 4].map(|frame| format!("open3d_livingroom/depth/0000{frame}.png")),
            [log[0].pose, log[4].pose],
            room,
        ),
    ] {
        let [Some(from), Some(to)] = names.each_ref().map(|name| depth_map(name, &DepthEncoding::Auto))
        else {
            return;
        };
        let motion = poses[1].world_to_camera * poses[0].world_to_camera.inverse();
        let agree = |motion: DAffine3| {
            let (mut compared, mut agreeing) = (0_usize, 0_usize);
            for (index, depth) in from.depths.iter().enumerate().filter(|(_, depth)| **depth > 0.0) {
                let pixel = DVec2::new((index % 640) as f64, (index / 640) as f64) + 0.5;
                let ray = ((pixel - intrinsics.center) / intrinsics.focal).extend(1.0);
                let point = motion.transform_point3(ray * f64::from(*depth));
                let place = (point.truncate() / point.z * intrinsics.focal + intrinsics.center).floor();
                if point.z > 0.0
                    && place.cmpge(DVec2::ZERO).all()
                    && place.cmplt(DVec2::new(640.0, 480.0)).all()
                {
                    let there = f64::from(to.depths[place.y as usize * 640 + place.x as usize]);
                    if there > 0.0 {
                        compared += 1;
                        agreeing += usize::from((there - point.z).abs() < 0.01 * there);
                    }
                }
            }
            agreeing as f64 / compared as f64
        };
        let (moved, unmoved) = (agree(motion), agree(DAffine3::IDENTITY));
        println!("{}: {moved:.3} of the depths agree within 1 %, {unmoved:.3} without the motion", names[1]);
        assert!(moved > 0.8 && moved > unmoved);
    }
}

/// Positions are near each other in time, and all are rigid.
#[test]
fn every_pose_is_rigid() {
    let Some(folder) = data("rgbd/7scenes") else { return };
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let files: Vec<PathBuf> = files.filter(|path| path.to_string_lossy().ends_with(".pose.txt")).collect();
    assert!(files.len() > 50);
    for path in files {
        let poses = read_poses(&path).unwrap();
        assert!(poses.len() == 1 && poses[0].stamp == Stamp::Unsaid, "{}", path.display());
        let matrix = poses[0].pose.world_to_camera.matrix3;
        let off = (matrix.transpose() * matrix - DMat3::IDENTITY).to_cols_array();
        assert!(off.iter().all(|o| o.abs() < 1e-14), "{}", path.display());
    }
    let Some(odometry) = data("rgbd/open3d_livingroom/odometry.log") else { return };
    assert_eq!(read_poses(odometry).unwrap().len(), 5);
}
