//! Pictures, times and errors of the ways in which a subject can be drawn.

use crate::front::{MARGIN, Standing, front};
use crate::methods::{Family, Method, methods, way};
use crate::rgba::{channels, compare_channels};
use crate::scenes::{Known, Peer, Scale, Subject};
use crate::windows::{Window, Windows};
use oblate_engine::color::{linear_to_srgb, srgb_to_linear};
use oblate_engine::{
    Blend, CameraError, Channels, Counts, Frame, MetricsError, Observer, ReferenceKind, RenderSettings,
    Renderer, Scene, SceneError, Stage, reference, settle,
};
use serde::Serialize;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use thiserror::Error;

/// Who watches: the library reads no clock.
pub trait Watch: Sync {
    /// The time since some moment.
    fn now(&self) -> Duration;
    /// So much of a piece of work is done, from 0 to 1.
    fn at(&self, work: &str, share: f64);
}

/// How much is measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Plan {
    /// Pictures that times are taken of, after one that warms up.
    pub frames: usize,
    /// Pixels along a side of what R1 draws: sixteen windows, four in a row.
    pub r1_side: u32,
    /// Pixels along a side of what R2 draws.
    pub r2_side: u32,
    /// Its rays a pixel.
    pub r2_rays: u32,
}

impl Plan {
    /// What fits a scale.
    pub fn new(scale: Scale) -> Self {
        match scale {
            Scale::Full => Self { frames: 5, r1_side: 64, r2_side: 32, r2_rays: 16 },
            Scale::Quick => Self { frames: 3, r1_side: 32, r2_side: 16, r2_rays: 8 },
        }
    }
}

/// Why a subject can't be measured.
#[derive(Debug, Error)]
#[error(transparent)]
#[allow(missing_docs, reason = "each is the error that it is named after")]
pub enum MeasureError {
    Camera(#[from] CameraError),
    Metrics(#[from] MetricsError),
    Scene(#[from] SceneError),
}

/// What a subject's ways of drawing cost and how far they are from the truth.
#[derive(Clone, Debug, Serialize)]
pub struct Measured {
    /// The subject's.
    pub name: String,
    /// The subject's.
    pub about: String,
    /// In the scene.
    pub splats: u64,
    /// Pixels of the picture: width, height.
    pub size: [u32; 2],
    /// What errors are to: R1, and R2 or what is known.
    pub references: [String; 2],
    /// Left, top, width, height in pixels of the parts that each reference draws.
    pub windows: [Vec<[u32; 4]>; 2],
    /// How many times as long as at its quickest a picture takes at the median, at most, in nine ways of ten; 1.1 where none was
    /// drawn several times.
    pub variation: f64,
    /// The ways of drawing; the first is the default.
    pub rows: Vec<Row>,
    /// What people look at: the whole picture, and parts of it beside what is right there.
    #[serde(skip)]
    pub pictures: Vec<Picture>,
}

/// A way of drawing.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// A few words.
    pub method: String,
    /// What is turned.
    pub family: Family,
    /// Median time of a picture in milliseconds.
    pub median_ms: f64,
    /// The quickest and the slowest.
    pub spread_ms: [f64; 2],
    /// What was left to the engine, as it settled it, and how many milliseconds that took.
    pub settled: Option<(String, f64)>,
    /// Splats that were projected, and those of them that stand for several; not of others.
    pub visible: Option<[u64; 2]>,
    /// Errors to each reference.
    pub errors: [Option<Errors>; 2],
    /// How it stands by time and 99.9 % error to each reference.
    pub standing: [Standing; 2],
}

/// How far pictures are apart, in values of the space of blending, where white is 1; alpha counts where a picture has any that is not opaque.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Errors {
    /// Null where nothing differs.
    pub psnr_db: Option<f64>,
    /// What 99.9 % of the pixels keep to.
    pub p999: f64,
    /// The largest.
    pub max: f64,
    /// The mean over pixels.
    pub mean: f64,
    /// Structural similarity.
    pub ssim: f64,
}

/// A picture to be shown.
#[derive(Clone, Debug)]
pub struct Picture {
    /// What it is: a few words.
    pub name: String,
    /// Pixels: width, height.
    pub size: [usize; 2],
    /// Display-encoded, opaque.
    pub values: Vec<[f32; 3]>,
}

/// What is right in parts of the picture.
struct Truth {
    name: String,
    windows: Windows,
    values: Vec<[f32; 4]>,
    /// Pixels that count.
    counts: Option<Vec<bool>>,
}

impl Truth {
    fn drawn(
        subject: &Subject,
        (name, kind, side): (&str, ReferenceKind, u32),
        watch: &dyn Watch,
    ) -> Result<Self, MeasureError> {
        let windows = Windows::spread(&subject.camera, side);
        let work = format!("{}: {name}", subject.name);
        let mut drawn = Vec::with_capacity(windows.parts.len());
        for (number, Window { low, size }) in windows.parts.iter().enumerate() {
            let camera = subject.camera.part(low.as_ivec2().into(), (*size).into())?;
            watch.at(&work, number as f64 / windows.parts.len() as f64);
            let frame = reference(&subject.scene, &camera, &subject.settings, kind, &|_| ())?;
            drawn.push(values(&frame, subject.settings.blend));
        }
        let width = windows.parts[0].size.x as usize;
        let values = windows.joined(|number, [x, y]| drawn[number][y * width + x]);
        Ok(Self { name: name.into(), windows, values, counts: None })
    }

