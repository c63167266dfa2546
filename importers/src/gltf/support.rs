//! What of a file is read, and what is said of the rest.

use super::meshopt;
use crate::file::File;
use crate::{ImportError, Note, Place};
use ::gltf::json::Root;

/// Extensions that a file may require: those that are read, and those that don't matter to shape or base colour.
const HARMLESS: [&str; 9] = [
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_lights_punctual",
    "KHR_gaussian_splatting",
    "EXT_texture_webp",
    // Formats of images are refused where a base colour has no other.
    "KHR_texture_basisu",
    "EXT_texture_avif",
    "MSFT_texture_dds",
    "KHR_animation_pointer",
];

/// Refuses a file that requires what is not read.
pub(super) fn check_required(file: &File, root: &Root) -> Result<(), ImportError> {
    // Materials change neither shape nor, those aside that are known here, base colour.
    let read = |name: &str| {
        HARMLESS.contains(&name)
            || name.starts_with("KHR_materials_")
            || (meshopt::NAMES.contains(&name) && meshopt::AVAILABLE)
    };
    let Some(name) = root.extensions_required.iter().find(|name| !read(name)) else { return Ok(()) };
    let feature = match name.as_str() {
        "KHR_draco_mesh_compression" => {
            format!(
                "requires the extension {name}, which is not supported; save it without Draco compression"
            )
        }
        name if meshopt::NAMES.contains(&name) => {
            format!("requires the extension {name}; {}", meshopt::UNAVAILABLE)
        }
        name => format!("requires the extension {name}, which is not supported; save it without"),
    };
    Err(file.unsupported(Place::Part("extensionsRequired".into()), feature))
}

/// Extensions of materials that are read, or that change no material by themselves.
const MATERIALS: [&str; 3] =
    ["KHR_materials_pbrSpecularGlossiness", "KHR_materials_unlit", "KHR_materials_variants"];

/// What the file holds and a picture of it doesn't show; `skipped` primitives were no triangles, `emissive` materials of what is shown
/// emit light, `shaded` primitives should not be.
pub(super) fn left_out(root: &Root, (skipped, emissive, shaded): (usize, usize, usize)) -> Vec<Note> {
    let uses = |name: &str| root.extensions_used.iter().any(|used| used == name);
    let instanced = root.nodes.iter().filter(|node| {
        let extensions = node.extensions.as_ref();
        node.mesh.is_some() && extensions.is_some_and(|e| e.others.contains_key("EXT_mesh_gpu_instancing"))
    });
    let several = |count: usize, one: &str, more: &str| match count {
        0 => None,
        1 => Some(format!("1 {one}")),
        _ => Some(format!("{count} {more}")),
    };
    let parts = [
        several(root.animations.len(), "animation", "animations"),
        several(root.cameras.len(), "camera", "cameras"),
        uses("KHR_lights_punctual").then(|| "lights".to_owned()),
        several(emissive, "material", "materials").map(|materials| format!("the emission of {materials}")),
        several(shaded, "primitive", "primitives")
            .map(|primitives| format!("KHR_materials_unlit of {primitives}, shaded as the others are")),
        several(skipped, "primitive of points or lines", "primitives of points or lines"),
        several(instanced.count(), "mesh", "meshes")
            .map(|meshes| format!("instances of {meshes} (EXT_mesh_gpu_instancing), shown once")),
    ];
    let required = root
        .extensions_required
        .iter()
        .filter(|name| name.starts_with("KHR_materials_") && !MATERIALS.contains(&name.as_str()));
    let required = required.map(|name| format!("{name}, which it requires"));
    let text: Vec<String> = parts.into_iter().flatten().chain(required).collect();
    if text.is_empty() { Vec::new() } else { vec![Note::LeftOut(text.join(", "))] }
}
