//! glTF 2.0 and GLB: the triangles of a scene, or its trained splats.
//!
//! Source: Khronos, *glTF 2.0 Specification*, 2021 (ISO/IEC 12113:2022); extensions KHR_mesh_quantization,
//! KHR_texture_transform, KHR_materials_pbrSpecularGlossiness (its diffuse colour), KHR_materials_unlit, EXT_texture_webp, EXT_meshopt_compression
//! and KHR_meshopt_compression (with the cargo feature `meshopt`), KHR_gaussian_splatting (release candidate of 2026).
//! glTF's world is oblate's. The default scene is read, else all nodes.
//!
//! Meshes: each use of a mesh by a node is a primitive with the node's transform. Points and lines are left out; skins and
//! morph weights are refused, as are required extensions that could change shape or base colour. Vertex colours are
//! linear; alpha counts as the material's `alphaMode` says: `OPAQUE` makes it 1, `MASK` makes it 0 or 1 texel by texel,
//! by the product with factor and vertex colour. Where all materials are KHR_materials_unlit, colours are shown as they are. `doubleSided` counts where a mesh is not opaque (glTF 2.0,
//! 3.9.5, drops the backs of opaque ones too, but scans are looked at from behind).
//!
//! Splats: the primitives of points that have KHR_gaussian_splatting, all of the scene as one, in the world: centres,
//! covariances and harmonics are transformed by their nodes. A scene of both is read as its splats. σ are linear, opacities
//! and quaternions (x y z w) as they are used; `srgb_rec709_display` mixes display-encoded colours, `lin_rec709_display` linear
//! ones, for which harmonics above degree 0 are refused. Opacities are those of the original training
//! ([`OpacityFilter::Classic`](oblate_engine::OpacityFilter)): the extension has no word for others.
//!
//! What is neither (lights, cameras, animations, emission) is noted. What a file unpacks to, images and many uses of one mesh
//! included, is at most [`OpenOptions::max_memory`].

mod accessor;
mod budget;
mod buffers;
mod glb;
mod material;
mod meshopt;
mod nodes;
mod primitive;
mod splats;
mod support;

use crate::file::{File, quoted, unmarked};
use crate::meshes::geometry::mesh;
use crate::{Content, ImportError, Note, OpenOptions, Opened, Place};
use ::gltf::json::{self, Root};
use accessor::Accessors;
use budget::Budget;
use buffers::Buffers;
use material::Materials;
use oblate_surfels::Primitive;
use primitive::Reader;

/// What a morphed mesh is told.
const MORPHED: &str = "has morph weights other than 0, which are not supported; export the morphed mesh";

/// Reads a scene.
pub(crate) fn read(file: &File, options: &OpenOptions) -> Result<Opened, ImportError> {
    let (json, binary) =
        if file.bytes.starts_with(b"glTF") { glb::chunks(file)? } else { (&file.bytes[..], None) };
    let json = unmarked(json);
    let budget = Budget::new(options.max_memory);
    budget.take_json(file, json)?;
    let root: Root = from_json(file, json)?;
    check_version(file, &root)?;
    support::check_required(file, &root)?;
    let buffers = Buffers::new(file, &root, binary, &budget);
    let placed = nodes::placed_meshes(file, &root)?;
    let accessors = Accessors { file, root: &root, buffers: &buffers };
    if let Some(mut opened) = splats::read(&accessors, json, &placed)? {
        opened.notes.extend(support::left_out(&root, (0, 0, 0)));
        return Ok(opened);
    }
    let mut reader = Reader { accessors, materials: &mut Materials::new(file, &root), skipped: 0 };
    let mut primitives: Vec<Primitive> = Vec::new();
    for (mesh, node_to_mesh) in placed {
        primitives.extend(reader.mesh(mesh, node_to_mesh)?);
    }
    let (skipped, emissive) = (reader.skipped, reader.materials.emissive.len());
    let mesh = mesh(file, primitives)?;
    let unlit = mesh.primitives.iter().filter(|primitive| primitive.unlit).count();
    let shaded = if unlit < mesh.primitives.len() { unlit } else { 0 };
    let notes: Vec<Note> = support::left_out(&root, (skipped, emissive, shaded));
    Ok(Opened::noting(Content::Mesh(mesh), notes))
}

/// Refuses versions other than 2, and files that need a later one than 2.0 by their `minVersion`.
fn check_version(file: &File, root: &Root) -> Result<(), ImportError> {
    let place = || Place::Part("asset".into());
    let version = &root.asset.version;
    if !version.starts_with("2.") {
        return Err(file.unsupported(place(), format!("glTF {version}; version 2 is supported")));
    }
    let Some(least) = &root.asset.min_version else { return Ok(()) };
    let number = |text: &str| text.parse::<u32>().ok();
    match least.split_once('.').map(|(major, minor)| (number(major), number(minor))) {
        Some((Some(major), Some(minor))) if (major, minor) <= (2, 0) => Ok(()),
        Some((Some(major), Some(minor))) => {
            let feature = format!("needs glTF {major}.{minor} (minVersion); version 2.0 is supported");
            Err(file.unsupported(place(), feature))
        }
        _ => {
            let problem = format!("minVersion {} must be two numbers, such as 2.0", quoted(least));
            Err(file.malformed(place(), problem))
        }
    }
}

fn from_json<'a, T: serde::Deserialize<'a>>(file: &File, json: &'a [u8]) -> Result<T, ImportError> {
    json::deserialize::from_slice(json).map_err(|error| {
        file.malformed(Place::Part(format!("JSON line {}", error.line())), error.to_string())
    })
}
