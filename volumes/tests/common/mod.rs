//! What several tests of this crate share.
#![allow(dead_code, reason = "each test binary uses its own part")]

pub(crate) mod cells;

use std::io::Read;
use std::path::PathBuf;

use flate2::read::GzDecoder;
use glam::{DMat2, DMat3, DVec2, DVec3};
use oblate_engine::{Cloud, Strength, Surface};
use oblate_volumes::{GridFrame, Volume, Voxels};

/// The bytes of a gzipped volume of the test data; `None`, said aloud, if it is not there.
pub(crate) fn real_bytes(name: &str) -> Option<Vec<u8>> {
    let root = std::env::var_os("OBLATE_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")),
        PathBuf::from,
    );
    let path = root.join("volumes").join(name);
    let Ok(file) = std::fs::File::open(&path) else {
        assert!(
            std::env::var_os("OBLATE_REQUIRE_DATA").is_none_or(|v| v != "1"),
            "{} is missing",
            path.display()
        );
        println!("skipped: {} is missing", path.display());
        return None;
    };
    let mut bytes = Vec::new();
    GzDecoder::new(file).read_to_end(&mut bytes).unwrap();
    Some(bytes)
}

/// The scanned engine.
pub(crate) fn real_engine() -> Option<Volume> {
    let bytes = real_bytes("engine_256x256x128_uint8.raw.gz")?;
    Some(Volume::new([256, 256, 128], Voxels::U8(bytes), GridFrame::default()).unwrap())
}

/// The scanned head, whose slices are 2 apart.
pub(crate) fn real_head() -> Option<Volume> {
    let bytes = real_bytes("CThead_256x256x113_uint16be.raw.gz")?;
    let values = bytes.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect();
    let frame = GridFrame { spacing: DVec3::new(1.0, 1.0, 2.0), ..GridFrame::default() };
    Some(Volume::new([256, 256, 113], Voxels::U16(values), frame).unwrap())
}

/// A volume of a field given in world coordinates.
pub(crate) fn sampled(dims: [usize; 3], frame: GridFrame, field: impl Fn(DVec3) -> f64) -> Volume {
    let steps = frame.direction * DMat3::from_diagonal(frame.spacing);
    let [nx, ny, nz] = dims;
    let mut values = Vec::new();
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                let world = frame.origin + steps * DVec3::new(i as f64, j as f64, k as f64);
                values.push(field(world) as f32);
            }
        }
    }
    Volume::new(dims, Voxels::F32(values), frame).unwrap()
}

/// The point in the middle of a grid.
pub(crate) fn middle(dims: [usize; 3], frame: GridFrame) -> DVec3 {
    let half = DVec3::from(dims.map(|d| 0.5 * (d - 1) as f64));
    frame.origin + frame.direction * (frame.spacing * half)
}

/// Frames that a grid may have: spacing even and uneven, turned, flipped, sheared.
pub(crate) fn frames() -> Vec<(&'static str, GridFrame)> {
    let turned = DMat3::from_axis_angle(DVec3::new(1.0, -2.0, 0.5).normalize(), 0.9);
    let uneven = DVec3::new(1.0, 1.0, 2.0);
    let sheared = DMat3::from_cols(
        DVec3::X,
        DVec3::new(0.3, 1.0, 0.0).normalize(),
        DVec3::new(-0.2, 0.1, 1.0).normalize(),
    );
    let frame = |spacing, direction| GridFrame {
        spacing,
        direction,
        origin: DVec3::new(3.0, -7.0, 11.0),
        ..GridFrame::default()
    };
    vec![
        ("even", GridFrame::default()),
        ("1:1:2", frame(uneven, DMat3::IDENTITY)),
        ("turned 1:1:2", frame(uneven, turned)),
        ("flipped", frame(DVec3::new(0.5, 0.5, 0.75), DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)))),
        ("sheared", frame(DVec3::new(1.0, 0.8, 1.2), sheared)),
    ]
}

/// A grid of frame `frame` in which a sphere of radius `radius` in world units has room, and its middle.
pub(crate) fn grid_around(frame: GridFrame, radius: f64) -> ([usize; 3], DVec3) {
    let reach = (frame.direction * DMat3::from_diagonal(frame.spacing)).inverse().transpose();
    let dims = [0, 1, 2].map(|axis| (2.0 * radius * reach.col(axis).length()).ceil() as usize + 7);
    (dims, middle(dims, frame) + DVec3::new(0.21, -0.13, 0.08) * frame.spacing)
}

/// What `work` gives on 1, 2 and 5 threads.
pub(crate) fn on_threads<T: Send>(work: impl Fn() -> T + Sync) -> [T; 3] {
    [1, 2, 5]
        .map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(&work))
}

/// The surface part of a cloud.
pub(crate) fn surface(cloud: &Cloud) -> Surface {
    match cloud.splats().strength {
        Strength::Surface(surface) => surface,
        other => panic!("no surface but {other:?}"),
    }
}

/// Centre in the world, factor, normal, area of each surfel.
pub(crate) fn surfels(cloud: &Cloud) -> Vec<(DVec3, DMat3, DVec3, f64)> {
    let splats = cloud.splats();
    let areas = surface(cloud).areas;
    (0..cloud.len())
        .map(|i| {
            let center = cloud.cloud_to_world().transform_point3(splats.centers[i].as_dvec3());
            let factor = splats.shapes.factor(i).as_dmat3();
            let normal = factor.x_axis.cross(factor.y_axis).normalize();
            (center, factor, normal, f64::from(areas[i]))
        })
        .collect()
}

/// Summed coverage Σw at `point` seen along its unit `normal`: each surfel's Gaussian, projected along the
/// normal, times its area and the cosine. Surfels further off the tangent plane than `depth` stay out.
pub(crate) fn coverage(
    surfels: &[(DVec3, DMat3, DVec3, f64)],
    point: DVec3,
    normal: DVec3,
    depth: f64,
) -> f64 {
    let (t1, t2) = normal.any_orthonormal_pair();
    let onto = |v: DVec3| DVec2::new(t1.dot(v), t2.dot(v));
    let near = surfels.iter().filter(|(center, factor, _, _)| {
        let reach = 8.0 * factor.x_axis.length().max(factor.y_axis.length());
        (*center - point).dot(normal).abs() <= depth && onto(*center - point).length() <= reach
    });
    near.map(|(center, factor, facing, area)| {
        let mut covariance = DMat2::ZERO;
        for axis in [factor.x_axis, factor.y_axis, factor.z_axis].map(onto) {
            covariance += DMat2::from_cols(axis * axis.x, axis * axis.y);
        }
        let d = onto(*center - point);
        let determinant = covariance.determinant();
        let exponent = -0.5 * d.dot(covariance.inverse() * d);
        area * facing.dot(normal).abs() / (std::f64::consts::TAU * determinant.sqrt()) * exponent.exp()
    })
    .sum()
}

/// Pseudo-random numbers from 0 to 1, the same each time.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> f64 {
        // Steele, Lea, Flood, Fast Splittable Pseudorandom Number Generators, 2014 (SplitMix64).
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Evenly spread over the unit sphere.
    pub(crate) fn direction(&mut self) -> DVec3 {
        let z = 2.0 * self.next() - 1.0;
        let (sine, cosine) = (std::f64::consts::TAU * self.next()).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cosine, r * sine, z)
    }
}
