//! The tables of a scene file that say what is in the scene.

use super::check;
use crate::check::{FARTHEST, Wrong, coordinates};
use crate::description::{ByteOrder, FileOptions, Kind, Look, PointColors, SampleKind, Source, Transfer};
use crate::notation::{Corners, Plane, Press, Rgba};
use crate::transfer;
use glam::{DAffine3, DMat3, DQuat, DVec3, EulerRot};
use oblate::engine::Light;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use toml::Spanned;

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) struct MeshTable {
    path: PathBuf,
    translate: Option<[f64; 3]>,
    rotate: Option<[f64; 3]>,
    scale: Option<Scale>,
    instances: Option<Places>,
    texture: Option<PathBuf>,
    surfels: Option<usize>,
    surfel_spacing: Option<f64>,
    clip_box: Option<Corners>,
    clip_plane: Option<Vec<Plane>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) struct VolumeTable {
    path: PathBuf,
    translate: Option<[f64; 3]>,
    rotate: Option<[f64; 3]>,
    scale: Option<Scale>,
    instances: Option<Places>,
    dims: Option<Dims>,
    #[serde(rename = "type")]
    sample_type: Option<SampleKind>,
    endian: Option<ByteOrder>,
    spacing: Option<[f64; 3]>,
    flow: Option<PathBuf>,
    iso: Option<Vec<f32>>,
    iso_color: Option<Colors>,
    transfer: Option<String>,
    refine: Option<usize>,
    flatten: Option<Press>,
    color_by: Option<PathBuf>,
    color_transfer: Option<String>,
    clip_box: Option<Corners>,
    clip_plane: Option<Vec<Plane>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) struct PointsTable {
    path: PathBuf,
    translate: Option<[f64; 3]>,
    rotate: Option<[f64; 3]>,
    scale: Option<Scale>,
    instances: Option<Places>,
    point_color: Option<PointColors>,
    clip_box: Option<Corners>,
    clip_plane: Option<Vec<Plane>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(super) struct SplatsTable {
    path: PathBuf,
    translate: Option<[f64; 3]>,
    rotate: Option<[f64; 3]>,
    scale: Option<Scale>,
    instances: Option<Places>,
    level: Option<u32>,
    clip_box: Option<Corners>,
    clip_plane: Option<Vec<Plane>>,
}

/// One of the places of a thing that stands in many.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlaceTable {
    translate: Option<[f64; 3]>,
    rotate: Option<[f64; 3]>,
    scale: Option<Scale>,
}

pub(super) type Places = Spanned<Vec<Spanned<PlaceTable>>>;

/// A table that says what stands in the scene.
pub(super) trait SourceTable {
    /// Takes its list of places.
    fn instances(&mut self) -> Option<Places>;

    /// What it says besides, at the table's own place.
    fn source(self, folder: &Path) -> Result<Source, Wrong>;
}

#[derive(Clone, Copy, Deserialize)]
#[serde(untagged, expecting = "`scale` is one number or three")]
enum Scale {
    Uniform(f64),
    Axes([f64; 3]),
}

#[derive(Clone, Copy, Deserialize)]
#[serde(untagged, expecting = "`dims` is three whole numbers, or two of each slice")]
enum Dims {
    Slice([usize; 2]),
    Volume([usize; 3]),
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "`iso-color` is one colour or a list of them")]
enum Colors {
    One(Rgba),
    Each(Vec<Rgba>),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LightTable {
    kind: LightKind,
    towards: Option<[f64; 3]>,
    position: Option<[f64; 3]>,
    color: Option<Rgba>,
    intensity: Option<f32>,
}

#[derive(Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum LightKind {
    Ambient,
    Directional,
    Point,
}

impl SourceTable for MeshTable {
    fn instances(&mut self) -> Option<Places> {
        self.instances.take()
    }

    fn source(self, folder: &Path) -> Result<Source, Wrong> {
        let look = Look {
            surfels: self.surfels,
            surfel_spacing: self.surfel_spacing,
            clip_box: self.clip_box,
            clip_plane: self.clip_plane,
            ..Look::default()
        };
        look.check()?;
        Ok(Source {
            path: folder.join(self.path),
            kind: Some(Kind::Mesh),
            places: vec![placement(self.translate, self.rotate, self.scale)?],
            file: FileOptions {
                texture: self.texture.map(|path| folder.join(path)),
                ..FileOptions::default()
            },
            look,
        })
    }
}

impl SourceTable for VolumeTable {
    fn instances(&mut self) -> Option<Places> {
        self.instances.take()
    }

