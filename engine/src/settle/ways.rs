//! The ways in which a scene may be drawn.

use crate::closing::LARGEST_RATIO;
use crate::cloud::Cloud;
use crate::levels::eigenvalues;
use crate::scene::{FootprintForm, Order, RenderSettings, Scene};
use glam::DMat3;
use std::f64::consts::TAU;

/// Ways of drawing kernels, from the quickest on; then thinner slabs follow, the thinnest of which are exact in the end. Where forms are left
/// to the engine, each splat is as exact as its own bound asks for; bounds leave out that errors of neighbours cancel, which trials see.
const WAYS: [(Order, FootprintForm); 11] = [
    (SHELLS, FootprintForm::Affine),
    (slabs(2.45), FootprintForm::Affine),
    (slabs(2.0), FootprintForm::Affine),
    (slabs(BOXED), FootprintForm::Affine),
    (SHELLS, FootprintForm::Auto),
    (slabs(1.5), FootprintForm::Affine),
    (slabs(1.0), FootprintForm::Affine),
    (slabs(2.0), FootprintForm::Auto),
    (slabs(BOXED), FootprintForm::Auto),
    (slabs(1.5), FootprintForm::Auto),
    (slabs(1.0), FootprintForm::Auto),
];

const fn slabs(thickness: f64) -> Order {
    Order::Slabs { thickness }
}

/// In σ, about the thinnest slabs of which kernels touch two, as boxes (v ≤ 1.5/12 in [`crate::closing`]'s terms), where a volume's samples
/// are all alike; in those of 1.5σ they touch three, which takes a fifth to a third longer.
const BOXED: f64 = 1.86;

/// Sorted centres instead where there are opacities, which are defined by their order, or several clouds of kernels: of two that overlap
/// one would come first in every shell.
const SHELLS: Order = Order::Shells { thickness: 0.5 };

/// In σ, slabs of which one thickness is the finest that a scene asks for.
const FINEST: [f64; 4] = [1.0, 0.5, 0.25, 0.125];

/// The share of the tolerance that two of the densest kernels may be off by in the finest slabs.
const SHARE_OF_FINEST: f64 = 0.1;

/// And the share that what is before an opacity may be off by in them.
const SHARE_BEFORE_CENTERS: f64 = 0.25;

/// The ways that the settings allow, from the quickest to the finest.
pub(super) fn ways(scene: &Scene, settings: &RenderSettings) -> Vec<(Order, FootprintForm)> {
    let order = match settings.order {
        Order::Auto if scene.clouds.iter().all(Cloud::is_surface) => Some(Order::Auto),
        Order::Auto if !scene.has_extinctions() => Some(Order::Centers),
        Order::Auto => None,
        order => Some(order),
    };
    let media = || scene.clouds.iter().filter(|cloud| cloud.is_medium());
    let needs_centers = scene.has_opacities() || media().count() > 1;
    let are_alike = media().count() == 1 && media().all(|cloud| cloud.columns().factors.are_alike());
    let is_left_out = |way: &(Order, FootprintForm)| way.0 == slabs(BOXED) && !are_alike;
    let finest = finest(scene, settings);
    let thin = FINEST.into_iter().filter(|thickness| *thickness >= finest);
    let thin = thin.map(|thickness| (slabs(thickness), FootprintForm::Auto));
    let exact = (slabs(finest), FootprintForm::Exact);
    let mut ways = Vec::new();
    for (own, form) in WAYS.into_iter().filter(|way| !is_left_out(way)).chain(thin).chain([exact]) {
        let form = if settings.footprint == FootprintForm::Auto { form } else { settings.footprint };
        let own = if own == SHELLS && needs_centers { Order::Centers } else { own };
        let way = (order.unwrap_or(own), form);
        if !ways.contains(&way) {
            ways.push(way);
        }
    }
    ways
}

