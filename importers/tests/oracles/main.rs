//! What oblate reads of the test data against what other readers read: `tests/oracles/` of the repository holds what they said
//! and how to ask them. Without the data these tests skip, unless `OBLATE_REQUIRE_DATA=1`.

#![expect(clippy::unwrap_used, reason = "helpers of tests may panic as tests do")]

mod agreement;
mod irregular;
mod mesh;
mod points;
mod splats;
mod volume;

use agreement::Agreement;
use oblate_importers::{Content, OpenOptions, Opened, open};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::{env, fs};

/// What another reader says of a file.
#[derive(Deserialize)]
struct Oracle {
    /// Its place in the test data.
    file: String,
    #[serde(flatten)]
    facts: Facts,
}

#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
enum Facts {
    Mesh(mesh::Facts),
    Volume(volume::Facts),
    Points(points::Facts),
    Splats(splats::Facts),
    SplatLevels(splats::Levels),
    StructuredGrid(irregular::Facts),
    /// The other reader cannot read it; there is nothing to compare with.
    Refused {},
}

/// Where a file is that something is said of.
fn place(file: &str) -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = match env::var_os("OBLATE_DATA") {
        _ if file.starts_with("written/") => manifest.join("../tests/oracles"),
        Some(root) => PathBuf::from(root),
        None => manifest.join("../../shared/data"),
    };
    root.join(file)
}

/// What is said of the files in a folder of the test data.
fn oracles(folder: &str) -> Vec<Oracle> {
    let expected = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/oracles/expected"));
    let mut paths: Vec<_> = fs::read_dir(expected).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let read = |path: PathBuf| {
        let text = fs::read_to_string(&path).unwrap();
        serde_json::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    };
    let all: Vec<Oracle> = paths.into_iter().map(read).collect();
    all.into_iter().filter(|oracle| oracle.file.starts_with(folder)).collect()
}

/// Opens all files of a folder and says of all of them what is not as other readers have it.
fn agree(folder: &str) {
    let oracles = oracles(folder);
    assert!(!oracles.is_empty(), "nothing is said of {folder}");
    let problems: Vec<String> = oracles.iter().flat_map(problems).collect();
    assert!(problems.is_empty(), "\n{}", problems.join("\n"));
}

fn problems(oracle: &Oracle) -> Vec<String> {
    let path = place(&oracle.file);
    if !path.exists() {
        let is_here = oracle.file.starts_with("written/");
        let required = is_here || env::var_os("OBLATE_REQUIRE_DATA").is_some_and(|value| value == "1");
        assert!(!required, "{} is required", path.display());
        println!("skipped: {} is not there", path.display());
        return Vec::new();
    }
    let mut agreement = Agreement::new(&oracle.file);
    let opened = open(&path, &OpenOptions::default());
    match (opened, &oracle.facts) {
        (_, Facts::Refused {}) => println!("nothing to compare with: {}", oracle.file),
        (Err(error), _) => agreement.problem(error.to_string()),
        (Ok(Opened { content, .. }), facts) => compare(&mut agreement, content, facts),
    }
    agreement.into_problems()
}

fn compare(agreement: &mut Agreement, content: Content, facts: &Facts) {
    match (content, facts) {
        (Content::Mesh(mesh), Facts::Mesh(facts)) => mesh::compare(agreement, &mesh, facts),
        (Content::Volume(volume), Facts::Volume(facts)) => volume::compare(agreement, &volume, facts),
        (Content::Irregular(volume), Facts::StructuredGrid(facts)) => {
            irregular::compare(agreement, &volume, facts)
        }
        (Content::Points(points), Facts::Points(facts)) => points::compare(agreement, &points, facts),
        (Content::Splats { splats, .. }, Facts::Splats(facts)) => splats::compare(agreement, &splats, facts),
        (Content::Splats { splats, .. }, Facts::SplatLevels(levels)) => {
            splats::compare_levels(agreement, &splats, levels);
        }
        _ => agreement.problem("is something else than other readers say"),
    }
}

#[test]
fn meshes() {
    agree("meshes/");
}

#[test]
fn volumes() {
    agree("volumes/");
}

#[test]
fn point_clouds() {
    agree("pointclouds/");
}

#[test]
fn trained_splats() {
    agree("splats/");
}

/// What other programs wrote for these tests: rotated, flipped and contradictory headers, and formats that the data lacks.
#[test]
fn files_of_other_writers() {
    agree("written/");
}

#[test]
fn irregular_grids() {
    agree("irregular/");
}