    fn source(self, folder: &Path) -> Result<Source, Wrong> {
        // What is no preset is a file beside this one.
        let named = |name: String| {
            let beside = |name| folder.join(name).to_string_lossy().into_owned();
            Transfer::Named(if transfer::is_preset(&name) { name } else { beside(name) })
        };
        check("color-transfer", self.color_transfer.is_none() || self.color_by.is_some(), || {
            "is for the values of `color-by`; name a volume there".into()
        })?;
        let file = FileOptions {
            dims: self.dims.map(|dims| match dims {
                Dims::Slice([x, y]) => [x, y, 1],
                Dims::Volume(dims) => dims,
            }),
            sample_type: self.sample_type,
            endian: self.endian,
            spacing: self.spacing,
            flow: self.flow.map(|path| folder.join(path)),
            ..FileOptions::default()
        };
        file.check()?;
        let look = Look {
            iso: self.iso,
            iso_color: self.iso_color.map(|colors| match colors {
                Colors::One(color) => vec![color],
                Colors::Each(colors) => colors,
            }),
            transfer: self.transfer.map(named),
            refine: self.refine,
            flatten: self.flatten,
            color_by: self.color_by.map(|path| folder.join(path)),
            color_transfer: self.color_transfer.map(named),
            clip_box: self.clip_box,
            clip_plane: self.clip_plane,
            ..Look::default()
        };
        look.check()?;
        Ok(Source {
            path: folder.join(self.path),
            kind: Some(Kind::Volume),
            places: vec![placement(self.translate, self.rotate, self.scale)?],
            file,
            look,
        })
    }
}

impl SourceTable for PointsTable {
    fn instances(&mut self) -> Option<Places> {
        self.instances.take()
    }

    fn source(self, folder: &Path) -> Result<Source, Wrong> {
        Ok(Source {
            kind: Some(Kind::Points),
            places: vec![placement(self.translate, self.rotate, self.scale)?],
            look: Look {
                point_color: self.point_color,
                clip_box: self.clip_box,
                clip_plane: self.clip_plane,
                ..Look::default()
            },
            ..Source::new(folder.join(self.path))
        })
    }
}

impl SourceTable for SplatsTable {
    fn instances(&mut self) -> Option<Places> {
        self.instances.take()
    }

    fn source(self, folder: &Path) -> Result<Source, Wrong> {
        Ok(Source {
            kind: Some(Kind::Splats),
            places: vec![placement(self.translate, self.rotate, self.scale)?],
            file: FileOptions { level: self.level, ..FileOptions::default() },
            look: Look { clip_box: self.clip_box, clip_plane: self.clip_plane, ..Look::default() },
            ..Source::new(folder.join(self.path))
        })
    }
}

impl PlaceTable {
    pub(super) fn placement(self) -> Result<DAffine3, Wrong> {
        placement(self.translate, self.rotate, self.scale)
    }
}

/// Scales, then rotates about x, y, z in that order, then translates.
fn placement(
    translate: Option<[f64; 3]>,
    rotate_degrees: Option<[f64; 3]>,
    scale: Option<Scale>,
) -> Result<DAffine3, Wrong> {
    coordinates("translate", translate)?;
    coordinates("rotate", rotate_degrees)?;
    let scale = match scale.unwrap_or(Scale::Uniform(1.0)) {
        Scale::Uniform(s) => DVec3::splat(s),
        Scale::Axes(axes) => DVec3::from(axes),
    };
    let range = 1.0 / FARTHEST..=FARTHEST;
    check("scale", scale.to_array().iter().all(|s| range.contains(s)), || {
        format!("is {scale}; it must be above 0, from {:e} to {FARTHEST:e}", 1.0 / FARTHEST)
    })?;
    let [x, y, z] = rotate_degrees.unwrap_or_default().map(f64::to_radians);
    let rotation = DMat3::from_quat(DQuat::from_euler(EulerRot::ZYX, z, y, x));
    Ok(DAffine3::from_mat3_translation(
        rotation * DMat3::from_diagonal(scale),
        DVec3::from(translate.unwrap_or_default()),
    ))
}

impl LightTable {
    pub(super) fn light(self) -> Result<Light, Wrong> {
        let intensity = self.intensity.unwrap_or(1.0);
        check("intensity", (0.0..=1e15).contains(&intensity), || {
            format!("is {intensity}; it must be at least 0 and at most 1e15")
        })?;
        let [r, g, b, _] = self.color.map_or([1.0; 4], |c| c.0).map(|c| c * intensity);
        let color = [r, g, b];
        coordinates("towards", self.towards)?;
        coordinates("position", self.position)?;
        let kind = |problem: &str| Err(Wrong { key: "kind", problem: problem.into() });
        match (self.kind, self.towards, self.position) {
            (LightKind::Ambient, None, None) => Ok(Light::Ambient { color }),
            (LightKind::Directional, Some(towards), None) => {
                check("towards", towards != [0.0; 3], || "must not be zero".into())?;
                Ok(Light::Directional { towards: towards.into(), color })
            }
            (LightKind::Point, None, Some(position)) => Ok(Light::Point { position: position.into(), color }),
            (LightKind::Ambient, ..) => kind("ambient has neither `towards` nor `position`"),
            (LightKind::Directional, ..) => kind("directional needs `towards`, and only that"),
            (LightKind::Point, ..) => kind("point needs `position`, and only that"),
        }
    }
}
