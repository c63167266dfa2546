//! Files to meshes, volumes, points and splats that stand in the world.

use crate::check::{Uses, Wrong};
use crate::description::{ByteOrder, FileOptions, Kind, Look, SampleKind, Source};
use crate::progress::Console;
use anyhow::{Context, Result, anyhow, bail, ensure};
use glam::{DAffine3, DMat3, DVec3};
use oblate::engine::{Blend, Cloud};
use oblate::importers::{Content, Endian, OpenOptions, Opened, RawLayout, SampleType, Watch};
use oblate::surfels::{Mesh, PointCloud};
use oblate::volumes::{GridFrame, IrregularVolume, Space, Volume};
use std::path::Path;
use std::sync::Arc;

/// Something to draw.
#[derive(Clone, Debug)]
pub(crate) struct Item {
    /// What messages call it.
    pub(crate) name: String,
    pub(crate) body: Body,
    /// From the body's space to the world, wherever it stands; at least one.
    pub(crate) places: Vec<DAffine3>,
    pub(crate) look: Look,
    /// What is up, by custom.
    pub(crate) up: DVec3,
}

/// What it consists of.
#[derive(Clone, Debug)]
pub(crate) enum Body {
    Mesh(Mesh),
    Volume(Volume),
    Irregular(IrregularVolume),
    Points(PointCloud),
    /// Splats as they are.
    Splats {
        cloud: Cloud,
        /// The space in which their colours are meant to mix.
        blend: Blend,
    },
}

/// Reads a file. `given` are options for all files, which stand over the source's.
pub(crate) fn load(source: Source, given: &FileOptions, console: Console) -> Result<(Item, Uses)> {
    let name = source.path.display().to_string();
    let (opened, uses) = open(&source.path, &given.clone().over(source.file.clone()), console)?;
    for note in &opened.notes {
        console.say(format_args!("{name}: {note}"));
    }
    let (kind, what) = match &opened.content {
        Content::Mesh(_) => (Kind::Mesh, "it is a mesh; list it under [[mesh]]"),
        Content::Volume(_) | Content::Irregular(_) => {
            (Kind::Volume, "it is a volume; list it under [[volume]]")
        }
        Content::Points(_) => (Kind::Points, "it holds points; list it under [[points]]"),
        Content::Splats { .. } => (Kind::Splats, "it holds splats; list it under [[splats]]"),
    };
    if source.kind.is_some_and(|wanted| wanted != kind) {
        bail!("{name}: {what}");
    }
    let up = opened.up;
    let body = match opened.content {
        Content::Mesh(mesh) => Body::Mesh(mesh),
        Content::Volume(volume) => Body::Volume(volume),
        Content::Irregular(volume) => Body::Irregular(volume),
        Content::Points(points) => Body::Points(points),
        Content::Splats { splats, blend, origin } => {
            let cloud = Cloud::new(splats).with_context(|| name.clone())?;
            Body::Splats { cloud: cloud.transformed(DAffine3::from_translation(origin)), blend }
        }
    };
    // What a scene file says of one file must be of use for that file.
    let said = source.file.check_use(uses);
    said.map_err(|Wrong { key, problem }| anyhow!("{name}: {key} {problem}"))?;
    Ok((Item { name, body, places: source.places, look: source.look, up }, uses))
}

/// Reads a file and says which options it had a use for.
pub(crate) fn open(path: &Path, options: &FileOptions, console: Console) -> Result<(Opened, Uses)> {
    let mut settings = open_options(options);
    let raw = settings.raw;
    let task = Arc::new(console.task(format!("reading {}", path.display())));
    let told = Arc::clone(&task);
    settings.watch = Some(Watch::new(move |done, of| told.at(done, of)));
    let opened = oblate::importers::open(path, &settings)?;
    drop((settings, task));
    // Slices may be raw ones.
    let is_raw = matches!(opened.format, "raw" | "slices");
    let said = options.sample_type.is_some() || options.endian.is_some();
    ensure!(
        !is_raw || raw.is_some() || !said,
        "{}: --type and --endian describe raw volumes; give --dims with them",
        path.display()
    );
    let uses = match &opened.content {
        Content::Mesh(mesh) => Uses {
            mesh: true,
            // Without any texture in the mesh the one given was not used.
            texture: mesh.primitives.iter().any(|part| part.material.texture.is_some()),
            ..Uses::default()
        },
        Content::Volume(_) => Uses { volume: true, raw: is_raw, ..Uses::default() },
        Content::Irregular(_) => Uses { volume: true, flow: opened.format == "PLOT3D", ..Uses::default() },
        Content::Points(_) => Uses { points: true, ..Uses::default() },
        Content::Splats { .. } => Uses { level: opened.format == "SOG", ..Uses::default() },
    };
    Ok((opened, uses))
}

