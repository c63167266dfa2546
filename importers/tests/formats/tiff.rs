use crate::common::{DIMS, Folder, assert_corner_marked, corner_marked, refused, volume, written, zlib};
use glam::DVec3;
use oblate_importers::{Note, OpenOptions};

/// How a file's numbers are written.
#[derive(Clone, Copy)]
pub(crate) struct Form {
    big_endian: bool,
    big_tiff: bool,
}

pub(crate) const LITTLE: Form = Form { big_endian: false, big_tiff: false };
const FORMS: [Form; 4] = [
    LITTLE,
    Form { big_endian: true, ..LITTLE },
    Form { big_tiff: true, ..LITTLE },
    Form { big_endian: true, big_tiff: true },
];

/// Fields of a page: tag, type and values; ASCII as bytes.
pub(crate) type Field = (u16, u16, Vec<u64>);

impl Form {
    fn number(self, value: u64, size: usize) -> Vec<u8> {
        let mut bytes = value.to_le_bytes()[..size].to_vec();
        if self.big_endian {
            bytes.reverse();
        }
        bytes
    }

    /// A file of pages, each of fields and samples; the fields on where samples are come of themselves. A page's next is
    /// the one after it, the last one's is `after_last`.
    pub(crate) fn file(self, pages: &[(Vec<Field>, Vec<u8>)], after_last: Option<usize>) -> Vec<u8> {
        let word = if self.big_tiff { 8 } else { 4 };
        let mut bytes = if self.big_endian { b"MM".to_vec() } else { b"II".to_vec() };
        bytes.extend(self.number(if self.big_tiff { 43 } else { 42 }, 2));
        if self.big_tiff {
            bytes.extend([self.number(8, 2), self.number(0, 2)].concat());
        }
        let mut link = bytes.len();
        bytes.extend(self.number(0, word));
        let mut places = Vec::new();
        for (fields, samples) in pages {
            let at = bytes.len() as u64;
            bytes.extend(samples);
            let mut fields = fields.clone();
            let tiled = fields.iter().any(|field| field.0 == 322);
            let (place, count) = if tiled { (324, 325) } else { (273, 279) };
            let number = |tag: u16| {
                fields
                    .iter()
                    .find(|field| field.0 == tag)
                    .and_then(|field| field.2.first().copied())
                    .unwrap_or(1)
            };
            // Strips of fewer rows than the page has are of samples as they are.
            let strips = if tiled { 1 } else { number(257).div_ceil(number(278).max(1)).max(1) };
            let length = samples.len() as u64 / strips;
            fields.push((place, 4, (0..strips).map(|strip| at + strip * length).collect()));
            fields.push((count, 4, vec![length; strips as usize]));
            fields.sort();
            let mut table = self.number(fields.len() as u64, if self.big_tiff { 8 } else { 2 });
            for (tag, kind, values) in fields {
                let size = [0, 1, 1, 2, 4, 4][usize::from(kind)];
                let value: Vec<u8> = values.iter().flat_map(|value| self.number(*value, size)).collect();
                // A rational is two numbers.
                let count = if kind == 5 { values.len() / 2 } else { values.len() };
                table.extend([self.number(tag.into(), 2), self.number(kind.into(), 2)].concat());
                table.extend(self.number(count as u64, word));
                if value.len() > word {
                    table.extend(self.number(bytes.len() as u64, word));
                    bytes.extend(value);
                } else {
                    table.extend(value.iter().copied().chain([0; 8]).take(word));
                }
            }
            let place = bytes.len();
            bytes.splice(link..link + word, self.number(place as u64, word));
            places.push(place);
            bytes.extend(table);
            link = bytes.len();
            bytes.extend(self.number(0, word));
        }
        if let Some(page) = after_last {
            bytes.splice(link..link + word, self.number(places[page] as u64, word));
        }
        bytes
    }
}

/// The fields of an uncompressed page.
pub(crate) fn fields([width, height]: [usize; 2], bits: u64, format: u64) -> Vec<Field> {
    vec![
        (256, 3, vec![width as u64]),
        (257, 4, vec![height as u64]),
        (258, 3, vec![bits]),
        (259, 3, vec![1]),
        (262, 3, vec![1]),
        (277, 3, vec![1]),
        (278, 4, vec![height as u64]),
        (339, 3, vec![format]),
    ]
}

