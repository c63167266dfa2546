//! What is drawn, under which light, and how.

use crate::cloud::{Cloud, OpacityFilter};
use crate::columns::Kind;
use crate::frame::Channels;
use glam::DVec3;
use std::collections::HashSet;

/// Clouds and lights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The clouds; all mix in one picture.
    pub clouds: Vec<Cloud>,
    /// The lights. Without any, white ambient light and a white headlight along the view axis shine.
    pub lights: Vec<Light>,
}

impl Scene {
    /// Memory of the splats and their levels of detail in bytes; what clouds share counts once.
    pub fn bytes(&self) -> usize {
        let mut counted = HashSet::new();
        self.clouds.iter().filter(|cloud| counted.insert(cloud.address())).map(Cloud::bytes).sum()
    }

    /// Whether there are kernels with opacities, which are composited at their centres by definition.
    pub(crate) fn has_opacities(&self) -> bool {
        self.clouds
            .iter()
            .any(|cloud| matches!(cloud.columns().kind, Kind::Opacity { .. }) && !cloud.is_empty())
    }

    /// Below this all kernels have ended by themselves, whatever pictures leave out. Extinctions don't, nor what a filter dims, however faint it makes it,
    /// nor what stands for others.
    pub(crate) fn least_opacity(&self, settings: &RenderSettings) -> f64 {
        let least = |cloud: &Cloud| match cloud.columns().kind {
            Kind::Opacity { filter: OpacityFilter::Classic, least }
                if settings.level_of_detail == 0.0 || cloud.levels().len() == 1 =>
            {
                Some(f64::from(least))
            }
            Kind::Opacity { .. } | Kind::Extinction => Some(0.0),
            Kind::Surface(_) => None,
        };
        let shown = self.clouds.iter().filter(|cloud| !cloud.is_empty());
        shown.filter_map(least).reduce(f64::min).unwrap_or(0.0)
    }

    /// Whether there are kernels with extinctions, which are spread along rays.
    pub(crate) fn has_extinctions(&self) -> bool {
        self.clouds.iter().any(Cloud::is_medium)
    }
}

/// A light; colours are linear Rec. 709 times intensity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Light {
    /// The same from everywhere.
    Ambient {
        /// Its colour.
        color: [f32; 3],
    },
    /// Parallel light.
    Directional {
        /// Towards the light in the world, any length above 0.
        towards: DVec3,
        /// Its colour.
        color: [f32; 3],
    },
    /// A point that shines without falling off.
    Point {
        /// Where it is in the world.
        position: DVec3,
        /// Its colour.
        color: [f32; 3],
    },
}

/// Which form of the footprint is used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FootprintForm {
    /// For each splat the cheapest form whose error stays within its share of the tolerance. In [`Order::PerPixel`] no kernel becomes a
    /// point, since that order goes by slopes of depths, which points don't have.
    #[default]
    Auto,
    /// Every splat a point, as Yuan, Chen et al., *Hybrid Forward Resampling and Volume Rendering*, 2003, §4.1 accumulate those that are
    /// minified: round in the picture, its energy kept, without a slope of its depth. Their filter's variance is
    /// [`RenderSettings::low_pass`], to which the splat's own mean variance is added; the range of depths in which they sum is a slab's
    /// ([`Order::Slabs`]) and a surface layer's. Their threshold, the projected size below which a splat becomes a point, is [`Self::Auto`]'s
    /// bound on the error: here it is infinite.
    /// A splat that reaches the camera plane is exact. In slabs a frame of points takes some 6 % less time
    /// than one of affine splats.
    Point,
    /// Zwicker, Pfister, van Baar, Gross, *EWA Volume Splatting*, 2001: the perspective denominator dropped.
    Affine,
    /// Exact perspective.
    Exact,
}

/// The space that colours are shaded and blended in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Blend {
    /// Linear light.
    #[default]
    Linear,
    /// Display-encoded sRGB, as volume renderers and trained scenes do it.
    Display,
}

