//! Depth images, and the cameras that took them, as the command line names them.

use crate::notation::fraction;
use crate::progress::Console;
use anyhow::{Context, Result, bail, ensure};
use clap::{Args, ValueEnum};
use glam::{DAffine3, DVec2};
use oblate::engine::{Intrinsics, Pose};
use oblate::importers::OpenOptions;
use oblate::importers::depth::{DepthEncoding, read_color, read_depth, read_intrinsics, read_poses};
use oblate::surfels::{DepthKind, RgbdImage};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Pictures with depths.
#[derive(Args)]
pub(crate) struct DepthInputs {
    /// Photographs (PNG, JPEG, WebP, PPM, EXR), each with its depths (PNG, PGM, TIFF, PFM, EXR)
    #[arg(value_name = "COLOUR DEPTH", required = true, num_args = 2..)]
    files: Vec<PathBuf>,
    /// Focal lengths and principal point in pixels, the centre of the first pixel being 0,0 (OpenCV's way); or a JSON file of Open3D's
    #[arg(long, value_name = "FX,FY,CX,CY|FILE", allow_hyphen_values = true)]
    intrinsics: String,
    /// Where the camera stood, once for each photograph: a file of 4×4 camera-to-world matrices, a TUM trajectory or a Redwood log; FILE:N is its pose N, from
    /// 0 on [default of one photograph: the origin]
    #[arg(long, value_name = "FILE[:N]")]
    pose: Vec<String>,
    /// What a stored depth of 1 is in world units, such as 1/5000 [default: 0.001 of integers, 1 of others]
    #[arg(long, value_name = "S", value_parser = fraction, allow_hyphen_values = true, conflicts_with_all = ["disparity", "depth_format"])]
    depth_scale: Option<f64>,
    /// Depths are disparities: focal length in pixels × baseline [, distance of the principal points, steps of a pixel]
    #[arg(long, value_name = "FB[,DOFFS[,STEPS]]", allow_hyphen_values = true)]
    disparity: Option<Disparity>,
    /// Depths in the bits of another data set
    #[arg(long, value_name = "SET", conflicts_with = "disparity")]
    depth_format: Option<DepthFormat>,
    /// What depths measure
    #[arg(long, value_name = "ALONG", default_value = "axis")]
    depth_along: Along,
    /// Depths are scattered, as a laser scanner's: those between are interpolated
    #[arg(long)]
    densify: bool,
    /// Bytes that a file may unpack to
    #[arg(long, value_name = "N", default_value_t = OpenOptions::MAX_MEMORY)]
    max_memory: u64,
}

#[derive(Clone, Copy, ValueEnum)]
enum Along {
    /// z along the view axis
    Axis,
    /// The distance along the pixel's ray
    Ray,
}

#[derive(Clone, Copy, ValueEnum)]
enum DepthFormat {
    /// SUN RGB-D's rotated bits
    Sun,
    /// NYU Depth v2's raw ones
    Nyu,
}

/// `baseline_focal[,offset[,scale]]`.
#[derive(Clone, Copy)]
struct Disparity([f64; 3]);

impl FromStr for Disparity {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("`{text}` is not 1 to 3 numbers; write them like 150,0,4");
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
        match numbers.map_err(|_| wrong())?[..] {
            [focal] => Ok(Self([focal, 0.0, 1.0])),
            [focal, offset] => Ok(Self([focal, offset, 1.0])),
            [focal, offset, scale] => Ok(Self([focal, offset, scale])),
            _ => Err(wrong()),
        }
    }
}

impl DepthInputs {
    /// Reads all.
    pub(crate) fn load(&self, console: Console) -> Result<Vec<RgbdImage>> {
        let Self { files, pose, .. } = self;
        ensure!(files.len().is_multiple_of(2), "{} files; photographs and depths come in pairs", files.len());
        let count = files.len() / 2;
        let is_unsaid = pose.is_empty() && count == 1;
        ensure!(
            is_unsaid || pose.len() == count,
            "{count} photographs and {} --pose; give one for each",
            pose.len()
        );
        let intrinsics = self.intrinsics()?;
        let _task = console.task("reading");
        let mut images = Vec::new();
        for (number, pair) in files.chunks_exact(2).enumerate() {
            let pose = match pose.get(number) {
                Some(place) => self::pose(place)?,
                None => Pose { world_to_camera: DAffine3::IDENTITY },
            };
            let image = self.image([&pair[0], &pair[1]], (intrinsics, pose), console)?;
            images.push(if self.densify { image.densified()? } else { image });
        }
        Ok(images)
    }

