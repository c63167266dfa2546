use crate::common::{
    DIMS, Folder, assert_corner_marked, assert_corners_at, corner_marked, gzip, refused, volume, written,
};
use glam::DVec3;
use oblate_importers::{Note, OpenOptions, Opened};
use oblate_volumes::Voxels;

/// The fields that the tests write.
#[derive(Clone)]
struct Nifti {
    version: u8,
    big: bool,
    dim: [i64; 8],
    datatype: i16,
    pixdim: [f64; 8],
    vox_offset: f64,
    scale: [f64; 2],
    codes: [i16; 2],
    quatern: [f64; 6],
    srow: [f64; 12],
    samples: Vec<u8>,
}

impl Default for Nifti {
    /// The corner-marked samples as u8, with neither form.
    fn default() -> Self {
        let [x, y, z] = DIMS.map(|dim| dim as i64);
        Self {
            version: 1,
            big: false,
            dim: [3, x, y, z, 1, 1, 1, 1],
            datatype: 2,
            pixdim: [1.0; 8],
            vox_offset: 0.0,
            scale: [0.0; 2],
            codes: [0; 2],
            quatern: [0.0; 6],
            srow: [0.0; 12],
            samples: corner_marked(),
        }
    }
}

impl Nifti {
    /// The file: header, no extensions, samples.
    fn bytes(&self) -> Vec<u8> {
        let second = self.version == 2;
        let mut bytes = vec![0; if second { 544 } else { 352 }];
        let mut put = |at: usize, little: &[u8]| {
            let mut number = little.to_vec();
            if self.big {
                number.reverse();
            }
            bytes[at..at + number.len()].copy_from_slice(&number);
        };
        put(0, &(if second { 540_i32 } else { 348 }).to_le_bytes());
        let float = |value: f64| match second {
            true => value.to_le_bytes().to_vec(),
            false => (value as f32).to_le_bytes().to_vec(),
        };
        let floats = [
            (76, 104, &self.pixdim[..]),
            (112, 176, &self.scale[..]),
            (256, 352, &self.quatern[..]),
            (280, 400, &self.srow[..]),
        ];
        for (first_at, second_at, values) in floats {
            for (i, &value) in values.iter().enumerate() {
                put(if second { second_at + 8 * i } else { first_at + 4 * i }, &float(value));
            }
        }
        for (i, &size) in self.dim.iter().enumerate() {
            match second {
                true => put(16 + 8 * i, &size.to_le_bytes()),
                false => put(40 + 2 * i, &(size as i16).to_le_bytes()),
            }
        }
        put(if second { 12 } else { 70 }, &self.datatype.to_le_bytes());
        for (i, &code) in self.codes.iter().enumerate() {
            match second {
                true => put(344 + 4 * i, &i32::from(code).to_le_bytes()),
                false => put(252 + 2 * i, &code.to_le_bytes()),
            }
        }
        match second {
            true => put(168, &(self.vox_offset as i64).to_le_bytes()),
            false => put(108, &(self.vox_offset as f32).to_le_bytes()),
        }
        match second {
            true => bytes[4..12].copy_from_slice(b"n+2\0\r\n\x1a\n"),
            false => bytes[344..348].copy_from_slice(b"n+1\0"),
        }
        // Extensions, if the offset leaves room.
        bytes.resize(bytes.len().max(self.vox_offset.clamp(0.0, 9999.0) as usize), 0xee);
        bytes.extend(&self.samples);
        bytes
    }
}

/// A file of u8 with both forms.
pub(crate) fn example(version: u8, samples: &[u8]) -> Vec<u8> {
    let srow = [0.0, -2.0, 0.0, 10.0, 1.0, 0.0, 0.0, 20.0, 0.0, 0.0, 3.0, 30.0];
    Nifti { version, codes: [1, 1], srow, samples: samples.to_vec(), ..Nifti::default() }.bytes()
}

/// A NIfTI-1 file as a header and a file of samples.
pub(crate) fn pair(file: &[u8]) -> (Vec<u8>, Vec<u8>) {
    let mut header = file[..348].to_vec();
    header[344..348].copy_from_slice(b"ni1\0");
    (header, file[352..].to_vec())
}

#[track_caller]
fn noted(opened: &Opened) -> String {
    assert_eq!(opened.notes.len(), 1, "{:?}", opened.notes);
    opened.notes[0].to_string()
}

fn datatype(rust: &str) -> i16 {
    match rust {
        "u8" => 2,
        "i16" => 4,
        "i32" => 8,
        "f32" => 16,
        "f64" => 64,
        "i8" => 256,
        "u16" => 512,
        "u32" => 768,
        "i64" => 1024,
        _ => 1280,
    }
}