    fn known(subject: &Subject, known: &Known) -> Self {
        let windows = Windows::whole(&subject.camera);
        let values = values(&known.frame, subject.settings.blend);
        Self { name: known.name.clone(), windows, values, counts: Some(known.counts.clone()) }
    }

    fn errors(&self, whole: &[[f32; 4]], width: usize) -> Result<Errors, MetricsError> {
        let mut found = self.windows.cut(whole, width);
        if let Some(counts) = &self.counts {
            for ((value, right), counts) in found.iter_mut().zip(&self.values).zip(counts) {
                if !counts {
                    *value = *right;
                }
            }
        }
        // Of all ways as of the truth, so that they can be compared; holes show in premultiplied colours.
        let channels = channels(&self.values, &self.values);
        let metrics = compare_channels(channels, self.windows.size(), &found, &self.values)?;
        // Structures don't reach from one part into the next.
        let own = self.windows.parts[0].size.to_array().map(|side| side as usize);
        let mut ssim = 0.0;
        for number in 0..self.windows.parts.len() {
            let [found, right] = [&found, &self.values].map(|all| self.windows.part(all, number));
            ssim += compare_channels(channels, own, &found, &right)?.ssim;
        }
        Ok(Errors {
            psnr_db: Some(metrics.psnr_db).filter(|db| db.is_finite()),
            p999: metrics.p999_error,
            max: metrics.max_error,
            mean: metrics.mean_error,
            ssim: ssim / self.windows.parts.len() as f64,
        })
    }
}

/// A frame's values in the space of blending: linear light or display-encoded, premultiplied.
fn values(frame: &Frame, blend: Blend) -> Vec<[f32; 4]> {
    let encode = |[r, g, b, a]: [f32; 4]| match blend {
        Blend::Linear => [r, g, b, a],
        Blend::Display if a > 0.0 => {
            let [r, g, b] = [r, g, b].map(|c| a * linear_to_srgb(c / a));
            [r, g, b, a]
        }
        Blend::Display => [0.0; 4],
    };
    frame.color.iter().map(|pixel| encode(*pixel)).collect()
}

/// A peer's picture in the space of blending.
fn shown_values(peer: &Peer, blend: Blend) -> Vec<[f32; 4]> {
    let decode = |c: f32| if blend == Blend::Linear { srgb_to_linear(c) } else { c };
    peer.display.iter().map(|pixel| pixel.map(decode)).map(|[r, g, b]| [r, g, b, 1.0]).collect()
}

/// What is drawn and timed: one of the engine's ways, or another.
struct Contender<'a> {
    method: Method,
    other: Option<&'a (dyn Fn() -> Frame + Send + Sync)>,
    settled: Option<(String, f64)>,
    times: Vec<f64>,
    counts: Counts,
    values: Vec<[f32; 4]>,
}

