//! Nodes: where meshes stand.

use crate::file::File;
use crate::{ImportError, Place};
use ::gltf::json::{Index, Mesh, Node, Root};
use glam::{DAffine3, DMat4, DQuat, DVec3, DVec4};

/// Meshes of the scene, each with its node's transform to the world.
pub(super) fn placed_meshes(file: &File, root: &Root) -> Result<Vec<(Index<Mesh>, DAffine3)>, ImportError> {
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
            // A node's weights take the place of its mesh's.
            let of_mesh = || Some((format!("mesh {}", mesh.value()), root.get(mesh)?.weights.as_ref()?));
            let weights = node.weights.as_ref().map(|weights| (name(), weights)).or_else(of_mesh);
            if let Some((place, weights)) = weights
                && weights.iter().any(|&weight| weight != 0.0)
            {
                return Err(file.unsupported(Place::Part(place), super::MORPHED));
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
