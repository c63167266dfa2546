//! How far sheets of surfels cover a pixel in which they end: one behind the other, or beside each other.

#![expect(clippy::unwrap_used, reason = "what is not there fails the test")]

use glam::{DVec3, Vec3};
use oblate_engine::cloud::oblate_factor;
use oblate_engine::{
    Camera, Closed, Cloud, Frame, Material, Pose, ReferenceKind, RenderSettings, Scene, Shapes, Splats,
    Strength, Surface, reference, render,
};

/// A pixel is one unit wide and high.
const SIZE: [u32; 2] = [24, 8];

/// Surfels a pixel along rows and columns.
const DENSITY: usize = 3;

/// A sheet across the view, between two columns, at a depth behind the first.
#[derive(Clone, Copy)]
struct Sheet {
    columns: [f64; 2],
    depth: f32,
    is_back: bool,
    opacity: f32,
}

impl Sheet {
    const fn front(from: f64, to: f64, depth: f32) -> Self {
        Self { columns: [from, to], depth, is_back: false, opacity: 1.0 }
    }

    const fn back(from: f64, to: f64, depth: f32) -> Self {
        Self { is_back: true, ..Self::front(from, to, depth) }
    }

    /// Evenly spread, over more rows than the picture has; every second surfel is turned if `turned` says so.
    fn cloud(self, closed: Closed, turned: bool) -> Cloud {
        let [from, to] = self.columns;
        let columns = ((to - from) * DENSITY as f64).round().max(1.0) as usize;
        let step = (to - from) / columns as f64;
        let rows = 16 * DENSITY;
        let of = |i: usize| {
            let (column, row) = (i % columns, i / columns);
            let x = from + (column as f64 + 0.5) * step;
            let y = (row as f64 + 0.5) / DENSITY as f64 - 4.0;
            let center = Vec3::new((x - 12.0) as f32, (y - 4.0) as f32, self.depth);
            let is_back = self.is_back ^ (turned && (column + row) % 2 == 1);
            let normal = if is_back { Vec3::Z } else { Vec3::NEG_Z };
            (center, oblate_factor(normal, 0.4 / DENSITY as f32, f32::INFINITY))
        };
        let count = columns * rows;
        let (centers, factors): (Vec<_>, Vec<_>) = (0..count).map(of).unzip();
        let area = (step / DENSITY as f64) as f32;
        let surface = Surface {
            areas: vec![area; count],
            opacities: (self.opacity < 1.0).then(|| vec![self.opacity; count]),
            depth_tolerance: 0.5,
            coverage_floor: 0.9,
            closed,
        };
        Cloud::new(Splats {
            centers,
            shapes: Shapes::Each(factors),
            strength: Strength::Surface(surface),
            colors: vec![[1.0; 3]; count],
            harmonics: None,
            normals: None,
            material: Material::UNLIT,
        })
        .unwrap()
    }
}

/// How opaque each column is, in the middle of the picture.
fn opacities(clouds: Vec<Cloud>) -> Vec<f64> {
    let pose = Pose::look_at(DVec3::NEG_Z * 20.0, DVec3::ZERO, DVec3::NEG_Y).unwrap();
    let camera = Camera::orthographic(pose, f64::from(SIZE[1]), SIZE).unwrap();
    let settings = RenderSettings { shade: false, ..RenderSettings::default() };
    let scene = Scene { clouds, lights: Vec::new() };
    let row = |frame: Frame| -> Vec<f64> {
        let first = (SIZE[0] * SIZE[1] / 2) as usize;
        frame.color[first..][..SIZE[0] as usize].iter().map(|pixel| f64::from(pixel[3])).collect()
    };
    let drawn = row(render(&scene, &camera, &settings, &()).unwrap());
    let right = row(reference(&scene, &camera, &settings, ReferenceKind::R1, &|_| ()).unwrap());
    for (column, (drawn, right)) in drawn.iter().zip(&right).enumerate() {
        // A quarter of the tolerance may be left out.
        assert!((drawn - right).abs() < 0.25 / 255.0 + 1e-4, "column {column}: {drawn}, by R1 {right}");
    }
    drawn
}

fn of_sheets(sheets: &[Sheet]) -> Vec<f64> {
    opacities(sheets.iter().map(|sheet| sheet.cloud(Closed::Sided, false)).collect())
}

/// Pixels that are covered.
fn covered(sheets: &[Sheet]) -> f64 {
    of_sheets(sheets).iter().sum()
}

