//! What to draw and how: the one form that the command line and scene files both fill.
//!
//! Every choice is optional here. A choice made at the command line stands over the scene file's, and
//! what neither makes is decided where it is used.

use crate::notation::{self, Corners, Plane, Press, Rgba, Tolerance};
use crate::transfer::is_preset;
use clap::{Args, ValueEnum};
use glam::DAffine3;
use oblate::engine::{Blend, FootprintForm, Light, Order};
use oblate::surfels::PointColor;
use oblate::volumes::TransferFunction;
use serde::Deserialize;
use std::convert::Infallible;
use std::path::{Path, PathBuf};

/// A scene before its files are read.
#[derive(Clone, Debug, Default)]
pub(crate) struct Description {
    pub(crate) camera: CameraOptions,
    pub(crate) picture: PictureOptions,
    pub(crate) sources: Vec<Source>,
    pub(crate) lights: Vec<Light>,
}

/// A file and how it is drawn.
#[derive(Clone, Debug)]
pub(crate) struct Source {
    pub(crate) path: PathBuf,
    /// What the file must hold; `None` takes what comes.
    pub(crate) kind: Option<Kind>,
    /// From the file's space to the world, for each place where it stands; at least one.
    pub(crate) places: Vec<DAffine3>,
    pub(crate) file: FileOptions,
    pub(crate) look: Look,
}

/// What a file can hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Mesh,
    Volume,
    Points,
    Splats,
}

impl Source {
    /// A file as it is.
    pub(crate) fn new(path: PathBuf) -> Self {
        Self {
            path,
            kind: None,
            places: vec![DAffine3::IDENTITY],
            file: FileOptions::default(),
            look: Look::default(),
        }
    }
}

/// Where the camera stands and what it sees.
#[derive(Args, Clone, Debug, Default, PartialEq, Deserialize)]
#[command(next_help_heading = "Camera")]
#[serde(deny_unknown_fields)]
pub(crate) struct CameraOptions {
    /// Where the camera stands [default: so far away that the scene fills the picture, in a
    /// three-quarter view]
    #[arg(long, value_name = "X,Y,Z", value_parser = notation::triple, allow_hyphen_values = true)]
    pub(crate) eye: Option<[f64; 3]>,
    /// What it looks at [default: the middle of the scene]
    #[arg(long, value_name = "X,Y,Z", value_parser = notation::triple, allow_hyphen_values = true)]
    pub(crate) target: Option<[f64; 3]>,
    /// What is up in the picture [default: 0,0,1 if the scene holds a volume; else what is up in the first file by the
    /// custom of its format: +z of points and STL, −y of trained splats, +y of other meshes]
    #[arg(long, value_name = "X,Y,Z", value_parser = notation::triple, allow_hyphen_values = true)]
    pub(crate) up: Option<[f64; 3]>,
    /// Vertical angle of view in degrees [default: 30]
    #[arg(long, value_name = "DEGREES", allow_hyphen_values = true)]
    pub(crate) fov: Option<f64>,
    /// Parallel rays that see this height in world units, instead of an angle
    #[arg(long, value_name = "HEIGHT", allow_hyphen_values = true, conflicts_with = "fov")]
    pub(crate) orthographic: Option<f64>,
}

impl CameraOptions {
    /// These choices, and the others where these make none.
    pub(crate) fn over(self, under: Self) -> Self {
        // An angle and a height are one choice, the lens.
        let lens = if self.fov.or(self.orthographic).is_some() { &self } else { &under };
        Self {
            fov: lens.fov,
            orthographic: lens.orthographic,
            eye: self.eye.or(under.eye),
            target: self.target.or(under.target),
            up: self.up.or(under.up),
        }
    }
}