/// Whether two ways are slabs of which kernels touch two, or now and then three, in the same form: the engine from afar, of which half of the splats or
/// more were merged, took 52 to 60 ms with slabs of 2.45, 2 and 1.86σ at one level of detail, and 24 to 27 at a coarser one.
pub(super) fn take_as_long(a: &(Order, FootprintForm), b: &(Order, FootprintForm)) -> bool {
    let are_thick = |order: &Order| matches!(order, Order::Slabs { thickness } if *thickness >= BOXED);
    are_thick(&a.0) && are_thick(&b.0) && a.1 == b.1
}

/// In σ, the thickest slabs that are as fine as a tolerance asks for. Where nothing bounds what they are off by, thin ones.
fn finest(scene: &Scene, settings: &RenderSettings) -> f64 {
    let tolerance = settings.tolerance;
    let has_centers = scene.has_opacities();
    let [_, half, quarter, eighth] = FINEST;
    let unbounded = match (tolerance < 1.0 / 255.0, has_centers) {
        (false, false) => half,
        (true, true) => eighth,
        _ => quarter,
    };
    // Merged kernels are not alike.
    let is_merged = settings.level_of_detail > 0.0 || settings.budget.is_some();
    let media = || scene.clouds.iter().filter(|cloud| cloud.is_medium());
    let sigmas = || media().filter_map(|cloud| cloud.median_sigma(0));
    let least = sigmas().fold(f64::INFINITY, f64::min).max(sigmas().fold(0.0, f64::max) / LARGEST_RATIO);
    let are_enough = |thickness: &f64| {
        media().all(|cloud| match densest(cloud).filter(|_| !(is_merged && cloud.has_levels())) {
            Some([optical_depth, shortest]) => {
                let [between, before_centers] = errors(optical_depth, thickness * least / shortest);
                between <= SHARE_OF_FINEST * tolerance
                    && (!has_centers || before_centers <= SHARE_BEFORE_CENTERS * tolerance)
            }
            None => *thickness <= unbounded,
        })
    };
    FINEST.into_iter().find(are_enough).unwrap_or(eighth)
}

/// What kernels of an optical depth are off by at most in slabs of a thickness in σ along a ray.
///
/// Two of them in opposite colours: 8e-4 τ² of the fourth power of the thickness, up to τ = 1, and hardly more for denser ones (the table in
/// ARCHITECTURE.md). Nothing is said of slabs that are thicker than √1.5 σ.
///
/// One of them before something flat: in a slab its optical depth is taken to be even. Over all phases of slabs that is right, but from a
/// curve a straight line between the ends of a slab differs by δ²/8 of its second derivative, here at most φ(1) τ/σ².
fn errors(optical_depth: f64, thickness: f64) -> [f64; 2] {
    let tau = optical_depth.min(1.0);
    let is_thin = thickness <= MOST_OF_SHORTEST;
    let between = if is_thin { 9e-4 * tau.powi(2) * thickness.powi(4) } else { f64::INFINITY };
    [between, 0.242 / 8.0 * tau * thickness.powi(2)]
}

/// The largest optical depth of a cloud's kernels, seen along their longest axis (pixels' filters make it less), and the σ of the shortest, in the world. `None`
/// where kernels aren't alike, or flat.
fn densest(cloud: &Cloud) -> Option<[f64; 2]> {
    let columns = cloud.columns();
    if !columns.factors.are_alike() {
        return None;
    }
    let factor = columns.factor(0).as_dmat3();
    let to_world: DMat3 = cloud.cloud_to_world().matrix3 * factor;
    let [longest, _, shortest] = eigenvalues(to_world * to_world.transpose()).map(f64::sqrt);
    let optical_depth = f64::from(columns.strengths.largest()) * longest / (TAU * factor.determinant().abs());
    (shortest > 0.0 && optical_depth.is_finite()).then_some([optical_depth, shortest])
}

