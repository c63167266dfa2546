//! The built-in scene: a torus knot, textured, and the Shepp–Logan head phantom that it cuts through,
//! half transparent with the surfaces of its organs inside.

use crate::content::{Body, Item, placed_mesh};
use crate::description::{CameraOptions, Description, Look};
use crate::notation::Rgba;
use crate::progress::Console;
use anyhow::Result;
use glam::{DAffine3, DMat3, DVec3, Vec4};
use oblate::engine::Light;
use oblate::surfels::{BaseColor, Mesh, Texture, Wrap, primitives};
use oblate::volumes::{Volume, Voxels, shepp_logan};
use std::sync::Arc;

/// Samples along a side of the phantom.
const SAMPLES: usize = 160;

/// Camera and lights.
pub(crate) fn description() -> Description {
    Description { camera: CameraOptions::default(), lights: lights(), ..Description::default() }
}

fn lights() -> Vec<Light> {
    Vec::new()
}

/// What is in it.
pub(crate) fn items(console: Console) -> Result<Vec<Item>> {
    let _task = console.task("making the built-in scene");
    let phantom = shepp_logan(SAMPLES)?;
    let organs = inner(&phantom)?;
    let item = |name: &str, body, look| Item { name: name.into(), body, look };
    Ok(vec![
        item("phantom", Body::Volume(phantom), Look { transfer: Some("cool".into()), ..Look::default() }),
        item(
            "organs",
            Body::Volume(organs),
            Look {
                iso: Some(vec![0.1, 0.3]),
                iso_color: Some(Rgba::from_bytes([0xd8, 0x60, 0x40, 0xff])),
                ..Look::default()
            },
        ),
        item("knot", Body::Mesh(knot()), Look::default()),
    ])
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

fn knot() -> Mesh {
    let mut knot = primitives::torus_knot(2, 3, 0.16, [600, 64]);
    knot.material = BaseColor { factor: Vec4::ONE, texture: Some(Arc::new(checker())) };
    let upright = DAffine3::from_mat3(DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2));
    placed_mesh(Mesh { primitives: vec![knot] }, upright)
}

/// A checker of two colours.
fn checker() -> Texture {
    const SIDE: usize = 64;
    let texels = (0..SIDE * SIDE)
        .map(|i| {
            let (x, y) = (i % SIDE * 4 / SIDE, i / SIDE * 4 / SIDE);
            if (x + y) % 2 == 0 { [0xe8, 0xdc, 0xc0, 0xff] } else { [0x2a, 0x6f, 0x97, 0xff] }
        })
        .collect();
    Texture { width: SIDE, height: SIDE, texels, wrap: [Wrap::Repeat; 2] }
}