/// Where outlines lie in a pixel.
const PHASES: [f64; 4] = [12.0, 12.2, 12.5, 12.8];

/// The front and the back of a sheet that folds end at one outline: the pixel is covered as far as by either, in one layer or in two. Were they
/// beside each other, it would be covered by 2Φ(x/σ) up to 1 instead of Φ: 0.8 σ more at each outline, 0.45 pixels here.
#[test]
fn what_ends_at_one_line_covers_once() {
    for edge in PHASES {
        let alone = covered(&[Sheet::front(2.0, edge, 0.0)]);
        // The floor is q = 0.96 − 0.06 √a = 0.946, the filter dimming a surfel to a = 0.056 of its peak. Where Φ/q counts as coverage up to 1, the
        // integral of what is too much is 0.116 of the footprint's σ of 0.56 pixels, at both outlines.
        assert!((alone - (edge - 2.0) - 0.13).abs() < 0.02, "{alone} from 2 to {edge}");
        for depth in [0.2, 5.0] {
            for sheets in [
                [Sheet::front(2.0, edge, 0.0), Sheet::back(2.0, edge, depth)],
                [Sheet::back(2.0, edge, 0.0), Sheet::front(2.0, edge, depth)],
                // What is within it changes nothing.
                [Sheet::front(2.0, edge, 0.0), Sheet::back(2.0, edge - 0.5, depth)],
            ] {
                let both = covered(&sheets);
                // But for what may be left out, a quarter of the tolerance in each of 24 pixels.
                assert!(
                    (both - alone).abs() < 24.0 / 4.0 / 255.0,
                    "{both} instead of {alone} to {edge}, {depth} behind"
                );
            }
        }
    }
}

/// At a crease one part ends where the other begins; nothing shows through, in one layer or in two.
#[test]
fn what_lies_beside_each_other_covers_all() {
    for edge in PHASES {
        for depth in [0.2, 5.0] {
            for side in [Sheet::front, Sheet::back] {
                let opacities = of_sheets(&[side(2.0, edge, 0.0), side(edge, 22.0, depth)]);
                let least = opacities[4..20].iter().copied().fold(1.0, f64::min);
                assert!(least > 0.999, "{least} at a crease at {edge}, {depth} deep");
            }
        }
    }
}

/// A surface that turns away falls into strips, one farther than the other: it covers as much as if it were one.
#[test]
fn strips_lie_beside_each_other() {
    for edge in PHASES {
        for width in [0.5, 1.0, 2.0] {
            let whole = covered(&[Sheet::front(2.0, edge, 0.0)]);
            let parts =
                covered(&[Sheet::front(2.0, edge - width, 0.0), Sheet::front(edge - width, edge, 5.0)]);
            // As above.
            assert!(
                (parts - whole).abs() < 24.0 / 4.0 / 255.0,
                "{parts} instead of {whole}, with a strip of {width} to {edge}"
            );
        }
    }
}

/// Inside its outline a translucent sheet that folds is two sheets, in one layer or in two; where it ends its two sides end together.
#[test]
fn translucent_folds_are_two_sheets() {
    let opacity = 0.4;
    for depth in [0.2, 5.0] {
        let sheets = [Sheet::front(2.0, 12.5, 0.0), Sheet::back(2.0, 12.5, depth)];
        let both = of_sheets(&sheets.map(|sheet| Sheet { opacity, ..sheet }));
        let two = 1.0 - (1.0 - f64::from(opacity)).powi(2);
        // The floor is 0.946, so that each side covers the pixel 1.057 times, which counts as once. An eighth of the tolerance is rounding.
        for alpha in &both[4..10] {
            assert!((alpha - two).abs() < 0.002, "{alpha} instead of {two}, {depth} behind");
        }
        // Half a pixel over the floor, by both; in one layer what may be ripple of 0.054 counts for none, twice, of the second sheet: 0.019 less opaque.
        let at_outline = 0.5 / 0.946 * two;
        assert!((both[12] - at_outline).abs() < 0.015, "{}, not {at_outline}, {depth} behind", both[12]);
    }
}

/// Of points the normals may be turned to and fro.
#[test]
fn what_has_no_sides_covers_whole() {
    let sheet = Sheet::front(2.0, 22.0, 0.0);
    let opacities = opacities(vec![sheet.cloud(Closed::Nowhere, true)]);
    let least = opacities[4..20].iter().copied().fold(1.0, f64::min);
    assert!(least > 0.999, "{least}");
}
