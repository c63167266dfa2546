//! What fuzz targets do: read a file, and hold what it gave to its promises.

use oblate::engine::Cloud;
use oblate::importers::depth::{DepthEncoding, read_color, read_depth, read_intrinsics, read_poses};
use oblate::importers::{Content, OpenOptions, open as open_file};
use std::fs;
use std::path::{Path, PathBuf};
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

/// A file of `bytes`.
fn written(name: &str, bytes: &[u8]) -> PathBuf {
    let path = FOLDER.path().join(name);
    fs::write(&path, bytes).expect("a file can be written");
    path
}

/// Reads `bytes` as a depth map, under every encoding, and as a photograph.
pub fn depth(bytes: &[u8]) {
    let path = written("depth", bytes);
    let disparity = DepthEncoding::Disparity { baseline_focal: 1.0, offset: -3.0, scale: 1.0 };
    for encoding in [DepthEncoding::Auto, disparity, DepthEncoding::SunRgbd, DepthEncoding::NyuRaw] {
        if let Ok(map) = read_depth(&path, &encoding, MAX_MEMORY) {
            assert_eq!(map.depths.len(), map.size[0] * map.size[1]);
            assert!(map.depths.iter().all(|depth| depth.is_finite() && *depth >= 0.0));
        }
    }
    if let Ok(picture) = read_color(&path, MAX_MEMORY) {
        assert_eq!(picture.colors.len(), picture.size[0] * picture.size[1]);
        assert!(picture.colors.iter().flatten().all(|c| c.is_finite()));
    }
}

/// Reads `bytes` as poses and as intrinsics.
pub fn poses(bytes: &[u8]) {
    let path = written("poses", bytes);
    for timed in read_poses(&path).unwrap_or_default() {
        let to_camera = timed.pose.world_to_camera;
        assert!(to_camera.is_finite() && (to_camera.matrix3.determinant() - 1.0).abs() < 1e-12);
    }
    if let Ok((_, intrinsics)) = read_intrinsics(&path) {
        assert!(intrinsics.focal.is_finite() && intrinsics.center.is_finite());
    }
}

/// Opens `bytes` under a name: anything but a panic, a hang or much memory is right.
pub fn open(name: &str, bytes: &[u8]) {
    let path = written(name, bytes);
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