/// How thick slabs may be beside the σ of the shortest axis of kernels: √1.5, so that those of σ are where one axis is longer than the others.
const MOST_OF_SHORTEST: f64 = 1.225;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::{Material, OpacityFilter, Shapes, Splats, Strength};
    use glam::{DAffine3, DVec3, Mat3, Vec3};

    /// Kernels with half-axes, seen along the longest of which they have an optical depth.
    fn kernels(axes: [f32; 3], optical_depth: f32) -> Cloud {
        let factor = Mat3::from_diagonal(Vec3::from(axes));
        let across = factor.determinant() / axes.into_iter().fold(0.0, f32::max);
        let masses = vec![0.0, optical_depth * across * std::f32::consts::TAU];
        cloud(Shapes::Shared(factor), masses)
    }

    fn cloud(shapes: Shapes, masses: Vec<f32>) -> Cloud {
        let (centers, colors) = (vec![Vec3::ZERO; 2], vec![[0.5; 3]; 2]);
        let (harmonics, normals, material) = (None, None, Material::UNLIT);
        let strength = Strength::Extinction { masses };
        Cloud::new(Splats { centers, shapes, strength, colors, harmonics, normals, material }).unwrap()
    }

    #[test]
    fn the_finest_slabs_are_as_thin_as_kernels_are_dense() {
        let finest_of = |clouds: Vec<Cloud>, of_255: f64| {
            let tolerance = of_255 / 255.0;
            let settings = RenderSettings { tolerance, level_of_detail: 0.0, ..RenderSettings::default() };
            finest(&Scene { clouds, lights: Vec::new() }, &settings)
        };
        let of_one = |optical_depth, of_255| finest_of(vec![kernels([1.0; 3], optical_depth)], of_255);
        // 9e-4 τ² is a tenth of 1/255 at τ = 0.66; an eighth of the tolerance asks for slabs half as thick.
        assert_eq!([0.65, 0.67, 40.0].map(|dense| of_one(dense, 1.0)), [1.0, 0.5, 0.5]);
        assert_eq!([0.2, 0.7, 4.0].map(|dense| of_one(dense, 0.125)), [1.0, 0.5, 0.25]);
        assert_eq!(of_one(40.0, 8.0), 1.0);
        assert_eq!(of_one(40.0, 1e-4), 0.125);
        let moved = DAffine3::from_scale_rotation_translation(
            DVec3::new(-7.0, 7.0, 7.0),
            glam::DQuat::from_rotation_x(1.0),
            DVec3::splat(9.0),
        );
        // Rays are seven times as long in what is seven times as large.
        for dense in [0.65, 0.67] {
            assert_eq!(
                finest_of(vec![kernels([1.0; 3], dense / 7.0).transformed(moved)], 1.0),
                of_one(dense, 1.0)
            );
        }
        // σ is measured across the shortest axis: 2.25 times the error if one axis is much longer, nothing is known if two are.
        let of_axes = |axes, dense| finest_of(vec![kernels(axes, dense)], 1.0);
        assert_eq!([0.43, 0.45].map(|dense| of_axes([1.0, 90.0, 1.0], dense)), [1.0, 0.5]);
        assert_eq!(of_axes([1.0, 2.0, 2.0], 0.01), 0.5);
        assert_eq!(of_axes([1.0, 1.0, 0.0], 0.01), 0.5);
        let each = [1.0, 1.1].map(|size| Mat3::IDENTITY * size);
        assert_eq!(finest_of(vec![cloud(Shapes::Each(each.into()), vec![0.1; 2])], 1.0), 0.5);
        assert_eq!(finest_of(vec![cloud(Shapes::Each(each.into()), vec![0.1; 2])], 0.9), 0.25);
        // Before what is composited at its centre 0.03 τ is off: a quarter of 1/255 at τ = 0.032, four times that in slabs half as thick.
        let strength = Strength::Opacity { peaks: vec![0.5; 2], filter: OpacityFilter::Classic, least: 0.0 };
        let trained = Cloud::new(Splats { strength, ..kernels([1.0; 3], 0.1).splats() }).unwrap();
        let beside = |dense| finest_of(vec![kernels([1.0; 3], dense), trained.clone()], 1.0);
        assert_eq!([0.03, 0.034, 0.14, 0.5, 9.0].map(beside), [1.0, 0.5, 0.25, 0.25, 0.125]);
        // The densest of several counts.
        assert_eq!(finest_of([0.1, 0.8, 0.2].map(|dense| kernels([1.0; 3], dense)).into(), 1.0), 0.5);
    }
}
