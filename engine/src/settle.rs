//! What is left to the engine, settled by trial.

mod trial;
mod ways;
mod windows;

use crate::camera::Camera;
use crate::cloud::Cloud;
use crate::columns::Kind;
use crate::scene::{FootprintForm, Order, RenderSettings, Scene};
use crate::validate::SceneError;
use crate::view::SceneView;
use trial::{MOST_OF_ALL, Trial};
use ways::{take_as_long, ways};
use windows::windows;

/// The share of the tolerance that 99.9 % of the pixels of windows may be off by in a way: they are a sample.
const SHARE_OF_WAYS: f64 = 0.6;

/// The share that 99 % may be off by where kernels end nearer. Windows see little of the tail of these errors, which lie along all
/// borders: of whole pictures what 99.9 % are off by was 1.2 to 1.8 times what 99 % are.
const SHARE_OF_ENDS: f64 = 0.5;

/// The share that 99.9 % may be off by where opacities end nearer: of these errors the tail is longer.
const SHARE_OF_OPACITIES: f64 = 0.6;

/// The tolerance of the picture that these are compared with, as a share of the one that is asked for: it is off, too, where its
/// opacities end.
const TRUTH_OF_ENDS: f64 = 0.125;

/// Where kernels with an extinction may end, nearer than usual. Windows may miss most of the few pixels that still nearer ends change.
const NEARER: f64 = 9.0;

/// The shares of the tolerance that opacities may end at, from the quickest to the finest: where dozens lie in a pixel, what they lack
/// adds up.
const END_SHARES: [f64; 5] = [1.0 / 4.0, 1.0 / 8.0, 1.0 / 16.0, 1.0 / 32.0, 1.0 / 64.0];

/// Finer ones, tried where even the last of these lack too much: in crowds of hundreds of faint ones.
const FINER_SHARES: [f64; 3] = [1.0 / 256.0, 1.0 / 1024.0, 1.0 / 4096.0];

/// Where surfels may end, from the nearest on: tried where coverage steps by two tolerances at most at the outline of one by itself.
/// At 5 an iso-surface shows faint dots, few enough for 99.9 % of the pixels, and is drawn no sooner.
const OUTLINES: [f64; 2] = [6.25, 9.0];

/// How much wider than it is the pixels' filter may count for levels of detail, from the quickest on: what makes them differ is fitted to
/// many scenes, and some ask for less and some for more. Else every splat is drawn. Every second one is tried, then the one before the first
/// that will do: errors grow with them, but not always. With thinner slabs, what is coarser than that is tried one by one.
const LEVELS: [f64; 9] = [8.0, 5.6, 4.0, 2.8, 2.0, 1.4, 1.0, 0.5, 0.25];

/// Fewer pixels that show anything tell nothing of where splats may end.
const LEAST_SHOWN: usize = 100;