/// Keeps the counts of a frame.
#[derive(Default)]
struct Counter(Mutex<Counts>);

impl Observer for Counter {
    fn begin(&self, _stage: Stage) {}

    fn counts(&self, counts: Counts) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = counts;
    }
}

/// Draws a subject in every way, compares it with what is right, and takes the times, in turns.
///
/// # Errors
/// When the subject can't be drawn.
pub fn measure(subject: &Subject, plan: &Plan, watch: &dyn Watch) -> Result<Measured, MeasureError> {
    let r1 = Truth::drawn(subject, ("R1", ReferenceKind::R1, plan.r1_side), watch)?;
    let second = match &subject.known {
        Some(known) => Truth::known(subject, known),
        None => {
            let kind = ReferenceKind::R2 { samples: plan.r2_rays };
            Truth::drawn(subject, ("R2", kind, plan.r2_side), watch)?
        }
    };
    let contenders = race(subject, plan, watch)?;
    let width = subject.camera.size()[0] as usize;
    let mut rows = Vec::with_capacity(contenders.len());
    for contender in &contenders {
        // Others are not held to what splats alone should show.
        let to_r1 = contender.other.is_none().then(|| r1.errors(&contender.values, width)).transpose()?;
        let to_second = Some(second.errors(&contender.values, width)?);
        rows.push(row(contender, [to_r1, to_second]));
    }
    for peer in &subject.peers {
        let values = shown_values(peer, subject.settings.blend);
        let errors = [r1.errors(&values, width)?, second.errors(&values, width)?];
        let (median_ms, spread_ms) = (peer.median_ms, peer.spread_ms);
        let (method, family) = (peer.name.clone(), Family::Peer);
        let standing = [Standing::Beaten; 2];
        rows.push(Row {
            settled: None,
            method,
            family,
            median_ms,
            spread_ms,
            visible: None,
            errors: errors.map(Some),
            standing,
        });
    }
    let variation = variation(&rows);
    for which in 0..2 {
        let points = rows.iter().map(|row| {
            // Another filter is another picture, no better or worse one; and programs of others drew what they were given, not this.
            let counts = !matches!(row.family, Family::LowPass | Family::Peer);
            let error = row.errors[which].filter(|_| counts).map_or(f64::NAN, |errors| errors.p999);
            // The least of the times: what else the machine does only adds to them.
            [row.spread_ms[0], error]
        });
        let standings = front(&points.collect::<Vec<_>>(), variation);
        rows.iter_mut().zip(standings).for_each(|(row, standing)| row.standing[which] = standing);
    }
    let corners = |truth: &Truth| {
        let corners = |window: &Window| [window.low.x, window.low.y, window.size.x, window.size.y];
        truth.windows.parts.iter().map(corners).collect()
    };
    Ok(Measured {
        name: subject.name.clone(),
        about: subject.about.clone(),
        splats: subject.scene.clouds.iter().map(|cloud| cloud.len() as u64).sum(),
        size: subject.camera.size(),
        references: [r1.name.clone(), second.name.clone()],
        windows: [corners(&r1), corners(&second)],
        variation,
        rows,
        pictures: pictures(subject, [&r1, &second], &contenders),
    })
}

