//! The built-in scene: a torus knot, textured, and the Shepp–Logan head phantom that it cuts through,
//! half transparent with the surfaces of its organs inside.

use crate::content::{Body, Item, placed_mesh};
use crate::description::{Description, Look, Transfer};
use crate::notation::Rgba;
use crate::progress::Console;
use anyhow::Result;
use glam::{DAffine3, DMat3, DVec3, Vec4};
use oblate::engine::Light;
use oblate::surfels::{BaseColor, Filter, Mesh, Texture, Wrap, primitives};
use oblate::volumes::{Volume, Voxels, shepp_logan};
use std::sync::Arc;

/// Samples along a side of the phantom.
const SAMPLES: usize = 160;

/// The skull as tinted glass, clear where it is thin; the brain is not drawn.
const GLASS: &str = "
    transfer 1
    strength extinction
    color srgb
    0.22  0.10 0.40 0.50  0
    0.50  0.30 0.66 0.70  2.5
    0.80  0.75 0.95 0.92  6
";

/// Its lights; the camera is framed.
pub(crate) fn description() -> Description {
    Description { lights: lights(), ..Description::default() }
}

/// Warm from the upper left, cool from the right, a little from everywhere.
fn lights() -> Vec<Light> {
    vec![
        Light::Ambient { color: [0.55, 0.6, 0.7] },
        Light::Directional { towards: DVec3::new(-0.6, -0.9, 1.3), color: [1.35, 1.25, 1.1] },
        Light::Directional { towards: DVec3::new(1.0, -0.4, 0.1), color: [0.18, 0.25, 0.4] },
    ]
}

/// What is in it.
pub(crate) fn items(console: Console) -> Result<Vec<Item>> {
    let _task = console.task("making the built-in scene");
    let phantom = smoothed(&shepp_logan(SAMPLES)?)?;
    let organs = inner(&phantom)?;
    let item = |name: &str, body, look| {
        let places = vec![DAffine3::IDENTITY];
        Item { name: name.into(), body, places, look, up: DVec3::Z }
    };
    Ok(vec![
        item(
            "phantom",
            Body::Volume(phantom),
            Look { transfer: Some(Transfer::Made(GLASS.parse()?)), ..Look::default() },
        ),
        item(
            "organs",
            Body::Volume(organs),
            Look {
                iso: Some(vec![0.1, 0.3]),
                iso_color: Some(vec![Rgba::from_bytes([0xd8, 0x60, 0x40, 0xff])]),
                ..Look::default()
            },
        ),
        item("knot", Body::Mesh(knot()), Look::default()),
    ])
}

/// The phantom with each axis filtered by (1 2 1)/4: its skull is thinner than the lattice can hold, and
/// would show rings.
fn smoothed(phantom: &Volume) -> Result<Volume> {
    let [nx, ny, _] = phantom.dims();
    let mut values: Vec<f32> = (0..phantom.voxels().len()).map(|i| phantom.voxels().get(i)).collect();
    for step in [1, nx, nx * ny] {
        let before = values.clone();
        // Neighbours across the end of a row are both empty.
        for i in step..values.len() - step {
            values[i] = 0.25 * before[i - step] + 0.5 * before[i] + 0.25 * before[i + step];
        }
    }
    Ok(Volume::new(phantom.dims(), Voxels::F32(values), phantom.frame())?)
}

/// The phantom inside its skull; outside nothing.
fn inner(phantom: &Volume) -> Result<Volume> {
    let to_world = phantom.index_to_world();
    let [nx, ny, _] = phantom.dims();
    let values = (0..phantom.voxels().len()).map(|i| {
        let index = [i % nx, i / nx % ny, i / nx / ny];
        let p = to_world.transform_point3(DVec3::from(index.map(|n| n as f64)));
        let inside = (p / DVec3::new(0.62, 0.83, 0.84)).length() < 1.0;
        if inside { phantom.voxels().get(i) } else { f32::NAN }
    });
    Ok(Volume::new(phantom.dims(), Voxels::F32(values.collect()), phantom.frame())?)
}

/// A trefoil around the phantom, through its temples, coloured from gold to violet.
fn knot() -> Mesh {
    let mut knot = primitives::torus_knot(2, 3, 0.17, [720, 72]);
    // The texture's u runs along the knot; colours change with the place on it.
    let along = knot.tex_coords.iter().flatten().map(|t| f64::from(t.x));
    let length = along.clone().fold(1.0, f64::max);
    knot.colors = Some(along.map(|u| gradient(u / length)).collect());
    knot.material = BaseColor { factor: Vec4::ONE, texture: Some(Arc::new(checker())) };
    // Upright, and turned so that it leaves a window to the organs.
    let rotation = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let upright = DAffine3::from_mat3(rotation * DMat3::from_diagonal(DVec3::splat(0.88)));
    placed_mesh(Mesh { primitives: vec![knot] }, upright)
}

/// Gold, vermilion, violet and back as `turn` goes from 0 to 1.
fn gradient(turn: f64) -> Vec4 {
    let stops = [[0xf2, 0xb1, 0x34], [0xe0, 0x4f, 0x2e], [0x8e, 0x3b, 0x8a]];
    let place = turn.rem_euclid(1.0) * 3.0;
    let color = |i: usize| {
        let [r, g, b] = stops[i % 3];
        Vec4::from(Rgba::from_bytes([r, g, b, 0xff]).0)
    };
    color(place as usize).lerp(color(place as usize + 1), place.fract() as f32)
}

/// Light squares and darker ones.
fn checker() -> Texture {
    const SIDE: usize = 256;
    let texels = (0..SIDE * SIDE)
        .map(|i| {
            let (x, y) = (i % SIDE, i / SIDE);
            let light = (x * 4 / SIDE + y * 4 / SIDE).is_multiple_of(2);
            if light { [0xff, 0xff, 0xff, 0xff] } else { [0xac, 0x9e, 0xa4, 0xff] }
        })
        .collect();
    Texture { width: SIDE, height: SIDE, texels, wrap: [Wrap::Repeat; 2], filter: Filter::Linear }
}