/// The options in the importers' words.
pub(crate) fn open_options(options: &FileOptions) -> OpenOptions {
    let layout = |dims| RawLayout {
        dims,
        sample_type: options.sample_type.unwrap_or_default().into(),
        endian: options.endian.unwrap_or_default().into(),
    };
    let defaults = OpenOptions::default();
    OpenOptions {
        raw: options.dims.map(layout),
        spacing: options.spacing.map(DVec3::from),
        texture: options.texture.clone(),
        flow: options.flow.clone(),
        level: options.level,
        max_memory: options.max_memory.unwrap_or(defaults.max_memory),
        ..defaults
    }
}

impl From<SampleKind> for SampleType {
    fn from(kind: SampleKind) -> Self {
        match kind {
            SampleKind::U8 => Self::U8,
            SampleKind::U16 => Self::U16,
            SampleKind::I16 => Self::I16,
            SampleKind::F32 => Self::F32,
        }
    }
}

impl From<ByteOrder> for Endian {
    fn from(order: ByteOrder) -> Self {
        match order {
            ByteOrder::Little => Self::Little,
            ByteOrder::Big => Self::Big,
        }
    }
}

/// What is said where things meet whose spaces have different names: nothing turns one to the other.
pub(crate) fn differing(spaces: &[(&str, Option<Space>)]) -> Option<String> {
    let mut named = spaces.iter().filter_map(|(name, space)| Some((name, (*space)?)));
    let (first, space) = named.next()?;
    let (other, others) = named.find(|(_, others)| *others != space)?;
    let (space, others) = (space.name(), others.name());
    Some(format!(
        "{first} is in a space named {space}, {other} in one named {others}: each keeps its numbers, and nothing turns one to the other"
    ))
}

/// The mesh moved to the world, so that surfels are spread evenly there.
pub(crate) fn placed_mesh(mut mesh: Mesh, placement: DAffine3) -> Mesh {
    for primitive in &mut mesh.primitives {
        primitive.primitive_to_mesh = placement * primitive.primitive_to_mesh;
    }
    mesh
}

/// The volume moved to the world: extinction is per world unit, and gradients are the world's.
pub(crate) fn placed_volume(volume: Volume, placement: DAffine3) -> Result<Volume> {
    let index_to_world = placement * volume.index_to_world();
    let columns =
        [index_to_world.matrix3.x_axis, index_to_world.matrix3.y_axis, index_to_world.matrix3.z_axis];
    let [x, y, z] = columns.map(DVec3::length);
    let spacing = DVec3::new(x, y, z);
    let direction = DMat3::from_cols(columns[0] / x, columns[1] / y, columns[2] / z);
    let frame = GridFrame { spacing, origin: index_to_world.translation, direction, ..volume.frame() };
    Ok(volume.with_frame(frame)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use oblate::volumes::Voxels;

    #[test]
    fn only_names_that_differ_are_told() {
        let (ras, lps) = (Some(Space::Ras), Some(Space::Lps));
        assert_eq!(differing(&[("a", ras), ("b", None), ("c", ras)]), None);
        let told = differing(&[("a", None), ("b", ras), ("c", ras), ("d", lps)]).unwrap();
        assert!(told.contains("b is in") && told.contains("right-") && told.contains("d in"), "{told}");
    }

    #[test]
    fn volumes_move_with_their_placement() {
        let frame = GridFrame { spacing: DVec3::new(1.0, 2.0, 3.0), ..GridFrame::default() };
        let volume = Volume::new([2, 2, 2], Voxels::U8(vec![0; 8]), frame).unwrap();
        let placement = DAffine3::from_mat3_translation(
            DMat3::from_rotation_z(0.3) * DMat3::from_diagonal(DVec3::new(2.0, 1.0, 0.5)),
            DVec3::new(5.0, -1.0, 2.0),
        );
        let placed = placed_volume(volume.clone(), placement).unwrap();
        for index in [DVec3::ZERO, DVec3::ONE, DVec3::new(1.0, 0.0, 1.0)] {
            let wanted = placement.transform_point3(volume.index_to_world().transform_point3(index));
            let found = placed.index_to_world().transform_point3(index);
            assert!((found - wanted).length() < 1e-12, "{found} for {wanted}");
        }
    }
}