    /// The files that are named.
    pub(crate) fn reads(&self) -> impl Iterator<Item = &Path> {
        let poses = self.pose.iter().flat_map(|text| pose_files(text));
        self.files.iter().map(PathBuf::as_path).chain(poses).chain([Path::new(&self.intrinsics)])
    }

    fn image(
        &self,
        [color, depth]: [&Path; 2],
        ((said, intrinsics), pose): ((Option<[usize; 2]>, Intrinsics), Pose),
        console: Console,
    ) -> Result<RgbdImage> {
        let photograph = read_color(color, self.max_memory)?;
        let map = read_depth(depth, &self.encoding(), self.max_memory)?;
        for (path, notes) in [(color, &photograph.notes), (depth, &map.notes)] {
            for note in notes {
                console.say(format_args!("{}: {note}", path.display()));
            }
        }
        let ([width, height], [across, down]) = (photograph.size, map.size);
        ensure!(
            photograph.size == map.size,
            "{} has {width}×{height} pixels and {} {across}×{down}; they must be registered, pixel for pixel",
            color.display(),
            depth.display()
        );
        if let Some([across, down]) = said.filter(|said| *said != photograph.size) {
            bail!("{}: {width}×{height} pixels, and --intrinsics are of {across}×{down}", color.display());
        }
        let [x, y] = intrinsics.center.to_array();
        let is_inside = (0.0..=width as f64).contains(&x) && (0.0..=height as f64).contains(&y);
        if !is_inside {
            console.say(format_args!(
                "the principal point lies outside the photograph; are --intrinsics of another size?"
            ));
        }
        let kind = match self.depth_along {
            Along::Axis => DepthKind::AlongAxis,
            Along::Ray => DepthKind::AlongRay,
        };
        let (size, colors, depths) = (photograph.size, photograph.colors, map.depths);
        Ok(RgbdImage { size, colors, depths, kind, intrinsics, pose })
    }

    fn encoding(&self) -> DepthEncoding {
        match (self.depth_scale, self.disparity, self.depth_format) {
            (Some(scale), ..) => DepthEncoding::Units(scale),
            (_, Some(Disparity([baseline_focal, offset, scale])), _) => {
                DepthEncoding::Disparity { baseline_focal, offset, scale }
            }
            (.., Some(DepthFormat::Sun)) => DepthEncoding::SunRgbd,
            (.., Some(DepthFormat::Nyu)) => DepthEncoding::NyuRaw,
            _ => DepthEncoding::Auto,
        }
    }

    /// And the size that they are for, where a file says so.
    fn intrinsics(&self) -> Result<(Option<[usize; 2]>, Intrinsics)> {
        let numbers: Result<Vec<f64>, _> =
            self.intrinsics.split(',').map(|part| part.trim().parse()).collect();
        match numbers.as_deref() {
            Ok(&[fx, fy, cx, cy]) => {
                let (focal, center) = (DVec2::new(fx, fy), DVec2::new(cx, cy) + 0.5);
                Ok((None, Intrinsics { focal, center }))
            }
            Ok(_) => bail!("--intrinsics {}: four numbers are needed, fx,fy,cx,cy", self.intrinsics),
            Err(_) => {
                let (size, intrinsics) = read_intrinsics(&self.intrinsics).context("--intrinsics")?;
                Ok((Some(size), intrinsics))
            }
        }
    }
}

/// What the file of `FILE` or `FILE:N` may be.
pub(crate) fn pose_files(text: &str) -> impl Iterator<Item = &Path> {
    [Some(text), text.rsplit_once(':').map(|(path, _)| path)].into_iter().flatten().map(Path::new)
}

/// The pose at `FILE` or `FILE:N`.
pub(crate) fn pose(text: &str) -> Result<Pose> {
    let numbered =
        text.rsplit_once(':').and_then(|(path, number)| Some((path, number.parse::<usize>().ok()?)));
    let (path, number) = match numbered {
        Some((path, number)) if !Path::new(text).exists() => (path, Some(number)),
        _ => (text, None),
    };
    let poses = read_poses(path)?;
    let count = poses.len();
    match (number, &poses[..]) {
        (None, [one]) => Ok(one.pose),
        (None, _) => bail!("{path}: {count} poses; say which, such as {path}:0"),
        (Some(number), poses) => match poses.get(number) {
            Some(pose) => Ok(pose.pose),
            None => bail!("{path}: {count} poses, from 0 on; there is no number {number}"),
        },
    }
}