/// The picture and how it is computed.
#[derive(Args, Clone, Debug, Default, PartialEq, Deserialize)]
#[command(next_help_heading = "Picture")]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct PictureOptions {
    /// Width and height in pixels [default: 1024x1024]
    #[arg(long, value_name = "WxH", value_parser = notation::size)]
    pub(crate) size: Option<[u32; 2]>,
    /// Whether light acts; without it colours are shown as they are [default: on]
    #[arg(long, value_name = "on|off", value_parser = notation::switch)]
    pub(crate) shade: Option<bool>,
    /// Colour behind the scene, sRGB in hexadecimal, with alpha or without [default: 202020]
    #[arg(long, value_name = "RGB[A]")]
    pub(crate) background: Option<Rgba>,
    /// Form of the footprints: round points, EWA's affine approximation, exact perspective, or for each splat
    /// the cheapest that is accurate enough [default: auto]
    #[arg(long)]
    pub(crate) footprint: Option<Footprint>,
    /// Variance of the low-pass filter in squared pixels [default: 0.3]
    #[arg(long, value_name = "VARIANCE", allow_hyphen_values = true)]
    pub(crate) low_pass: Option<f64>,
    /// Space of shading and blending: linear light, or sRGB display values as many volume renderers use
    /// [default: linear; display where only trained splats are drawn]
    #[arg(long)]
    pub(crate) blend: Option<BlendSpace>,
    /// How kernels that overlap are mixed: centers, one after the other from near to far; per-pixel, the same with
    /// each pixel's own order; slabs, in layers from near to far, those in a layer all at once; auto, the quickest
    /// way that keeps to the tolerance, found by trial. Trained splats keep the order of their centres, in slabs beside
    /// volumes, too [default: auto]
    #[arg(long)]
    pub(crate) order: Option<OrderMode>,
    /// Thickness of the slabs, where 1 is the size of the kernels (their median σ): thinner is
    /// closer to the exact picture and slower. Asks for slabs where --order is auto [default: 2]
    #[arg(long, value_name = "X", allow_hyphen_values = true)]
    pub(crate) slab_thickness: Option<f64>,
    /// What the picture shows: the scene; or each splat in the colour of its footprint's form, points red, affine
    /// ones green, exact ones blue [default: scene]
    #[arg(long)]
    pub(crate) show: Option<Show>,
    /// Largest error of a channel that is aimed at, where white is 1: a fraction or a number. All that saves
    /// work keeps to a share of it [default: 1/255]
    #[arg(long, value_name = "X", allow_hyphen_values = true)]
    pub(crate) tolerance: Option<Tolerance>,
    /// Draws at most N splats: the best picture that can be had of so few, by coarser levels of detail
    /// [default: as many as the tolerance asks for]
    #[arg(long, value_name = "N")]
    pub(crate) budget: Option<usize>,
    /// Whether one splat is drawn for several where the picture can't tell [default: on]
    #[arg(long, value_name = "on|off", value_parser = notation::switch)]
    pub(crate) level_of_detail: Option<bool>,
    /// Whether splats hidden by what is nearer are left out before they are projected, where many are [default: on]
    #[arg(long, value_name = "on|off", value_parser = notation::switch)]
    pub(crate) occlusion: Option<bool>,
    /// Whether volumes whose kernels are several pixels wide are drawn at every second pixel, and interpolated between where that keeps to
    /// the tolerance [default: on]
    #[arg(long, value_name = "on|off", value_parser = notation::switch)]
    pub(crate) interpolation: Option<bool>,
    /// Lets a slow reference draw the picture: r1 integrates the filtered splats along pixel centres, r2
    /// the unfiltered ones with many samples a pixel [default: off]
    #[arg(long)]
    pub(crate) reference: Option<Reference>,
    /// Samples a pixel for --reference r2 [default: 64]
    #[arg(long, value_name = "N")]
    pub(crate) samples: Option<u32>,
}

impl PictureOptions {
    /// These choices, and the others where these make none.
    pub(crate) fn over(self, under: Self) -> Self {
        Self {
            size: self.size.or(under.size),
            shade: self.shade.or(under.shade),
            background: self.background.or(under.background),
            footprint: self.footprint.or(under.footprint),
            low_pass: self.low_pass.or(under.low_pass),
            blend: self.blend.or(under.blend),
            order: self.order.or(under.order),
            // A thickness is for slabs: another choice of order leaves it behind.
            slab_thickness: self
                .slab_thickness
                .or(under.slab_thickness.filter(|_| self.order.is_none_or(OrderMode::may_be_slabs))),
            // A reference draws every splat as it is.
            show: self.show.or(under.show.filter(|_| !self.asks_reference())),
            tolerance: self.tolerance.or(under.tolerance),
            // Levels are what a budget is kept with: who turns them off leaves it behind.
            budget: self
                .budget
                .or(under.budget.filter(|_| self.level_of_detail != Some(false) && !self.asks_reference())),
            // And who gives one wants them.
            level_of_detail: self.level_of_detail.or(under.level_of_detail.filter(|_| self.budget.is_none())),
            occlusion: self.occlusion.or(under.occlusion),
            interpolation: self.interpolation.or(under.interpolation),
            // And who wants what it can't do leaves it behind.
            reference: self
                .reference
                .or(under.reference.filter(|_| self.budget.is_none() && self.show != Some(Show::Forms))),
            // Samples are for one reference: another choice of it leaves them behind.
            samples: self
                .samples
                .or(under.samples.filter(|_| self.reference.is_none_or(|choice| choice == Reference::R2))),
        }
    }

