use crate::common::{DIMS, Folder, assert_corner_marked, corner_marked, gzip, refused, volume, written};
use glam::DVec3;
use oblate_importers::{Endian, OpenOptions, RawLayout, SampleType, parse_dims};

fn layout(dims: [usize; 3], sample_type: SampleType, endian: Endian) -> OpenOptions {
    OpenOptions { raw: Some(RawLayout { dims, sample_type, endian }), ..OpenOptions::default() }
}

#[test]
fn every_type_in_both_orders_by_option_and_by_name() {
    let folder = Folder::new();
    for written in written() {
        let Ok(sample_type) = written.name.parse::<SampleType>() else { continue };
        for (order, endian, bytes) in
            [("le", Endian::Little, &written.little), ("be", Endian::Big, &written.big)]
        {
            let by_option = folder.open_with("samples", bytes, &layout(DIMS, sample_type, endian));
            let by_option = volume(by_option);
            assert_corner_marked(&by_option);
            assert_eq!(by_option.voxels().type_name(), written.voxel_type);
            let name = format!("marked_4x3x2_{}{order}.raw", written.name);
            assert_eq!(folder.volume(&name, bytes), by_option);
            assert_eq!(folder.volume(&format!("{name}.gz"), gzip(bytes)), by_option);
        }
    }
}

#[test]
fn samples_may_begin_like_gzip() {
    let folder = Folder::new();
    let samples = [0x1f, 0x8b, 8, 0, 5, 6, 7, 8];
    let opened = folder.volume("a_2x2x2_u8.raw", samples);
    assert_eq!(opened.value([0, 0, 0]), 31.0);
    assert_eq!(opened.value([1, 1, 1]), 8.0);
}

#[test]
fn gzip_of_several_members_is_one_volume() {
    let samples = corner_marked();
    let (front, back) = samples.split_at(7);
    let members = [gzip(front), gzip(back)].concat();
    assert_corner_marked(&Folder::new().volume("marked_4x3x2_uint8.raw.gz", members));
}

#[test]
fn spacing_is_the_callers() {
    let spacing = DVec3::new(0.5, 1.0, 2.0);
    let options = OpenOptions { spacing: Some(spacing), ..layout(DIMS, SampleType::U8, Endian::Little) };
    let opened = volume(Folder::new().open_with("head.bin", corner_marked(), &options));
    assert_eq!(opened.frame().spacing, spacing);
    let options = OpenOptions { spacing: Some(-spacing), ..options };
    refused(
        Folder::new().open_with("head.bin", corner_marked(), &options),
        "head.bin",
        &["spacing", "above 0"],
    );
}

#[test]
fn what_is_missing_is_named() {
    let folder = Folder::new();
    folder.refused("head.raw", [7; 24], &["dims", "number type", "head_256x256x113_uint16be"]);
    folder.refused("head_4x3x2.raw", [7; 24], &["give their number type"]);
    folder.refused("head_u8.raw", [7; 24], &["give their dims"]);
    folder.refused("head.raw.gz", gzip(&[7; 24]), &["dims"]);
    folder.refused("mesh.ply.gz", gzip(b"ply\nformat ascii 1.0\n"), &["PLY under gzip", "unpack"]);
    folder.refused("nothing", [], &["not recognised"]);
    let missing = oblate_importers::open("no such file", &OpenOptions::default());
    refused(missing, "no such file", &["cannot be read"]);
}

#[test]
fn sizes_must_fit() {
    let folder = Folder::new();
    for bytes in [&corner_marked()[1..], &[corner_marked(), vec![0]].concat()] {
        folder.refused("a_4x3x2_u8.raw", bytes, &["24", "dims 4x3x2", "u8"]);
        folder.refused("a_4x3x2_u8.raw.gz", gzip(bytes), &["24", "dims 4x3x2", "u8"]);
    }
    // 10^15 voxels in 44 bytes: refused before anything is allocated.
    folder.refused("a_100000x100000x100000_u8.raw.gz", gzip(&[0; 24]), &["cannot hold"]);
    folder.refused("a_100000x100000x100000_u8.raw", [0; 24], &["1000000000000000 are expected"]);
    let huge = layout([usize::MAX; 3], SampleType::F32, Endian::Little);
    refused(folder.open_with("a", [0; 24], &huge), "a", &["more than memory can hold"]);
    let none = layout([4, 0, 2], SampleType::U8, Endian::Little);
    refused(folder.open_with("a", [], &none), "a", &["each must be above 0"]);
    // A gzip bomb stops at the 24 bytes that are expected.
    folder.refused("a_4x3x2_u8.raw.gz", gzip(&vec![0; 10_000_000]), &["more than the 24 bytes"]);
}

#[test]
fn values_that_are_not_finite_are_kept() {
    let bytes: Vec<u8> = [1.0, f32::NAN, f32::INFINITY].iter().flat_map(|v| v.to_le_bytes()).collect();
    let opened = Folder::new().volume("a_3x1x1_f32.raw", bytes);
    assert!(opened.value([1, 0, 0]).is_nan());
    assert_eq!(opened.value([2, 0, 0]), f32::INFINITY);
}

#[test]
fn words_of_layouts() {
    assert_eq!(parse_dims("256x256x113").unwrap(), [256, 256, 113]);
    assert_eq!(parse_dims("256x128").unwrap(), [256, 128, 1]);
    for bad in ["256", "1x2x3x4", "0x1x1", "axbxc", "", "1x-2x3"] {
        assert!(parse_dims(bad).unwrap_err().to_string().contains("256x256x128"), "{bad}");
    }
    for sample_type in [SampleType::U8, SampleType::U16, SampleType::I16, SampleType::F32] {
        assert_eq!(sample_type.to_string().parse(), Ok(sample_type));
    }
    for endian in [Endian::Little, Endian::Big] {
        assert_eq!(endian.to_string().parse(), Ok(endian));
    }
    assert!("u12".parse::<SampleType>().unwrap_err().to_string().contains("u8, u16, i16 or f32"));
    assert!("middle".parse::<Endian>().unwrap_err().to_string().contains("little or big"));
}

#[test]
fn content_counts_before_options_and_names() {
    let folder = Folder::new();
    let options = layout(DIMS, SampleType::U8, Endian::Little);
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    crate::common::mesh(folder.open_with("mesh.raw", ply, &options));
    // OBJ has no fixed beginning: by content when the name says nothing, raw when the caller says raw.
    let obj = "# a triangle\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    crate::common::mesh(folder.open("mesh", obj));
    refused(folder.open_with("mesh", obj, &options), "mesh", &["dims 4x3x2"]);
    // What a name tells is no raw file, though the caller describes raw ones that may stand beside it.
    crate::common::mesh(folder.open_with("mesh.obj", obj, &options));
    let points = folder.open_with("points.asc", "0 0 0\n1 0 0\n0 1 0\n", &options).unwrap();
    assert_eq!(points.format, "XYZ");
}