pub(crate) fn set(fields: &mut Vec<Field>, tag: u16, value: u64) {
    fields.retain(|field| field.0 != tag);
    fields.push((tag, 4, vec![value]));
}

fn described(fields: &mut Vec<Field>, text: &str) {
    fields.push((270, 2, text.bytes().chain([0]).map(u64::from).collect()));
}

/// The corner-marked volume as pages of bytes, with changed fields.
fn bytes_changed(change: impl Fn(usize, &mut Vec<Field>)) -> Vec<(Vec<Field>, Vec<u8>)> {
    let pages = corner_marked();
    let pages = pages.chunks(DIMS[0] * DIMS[1]).enumerate();
    pages
        .map(|(index, samples)| {
            let mut fields = fields([DIMS[0], DIMS[1]], 8, 1);
            change(index, &mut fields);
            (fields, samples.to_vec())
        })
        .collect()
}

/// PackBits with runs of one literal.
fn pack_bits(bytes: &[u8]) -> Vec<u8> {
    bytes.iter().flat_map(|byte| [0, *byte]).collect()
}

/// LZW that never uses its table: codes of nine bits, between clear (256) and end (257).
fn lzw(bytes: &[u8]) -> Vec<u8> {
    let codes = [256].into_iter().chain(bytes.iter().map(|b| u32::from(*b))).chain([257]);
    let bits: Vec<u8> = codes.flat_map(|code| (0..9).rev().map(move |bit| (code >> bit & 1) as u8)).collect();
    bits.chunks(8).map(|bits| (0..8).fold(0, |byte, i| byte << 1 | bits.get(i).unwrap_or(&0))).collect()
}

/// Tables of strips that are larger than a page, and what they become in memory larger still.
#[test]
fn strips_may_be_single_rows() {
    for form in FORMS {
        let pages = bytes_changed(|_, fields| set(fields, 278, 1));
        assert_corner_marked(&Folder::new().volume("a.tif", form.file(&pages, None)));
    }
}

/// A stack with ImageJ's description.
pub(crate) fn example() -> Vec<u8> {
    let pages = bytes_changed(|index, fields| {
        if index == 0 {
            described(fields, "ImageJ=1.53t\nimages=2\nslices=2\nunit=mm\nspacing=2.5\n");
            fields.push((282, 5, vec![4, 1]));
            fields.push((283, 5, vec![2, 1]));
        }
    });
    LITTLE.file(&pages, None)
}

/// A stack of deflated pages with OME's description.
pub(crate) fn ome_example() -> Vec<u8> {
    let pages = bytes_changed(|index, fields| {
        set(fields, 259, 8);
        if index == 0 {
            described(fields, "<OME><Pixels SizeZ=\"2\" PhysicalSizeZ=\"3\"/></OME>");
        }
    });
    let pages: Vec<_> = pages.into_iter().map(|(fields, samples)| (fields, zlib(&samples))).collect();
    FORMS[3].file(&pages, None)
}

#[test]
fn every_type_order_and_form() {
    let folder = Folder::new();
    for written in written() {
        let bits = 8 * written.little.len() as u64 / 24;
        let format = match &written.name[..1] {
            "u" => 1,
            "i" => 2,
            _ => 3,
        };
        for form in FORMS {
            let bytes = if form.big_endian { &written.big } else { &written.little };
            let page = |samples: &[u8]| (fields([DIMS[0], DIMS[1]], bits, format), samples.to_vec());
            let pages: Vec<_> = bytes.chunks(bytes.len() / 2).map(page).collect();
            let opened = folder.open("a", form.file(&pages, None)).unwrap();
            assert_eq!(opened.notes, []);
            let opened = volume(Ok(opened));
            assert_corner_marked(&opened);
            assert_eq!(opened.voxels().type_name(), written.voxel_type);
            assert_eq!(opened.frame(), Default::default());
        }
    }
}