/// Settles what settings leave to the engine: [`Order::Auto`], [`FootprintForm::Auto`], where splats end, and levels of detail. It finds the
/// quickest way that keeps to the tolerance.
///
/// Windows of what the scene may touch of the picture, 64 of 6×6 pixels that are spread over it or all of it where that is small, are drawn in one way after another, from the quickest
/// on, and the first is taken that is within 0.6 of the tolerance of the finest way at 99.9 % of the pixels that show anything. Where at most one
/// in a thousand is off by more, or at most a hundredth by at most two tolerances, three times as many windows elsewhere tell whether they are too many.
/// Where each window shows much of a large scene, there are fewer, eight at least; the fewer, the more a single pixel counts.
/// Nothing is taken, be it a way or what follows, with which 99.9 % of the pixels of all windows together are off by more than 0.8 of the tolerance. Kernels are
/// drawn to where opacities end; then the way that is taken is drawn with nearer ends, from the nearest on, and the first are taken that
/// keep to a share of the tolerance beside the finest way drawn at an eighth of it (way and ends are judged together):
/// - Extinctions end at a [cut-off](RenderSettings::cutoff) of 9, if that is what it is by default, or as it is, where 99 % of the
///   pixels that show anything differ by at most half of the tolerance.
/// - Opacities end at a [share of the tolerance](RenderSettings::end_share) from a quarter to 1/64, where 99.9 % differ by at most 0.6 of
///   it, if that is what it is by default, and at finer ones down to 1/4096 where those differ by more; not below what all kernels end at by themselves
///   ([`crate::Strength::Opacity`]). They are cut off by their opacity alone, which costs little.
/// - Of both, extinctions end nearer first, with opacities at the share that is set, and then opacities at smaller ones; all is judged as
///   opacities are.
/// - Surfels end at an [outline](RenderSettings::outline) of 6.25 or 9, if it is what it is by default, where 99.9 % differ by at
///   most half of it.
///
/// All this is judged with every splat drawn. Last, levels of detail are as coarse ([`RenderSettings::level_of_detail`], from 8 times the
/// width of the pixels' filter down to 0), if that is what it is by default, as the picture, with all that is settled before them, keeps to
/// what ways must keep to; where they may be coarser with surfels that end where they are set to, these do, and where they may be still coarser with slabs
/// of 1.86σ (2σ where kernels are not alike) than with the thicker ones that ways were judged by, those are taken instead.
///
/// The picture is then drawn with what this gives, as often as is wanted: nothing changes from frame to frame. Where windows and those elsewhere show nothing,
/// settings stay as they are, but opacities, if it is left open where they end and they don't end sooner, end at 1/4096 of the tolerance, as they do where windows show
/// less than a hundred pixels; pictures of fewer pixels than a window's are drawn in the finest way.
///
/// An order or a form that is not left to the engine stays as it is, and so do ends and levels that aren't what they are by default. Where all kernels have opacities they keep the
/// order that defines them. Surfaces by themselves need no order.
///
/// # Errors
/// Those of [`crate::render()`].
pub fn settle(
    scene: &Scene,
    camera: &Camera,
    settings: &RenderSettings,
) -> Result<RenderSettings, SceneError> {
    settings.validate()?;
    scene.validate()?;
    let Some(windows) = windows(SceneView { scene, camera, settings }) else { return Ok(*settings) };
    let levels = levels(scene, settings);
    // All but levels is judged with every splat.
    let level_of_detail = if levels.is_empty() { settings.level_of_detail } else { 0.0 };
    let open = RenderSettings { level_of_detail, ..*settings };
    let (ways, ends) = (ways(scene, &open), ends(scene, &open));
    let mut outlines = outlines(scene, &open).peekable();
    let ([others @ .., last], [nearer @ .., far]) = (&ways[..], &ends[..]) else { return Ok(*settings) };
    let drawn_in = |way: &(Order, FootprintForm), ends: &RenderSettings| RenderSettings {
        order: way.0,
        footprint: way.1,
        ..*ends
    };
    let nothing_else =
        others.is_empty() && nearer.is_empty() && outlines.peek().is_none() && levels.is_empty();
    let finest = drawn_in(last, far);
    let finer = |settings: RenderSettings| finer_ends((scene, &open), settings);
    // Where nothing tells, opacities end where they may matter least.
    let untold = |settings: RenderSettings| finer(settings).last().unwrap_or(settings);
    if windows[0].is_empty() || nothing_else {
        let settled = if nothing_else { finest } else { untold(finest) };
        return Ok(RenderSettings { level_of_detail: settings.level_of_detail, ..settled });
    }
    let [first_windows, others_of_them] = &windows;
    let mut asked = [&first_windows[..], others_of_them];
    let mut trial = Trial::new(scene, asked, finest)?;
    if trial.shown() == 0 && !others_of_them.is_empty() {
        // What is as thin as that may be seen by others.
        asked = [others_of_them, &[]];
        trial = Trial::new(scene, asked, finest)?;
    }
    if trial.shown() == 0 {
        return Ok(untold(*settings));
    }
    let way =
        first(others.iter(), |way| trial.is_within(SHARE_OF_WAYS, &drawn_in(way, far)))?.unwrap_or(last);
    let usual = drawn_in(way, far);
    let tells = trial.shown() >= LEAST_SHOWN;
    let settled = if tells {
        let with_ends = nearer.iter().map(|ends| drawn_in(way, ends));
        match nearest_ends(&trial, (scene, finest, settings), with_ends)? {
            Some(found) => found,
            None => far_ends(&trial, (scene, usual, settings), finer(usual))?,
        }
    } else {
        untold(usual)
    };
    if settled.end_share < far.end_share {
        // What follows is judged beside a picture that doesn't lack what these ends have.
        let RenderSettings { end_share, cutoff, .. } = settled;
        trial = Trial::new(scene, asked, RenderSettings { end_share, cutoff, ..finest })?;
    }
    let nearer = outlines.filter(|_| tells).map(|outline| RenderSettings { outline, ..settled });
    let outlined = first(nearer, |found| trial.is_within(SHARE_OF_ENDS, found))?;
    let with_outlines: Vec<_> = outlined.into_iter().chain([settled]).collect();
    let coarsest = coarsest_levels(&trial, &levels, &with_outlines)?;
    // Thinner slabs leave more of the tolerance to levels.
    let thinnest = ways.iter().rfind(|other| take_as_long(way, other)).filter(|other| *other != way);
    match thinnest {
        Some(thinner) => coarser_levels(&trial, &levels, coarsest, |ends| drawn_in(thinner, ends)),
        None => Ok(coarsest),
    }
}

