//! The ways of drawing that are compared: every choice and dial, one at a time, and how others go.

use oblate_engine::{Baseline, FootprintForm, Order, RenderSettings, Scene};
use serde::Serialize;

/// What is turned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// The one dial, all else left to the engine.
    Tolerance,
    /// Fixed choices: an order with a form of the footprint, every splat drawn.
    Fixed,
    /// Where kernels are cut off, every splat drawn.
    Cutoff,
    /// The pixel's filter, every splat drawn.
    LowPass,
    /// How many splats stand for the scene.
    Levels,
    /// How others go, in this engine.
    Baseline,
    /// How others go, by themselves.
    Other,
    /// Programs of others, measured elsewhere.
    Peer,
}

impl Family {
    /// Every family.
    pub const ALL: [Self; 8] = [
        Self::Tolerance,
        Self::Fixed,
        Self::Cutoff,
        Self::LowPass,
        Self::Levels,
        Self::Baseline,
        Self::Other,
        Self::Peer,
    ];

    /// In legends.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tolerance => "auto, by tolerance",
            Self::Fixed => "fixed order and form",
            Self::Cutoff => "cut-off",
            Self::LowPass => "low-pass",
            Self::Levels => "levels of detail",
            Self::Baseline => "how others go",
            Self::Other => "other methods",
            Self::Peer => "other programs",
        }
    }
}

/// A way of drawing.
#[derive(Clone, Debug, PartialEq)]
pub struct Method {
    /// A few words.
    pub name: String,
    /// What is turned.
    pub family: Family,
    /// How the engine draws, before what it leaves open is settled.
    pub settings: RenderSettings,
}

/// How kernels are ordered, footprints are made and, where that is not as usual, where kernels end, in words.
pub fn way(settings: &RenderSettings) -> String {
    let order = match settings.order {
        Order::Auto => "layers".into(),
        Order::Centers => "centers".into(),
        Order::Shells { thickness } => format!("shells {thickness}σ"),
        Order::PerPixel => "per pixel".into(),
        Order::Slabs { thickness } => format!("slabs {thickness}σ"),
        Order::AxisSheets { .. } => "axis sheets".into(),
    };
    let form = match settings.footprint {
        FootprintForm::Auto => "each its form",
        FootprintForm::Point => "points",
        FootprintForm::Affine => "affine",
        FootprintForm::Exact => "exact",
    };
    let usual = RenderSettings::default();
    let mut ends = String::new();
    if settings.cutoff != usual.cutoff {
        ends += &format!(", to ρ = {}", (settings.cutoff * 100.0).round() / 100.0);
    }
    if settings.outline != usual.outline {
        ends += &format!(", surfels to ρ = {}", settings.outline);
    }
    if settings.end_share != usual.end_share {
        ends += &format!(", opacities to 1/{} of the tolerance", (1.0 / settings.end_share).round());
    }
    if settings.level_of_detail > 0.0 && settings.level_of_detail != usual.level_of_detail {
        ends += &format!(", levels for filters × {}", settings.level_of_detail);
    }
    format!("{order}, {form}{ends}")
}

/// Tolerances in levels of 255.
pub const TOLERANCES: [f64; 6] = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0];

/// The tolerance of the default.
pub const LEVEL: f64 = 1.0 / 255.0;

/// Thicknesses of slabs in σ of kernels.
const THICKNESSES: [f64; 5] = [2.45, 2.0, 1.5, 1.0, 0.5];

/// Squared radii at which kernels end; 4 is the one of Zwicker et al., *EWA Volume Splatting*, 2001.
const CUTOFFS: [f64; 4] = [4.0, 9.0, 16.0, 25.0];

/// Variances of the pixel's filter in squared pixels; 1 is the one of Zwicker et al., 2001, 1/12 a pixel's own.
const LOW_PASSES: [f64; 2] = [1.0, 1.0 / 12.0];

/// Shares of a scene's splats that a budget leaves.
const BUDGETS: [f64; 2] = [0.5, 0.125];

/// The ways in which a scene can be drawn that is drawn with `settings` when nothing is said; the first is that. Other dials are turned
/// around what is `settled` of it with every splat, each by itself: how coarse levels may be is decided in trials by few pixels, which
/// roundings change.
pub fn methods(scene: &Scene, settings: &RenderSettings, settled: &RenderSettings) -> Vec<Method> {
    let has_kernels = scene.clouds.iter().any(|cloud| !cloud.is_surface());
    let mut all = Vec::new();
    let mut add = |family, name: String, settings| all.push(Method { name, family, settings });
    add(Family::Tolerance, "default".into(), *settings);
    for levels in TOLERANCES.into_iter().filter(|levels| *levels != 1.0) {
        let name = format!("tolerance {levels}/255");
        add(Family::Tolerance, name, RenderSettings { tolerance: levels * LEVEL, ..*settings });
    }
    let fixed = RenderSettings { level_of_detail: 0.0, ..*settings };
    let orders: Vec<Order> = if has_kernels {
        let slabs = |thickness| Order::Slabs { thickness };
        let shells = Order::Shells { thickness: 0.5 };
        [Order::Centers, shells, Order::PerPixel].into_iter().chain(THICKNESSES.map(slabs)).collect()
    } else {
        vec![settings.order]
    };
    for order in orders {
        for footprint in [FootprintForm::Affine, FootprintForm::Exact] {
            let settings = RenderSettings { order, footprint, ..fixed };
            add(Family::Fixed, way(&settings), settings);
        }
    }
    let order = if has_kernels { Order::Slabs { thickness: Order::THICKNESS } } else { settings.order };
    let points = RenderSettings { footprint: FootprintForm::Point, order, ..fixed };
    add(Family::Fixed, way(&points), points);
    for cutoff in CUTOFFS.into_iter().filter(|_| has_kernels) {
        add(Family::Cutoff, format!("cut off at ρ = {cutoff}"), RenderSettings { cutoff, ..*settled });
    }
    for low_pass in LOW_PASSES.into_iter().filter(|variance| *variance != settings.low_pass) {
        let name = format!("low-pass {:.2} px²", low_pass);
        add(Family::LowPass, name, RenderSettings { low_pass, ..*settled });
    }
    if scene.clouds.iter().any(|cloud| cloud.has_levels()) {
        add(Family::Levels, "every splat".into(), *settled);
        let untried = RenderSettings { level_of_detail: settings.level_of_detail, ..*settled };
        let splats: usize = scene.clouds.iter().map(|cloud| cloud.len()).sum();
        for share in BUDGETS {
            let budget = Some((splats as f64 * share) as usize);
            add(Family::Levels, format!("budget of {share}"), RenderSettings { budget, ..untried });
        }
    }
    if has_kernels {
        let sheets = Order::AxisSheets { spacing: 1.0 / 0.7 };
        let taylor = Some(Baseline::Taylor);
        let uncorrected = Some(Baseline::UncorrectedShares);
        add(Family::Baseline, "axis sheets".into(), RenderSettings { order: sheets, ..fixed });
        let centers = RenderSettings { order: Order::Centers, baseline: taylor, ..fixed };
        add(Family::Baseline, "centers, α = τ".into(), centers);
        for thickness in [2.0, 1.0] {
            let order = Order::Slabs { thickness };
            let name = format!("slabs {thickness}σ, uncorrected");
            add(Family::Baseline, name, RenderSettings { order, baseline: uncorrected, ..fixed });
        }
    }
    all
}
