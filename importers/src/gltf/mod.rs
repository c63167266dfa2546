//! glTF 2.0 and GLB: the triangles of a scene.
//!
//! Source: Khronos, *glTF 2.0 Specification*, 2021 (ISO/IEC 12113:2022); extensions KHR_mesh_quantization,
//! KHR_texture_transform, KHR_materials_pbrSpecularGlossiness (its diffuse colour). glTF's world is
//! oblate's. The default scene is read, else all nodes; each use of a mesh by a node is a primitive with
//! the node's transform. Points and lines are left out; skins and morph weights are refused, as are
//! required extensions that could change shape or base colour. Vertex colours are linear; alpha counts as
//! the material's `alphaMode` says: `OPAQUE` makes it 1, `MASK` makes it 0 or 1 texel by texel (vertex colours have
//! to pass the cut-off too, by themselves). `doubleSided` counts where a mesh is not opaque (glTF 2.0, 3.9.5,
//! drops the backs of opaque ones too, but scans are looked at from behind).

mod accessor;
mod buffers;
mod material;
mod primitive;

use crate::file::File;
use crate::meshes::geometry::mesh;
use crate::{ImportError, Place};
use ::gltf::json::{self, Index, Node, Root};
use buffers::Buffers;
use glam::{DAffine3, DMat4, DQuat, DVec3, DVec4};
use material::Materials;
use oblate_surfels::{Mesh, Primitive};
use primitive::Reader;

/// Extensions that a file may require.
const SUPPORTED: [&str; 4] = [
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_lights_punctual",
];

/// What a morphed mesh is told.
const MORPHED: &str = "has morph weights other than 0, which are not supported; export the morphed mesh";

/// Positions that all uses of meshes together may have: far beyond what is drawn, far below what memory
/// holds when a small file uses a large mesh many times.
const POSITION_LIMIT: usize = 1 << 27;

/// Reads a mesh.
pub(crate) fn read(file: &File) -> Result<Mesh, ImportError> {
    let (json, binary) =
        if file.bytes.starts_with(b"glTF") { chunks(file)? } else { (&file.bytes[..], None) };
    let json = json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json);
    let root: Root = json::deserialize::from_slice(json).map_err(|error| {
        file.malformed(Place::Part(format!("JSON line {}", error.line())), error.to_string())
    })?;
    if !root.asset.version.starts_with("2.") {
        let feature = format!("glTF {}; version 2 is supported", root.asset.version);
        return Err(file.unsupported(Place::Part("asset".into()), feature));
    }
    // Materials change neither shape nor, those aside that are known here, base colour.
    let harmless = |name: &str| SUPPORTED.contains(&name) || name.starts_with("KHR_materials_");
    if let Some(name) = root.extensions_required.iter().find(|name| !harmless(name)) {
        let feature = format!("requires the extension {name}, which is not supported; export without it");
        return Err(file.unsupported(Place::Part("extensionsRequired".into()), feature));
    }
    let buffers = Buffers::new(file, &root, binary);
    let mut materials = Materials::new(file, &root);
    let mut reader = Reader { file, root: &root, buffers: &buffers, materials: &mut materials };
    let mut primitives: Vec<Primitive> = Vec::new();
    let mut positions = 0;
    for (mesh, node_to_mesh) in placed_meshes(file, &root)? {
        let read: Vec<Primitive> = reader.mesh(mesh, node_to_mesh)?;
        positions += read.iter().map(|primitive| primitive.positions.len()).sum::<usize>();
        if positions > POSITION_LIMIT {
            let problem = format!("its nodes use more than {POSITION_LIMIT} positions");
            return Err(file.malformed(Place::Part("nodes".into()), problem));
        }
        primitives.extend(read);
    }
    mesh(file, primitives)
}