    /// Whether it is asked for a reference here.
    fn asks_reference(&self) -> bool {
        self.reference.is_some_and(|choice| choice != Reference::Off)
    }

    /// Whether a thickness, where one is given, has slabs to be of.
    pub(crate) fn thickness_has_use(&self) -> bool {
        self.slab_thickness.is_none() || self.order.is_none_or(OrderMode::may_be_slabs)
    }

    /// Whether a budget, where one is given, has levels to be kept with.
    pub(crate) fn budget_has_use(&self) -> bool {
        self.budget.is_none() || self.level_of_detail != Some(false)
    }

    /// When kernels are composited.
    pub(crate) fn order(&self) -> Order {
        let slabs =
            |thickness: Option<f64>| Order::Slabs { thickness: thickness.unwrap_or(Order::THICKNESS) };
        match (self.order.unwrap_or_default(), self.slab_thickness) {
            (OrderMode::Auto, None) => Order::Auto,
            (OrderMode::Auto | OrderMode::Slabs, thickness) => slabs(thickness),
            (OrderMode::Centers, _) => Order::Centers,
            (OrderMode::PerPixel, _) => Order::PerPixel,
        }
    }
}

/// `--footprint`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Footprint {
    Auto,
    Point,
    Affine,
    Exact,
}

impl From<Footprint> for FootprintForm {
    fn from(choice: Footprint) -> Self {
        match choice {
            Footprint::Auto => Self::Auto,
            Footprint::Point => Self::Point,
            Footprint::Affine => Self::Affine,
            Footprint::Exact => Self::Exact,
        }
    }
}

/// `--show`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Show {
    Scene,
    Forms,
}

/// `--blend`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum BlendSpace {
    Linear,
    Display,
}

impl From<BlendSpace> for Blend {
    fn from(choice: BlendSpace) -> Self {
        match choice {
            BlendSpace::Linear => Self::Linear,
            BlendSpace::Display => Self::Display,
        }
    }
}

/// `--order`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum OrderMode {
    #[default]
    Auto,
    Centers,
    PerPixel,
    Slabs,
}

impl OrderMode {
    fn may_be_slabs(self) -> bool {
        matches!(self, Self::Auto | Self::Slabs)
    }
}

/// `--reference`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Reference {
    #[default]
    Off,
    R1,
    R2,
}

/// What a file does not say itself.
#[derive(Args, Clone, Debug, Default, PartialEq)]
#[command(next_help_heading = "Files")]
pub(crate) struct FileOptions {
    /// Raw volumes: samples along x, y, z [default: as the file's name says, like head_256x256x113_u16be.raw]
    #[arg(long, value_name = "XxYxZ", value_parser = notation::dims)]
    pub(crate) dims: Option<[usize; 3]>,
    /// Raw volumes: type of the samples [default: u8]
    #[arg(long = "type", value_name = "TYPE")]
    pub(crate) sample_type: Option<SampleKind>,
    /// Raw volumes: byte order [default: little]
    #[arg(long)]
    pub(crate) endian: Option<ByteOrder>,
    /// Volumes: distance between samples along x, y, z [default: the header's, else 1,1,1]
    #[arg(long, value_name = "X,Y,Z", value_parser = notation::triple, allow_hyphen_values = true)]
    pub(crate) spacing: Option<[f64; 3]>,
    /// OBJ and PLY meshes: a PNG or JPEG for parts with texture coordinates and no texture of their own
    #[arg(long, value_name = "FILE")]
    pub(crate) texture: Option<PathBuf>,
    /// PLOT3D grids: the file of the flow [default: the one beside the points whose name says so, fin.q for fin.x]
    #[arg(long, value_name = "FILE")]
    pub(crate) flow: Option<PathBuf>,
    /// Splats in several levels of detail: which one, 0 being the finest [default: 0]
    #[arg(long, value_name = "N")]
    pub(crate) level: Option<u32>,
    /// What a compressed file may unpack to, such as 512M or 64G [default: 16G]
    #[arg(long, value_name = "BYTES", value_parser = notation::bytes)]
    pub(crate) max_memory: Option<u64>,
}