/// By how much times vary, told by those that were taken several times.
fn variation(rows: &[Row]) -> f64 {
    let is_own = |row: &&Row| row.family != Family::Peer && row.spread_ms[1] > row.spread_ms[0];
    let mut ratios: Vec<f64> =
        rows.iter().filter(is_own).map(|row| row.median_ms / row.spread_ms[0]).collect();
    ratios.sort_by(f64::total_cmp);
    let most = (ratios.len() * 9).div_ceil(10).saturating_sub(1);
    ratios.get(most).copied().unwrap_or(1.0 + MARGIN)
}

fn row(contender: &Contender<'_>, errors: [Option<Errors>; 2]) -> Row {
    let mut times = contender.times.clone();
    times.sort_by(f64::total_cmp);
    let counts = contender.counts;
    Row {
        method: contender.method.name.clone(),
        family: contender.method.family,
        median_ms: times[times.len() / 2],
        spread_ms: [times[0], times[times.len() - 1]],
        settled: contender.settled.clone(),
        visible: contender.other.is_none().then_some([counts.visible, counts.merged]),
        errors,
        standing: [Standing::Beaten; 2],
    }
}

/// A way that has been timed for so long in all is timed no more, and one that takes as long by itself needs nothing to warm up.
const ENOUGH_MS: f64 = 400.0;

/// Draws in every way, again and again in turns, so that what else the machine does meets all alike.
fn race<'a>(
    subject: &'a Subject,
    plan: &Plan,
    watch: &dyn Watch,
) -> Result<Vec<Contender<'a>>, MeasureError> {
    let every_splat = RenderSettings { level_of_detail: 0.0, ..subject.settings };
    let settled = settle(&subject.scene, &subject.camera, &every_splat)?;
    let ways = methods(&subject.scene, &subject.settings, &settled);
    let contender = |method, other| Contender {
        method,
        other,
        settled: None,
        times: Vec::new(),
        counts: Counts::default(),
        values: Vec::new(),
    };
    let others = subject.known.iter().flat_map(|known| &known.others).map(|other| {
        let method = Method { name: other.name.clone(), family: Family::Other, settings: subject.settings };
        contender(method, Some(&*other.draw as &(dyn Fn() -> Frame + Send + Sync)))
    });
    let mut contenders: Vec<Contender<'a>> =
        ways.into_iter().map(|way| contender(way, None)).chain(others).collect();
    for contender in contenders.iter_mut().filter(|contender| contender.method.family == Family::Tolerance) {
        let begun = watch.now();
        let settings = settle(&subject.scene, &subject.camera, &contender.method.settings)?;
        contender.settled = Some((way(&settings), (watch.now() - begun).as_secs_f64() * 1e3));
        contender.method.settings = settings;
    }
    let mut renderer = Renderer::new();
    let work = format!("{}: {} ways of drawing", subject.name, contenders.len());
    let rounds = plan.frames + 1;
    // Its buffers are made before anything is timed.
    if let Some(first) = contenders.first_mut() {
        first.draw(subject, &mut renderer, true)?;
    }
    let mut refused = Vec::new();
    for round in 0..rounds {
        for (place, contender) in contenders.iter_mut().enumerate() {
            watch.at(&work, round as f64 / rounds as f64);
            // What takes long varies less.
            if contender.times.iter().sum::<f64>() > ENOUGH_MS {
                continue;
            }
            let begun = watch.now();
            let is_drawn = contender.draw(subject, &mut renderer, round == 0)?;
            let took = (watch.now() - begun).as_secs_f64() * 1e3;
            if !is_drawn {
                refused.push(place);
            } else if round > 0 || took > ENOUGH_MS {
                contender.times.push(took);
            }
        }
        for place in refused.drain(..).rev() {
            contenders.remove(place);
        }
    }
    Ok(contenders)
}

