use crate::common::{DIMS, Folder, corner_marked, irregular, refused};
use crate::vtk::{place, places};
use glam::DVec3;
use oblate_importers::{OpenOptions, open};

/// How the two files are written.
#[derive(Clone, Copy, Debug, Default)]
struct Way {
    little: bool,
    double: bool,
    records: bool,
    counted: bool,
    marks: bool,
}

impl Way {
    fn integers(self, numbers: &[u32]) -> Vec<u8> {
        numbers.iter().flat_map(|n| if self.little { n.to_le_bytes() } else { n.to_be_bytes() }).collect()
    }

    fn reals(self, numbers: impl IntoIterator<Item = f64>) -> Vec<u8> {
        let bytes = |number: f64| match (self.double, self.little) {
            (true, true) => number.to_le_bytes().to_vec(),
            (true, false) => number.to_be_bytes().to_vec(),
            (false, true) => (number as f32).to_le_bytes().to_vec(),
            (false, false) => (number as f32).to_be_bytes().to_vec(),
        };
        numbers.into_iter().flat_map(bytes).collect()
    }

    fn record(self, bytes: Vec<u8>) -> Vec<u8> {
        let length = self.integers(&[bytes.len() as u32]);
        if self.records { [&length[..], &bytes, &length].concat() } else { bytes }
    }

    fn head(self) -> Vec<u8> {
        let count = if self.counted { self.record(self.integers(&[1])) } else { Vec::new() };
        [count, self.record(self.integers(&DIMS.map(|n| n as u32)))].concat()
    }

    /// Files of points and of the flow, of corner-marked densities; the second point may be blanked.
    fn files(self) -> [Vec<u8>; 2] {
        let points = places(DIMS);
        let mut list = self.reals((0..3).flat_map(|axis| points.iter().map(move |point| point[axis])));
        if self.marks {
            list.extend(self.integers(&(0..24).map(|n| u32::from(n != 1)).collect::<Vec<_>>()));
        }
        let densities = corner_marked().into_iter().map(f64::from);
        let flow = self.reals(densities.chain((0..96).map(f64::from)));
        let conditions = self.record(self.reals([2.0, 0.5, 1e6, 0.0]));
        [[self.head(), self.record(list)].concat(), [self.head(), conditions, self.record(flow)].concat()]
    }
}

/// A grid's files as they are most often.
pub(crate) fn pair() -> [Vec<u8>; 2] {
    Way { marks: true, ..Way::default() }.files()
}

#[test]
fn all_ways_to_write_a_pair() {
    let folder = Folder::new();
    for bits in 0..32 {
        let [little, double, records, counted, marks] = std::array::from_fn(|bit| bits >> bit & 1 == 1);
        let way = Way { little, double, records, counted, marks };
        let [points, flow] = way.files();
        let [points, flow] = [folder.write("finxyz.bin", points), folder.write("finq.bin", flow)];
        for path in [points, flow] {
            let volume = irregular(open(&path, &OpenOptions::default()));
            let samples = volume.samples();
            assert_eq!(samples.dims(), DIMS, "{way:?}");
            for (n, density) in corner_marked().into_iter().enumerate() {
                let index = [n % 4, n / 4 % 3, n / 12];
                if marks && n == 1 {
                    assert!(samples.value(index).is_nan());
                } else {
                    assert_eq!(samples.value(index), f32::from(density), "{way:?}, {index:?}");
                    assert_eq!(volume.points()[n], place(index), "{way:?}, {index:?}");
                }
            }
        }
    }
}

#[test]
fn files_find_each_other_by_name() {
    let folder = Folder::new();
    let [points, flow] = pair();
    for [of_points, of_flow] in
        [["a.x", "a.q"], ["b.xyz", "b.q"], ["c.g", "c.q"], ["dXYZ.dat", "dQ.dat"], ["xyz", "q"]]
    {
        folder.write(of_points, &points);
        folder.write(of_flow, &flow);
        for name in [of_points, of_flow] {
            let opened = open(folder.path().join(name), &OpenOptions::default()).unwrap();
            assert_eq!(opened.format, "PLOT3D", "{name}");
            assert!(opened.notes.iter().any(|note| note.to_string().contains("momentum")));
        }
    }
    let folder = Folder::new();
    folder.refused("finxyz.bin", &points, &["these are the points", "the flow", "finq.bin or finxyz.q"]);
    folder.refused("other.bin", &flow, &["these are the flow", "other.xyz or other.x or other.g"]);
    let flow = Some(folder.path().join("other.bin"));
    let options = OpenOptions { flow, ..OpenOptions::default() };
    irregular(folder.open_with("finxyz.bin", &points, &options));
    refused(open(folder.path().join("other.bin"), &options), "other.bin", &["the flow itself"]);
    let options = OpenOptions { flow: Some(folder.path().join("finxyz.bin")), ..options };
    let both = open(folder.path().join("finxyz.bin"), &options);
    refused(both, "finxyz.bin", &["it should be of the flow at the same points"]);
}

#[test]
fn what_fits_no_pair_is_refused() {
    let folder = Folder::new();
    let [points, flow] = pair();
    folder.write("a.q", &flow);
    let parts = ["fit no PLOT3D file", "counts along the axes"];
    folder.refused("a.x", &points[..points.len() - 1], &parts);
    folder.refused("a.x", [&points[..], &[0]].concat(), &parts);
    folder.refused("a.x", [], &parts);
    // Elsewhere what has no such size is nothing.
    folder.refused("a.bin", &points[..points.len() - 1], &["not recognised as", "PLOT3D"]);
    let mut wrong = points.clone();
    wrong[3] = 3;
    wrong[7] = 4;
    refused(folder.open("a.x", wrong), "a.q", &["the flow of 4x3x2 points", "at the same points"]);
    // Two grids.
    let two = [
        vec![0, 0, 0, 2],
        [[0, 0, 0, 4], [0, 0, 0, 3], [0, 0, 0, 2]].concat().repeat(2),
        vec![0; 2 * 24 * 12],
    ];
    folder.refused("a.x", two.concat(), &["2 grids", "one is supported"]);
    // Points that are all at one place.
    let mut flat = points;
    flat[12..12 + 288].fill(0);
    folder.refused("a.x", flat, &["the points reach 0 far"]);
}

#[test]
fn padding_is_left_out() {
    let folder = Folder::new();
    let dims = [9_usize, 8, 8];
    let count: usize = dims.iter().product();
    let head: Vec<u8> = dims.iter().flat_map(|n| (*n as u32).to_be_bytes()).collect();
    let mut points = head.clone();
    let index = |n: usize| [n % dims[0], n / dims[0] % dims[1], n / (dims[0] * dims[1])];
    for axis in 0..3 {
        points.extend((0..count).flat_map(|n| (index(n)[axis] as f32).to_be_bytes()));
    }
    let mut flow = head;
    flow.extend((0..4 + 5 * count).flat_map(|n| (n as f32).to_be_bytes()));
    flow.resize(flow.len().next_multiple_of(512), 0);
    folder.write("a.q", flow);
    let opened = folder.open("a.x", points);
    assert!(
        opened.as_ref().unwrap().notes.iter().any(|note| note.to_string().contains("bytes at the end of"))
    );
    let volume = irregular(opened);
    assert_eq!(volume.samples().value([1, 0, 0]), 5.0);
    assert_eq!(volume.bounds(), [DVec3::ZERO, DVec3::new(8.0, 7.0, 7.0)]);
}