impl FileOptions {
    /// These choices, and the others where these make none.
    pub(crate) fn over(self, under: Self) -> Self {
        Self {
            dims: self.dims.or(under.dims),
            sample_type: self.sample_type.or(under.sample_type),
            endian: self.endian.or(under.endian),
            spacing: self.spacing.or(under.spacing),
            texture: self.texture.or(under.texture),
            flow: self.flow.or(under.flow),
            level: self.level.or(under.level),
            max_memory: self.max_memory.or(under.max_memory),
        }
    }

    /// The files that are named.
    pub(crate) fn reads(&self) -> impl Iterator<Item = &Path> {
        [&self.texture, &self.flow].into_iter().flatten().map(PathBuf::as_path)
    }
}

/// `--type`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum SampleKind {
    #[default]
    U8,
    U16,
    I16,
    F32,
}

/// `--endian`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ByteOrder {
    #[default]
    Little,
    Big,
}

/// How a mesh or a volume becomes splats.
#[derive(Args, Clone, Debug, Default, PartialEq)]
#[command(next_help_heading = "Looks")]
pub(crate) struct Look {
    /// Volumes: draws the surface where the value is V
    #[arg(
        long,
        value_name = "V[,V…]",
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true,
        value_parser = finite
    )]
    pub(crate) iso: Option<Vec<f32>>,
    /// Volumes: draws the inside under a transfer function: a preset's name or a file; `list` prints the
    /// presets [default without --iso: one fitted to the volume's histogram]
    #[arg(long, value_name = "NAME|FILE|list", value_parser = Transfer::named)]
    pub(crate) transfer: Option<Transfer>,
    /// Volumes: colour and opacity of iso-surfaces, one for all or one for each value [default: opaque light grey]
    #[arg(long, value_name = "RRGGBB[AA][,…]", value_delimiter = ',', num_args = 1)]
    pub(crate) iso_color: Option<Vec<Rgba>>,
    /// Volumes: divides each voxel into N³, so that the transfer function sees what is between samples (post-classification) [default: 1]
    #[arg(long, value_name = "N")]
    pub(crate) refine: Option<usize>,
    /// Volumes: samples at the surface where the value is V, and the gradient at least G a world unit, become S times as wide as
    /// thick among the kernels of the others [default: G 0, S infinite]
    #[arg(long, value_name = "V[,G[,S]]", allow_hyphen_values = true, value_parser = notation::flattening)]
    pub(crate) flatten: Option<Press>,
    /// Volumes: colours what is drawn by another volume's values
    #[arg(long, value_name = "VOLUME")]
    pub(crate) color_by: Option<PathBuf>,
    /// Which colour the other volume's values have: a preset's name or a file [default: the first preset]
    #[arg(long, value_name = "NAME|FILE", value_parser = Transfer::named, requires = "color_by")]
    pub(crate) color_transfer: Option<Transfer>,
    /// Leaves only what is inside of a box in the world: its lower corner, its upper one
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", allow_hyphen_values = true, value_parser = notation::corners)]
    pub(crate) clip_box: Option<Corners>,
    /// Leaves only the half of the world in which X·x + Y·y + Z·z is at least D; may be given more than once
    #[arg(long, value_name = "X,Y,Z,D", allow_hyphen_values = true, value_parser = notation::plane)]
    pub(crate) clip_plane: Option<Vec<Plane>>,
    /// Meshes: number of surfels on each mesh [default: one a pixel of the view where it is nearest, for all
    /// meshes together at most 16 for each pixel of the picture (at least of 256×256) and at most 4 million]
    #[arg(long, value_name = "N", conflicts_with = "surfel_spacing")]
    pub(crate) surfels: Option<usize>,
    /// Meshes: distance between surfels in world units, instead of their number
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    pub(crate) surfel_spacing: Option<f64>,
    /// Point clouds: what their colours tell; heights are along --up (of maps, seen from
    /// above, along what is up by custom), ranges those of all clouds [default: rgb where there is
    /// one, else intensity, else height]
    #[arg(long, value_name = "rgb|intensity|height")]
    pub(crate) point_color: Option<PointColors>,
}