/// When the kernels along a ray are composited: between two closings things add, at a closing what has been added
/// goes over what lies behind.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Order {
    /// [`Order::Centers`] where all kernels have opacities, which are defined by it, whatever surfaces there are; else [`Order::Slabs`] of
    /// [`Order::THICKNESS`]. [`crate::settle()`] puts the quickest in its place that keeps to the tolerance.
    #[default]
    Auto,
    /// After each kernel, by the distance of centres from the eye, which does not change when the camera turns in place.
    Centers,
    /// The same but for what is about as far away: after each kernel, shell by shell around the eye, and within a shell in the order that
    /// splats have in memory, which keeps neighbours together. Which of two kernels comes first that overlap so far is wrong by about as
    /// much either way: in a haze of all colours shells of σ are 8 % farther from R1 than [`Self::Centers`]. But of several clouds one comes first
    /// in every shell. Lists are sorted and read in less time. Kernels that are defined by their order should have [`Self::Centers`].
    Shells {
        /// In σ of kernels, as slabs have it, from 0.001 to 1e6; shells are thinner by up to a half, since powers of two are quick.
        thickness: f64,
    },
    /// After each kernel, by its depth at the pixel, as far as a small window of kernels reaches.
    PerPixel,
    /// At spheres around the eye, or planes where rays are parallel: no order within a slab. Kernels are shared out between
    /// slabs as if they were narrower by what the slabs spread them.
    ///
    /// Beside kernels with extinctions those with opacities stay what they are defined to be, whole at the distances of their centres: of the
    /// slab in which one lies the part before it is closed first. Where there are no extinctions they are spread, too, which gives
    /// another picture, that doesn't pop.
    Slabs {
        /// In σ of kernels along rays from anywhere, from 0.001 to 1e6: the least of the medians of it in clouds that are spread, and at least 1/1024 of the
        /// largest. No slab is thinner than what single precision tells apart at the farthest kernel.
        thickness: f64,
    },
    /// At the sheets of a grid that face the viewer most, as in Zwicker, Pfister, van Baar, Gross, *EWA Volume Splatting*,
    /// 2001: a baseline, that pops where another axis takes over. The grid is that of the first cloud's kernels; they
    /// must share one shape, whose half-axes are the grid's.
    AxisSheets {
        /// Distance of the sheets in σ of the kernels, from 0.001 to 1e6: 1/0.7 is a sheet a voxel where σ is 0.7 voxels.
        spacing: f64,
    },
}

impl Order {
    /// The thickness of slabs where nothing is said, in median σ of kernels.
    pub const THICKNESS: f64 = 2.0;
}

/// Ways that others go, to compare with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Baseline {
    /// α = τ in place of 1 − e^{−τ} in [`Order::Centers`] and [`Order::PerPixel`].
    Taylor,
    /// Slabs take their shares of kernels as they are.
    UncorrectedShares,
}

/// How a scene is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderSettings {
    /// The form of the footprint.
    pub footprint: FootprintForm,
    /// Variance of the low-pass filter in squared pixels, from 0 to 1e6.
    pub low_pass: f64,
    /// The space of shading and blending.
    pub blend: Blend,
    /// When kernels are composited.
    pub order: Order,
    /// A way that others go, in place of ours.
    pub baseline: Option<Baseline>,
    /// Whether light acts; without it colours are shown as they are.
    pub shade: bool,
    /// Behind everything: linear Rec. 709, not premultiplied, finite; and alpha from 0 to 1.
    pub background: [f32; 4],
    /// The largest error of a channel that is aimed at, from 0 to 1. Each shortcut may use a share of it; together they are judged by
    /// [`crate::settle()`], which also finds where splats end: by itself no kernel reaches beyond [`Self::cutoff`], however small this is.
    pub tolerance: f64,
    /// Squared Mahalanobis radius at which kernels are cut off, from 1 to 100; their mass is renormalised. [`crate::settle()`] may find another.
    pub cutoff: f64,
    /// The share of the tolerance, from 0 to 1, below which opacities are left out: several kernels end in a pixel, and what they lack together is to
    /// stay within the tolerance. [`crate::settle()`] may find another. A cloud's own least opacity ends its kernels sooner.
    pub end_share: f64,
    /// Squared Mahalanobis radius at which surfels end, from 1 to 100, to references too: it is a part of what they are. [`crate::settle()`] may find
    /// another.
    pub outline: f64,
    /// How much wider than it is the pixels' filter counts where levels of detail are chosen, of clouds that have levels: from 0, with
    /// which every splat is drawn, to 1e6. [`crate::settle()`] may find another.
    pub level_of_detail: f64,
    /// The picture is drawn with at most as many splats, as far as clouds have levels: the best that can be had.
    /// The last level of a cloud, 1024 splats at most, is drawn even if that is more. Where no cloud has levels, or
    /// [`Self::level_of_detail`] is 0, it changes nothing.
    pub budget: Option<usize>,
    /// Whether what is hidden is left out before it is projected, where much seems to be; the picture is the same.
    pub occlusion: bool,
    /// Whether volumes whose kernels are wide in the picture (the median σ is 1.75 pixels or more) are drawn at every second pixel of
    /// every second row, and interpolated between, where only colours are asked for. It is off by 0.27 of the tolerance at 99.9 % of the
    /// pixels of a semi-transparent engine, by 0.66 at most; blocks where it may be off by more are drawn at every pixel.
    pub interpolation: bool,
    /// Whether splats are shown in the colour of their footprint's form, unshaded: points red, affine green, exact blue.
    pub color_by_form: bool,
    /// What the frame holds.
    pub channels: Channels,
}

