//! What lies in the middle of all that is seen along a ray.

use super::integral::{Fragment, NormalDistribution, REACH};
use super::layers::{Layer, layers, segments};
use super::splats::{Kernel, Setup, Splat};
use super::trace::Whole;
use super::view::Ray;
use crate::camera::Camera;
use crate::frame::LEAST_VISIBLE;
use crate::scene::{RenderSettings, Scene};
use glam::DVec2;

/// How many σ from its centre a splat is looked at, at most.
pub(crate) const MOST_REACH: f64 = REACH;

/// Halvings of an interval of depths that is some hundred σ long: to 1e-9 of a σ.
const BISECTIONS: usize = 48;

/// A scene whose rays can be asked one by one.
pub(crate) struct Median<'a> {
    setup: Setup<'a>,
    normal: NormalDistribution,
}

/// A kernel on a ray, spread along it.
struct Met {
    fragment: Fragment,
    id: u32,
}

/// What lets a part of the light through at one z; what is seen there may be at another one.
struct Sheet {
    z: f64,
    left: f64,
    id: u32,
    seen_at: f64,
}

impl<'a> Median<'a> {
    /// For settings that were checked, whose outline is within [`MOST_REACH`].
    pub(crate) fn new(scene: &'a Scene, camera: &Camera, settings: &'a RenderSettings) -> Self {
        let setup = Setup::new(scene, camera, settings, settings.low_pass);
        Self { setup, normal: NormalDistribution::new() }
    }

    /// Id and depth of the splat where half of what is seen through a point of the picture is in front, among the splats with
    /// these ids, and the opacity of all. `None` where nothing is seen.
    pub(crate) fn at(&self, pixel: DVec2, ids: &[u32]) -> Option<(u32, f64, f64)> {
        let ray = self.setup.view.ray(pixel);
        let near = self.setup.view.near;
        let (mut samples, mut kernels, mut whole) = (Vec::new(), Vec::new(), Vec::new());
        for id in ids {
            match self.setup.seen_splat(*id) {
                Some(Splat::Surfel(surfel)) => samples.extend(surfel.sample(&ray, near)),
                Some(Splat::Kernel(kernel)) if kernel.is_whole => whole.extend(Whole::of(&kernel, &ray)),
                Some(Splat::Kernel(kernel)) => kernels.extend(met(&kernel, &ray)),
                None => {}
            }
        }
        whole.sort_by(|a, b| a.at.total_cmp(&b.at).then(a.id.cmp(&b.id)));
        let sheets = self.sheets(layers(&mut samples), &whole);
        let end = kernels.iter().map(|k| k.fragment.z + REACH * k.fragment.sigma).fold(near, f64::max);
        let passed = |z: f64| (-self.optical_depth(&kernels, z)).exp();
        let behind = passed(end) * sheets.iter().map(|sheet| sheet.left).product::<f64>();
        let goal = half_seen(behind)?;
        let (mut from, mut left) = (near, 1.0);
        for Sheet { z, left: own, id, seen_at } in sheets {
            if left * passed(z) <= goal {
                return self.inside(&kernels, [from, z], goal / left, behind);
            }
            if left * passed(z) * own <= goal {
                return Some((id, seen_at, 1.0 - behind));
            }
            (from, left) = (z, left * own);
        }
        self.inside(&kernels, [from, end], goal / left, behind)
    }

    /// Surface layers, and what is composited whole between them, from near to far.
    fn sheets<'b>(&self, layers: impl Iterator<Item = Layer<'b>>, whole: &[Whole]) -> Vec<Sheet> {
        let mut sheets = Vec::new();
        for ([from, to], layer) in segments(layers, self.setup.view.near) {
            sheets.extend(whole.iter().filter_map(|kernel| {
                let left = (-kernel.between(&self.normal, [from, to])).exp();
                let [z, seen_at] = [kernel.at, kernel.fragment.z].map(|z| z.max(from).min(to));
                (left < 1.0).then_some(Sheet { z, left, id: kernel.id, seen_at })
            }));
            let sheet =
                |layer: Layer<'_>| Sheet { z: to, left: 1.0 - layer.alpha, id: layer.id, seen_at: to };
            sheets.extend(layer.map(sheet));
        }
        sheets
    }

    /// The kernel that takes most light where the volume's transmittance falls to `goal`, between two depths.
    fn inside(
        &self,
        kernels: &[Met],
        [from, to]: [f64; 2],
        goal: f64,
        behind: f64,
    ) -> Option<(u32, f64, f64)> {
        let (low, high) = (0..BISECTIONS).fold((from, to), |(low, high), _| {
            let middle = 0.5 * (low + high);
            if (-self.optical_depth(kernels, middle)).exp() > goal { (middle, high) } else { (low, middle) }
        });
        let z = 0.5 * (low + high);
        // Extinction along z, up to a constant.
        let density = |k: &Met| {
            let f = &k.fragment;
            f.optical_depth / f.sigma * (-0.5 * ((z - f.z) / f.sigma).powi(2)).exp()
        };
        let strongest = kernels.iter().max_by(|a, b| density(a).total_cmp(&density(b)).then(b.id.cmp(&a.id)));
        strongest.map(|k| (k.id, z, 1.0 - behind))
    }

    /// Of all kernels between the near plane and `z`.
    fn optical_depth(&self, kernels: &[Met], z: f64) -> f64 {
        let share = |f: &Fragment| {
            let up_to = |z: f64| self.normal.at((z - f.z) / f.sigma);
            (up_to(z) - up_to(self.setup.view.near)).max(0.0)
        };
        kernels.iter().map(|k| share(&k.fragment) * k.fragment.optical_depth).sum()
    }
}

fn met(kernel: &Kernel, ray: &Ray) -> Option<Met> {
    let fragment = kernel.fragment(ray).filter(|f| f.optical_depth > 0.0)?;
    Some(Met { fragment, id: kernel.id })
}

/// The transmittance at which half of what is seen is in front, where anything is seen.
fn half_seen(behind: f64) -> Option<f64> {
    (behind <= 1.0 - f64::from(LEAST_VISIBLE)).then_some((1.0 + behind) / 2.0)
}