#[test]
fn every_type_order_version_and_container() {
    let folder = Folder::new();
    for written in written() {
        for (big, samples) in [(false, &written.little), (true, &written.big)] {
            for version in [1, 2] {
                let nifti = Nifti {
                    version,
                    big,
                    datatype: datatype(written.name),
                    samples: samples.clone(),
                    codes: [0, 1],
                    srow: [2.0, 0.0, 0.0, 1.0, 0.0, 3.0, 0.0, 2.0, 0.0, 0.0, 4.0, 3.0],
                    ..Nifti::default()
                };
                let extended = Nifti { vox_offset: 600.0, ..nifti.clone() };
                let files = [
                    ("a.nii", nifti.bytes()),
                    ("a.nii", extended.bytes()),
                    ("a.nii.gz", gzip(&extended.bytes())),
                    ("a", gzip(&nifti.bytes())),
                ];
                for (name, file) in files {
                    let opened = folder.open(name, file);
                    let opened = opened.inspect_err(|_| println!("{} {big} {version} {name}", written.name));
                    assert_eq!(opened.as_ref().unwrap().notes, []);
                    let opened = volume(opened);
                    let steps = [[2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 4.0]];
                    assert_corners_at(&opened, [1.0, 2.0, 3.0], steps);
                    assert_eq!(opened.voxels().type_name(), written.voxel_type);
                }
            }
        }
    }
}

#[test]
fn pairs() {
    let (header, samples) = pair(&example(1, &corner_marked()));
    let folder = Folder::new();
    folder.refused("a.hdr", &header, &["byte 344", "a.img", "cannot be read"]);
    folder.write("a.img.gz", gzip(&samples));
    folder.refused("a.img.gz", gzip(&samples), &["holds the samples of", "a.hdr; open that"]);
    assert_corner_marked(&folder.volume("a.hdr", &header));
    assert_corner_marked(&folder.volume("a.hdr.gz", gzip(&header)));
    folder.write("a.img", &samples);
    assert_corner_marked(&folder.volume("a.hdr", &header));
    folder.write("a.img", &samples[1..]);
    refused(folder.open("a.hdr", &header), "a.img", &["23 bytes; the header needs 24"]);
    folder.refused("b.hdr", [92, 1, 0, 0].repeat(87), &["Analyze 7.5"]);
}

#[test]
fn corners_lie_where_the_header_says() {
    let folder = Folder::new();
    for version in [1, 2] {
        let corners = |nifti: Nifti, origin, steps| {
            let nifti = Nifti { version, ..nifti };
            assert_corners_at(&folder.volume("a.nii", nifti.bytes()), origin, steps);
        };
        // The sform before the qform: flipped, rotated, and sheared.
        let all = Nifti {
            codes: [1, 1],
            pixdim: [1.0, 9.0, 9.0, 9.0, 1.0, 1.0, 1.0, 1.0],
            quatern: [0.0, 0.0, 0.0, 9.0, 9.0, 9.0],
            ..Nifti::default()
        };
        let srow = [0.0, -2.0, 0.0, 10.0, 1.0, 0.0, 0.0, 20.0, 0.0, 0.0, 3.0, 30.0];
        corners(
            Nifti { srow, ..all.clone() },
            [10.0, 20.0, 30.0],
            [[0.0, 1.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 0.0, 3.0]],
        );
        let srow = [-1.0, 0.5, 0.0, 1.0, 0.0, 2.0, 0.25, 2.0, 0.0, 0.0, 4.0, 3.0];
        corners(
            Nifti { srow, ..all.clone() },
            [1.0, 2.0, 3.0],
            [[-1.0, 0.0, 0.0], [0.5, 2.0, 0.0], [0.0, 0.25, 4.0]],
        );
        // The qform before pixdim. A half turn about x has no real part.
        let qform = Nifti {
            codes: [1, 0],
            pixdim: [1.0, 2.0, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0],
            quatern: [1.0, 0.0, 0.0, 5.0, 6.0, 7.0],
            ..Nifti::default()
        };
        let steps = [[2.0, 0.0, 0.0], [0.0, -3.0, 0.0], [0.0, 0.0, -4.0]];
        corners(qform.clone(), [5.0, 6.0, 7.0], steps);
        let left_handed = Nifti { pixdim: [-1.0, 2.0, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0], ..qform.clone() };
        corners(left_handed, [5.0, 6.0, 7.0], [steps[0], steps[1], [0.0, 0.0, 4.0]]);
        // A third of a turn about (1, 1, 1): x becomes y, y becomes z.
        let turn = Nifti { quatern: [0.5, 0.5, 0.5, 5.0, 6.0, 7.0], ..qform };
        corners(turn, [5.0, 6.0, 7.0], [[0.0, 2.0, 0.0], [0.0, 0.0, 3.0], [4.0, 0.0, 0.0]]);
        // Neither.
        let plain =
            Nifti { pixdim: [-1.0, 2.0, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0], srow: [8.0; 12], ..Nifti::default() };
        corners(plain.clone(), [0.0; 3], [[2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 4.0]]);
        assert!(
            noted(&folder.open("a.nii", plain.bytes()).unwrap()).contains("sform_code and qform_code are 0")
        );
    }
}

