//! Irregular volumes: told, drawn, extracted and converted as others are.

use crate::place::{Workplace, levels};

/// Radii, angles and heights of a thick pipe, and its points.
const DIMS: [usize; 3] = [7, 25, 6];

fn point([i, j, k]: [usize; 3]) -> [f64; 3] {
    let (radius, angle) = (1.0 + i as f64 / 6.0, std::f64::consts::TAU * j as f64 / 24.0);
    [radius * angle.cos(), radius * angle.sin(), 0.4 * k as f64 - 1.0]
}

fn indices() -> impl Iterator<Item = [usize; 3]> {
    let [nx, ny, nz] = DIMS;
    (0..nx * ny * nz).map(move |n| [n % nx, n / nx % ny, n / (nx * ny)])
}

/// Writes a PLOT3D pair: the density is the distance from the axis, 1 to 2.
fn pipe(place: &Workplace, points: &str, flow: &str) {
    let bytes =
        |numbers: Vec<f64>| numbers.into_iter().flat_map(|x| (x as f32).to_be_bytes()).collect::<Vec<u8>>();
    let head: Vec<u8> = DIMS.iter().flat_map(|n| (*n as u32).to_be_bytes()).collect();
    let coordinates = (0..3).flat_map(|axis| indices().map(move |index| point(index)[axis]));
    place.write(points, [&head[..], &bytes(coordinates.collect())].concat());
    let densities = indices().map(|[i, ..]| 1.0 + i as f64 / 6.0);
    let others = std::iter::repeat_n(0.0, 4 * indices().count());
    let flow_bytes = bytes([0.0; 4].into_iter().chain(densities).chain(others).collect());
    place.write(flow, [&head[..], &flow_bytes].concat());
}

/// Pixels that differ from the background.
fn seen(place: &Workplace, args: &[&str]) -> usize {
    place.run(&[&["render"], args, &["--size", "48x48", "-o", "a.png", "--quiet"]].concat());
    levels(&place.path("a.png")).pixels().filter(|pixel| *pixel != &image::Rgba([32, 32, 32, 255])).count()
}

#[test]
fn grids_are_drawn_as_kernels_and_as_surfaces() {
    let place = Workplace::new();
    pipe(&place, "pipe.x", "pipe.q");
    for look in
        [&[][..], &["--transfer", "fire"], &["--iso", "1.4"], &["--iso", "1.2,1.7", "--transfer", "grey"]]
    {
        for name in ["pipe.x", "pipe.q"] {
            let pixels = seen(&place, &[&[name], look].concat());
            assert!(pixels > 400, "{name}, {look:?}: {pixels} pixels");
        }
    }
    let [_, said] = place.run(&["render", "pipe.x", "--size", "16x16", "--iso", "5", "-o", "a.png"]);
    assert!(said.contains("nothing in it is visible (values 1 to 2)"), "{said}");
    assert!(said.contains("momentum and energy"), "{said}");
}

#[test]
fn info_tells_of_points() {
    let place = Workplace::new();
    pipe(&place, "pipe.x", "pipe.q");
    let [text, _] = place.run(&["info", "pipe.x"]);
    for part in [
        "PLOT3D",
        "curvilinear grid of 7×25×6 points",
        "bounds      -2, -2, -1 to 2, 2, 1",
        "values      1 to 2",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let [json, _] = place.run(&["info", "pipe.x", "--json"]);
    let told: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((&told["kind"], &told["arrangement"]), (&"irregular".into(), &"curvilinear".into()));
    assert_eq!((&told["dims"], &told["range"]), (&[7, 25, 6].into(), &[1.0, 2.0].into()));
    assert_eq!(told["count"], 7 * 25 * 6);
}

#[test]
fn surfaces_are_written_and_drawn_again() {
    let place = Workplace::new();
    pipe(&place, "pipe.x", "pipe.q");
    let [stats, _] =
        place.run(&["extract", "pipe.x", "--iso", "1.45", "-o", "a.ply", "--quiet", "--stats", "-"]);
    let told: serde_json::Value = serde_json::from_str(&stats).unwrap();
    // Steps are longer than a 128th of the diagonal, 6/128: the 24·5 cells that are met are searched in parts, at most 64 of each.
    let surfels = told["surfels"].as_u64().unwrap();
    assert!(
        surfels.is_multiple_of(120) && (2..=64).contains(&(surfels / 120)) && told["closed"] == false,
        "{told}"
    );
    // 24 flat sides of a pipe of radius 1.45 whose edges are cut by the chords: 2·24·sin(π/24)·1.45 around, 2 high.
    let area = 2.0 * 24.0 * (std::f64::consts::PI / 24.0).sin() * 1.45 * 2.0;
    assert!((told["area"].as_f64().unwrap() / area - 1.0).abs() < 1e-4, "{told}");
    place.run(&["convert", "pipe.x", "b.ply", "--iso", "1.45", "--quiet"]);
    place.run(&["convert", "pipe.x", "c.ply", "--transfer", "amber", "--as", "surfel-ply", "--quiet"]);
    let view = ["--eye", "4,5,3", "--target", "0,0,0", "--up", "0,0,1"];
    let counts = ["a.ply", "b.ply", "c.ply"].map(|name| seen(&place, &[&[name], &view[..]].concat()));
    let direct = seen(&place, &[&["pipe.x", "--iso", "1.45"], &view[..]].concat());
    assert!(counts[0] == direct && counts[1] == direct && counts[2] > direct, "{counts:?}, {direct}");
    let message = place.refusal(&["convert", "pipe.x", "a.nrrd"]);
    assert!(message.contains("nrrd holds regular grids"), "{message}");
    let message = place.refusal(&["convert", "pipe.x", "a.ply"]);
    assert!(message.contains("--iso or --transfer"), "{message}");
}

#[test]
fn scattered_samples_have_no_surfaces() {
    let place = Workplace::new();
    let points: String = indices().map(point).map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    let values: String = indices().map(|[i, ..]| format!("{i} ")).collect();
    let count = indices().count();
    place.write(
        "a.vtk",
        format!(
            "# vtk DataFile Version 3.0\n\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {count} float\n{points}\
             POINT_DATA {count}\nSCALARS a float\nLOOKUP_TABLE default\n{values}\n"
        ),
    );
    assert!(seen(&place, &["a.vtk"]) > 400);
    for args in [&["render", "a.vtk", "--iso", "3"][..], &["extract", "a.vtk", "--iso", "3", "-o", "a.ply"]] {
        let message = place.refusal(args);
        assert!(message.contains("no cells") && message.lines().count() == 1, "{message}");
    }
    let [json, _] = place.run(&["info", "a.vtk", "--json"]);
    assert!(json.contains("\"scattered\"") && json.contains("\"dims\":null"), "{json}");
}

#[test]
fn the_flow_can_be_named() {
    let place = Workplace::new();
    pipe(&place, "pipe.x", "elsewhere.dat");
    let message = place.refusal(&["info", "pipe.x"]);
    assert!(message.contains("pipe.q") && message.lines().count() == 1, "{message}");
    place.run(&["info", "pipe.x", "--flow", "elsewhere.dat"]);
    place.write(
        "scene.toml",
        "version = 1\n[[volume]]\npath = \"pipe.x\"\nflow = \"elsewhere.dat\"\niso = [1.5]\nscale = 0.5\n",
    );
    assert!(seen(&place, &["scene.toml"]) > 400);
    let cube = place.cube();
    let message = place.refusal(&["info", cube.to_str().unwrap(), "--flow", "elsewhere.dat"]);
    assert!(message.contains("--flow is for PLOT3D grids"), "{message}");
}