/// The JSON chunk of a GLB and, if there is one, the binary chunk.
fn chunks(file: &File) -> Result<(&[u8], Option<&[u8]>), ImportError> {
    let number = |at: usize| {
        let bytes = file.bytes.get(at..at + 4).and_then(|bytes| bytes.try_into().ok());
        let problem = "the file ends in the middle of a GLB header";
        bytes.map(u32::from_le_bytes).ok_or_else(|| file.malformed(Place::Byte(at), problem))
    };
    let version = number(4)?;
    if version != 2 {
        return Err(
            file.unsupported(Place::Byte(4), format!("GLB version {version}; version 2 is supported"))
        );
    }
    let end = number(8)? as usize;
    if end > file.bytes.len() {
        let problem = format!("the GLB declares {end} bytes, but the file has {}", file.bytes.len());
        return Err(file.malformed(Place::Byte(8), problem));
    }
    let (mut json, mut binary) = (None, None);
    let mut at = 12;
    while at < end {
        let (length, kind) = (number(at)? as usize, number(at + 4)?.to_le_bytes());
        let Some(chunk) = file.bytes.get(at + 8..at + 8 + length) else {
            let problem = format!("a chunk of {length} bytes goes beyond the end of the file");
            return Err(file.malformed(Place::Byte(at), problem));
        };
        match &kind {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if binary.is_none() => binary = Some(chunk),
            // Other chunks are extensions' and may be skipped.
            _ => {}
        }
        at += 8 + length;
    }
    let missing = || file.malformed(Place::Byte(12), "the GLB has no JSON chunk");
    Ok((json.ok_or_else(missing)?, binary))
}

/// Meshes of the scene, each with its node's transform to the world.
fn placed_meshes(file: &File, root: &Root) -> Result<Vec<(Index<json::Mesh>, DAffine3)>, ImportError> {
    let missing = |what: String| file.malformed(Place::Part(what), "is named, but not there");
    let starts: Vec<Index<Node>> = match root.scene {
        Some(scene) => {
            root.get(scene).ok_or_else(|| missing(format!("scene {}", scene.value())))?.nodes.clone()
        }
        None => {
            let mut is_child = vec![false; root.nodes.len()];
            for child in root.nodes.iter().flat_map(|node| node.children.iter().flatten()) {
                is_child.get_mut(child.value()).into_iter().for_each(|is_child| *is_child = true);
            }
            let parentless = (0u32..).zip(is_child).filter(|(_, is_child)| !is_child);
            parentless.map(|(node, _)| Index::new(node)).collect()
        }
    };
    let mut placed = Vec::new();
    let mut seen = vec![false; root.nodes.len()];
    // Last in, first out: reversed so that nodes come in the file's order.
    let mut open: Vec<(Index<Node>, DAffine3)> =
        starts.into_iter().rev().map(|n| (n, DAffine3::IDENTITY)).collect();
    while let Some((index, parent_to_world)) = open.pop() {
        let name = || format!("node {}", index.value());
        let node = root.get(index).ok_or_else(|| missing(name()))?;
        if std::mem::replace(&mut seen[index.value()], true) {
            return Err(file.malformed(Place::Part(name()), "has two parents or is its own ancestor"));
        }
        let node_to_parent = transform(node);
        let node_to_world = parent_to_world * node_to_parent.unwrap_or(DAffine3::IDENTITY);
        if node_to_parent.is_none() || !node_to_world.is_finite() {
            return Err(file.malformed(Place::Part(name()), "its transform must be finite and affine"));
        }
        if let Some(mesh) = node.mesh {
            if node.skin.is_some() {
                let feature = "has a skin, which is not supported; export the posed mesh";
                return Err(file.unsupported(Place::Part(name()), feature));
            }
            if node.weights.iter().flatten().any(|&weight| weight != 0.0) {
                return Err(file.unsupported(Place::Part(name()), MORPHED));
            }
            placed.push((mesh, node_to_world));
        }
        let children = node.children.iter().flatten().rev();
        open.extend(children.map(|&child| (child, node_to_world)));
    }
    Ok(placed)
}

/// A node's transform to its parent, if it is affine.
fn transform(node: &Node) -> Option<DAffine3> {
    if let Some(matrix) = node.matrix {
        let matrix = DMat4::from_cols_array(&matrix.map(f64::from));
        return (matrix.row(3) == DVec4::W).then(|| DAffine3::from_mat4(matrix));
    }
    let vector =
        |values: Option<[f32; 3]>, default| values.map_or(default, |v| DVec3::from_array(v.map(f64::from)));
    let rotation = match &node.rotation {
        Some(rotation) => DQuat::from_array(rotation.0.map(f64::from)).normalize(),
        None => DQuat::IDENTITY,
    };
    if !rotation.is_finite() {
        return None;
    }
    let scale = vector(node.scale, DVec3::ONE);
    Some(DAffine3::from_scale_rotation_translation(scale, rotation, vector(node.translation, DVec3::ZERO)))
}