/// The nearest ends that keep to their share of the tolerance beside the finest way drawn at an eighth of it, and to
/// [`MOST_OF_ALL`] beside the finest way.
fn nearest_ends(
    trial: &Trial,
    (scene, finest, asked): (&Scene, RenderSettings, &RenderSettings),
    from_the_nearest: impl ExactSizeIterator<Item = RenderSettings>,
) -> Result<Option<RenderSettings>, SceneError> {
    if from_the_nearest.len() == 0 {
        return Ok(None);
    }
    let strict = RenderSettings { tolerance: TRUTH_OF_ENDS * finest.tolerance, ..finest };
    let truth = trial.first(&with_far_ends((scene, asked), &strict))?;
    let (share, rank) =
        if scene.has_opacities() { (SHARE_OF_OPACITIES, 0.999) } else { (SHARE_OF_ENDS, 0.99) };
    first(from_the_nearest, |found| {
        let drawn = trial.first(found)?;
        let is_near = trial.difference(rank, [&truth, &drawn]) <= share * finest.tolerance;
        Ok(is_near && trial.are_within(MOST_OF_ALL, found, &drawn)?)
    })
}

/// The ends that ways were judged with, or the first finer ones that keep to their share of the tolerance beside their own picture at an
/// eighth of the tolerance; the last, which isn't judged, where none do.
fn far_ends(
    trial: &Trial,
    (scene, settled, asked): (&Scene, RenderSettings, &RenderSettings),
    finer: impl Iterator<Item = RenderSettings>,
) -> Result<RenderSettings, SceneError> {
    let mut best = settled;
    for finer in finer {
        let strict = RenderSettings { tolerance: TRUTH_OF_ENDS * best.tolerance, ..best };
        let pictures = [trial.first(&with_far_ends((scene, asked), &strict))?, trial.first(&best)?];
        if trial.difference(0.999, [&pictures[0], &pictures[1]]) <= SHARE_OF_OPACITIES * best.tolerance {
            break;
        }
        best = finer;
    }
    Ok(best)
}

/// The coarsest levels of detail, given from the coarsest on, that keep to the ways' share of the tolerance, with the first of several outlines with
/// which they do; every splat with the first outline where none do. Levels save more than outlines.
fn coarsest_levels(
    trial: &Trial,
    levels: &[f64],
    outlined: &[RenderSettings],
) -> Result<RenderSettings, SceneError> {
    let merged = |level_of_detail: f64| {
        let all = outlined.iter().map(|settled| RenderSettings { level_of_detail, ..*settled });
        first(all, |found| trial.is_within(SHARE_OF_WAYS, found))
    };
    for (number, level_of_detail) in levels.iter().enumerate().step_by(2) {
        if let Some(found) = merged(*level_of_detail)? {
            let coarser = number.checked_sub(1).map(|number| merged(levels[number])).transpose()?;
            return Ok(coarser.flatten().unwrap_or(found));
        }
    }
    Ok(outlined[0])
}

/// Coarser levels than those that are settled, drawn in another way, from the next coarser on until some will not do.
fn coarser_levels(
    trial: &Trial,
    levels: &[f64],
    settled: RenderSettings,
    drawn_in_another: impl Fn(&RenderSettings) -> RenderSettings,
) -> Result<RenderSettings, SceneError> {
    let mut best = settled;
    for level_of_detail in levels.iter().rev().filter(|level| **level > settled.level_of_detail) {
        let found = RenderSettings { level_of_detail: *level_of_detail, ..drawn_in_another(&best) };
        if !trial.is_within(SHARE_OF_WAYS, &found)? {
            break;
        }
        best = found;
    }
    Ok(best)
}