#[test]
fn compressions() {
    let folder = Folder::new();
    for (compression, pack) in
        [(5, lzw as fn(&[u8]) -> Vec<u8>), (8, zlib), (32946, zlib), (32773, pack_bits)]
    {
        let pages = bytes_changed(|_, fields| set(fields, 259, compression));
        let pages: Vec<_> = pages.into_iter().map(|(fields, samples)| (fields, pack(&samples))).collect();
        let bytes = FORMS[1].file(&pages, None);
        assert_corner_marked(&folder.volume("a.tif", &bytes));
        let options = OpenOptions { max_memory: 23, ..OpenOptions::default() };
        refused(folder.open_with("a.tif", &bytes, &options), "a.tif", &["more than 23 bytes"]);
    }
    for (compression, name) in [(2, "fax"), (7, "JPEG"), (50000, "Zstandard"), (9, "unknown")] {
        let pages = bytes_changed(|_, fields| set(fields, 259, compression));
        folder.refused("a.tif", LITTLE.file(&pages, None), &["page 1", "compression", name, "LZW (5)"]);
    }
}

/// A tile may be larger than its page.
#[test]
fn tiles() {
    let pages = bytes_changed(|_, fields| {
        fields.retain(|field| field.0 != 278);
        set(fields, 259, 8);
        set(fields, 322, 512);
        set(fields, 323, 256);
    });
    let tile = |samples: &[u8]| {
        let mut tile = vec![99; 512 * 256];
        for (row, samples) in tile.chunks_mut(512).zip(samples.chunks(DIMS[0])) {
            row[..DIMS[0]].copy_from_slice(samples);
        }
        zlib(&tile)
    };
    let pages: Vec<_> = pages.into_iter().map(|(fields, samples)| (fields, tile(&samples))).collect();
    let folder = Folder::new();
    assert_corner_marked(&folder.volume("a.tif", LITTLE.file(&pages, None)));
    // One of 4 GB is none that the file holds.
    let mut large = pages;
    large.iter_mut().for_each(|page| set(&mut page.0, 322, 1 << 24));
    folder.refused("a.tif", LITTLE.file(&large, None), &["page 1", "cannot be decoded"]);
}

#[test]
fn spacing_of_image_j() {
    let folder = Folder::new();
    let opened = folder.volume("a.tif", example());
    assert_corner_marked(&opened);
    assert_eq!(opened.frame().spacing, DVec3::new(0.25, 0.5, 2.5));
    let described_by = |text: &str, resolutions: &[u16]| {
        let pages = bytes_changed(|index, fields| {
            if index == 0 {
                described(fields, text);
                fields.extend(resolutions.iter().map(|tag| (*tag, 5, vec![10, 1])));
            }
        });
        folder.open("a.tif", LITTLE.file(&pages, None))
    };
    let spacing = |text: &str, resolutions: &[u16]| volume(described_by(text, resolutions)).frame().spacing;
    // One of the two resolutions, none, and a resolution without ImageJ.
    assert_eq!(spacing("ImageJ=1\nspacing=-3", &[282]), DVec3::new(1.0, 1.0, 3.0));
    assert_eq!(spacing("ImageJ=1\n", &[282, 283]), DVec3::new(0.1, 0.1, 1.0));
    assert_eq!(spacing("a picture", &[282, 283]), DVec3::ONE);
    assert_eq!(spacing("ImageJ=1\nspacing=0\nunit=\u{b5}m", &[]), DVec3::ONE);
    let notes = described_by("ImageJ=1\nimages=7\n", &[]).unwrap().notes;
    assert!(
        matches!(&notes[..], [Note::Assumed(text)] if text.contains("7 images; the 2 pages")),
        "{notes:?}"
    );
    // Calibrations.
    let values = |text: &str| {
        let opened = described_by(&format!("ImageJ=1\n{text}"), &[]).unwrap();
        let notes = opened.notes.len();
        let volume = volume(Ok(opened));
        (volume.voxels().type_name(), volume.value([0; 3]), volume.value([1, 0, 0]), notes)
    };
    assert_eq!(values("cf=0\nc0=0.0\nc1=1.0"), ("u8", 1.0, 11.0, 0));
    assert_eq!(values("cf=0\nc0=-5\nc1=0.5\nvunit=HU"), ("f32", -4.5, 0.5, 0));
    assert_eq!(values("cf=2\nc0=-5\nc1=0.5"), ("u8", 1.0, 11.0, 1));
    let mut signed = fields([2, 1], 16, 1);
    described(&mut signed, "ImageJ=1\ncf=0\nc0=-32768.0\nc1=1.0\n");
    for form in FORMS {
        let samples = [1_u16, 0x8005].map(|v| form.number(v.into(), 2)).concat();
        let opened = folder.volume("signed.tif", form.file(&[(signed.clone(), samples)], None));
        assert_eq!(opened.voxels(), &oblate_volumes::Voxels::I16(vec![-32767, 5]));
    }
    refused(described_by("ImageJ=1\nimages=4\nchannels=2\n", &[]), "a.tif", &["ImageJ", "2 channels"]);
    refused(described_by("ImageJ=1\nframes=3\n", &[]), "a.tif", &["3 times"]);
    let mut one = bytes_changed(|_, fields| described(fields, "ImageJ=1\nimages=9\n"));
    one.truncate(1);
    folder.refused("a.tif", LITTLE.file(&one, None), &["9 images behind one page"]);
}