#[test]
fn an_oblique_quaternion_is_that_of_nibabel() {
    let nifti = Nifti {
        codes: [1, 0],
        pixdim: [-1.0, 1.5, 2.0, 2.5, 1.0, 1.0, 1.0, 1.0],
        quatern: [0.1, -0.2, 0.3, 10.0, -20.0, 30.0],
        ..Nifti::default()
    };
    let opened = Folder::new().volume("a.nii", nifti.bytes());
    // The columns of nibabel's get_qform(), which has nine digits, of numbers stored as f32.
    let columns = [
        DVec3::new(1.109999975, 0.774625692, 0.64641712),
        DVec3::new(-1.19283426, 1.59999997, 0.13094473),
        DVec3::new(0.777361851, 0.763680946, -2.249999993),
    ];
    for (axis, column) in columns.into_iter().enumerate() {
        let found = opened.index_to_world().matrix3.col(axis);
        assert!(found.abs_diff_eq(column, 1e-7), "{found} should be {column}");
    }
    assert_eq!(opened.frame().origin, DVec3::new(10.0, -20.0, 30.0));
    assert_eq!(opened.frame().space, Some(oblate_volumes::Space::Ras));
}

#[test]
fn slope_and_intercept() {
    let folder = Folder::new();
    let values = |scale: [f64; 2]| {
        let samples: Vec<u8> = corner_marked().iter().flat_map(|&s| i16::from(s).to_le_bytes()).collect();
        let nifti = Nifti { datatype: 4, scale, samples, ..Nifti::default() };
        folder.volume("a.nii", nifti.bytes())
    };
    for none in [[0.0, 5.0], [f64::NAN, 5.0], [1.0, 0.0], [f64::INFINITY, 0.0]] {
        assert_corner_marked(&values(none));
        assert!(matches!(values(none).voxels(), Voxels::I16(_)));
    }
    for (scale, first) in [([0.5, -10.0], -9.5), ([1.0, 3.0], 4.0), ([-2.0, 0.0], -2.0)] {
        let scaled = values(scale);
        assert_eq!(scaled.voxels().type_name(), "f32");
        assert_eq!(scaled.value([0, 0, 0]), first);
        let last = scale[0] * 8.0 + scale[1];
        assert_eq!(f64::from(scaled.value([3, 2, 1])), last);
    }
    let wrong = Nifti { scale: [2.0, f64::NAN], ..Nifti::default() };
    folder.refused("a.nii", wrong.bytes(), &["byte 116", "scl_inter is NaN", "finite"]);
    let large = Nifti { version: 2, scale: [1e300, 0.0], ..Nifti::default() };
    folder.refused("a.nii", large.bytes(), &["sample 0", "rescale"]);
}

#[test]
fn what_is_not_taken_as_it_stands_is_noted() {
    let folder = Folder::new();
    let sform = Nifti {
        codes: [0, 1],
        srow: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        ..Nifti::default()
    };
    let times = Nifti {
        dim: [4, 4, 3, 2, 3, 1, 1, 1],
        samples: [corner_marked(), vec![9; 48]].concat(),
        ..sform.clone()
    };
    let opened = folder.open("a.nii", times.bytes()).unwrap();
    assert_eq!(noted(&opened), "left out: time points 2 to 3");
    assert_corner_marked(&volume(Ok(opened)));
    let cut = &times.bytes()[..352 + 71];
    folder.refused("a.nii", cut, &["423 bytes; the header needs 424"]);
    let long = Nifti { samples: [corner_marked(), vec![9; 5]].concat(), ..sform };
    assert_eq!(noted(&folder.open("a.nii", long.bytes()).unwrap()), "left out: 5 bytes after the samples");
    let unknown =
        Nifti { codes: [1, 0], pixdim: [1.0, 2.0, 0.0, f64::NAN, 0.0, 0.0, 0.0, 0.0], ..Nifti::default() };
    let opened = folder.open("a.nii", unknown.bytes()).unwrap();
    let assumed =
        |note: &Note| matches!(note, Note::Assumed(what) if what.contains("spacing of 1, as pixdim"));
    assert!(opened.notes.len() == 2 && opened.notes.iter().all(assumed), "{:?}", opened.notes);
    assert_eq!(volume(Ok(opened)).frame().spacing, DVec3::new(2.0, 1.0, 1.0));
    // One slice is a volume, whatever stands behind the axes that there are.
    let flat = Nifti { dim: [2, 4, 6, 99, 99, 99, 99, 99], ..Nifti::default() };
    assert_eq!(folder.volume("a.nii", flat.bytes()).dims(), [4, 6, 1]);
}