/// The first of some that will do.
fn first<T>(
    mut all: impl Iterator<Item = T>,
    will_do: impl Fn(&T) -> Result<bool, SceneError>,
) -> Result<Option<T>, SceneError> {
    all.find_map(|one| will_do(&one).map(|will| will.then_some(one)).transpose()).transpose()
}

/// The outlines that the scene's surfels may have, from the nearest on. A surfel's weight there is e^{−ρ/2} of its peak, and covers as much more as
/// the coverage floor is less than 1.
fn outlines(scene: &Scene, settings: &RenderSettings) -> impl Iterator<Item = f64> + use<> {
    let floor = |cloud: &Cloud| match &cloud.columns().kind {
        Kind::Surface(surface) => Some(f64::from(surface.coverage_floor)),
        _ => None,
    };
    let least_floor = scene.clouds.iter().filter_map(floor).reduce(f64::min).unwrap_or(0.0);
    let is_left_open = settings.outline == RenderSettings::default().outline;
    let most = 2.0 * settings.tolerance * least_floor;
    OUTLINES.into_iter().filter(move |outline| is_left_open && (-0.5 * outline).exp() <= most)
}

/// How coarse levels of detail may be, from the coarsest on; none where the scene has none, and where that is said, be it by a budget.
fn levels(scene: &Scene, settings: &RenderSettings) -> Vec<f64> {
    let has_levels = scene.clouds.iter().any(|cloud| cloud.levels().len() > 1);
    let is_default = settings.level_of_detail == RenderSettings::default().level_of_detail;
    if has_levels && is_default && settings.budget.is_none() { LEVELS.to_vec() } else { Vec::new() }
}

/// Settings that draw kernels to where opacities end, if it was not asked for another cut-off than the usual one.
fn with_far_ends((scene, asked): (&Scene, &RenderSettings), settings: &RenderSettings) -> RenderSettings {
    let is_left_open = asked.cutoff == RenderSettings::default().cutoff;
    let cutoff = if is_left_open { opacities_end(scene, settings) } else { asked.cutoff };
    RenderSettings { cutoff, ..*settings }
}

/// The cut-off where the densest opacity falls below the least that counts, no less than the usual one.
fn opacities_end(scene: &Scene, settings: &RenderSettings) -> f64 {
    settings.cutoff.max(-2.0 * settings.least_opacity().max(scene.least_opacity(settings)).max(1e-9).ln())
}

/// Settings with opacities that end at finer shares than usual; none where the scene has no opacities, or it was said where they end.
fn finer_ends(
    (scene, asked): (&Scene, &RenderSettings),
    settings: RenderSettings,
) -> impl Iterator<Item = RenderSettings> {
    let is_left_open = scene.has_opacities() && asked.end_share == RenderSettings::default().end_share;
    let tells = move |share: f64| is_left_open && settings.tolerance * share > scene.least_opacity(&settings);
    let coarser = [settings.end_share].into_iter().chain(FINER_SHARES);
    let shares = FINER_SHARES.into_iter().zip(coarser).filter(move |(_, coarser)| tells(*coarser));
    shares.map(move |(end_share, _)| with_far_ends((scene, asked), &RenderSettings { end_share, ..settings }))
}

/// Settings with the ends that the scene's kernels may have, from the nearest to the farthest.
fn ends(scene: &Scene, settings: &RenderSettings) -> Vec<RenderSettings> {
    let has_extinctions = scene.has_extinctions();
    let mut ends = Vec::new();
    if has_extinctions {
        let is_left_open = settings.cutoff == RenderSettings::default().cutoff;
        ends.extend(is_left_open.then_some(RenderSettings { cutoff: NEARER, ..*settings }));
        ends.push(*settings);
    }
    if scene.has_opacities() && settings.end_share == RenderSettings::default().end_share {
        // As near as clouds' own ends no others tell.
        let tells = |share: f64| settings.tolerance * share > scene.least_opacity(settings);
        let told = END_SHARES.iter().take_while(|share| tells(**share)).count();
        let shares = END_SHARES
            .into_iter()
            .take(told + 1)
            .filter(|share| !has_extinctions || *share <= settings.end_share);
        ends.extend(
            shares.map(|end_share| {
                with_far_ends((scene, settings), &RenderSettings { end_share, ..*settings })
            }),
        );
    } else if has_extinctions || scene.has_opacities() {
        ends.push(with_far_ends((scene, settings), settings));
    } else {
        ends.push(*settings);
    }
    ends.dedup();
    ends
}
