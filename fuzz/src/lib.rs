//! What all fuzz targets do: open a file, and hold what it gave to its promises.

use oblate::engine::Cloud;
use oblate::importers::{Content, OpenOptions, open as open_file};
use std::fs;
use std::path::Path;
use std::sync::LazyLock;
use tempfile::TempDir;

/// What compressed files may unpack to.
const MAX_MEMORY: u64 = 64 << 20;

/// Where files are written, with those beside them that seeds name: `beside` is written with the seeds.
static FOLDER: LazyLock<TempDir> = LazyLock::new(|| {
    // In memory where there is such a place.
    let shared = Path::new("/dev/shm");
    let folder = if shared.is_dir() { TempDir::new_in(shared) } else { TempDir::new() };
    let folder = folder.expect("a temporary folder can be made");
    let beside = fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/beside"));
    for entry in beside.into_iter().flatten().flatten() {
        fs::copy(entry.path(), folder.path().join(entry.file_name())).expect("a file can be written");
    }
    folder
});

/// Opens `bytes` under a name: anything but a panic, a hang or much memory is right.
pub fn open(name: &str, bytes: &[u8]) {
    let path = FOLDER.path().join(name);
    fs::write(&path, bytes).expect("a file can be written");
    let options = OpenOptions { max_memory: MAX_MEMORY, ..OpenOptions::default() };
    let Ok(opened) = open_file(path, &options) else { return };
    match opened.content {
        Content::Mesh(mesh) => {
            for primitive in &mesh.primitives {
                let count = primitive.positions.len();
                assert!(primitive.triangles.iter().flatten().all(|corner| (*corner as usize) < count));
                assert!(primitive.positions.iter().all(|position| position.is_finite()));
            }
        }
        Content::Volume(volume) => assert!(volume.index_to_world().is_finite()),
        Content::Irregular(volume) => assert!(volume.bounds().iter().all(|corner| corner.is_finite())),
        Content::Points(points) => {
            assert!(
                points.origin.is_finite() && points.positions.iter().all(|position| position.is_finite())
            );
        }
        Content::Splats { splats, .. } => assert!(Cloud::new(splats).is_ok_and(|cloud| !cloud.is_empty())),
    }
}