/// `--point-color`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum PointColors {
    Rgb,
    Intensity,
    Height,
}

impl From<PointColors> for PointColor {
    fn from(choice: PointColors) -> Self {
        match choice {
            PointColors::Rgb => Self::Rgb,
            PointColors::Intensity => Self::Intensity,
            PointColors::Height => Self::Height,
        }
    }
}

impl Look {
    /// These choices, and the others where these make none.
    pub(crate) fn over(self, under: Self) -> Self {
        // A number and a spacing are one choice, the density.
        let dense = if self.surfels.is_some() || self.surfel_spacing.is_some() { &self } else { &under };
        Self {
            surfels: dense.surfels,
            surfel_spacing: dense.surfel_spacing,
            iso: self.iso.or(under.iso),
            transfer: self.transfer.or(under.transfer),
            iso_color: self.iso_color.or(under.iso_color),
            refine: self.refine.or(under.refine),
            flatten: self.flatten.or(under.flatten),
            // Colours are of a volume's values: another volume leaves them behind.
            color_transfer: self.color_transfer.or(under.color_transfer.filter(|_| self.color_by.is_none())),
            color_by: self.color_by.or(under.color_by),
            clip_box: self.clip_box.or(under.clip_box),
            clip_plane: self.clip_plane.or(under.clip_plane),
            point_color: self.point_color.or(under.point_color),
        }
    }

    /// The files that are named.
    pub(crate) fn reads(&self) -> impl Iterator<Item = &Path> {
        let transfers = [&self.transfer, &self.color_transfer].into_iter().flatten();
        let files = transfers.filter_map(|transfer| match transfer {
            Transfer::Named(name) if !is_preset(name) => Some(Path::new(name)),
            _ => None,
        });
        self.color_by.iter().map(PathBuf::as_path).chain(files)
    }
}

/// What values look like.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Transfer {
    /// A preset, else a file.
    Named(String),
    /// Already there.
    Made(TransferFunction),
}

impl Transfer {
    fn named(name: &str) -> Result<Self, Infallible> {
        Ok(Self::Named(name.to_owned()))
    }
}

fn finite(text: &str) -> Result<f32, String> {
    match text.trim().parse::<f32>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("`{text}` is not a finite number")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_stands_over_the_file() {
        let file = CameraOptions {
            eye: Some([1.0; 3]),
            up: Some([0.0, 1.0, 0.0]),
            orthographic: Some(3.0),
            ..Default::default()
        };
        let line = CameraOptions { eye: Some([2.0; 3]), fov: Some(40.0), ..Default::default() };
        let both = line.over(file.clone());
        assert_eq!((both.eye, both.up), (Some([2.0; 3]), file.up));
        assert_eq!((both.fov, both.orthographic), (Some(40.0), None));
        assert_eq!(CameraOptions::default().over(file.clone()), file);
    }

    #[test]
    fn a_thickness_goes_with_slabs() {
        let picture = |order, slab_thickness| PictureOptions { order, slab_thickness, ..Default::default() };
        let thin = picture(None, Some(0.5));
        for (line, order) in [
            (picture(None, None), Order::Slabs { thickness: 0.5 }),
            (picture(Some(OrderMode::Auto), None), Order::Slabs { thickness: 0.5 }),
            (picture(Some(OrderMode::Slabs), Some(3.0)), Order::Slabs { thickness: 3.0 }),
            (picture(Some(OrderMode::Centers), None), Order::Centers),
            (picture(Some(OrderMode::PerPixel), None), Order::PerPixel),
        ] {
            let both = line.over(thin.clone());
            assert!(both.thickness_has_use(), "{both:?}");
            assert_eq!(both.order(), order);
        }
        assert_eq!(picture(None, None).order(), Order::Auto);
        assert_eq!(
            picture(Some(OrderMode::Slabs), None).order(),
            Order::Slabs { thickness: Order::THICKNESS }
        );
        // Said of the thickness here, of the order there.
        assert!(!thin.over(picture(Some(OrderMode::Centers), None)).thickness_has_use());
    }
}