#[test]
fn spacing_of_ome() {
    let folder = Folder::new();
    let opened = folder.volume("a.tif", ome_example());
    assert_corner_marked(&opened);
    assert_eq!(opened.frame().spacing, DVec3::new(1.0, 1.0, 3.0));
    let with = |attributes: &str, more: &str| {
        let text = format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?><OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\">\
             <Image ID=\"Image:0\"><Pixels DimensionOrder=\"XYZCT\" Type=\"uint8\" {attributes}><TiffData IFD=\"0\"/>\
             </Pixels></Image>{more}</OME>"
        );
        let pages = bytes_changed(|index, fields| {
            if index == 0 {
                described(fields, &text);
            }
        });
        folder.open("a.tif", LITTLE.file(&pages, None))
    };
    let all = "PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.25\" PhysicalSizeZ=\"2\" PhysicalSizeXUnit=\"nm\" \
        PhysicalSizeYUnit=\"nm\"";
    let unit = "PhysicalSizeZUnit=\"nm\"";
    assert_eq!(volume(with(&format!("{all} {unit}"), "")).frame().spacing, DVec3::new(0.5, 0.25, 2.0));
    // Unsaid, it is micrometres.
    refused(with(all, ""), "a.tif", &["OME", "different units", "nm and nm and µm"]);
    refused(with("SizeC=\"3\"", ""), "a.tif", &["3 channels (SizeC)"]);
    refused(with("SizeT=\"5\"", ""), "a.tif", &["5 times (SizeT)"]);
    refused(with("SizeZ=\"3\"", ""), "a.tif", &["SizeZ is 3", "2 pages"]);
    refused(with("SizeZ=\"many\"", ""), "a.tif", &["\"many\", no number"]);
    refused(with("PhysicalSizeX=\"0\"", ""), "a.tif", &["PhysicalSizeX", "above 0"]);
    refused(with("", "<Image><Pixels/></Image>"), "a.tif", &["2 images"]);
    refused(with("", "<TiffData IFD=\"1\"/>"), "a.tif", &["another order"]);
    refused(with("", "<"), "a.tif", &["OME"]);
}

#[test]
fn pages_must_be_alike() {
    let folder = Folder::new();
    let mut pages = bytes_changed(|_, _| ());
    let small = (fields([2, 1], 8, 1), vec![9, 9]);
    pages.insert(1, small);
    folder.refused("a.tif", LITTLE.file(&pages, None), &["page 2", "2x1", "the first has 4x3"]);
    // A smaller copy says so.
    set(&mut pages[1].0, 254, 1);
    let opened = folder.open("a.tif", LITTLE.file(&pages, None)).unwrap();
    assert!(
        matches!(&opened.notes[..], [Note::LeftOut(text)] if text.contains("1 pages")),
        "{:?}",
        opened.notes
    );
    assert_corner_marked(&volume(Ok(opened)));
    pages.iter_mut().for_each(|page| set(&mut page.0, 254, 1));
    folder.refused("a.tif", LITTLE.file(&pages, None), &["all its pages are smaller"]);
}

#[test]
fn orientation_turns_nothing_and_is_noted() {
    let pages = bytes_changed(|_, fields| set(fields, 274, 4));
    let opened = Folder::new().open("a.tif", LITTLE.file(&pages, None)).unwrap();
    assert!(matches!(&opened.notes[..], [Note::Assumed(text)] if text.contains("Orientation")));
    assert_corner_marked(&volume(Ok(opened)));
}