#[test]
fn what_is_wrong_is_said() {
    let folder = Folder::new();
    let refuse = |nifti: Nifti, parts: &[&str]| {
        folder.refused("a.nii", nifti.bytes(), parts);
    };
    let some = Nifti::default;
    for (code, name) in [
        (1, "single bits"),
        (32, "complex"),
        (128, "colours"),
        (1536, "128-bit"),
        (1792, "complex"),
        (2048, "complex"),
        (2304, "colours"),
        (3, "no type"),
    ] {
        refuse(Nifti { datatype: code, ..some() }, &["byte 70", &format!("datatype {code} ("), name]);
    }
    refuse(Nifti { dim: [0; 8], ..some() }, &["byte 40", "dim[0]"]);
    refuse(Nifti { dim: [3, 4, 0, 2, 1, 1, 1, 1], ..some() }, &["dim[2] is 0"]);
    refuse(Nifti { dim: [3, 4, -3, 2, 1, 1, 1, 1], ..some() }, &["dim[2] is -3"]);
    refuse(Nifti { dim: [5, 4, 3, 2, 1, 3, 1, 1], ..some() }, &["dim[5] is 3", "one value"]);
    refuse(Nifti { dim: [3, 4, 3, 3, 1, 1, 1, 1], ..some() }, &["376 bytes; the header needs 388"]);
    let huge = 1 << 40;
    let large = Nifti { version: 2, dim: [3, huge, huge, huge, 1, 1, 1, 1], ..some() };
    refuse(large.clone(), &["more than memory"]);
    refuse(
        Nifti { dim: [4, 1 << 30, 1 << 20, 1, i64::MAX, 1, 1, 1], ..large.clone() },
        &["byte 16", "more than memory"],
    );
    let large = Nifti { dim: [3, huge, 4, 1, 1, 1, 1, 1], ..large }.bytes();
    folder.refused("a.nii.gz", gzip(&large), &["cannot hold"]);
    for offset in [-1.0, 348.0, 352.5] {
        refuse(Nifti { vox_offset: offset, ..some() }, &["byte 108", "vox_offset", "from 352 on"]);
    }
    refuse(
        Nifti { codes: [1, 0], quatern: [0.8, 0.8, 0.0, 0.0, 0.0, 0.0], ..some() },
        &["byte 256", "unit quaternion"],
    );
    refuse(Nifti { codes: [1, 0], quatern: [f64::NAN; 6], ..some() }, &["byte 256", "unit quaternion"]);
    refuse(Nifti { codes: [1, 0], pixdim: [-1.0; 8], ..some() }, &["byte 76", "pixdim[1] is -1"]);
    refuse(Nifti { codes: [0, 1], ..some() }, &["spacing", "above 0"]);
    let flat = [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    refuse(Nifti { codes: [0, 1], srow: flat, ..some() }, &["direction", "span space"]);
    folder.refused("a.nii", b"no header", &["no NIfTI header"]);
    folder.refused("a.nii", &Nifti { version: 2, ..some() }.bytes()[..400], &["header of NIfTI-2 has 540"]);
    let packed = gzip(&some().bytes());
    for (limit, opens) in [(375, false), (376, true)] {
        let options = OpenOptions { max_memory: limit, ..OpenOptions::default() };
        let opened = folder.open_with("a.nii.gz", &packed, &options);
        if opens {
            assert_corner_marked(&volume(opened));
        } else {
            refused(opened, "a.nii.gz", &["more than 375 bytes"]);
        }
    }
    // What unpacks to more than the header says is still bounded.
    let bomb = gzip(&[some().bytes(), vec![0; 1_000_000]].concat());
    let options = OpenOptions { max_memory: 100_000, ..OpenOptions::default() };
    refused(folder.open_with("a.nii.gz", bomb, &options), "a.nii.gz", &["more than 100000 bytes"]);
}