impl Contender<'_> {
    /// Draws once, and keeps the picture if it is the first. Gives whether the scene can be drawn in this way.
    fn draw(
        &mut self,
        subject: &Subject,
        renderer: &mut Renderer,
        is_first: bool,
    ) -> Result<bool, MeasureError> {
        if let Some(other) = self.other {
            let frame = other();
            if is_first {
                self.values = values(&opaque(&frame, subject.settings.background), subject.settings.blend);
            }
            return Ok(true);
        }
        let remade: Option<Scene> =
            subject.known.as_ref().and_then(|known| known.remake.as_ref()).map(|remake| remake());
        let scene = remade.as_ref().unwrap_or(&subject.scene);
        let counter = Counter::default();
        let settings = RenderSettings { channels: Channels::Color, ..self.method.settings };
        let frame = match renderer.render(scene, &subject.camera, &settings, &counter) {
            // Sheets need a grid.
            Err(SceneError::NoGrid) => return Ok(false),
            frame => frame?,
        };
        if is_first {
            self.values = values(frame, subject.settings.blend);
            self.counts = counter.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        }
        Ok(true)
    }
}

/// A frame over a background.
fn opaque(frame: &Frame, [r, g, b, a]: [f32; 4]) -> Frame {
    let over = |[x, y, z, w]: [f32; 4]| {
        let through = (1.0 - w) * a;
        [x + through * r, y + through * g, z + through * b, w + through]
    };
    Frame { color: frame.color.iter().map(|pixel| over(*pixel)).collect(), ..frame.clone() }
}

/// The default, what is right, how they differ, and how the worst of the quick ones does.
fn pictures(subject: &Subject, truths: [&Truth; 2], contenders: &[Contender<'_>]) -> Vec<Picture> {
    // People judge a known picture by what it shows, others by what splats should show.
    let truth = truths[usize::from(subject.known.is_some())];
    let width = subject.camera.size()[0] as usize;
    let size = truth.windows.size();
    let shown = |name: String, pixel: &dyn Fn(usize) -> [f32; 3]| Picture {
        name,
        size,
        values: (0..size[0] * size[1]).map(pixel).collect(),
    };
    let display = |[r, g, b, _]: [f32; 4]| match subject.settings.blend {
        Blend::Linear => [r, g, b].map(linear_to_srgb),
        Blend::Display => [r, g, b],
    };
    let mut all = Vec::new();
    if let Some(default) = contenders.first().filter(|_| subject.known.is_none()) {
        let whole = subject.camera.size().map(|side| side as usize);
        let mut values: Vec<_> = default.values.iter().map(|pixel| display(*pixel)).collect();
        truth.windows.parts.iter().for_each(|window| window.frame(&mut values, whole));
        all.push(Picture {
            name: "the whole picture; its parts in frames follow".into(),
            size: whole,
            values,
        });
    }
    all.push(shown(truth.name.clone(), &|at| display(truth.values[at])));
    let compared = |name: &str| contenders.iter().find(|contender| contender.method.name == name);
    let second = if subject.known.is_some() { "nearest writes" } else { "centers, affine" };
    for contender in contenders.first().into_iter().chain(compared(second)) {
        let part = truth.windows.cut(&contender.values, width);
        all.push(shown(contender.method.name.clone(), &|at| display(part[at])));
        let off = |at: usize| -> [f32; 3] {
            let counts = truth.counts.as_ref().is_none_or(|counts| counts[at]);
            let apart = |i: usize| (part[at][i] - truth.values[at][i]).abs();
            if counts { [0, 1, 2].map(apart) } else { [0.0; 3] }
        };
        let largest = (0..part.len()).flat_map(off).fold(0.0, f32::max);
        let scale = brightening(largest);
        let name = format!("{}, {scale} × the difference", contender.method.name);
        all.push(shown(name, &|at| off(at).map(|apart| apart * scale)));
    }
    all
}

/// By how much differences are multiplied to be seen: a power of two that leaves the largest below white.
fn brightening(largest: f32) -> f32 {
    (1.0 / largest.max(1e-6)).log2().floor().exp2().clamp(1.0, 4096.0)
}
