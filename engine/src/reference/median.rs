//! What lies in the middle of all that is seen along a ray.

use super::integral::{Fragment, NormalDistribution, OPAQUE, REACH};
use super::layers::layers;
use super::splats::{Kernel, Setup, Splat};
use super::view::Ray;
use crate::camera::Camera;
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

/// A kernel on a ray.
struct Met {
    fragment: Fragment,
    id: u32,
    distance: f64,
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
        let (mut samples, mut kernels) = (Vec::new(), Vec::new());
        for id in ids {
            match self.setup.seen_splat(*id) {
                Some(Splat::Surfel(surfel)) => samples.extend(surfel.sample(&ray, near)),
                Some(Splat::Kernel(kernel)) => kernels.extend(met(&kernel, &ray)),
                None => {}
            }
        }
        // What each layer leaves, front to back: (id, z, 1 − α).
        let layers: Vec<_> =
            layers(&mut samples).map(|layer| (layer.id, layer.z, 1.0 - layer.alpha)).collect();
        if self.setup.by_centers {
            return self.among_whole(kernels, &layers);
        }
        let end = kernels.iter().map(|k| k.fragment.z + REACH * k.fragment.sigma).fold(near, f64::max);
        let passed = |z: f64| (-self.optical_depth(&kernels, z)).exp();
        let behind = passed(end) * layers.iter().map(|(_, _, left)| left).product::<f64>();
        let goal = half_seen(behind)?;
        let (mut from, mut left) = (near, 1.0);
        for (id, z, own) in layers {
            if left * passed(z) <= goal {
                return self.inside(&kernels, [from, z], goal / left, behind);
            }
            if left * passed(z) * own <= goal {
                return Some((id, z, 1.0 - behind));
            }
            (from, left) = (z, left * own);
        }
        self.inside(&kernels, [from, end], goal / left, behind)
    }

    /// Among kernels that are composited whole between layers.
    fn among_whole(&self, mut kernels: Vec<Met>, layers: &[(u32, f64, f64)]) -> Option<(u32, f64, f64)> {
        kernels.sort_by(|a, b| a.distance.total_cmp(&b.distance).then(a.id.cmp(&b.id)));
        let (mut met, mut from) = (Vec::new(), self.setup.view.near);
        for layer in layers.iter().map(Some).chain([None]) {
            let to = layer.map_or(f64::INFINITY, |(_, z, _)| *z);
            met.extend(kernels.iter().map(|k| {
                let f = &k.fragment;
                let [before, until] = [from, to].map(|z| self.normal.at((z - f.z) / f.sigma));
                let left = (-(until - before).max(0.0) * f.optical_depth).exp();
                (k.id, f.z.max(from).min(to), left)
            }));
            met.extend(layer);
            from = to;
        }
        let behind: f64 = met.iter().map(|(_, _, left)| left).product();
        let goal = half_seen(behind)?;
        let mut seen_through = 1.0;
        let across = met.into_iter().find(|(_, _, left)| {
            seen_through *= left;
            seen_through <= goal
        });
        across.map(|(id, z, _)| (id, z, 1.0 - behind))
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
    Some(Met { fragment, id: kernel.id, distance: kernel.distance })
}

/// The transmittance at which half of what is seen is in front, where anything is seen.
fn half_seen(behind: f64) -> Option<f64> {
    (behind < 1.0 - OPAQUE).then_some((1.0 + behind) / 2.0)
}