#[test]
fn bright_is_high() {
    let folder = Folder::new();
    let pages = bytes_changed(|_, fields| set(fields, 262, 0));
    let opened = folder.open("a.tif", LITTLE.file(&pages, None)).unwrap();
    assert!(matches!(&opened.notes[..], [Note::Assumed(text)] if text.contains("turned round")));
    assert_eq!(volume(Ok(opened)).value([0, 0, 0]), 254.0);
    let floats = (
        fields([1, 1], 32, 3).into_iter().filter(|f| f.0 != 262).chain([(262, 3, vec![0])]).collect(),
        vec![0; 4],
    );
    folder.refused("a.tif", LITTLE.file(&[floats], None), &["white is 0 in F32"]);
}

#[test]
fn what_is_not_greyscale_is_named() {
    let folder = Folder::new();
    let changed = |change: &dyn Fn(&mut Vec<Field>), parts: &[&str]| {
        folder.refused("a.tif", LITTLE.file(&bytes_changed(|_, fields| change(fields)), None), parts);
    };
    for (photometric, name) in [(2, "RGB"), (3, "palette"), (5, "CMYK"), (6, "YCbCr")] {
        changed(&|fields| set(fields, 262, photometric), &["page 1", name, "greyscale of one sample"]);
    }
    changed(&|fields| set(fields, 277, 2), &["greyscale of 2 samples a pixel"]);
    changed(&|fields| set(fields, 258, 12), &["12 bits"]);
    changed(&|fields| set(fields, 266, 2), &["FillOrder 2"]);
    changed(&|fields| set(fields, 339, 4), &["SampleFormat 4"]);
    changed(&|fields| fields.retain(|field| field.0 != 256), &["no ImageWidth above 0"]);
    changed(&|fields| set(fields, 278, 0), &["page 1", "cannot be decoded"]);
}

/// Declared sizes are compared with the file's, chains of pages end.
#[test]
fn hostile_files() {
    let folder = Folder::new();
    let large = |compression| {
        bytes_changed(move |_, fields| {
            set(fields, 256, 1 << 31);
            set(fields, 257, 1 << 31);
            set(fields, 278, 1 << 31);
            set(fields, 259, compression);
        })
    };
    folder.refused("a.tif", LITTLE.file(&large(1), None), &["page 1", "need 4611686018427387904 bytes"]);
    folder.refused("a.tif", LITTLE.file(&large(8), None), &["page 1", "need 4611686018427387904 bytes"]);
    for after_last in [0, 1] {
        let bytes = LITTLE.file(&bytes_changed(|_, _| ()), Some(after_last));
        folder.refused("a.tif", bytes, &["page 2 is followed by a page that was already there"]);
    }
    // Each page by itself fits the file, and all share one place.
    let mut pages: Vec<_> = (0..60).map(|_| bytes_changed(|_, _| ()).remove(0)).collect();
    let count = pages.len();
    pages.iter_mut().take(count - 1).for_each(|page| page.1 = Vec::new());
    pages.iter_mut().for_each(|(fields, samples)| {
        *fields = self::fields([40, 40], 8, 1);
        if !samples.is_empty() {
            *samples = vec![0; 1600];
        }
    });
    folder.refused("a.tif", LITTLE.file(&pages, None), &["its pages need 96000 bytes"]);
    // A second page at byte 8 whose table is the rest of the file, the first page within it.
    let one = LITTLE.file(&bytes_changed(|_, _| ())[..1], None);
    let table = u32::from_le_bytes(one[4..8].try_into().unwrap()) as usize;
    let mut bytes = [&one[..table], &vec![0; 12 - table % 12 + 10], &one[table..]].concat();
    let moved = (bytes.len() - (one.len() - table)) as u32;
    bytes[4..8].copy_from_slice(&moved.to_le_bytes());
    let next = bytes.len() - 4;
    bytes[next..].copy_from_slice(&8_u32.to_le_bytes());
    let fields = ((bytes.len() - 10) / 12) as u16;
    bytes[8..10].copy_from_slice(&fields.to_le_bytes());
    folder.refused("a.tif", bytes, &["byte 8", "overlap those of other pages"]);
    folder.refused("a.tif", b"II*\0\0\0\0\0", &["no pages"]);
    folder.refused("a.tif", b"II*\0\xff\xff\0\0", &["byte 65535", "the file has 8"]);
    folder.refused("a.tif", b"no TIFF", &["begins with II*"]);
}