impl RenderSettings {
    /// The squared Mahalanobis radius at which every splat has ended.
    pub(crate) fn farthest_end(&self) -> f64 {
        self.cutoff.max(self.outline)
    }

    /// The squared Mahalanobis radius at which splats of a kind end.
    pub(crate) fn cutoff_of(&self, kind: &Kind) -> f64 {
        if matches!(kind, Kind::Surface(_)) { self.outline } else { self.cutoff }
    }

    /// Opacities below this are left out.
    pub(crate) fn least_opacity(&self) -> f64 {
        self.tolerance * self.end_share
    }
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            footprint: FootprintForm::Auto,
            low_pass: 0.3,
            blend: Blend::Linear,
            order: Order::Auto,
            baseline: None,
            shade: true,
            background: [0.0; 4],
            tolerance: 1.0 / 255.0,
            cutoff: 12.25,
            end_share: 0.125,
            outline: 12.25,
            level_of_detail: 1.0,
            budget: None,
            occlusion: true,
            interpolation: true,
            color_by_form: false,
            channels: Channels::All,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{Material, Shapes, Splats, Strength};
    use glam::{Mat3, Vec3};

    #[test]
    fn kernels_have_ended_by_themselves_where_nothing_dims_them_or_stands_for_them() {
        let count = 2000;
        let cloud = |strength| {
            Cloud::new(Splats {
                centers: (0..count).map(|i| Vec3::X * i as f32).collect(),
                shapes: Shapes::Shared(Mat3::IDENTITY),
                strength,
                colors: vec![[1.0; 3]; count],
                harmonics: None,
                normals: None,
                material: Material::UNLIT,
            })
            .unwrap()
        };
        let opacities = |filter, least| cloud(Strength::Opacity { peaks: vec![0.5; count], filter, least });
        let classic = opacities(OpacityFilter::Classic, 0.25);
        let fog = cloud(Strength::Extinction { masses: vec![1.0; count] });
        let [usual, every_splat] =
            [1.0, 0.0].map(|level_of_detail| RenderSettings { level_of_detail, ..RenderSettings::default() });
        for (clouds, settings, expected) in [
            (vec![classic.clone()], usual, 0.25),
            (vec![classic.clone().with_levels()], usual, 0.0),
            (vec![classic.clone().with_levels()], every_splat, 0.25),
            (vec![classic.clone(), opacities(OpacityFilter::Classic, 0.125)], usual, 0.125),
            (vec![classic.clone(), opacities(OpacityFilter::Compensated, 0.25)], usual, 0.0),
            (vec![classic, fog], usual, 0.0),
            (Vec::new(), usual, 0.0),
        ] {
            assert_eq!(Scene { clouds, lights: Vec::new() }.least_opacity(&settings), expected);
        }
    }
}
