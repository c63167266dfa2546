//! Measurements and curves as SVG and PNG.

use crate::curves::{Axis, Curve, Panel, Role};
use crate::front::Standing;
use crate::measure::{Measured, Row};
use crate::methods::{Family, LEVEL};
use kuva::backend::png::PngBackend;
use kuva::backend::svg::SvgBackend;
use kuva::plot::scatter::MarkerShape;
use kuva::plot::{LegendPosition, LinePlot, LineStyle, ScatterPlot};
use kuva::render::annotations::ReferenceLine;
use kuva::render::figure::Figure;
use kuva::render::layout::{Layout, TickFormat};
use kuva::render::plots::Plot;
use kuva::render::render::{Scene, render_multiple};
use std::sync::Arc;
use thiserror::Error;

/// A drawing, as vectors and as pixels.
#[derive(Clone, Debug)]
pub struct Drawing {
    /// An SVG document.
    pub svg: String,
    /// A PNG file.
    pub png: Vec<u8>,
}

/// A drawing that can't be made into pixels.
#[derive(Clone, Debug, Error)]
#[error("the chart {title:?} can't be drawn as PNG: {why}")]
pub struct PlotError {
    title: String,
    why: String,
}

/// Errors below this are drawn as this: single precision's own.
const LEAST_ERROR: f64 = 1e-7;

/// Colours that those who confuse some can tell apart (Okabe, Ito, *Color Universal Design*, 2008).
const PALETTE: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f7f7f"];

fn look(family: Family) -> (&'static str, MarkerShape) {
    match family {
        Family::Tolerance => (PALETTE[0], MarkerShape::Circle),
        Family::Fixed => (PALETTE[2], MarkerShape::Square),
        Family::Cutoff => (PALETTE[5], MarkerShape::Triangle),
        Family::LowPass => (PALETTE[6], MarkerShape::Plus),
        Family::Levels => (PALETTE[3], MarkerShape::TriangleDown),
        Family::Baseline => (PALETTE[1], MarkerShape::Cross),
        Family::Other => (PALETTE[4], MarkerShape::Diamond),
        Family::Peer => ("#000000", MarkerShape::Star),
    }
}

/// Time against the error that 99.9 % of the pixels keep to, of all ways of drawing a subject, to one of its two references; the best
/// are joined and named.
///
/// # Errors
/// When no PNG can be made.
pub fn chart(measured: &Measured, which: usize) -> Result<Drawing, PlotError> {
    let title = format!("{}: time against error to {}", measured.name, measured.references[which]);
    let (plots, layout) = scatter(measured, which, true);
    let layout = layout
        .with_title(title.clone())
        .with_width(760.0)
        .with_height(460.0)
        .with_legend_position(LegendPosition::OutsideRightTop);
    draw(render_multiple(plots, layout), &title)
}

/// The charts of several subjects beside each other, to R1 or what is known.
///
/// # Errors
/// When no PNG can be made.
pub fn overview(all: &[Measured]) -> Result<Drawing, PlotError> {
    let columns = all.len().clamp(1, 4);
    let rows = all.len().div_ceil(columns);
    let (mut plots, mut layouts) = (Vec::new(), Vec::new());
    for measured in all {
        // Of what is known the error to it counts.
        let which = usize::from(!measured.references[1].starts_with("R2"));
        let (plot, layout) = scatter(measured, which, false);
        plots.push(plot);
        layouts.push(layout.with_title(format!("{}, to {}", measured.name, measured.references[which])));
    }
    let title = "Time of a picture against the error that 99.9 % of its pixels keep to";
    let figure = Figure::new(rows, columns)
        .with_title(title)
        .with_plots(plots)
        .with_layouts(layouts)
        .with_cell_size(330.0, 280.0)
        .with_shared_legend_bottom();
    draw(figure.render(), title)
}

fn scatter(measured: &Measured, which: usize, is_named: bool) -> (Vec<Plot>, Layout) {
    let at = |row: &Row| {
        let error = row.errors[which]?.p999.max(LEAST_ERROR);
        Some((row.median_ms, error))
    };
    let mut plots = Vec::new();
    let mut best: Vec<(f64, f64)> =
        measured.rows.iter().filter(|row| row.standing[which].is_on_front()).filter_map(at).collect();
    best.sort_by(|a, b| a.0.total_cmp(&b.0));
    plots.push(Plot::Line(
        LinePlot::new().with_data(best).with_color("#bbbbbb").with_stroke_width(2.0).with_legend("best"),
    ));
    for family in Family::ALL {
        let rows: Vec<&Row> =
            measured.rows.iter().filter(|row| row.family == family && row.errors[which].is_some()).collect();
        if rows.is_empty() {
            continue;
        }
        let (color, marker) = look(family);
        let low = |row: &&Row| row.median_ms - row.spread_ms[0];
        let high = |row: &&Row| row.spread_ms[1] - row.median_ms;
        let mut plot = ScatterPlot::new()
            .with_data(rows.iter().filter_map(|row| at(row)))
            .with_x_err_asymmetric(rows.iter().map(|row| (low(row), high(row))))
            .with_color(color)
            .with_marker(marker)
            .with_size(if is_named { 4.5 } else { 3.5 })
            .with_legend(family.name());
        if is_named {
            let name = |row: &&Row| {
                let is_best = row.standing[which] == Standing::Best;
                let is_shown = is_best || row.method == "default" || family == Family::Peer;
                if is_shown { row.method.clone() } else { String::new() }
            };
            plot = plot.with_labels(rows.iter().map(name)).with_repel_labels();
        }
        plots.push(Plot::Scatter(plot));
    }
    let mut layout = Layout::auto_from_plots(&plots)
        .with_log_scale()
        .with_x_label("milliseconds a picture")
        .with_y_label("error of 99.9 % of the pixels")
        .with_x_tick_format(plain_ticks())
        .with_y_tick_format(powers());
    layout = layout
        .with_reference_line(ReferenceLine::horizontal(LEVEL).with_color("#999999").with_label("1/255"));
    (plots, layout)
}

/// A panel of curves.
///
/// # Errors
/// When no PNG can be made.
pub fn panel(panel: &Panel) -> Result<Drawing, PlotError> {
    let mut of_role = [0_usize; 5];
    let mut plots = Vec::new();
    for curve in &panel.curves {
        let place = &mut of_role[curve.role as usize];
        plots.push(Plot::Line(line(panel, curve, *place)));
        *place += 1;
    }
    let mut layout = Layout::auto_from_plots(&plots)
        .with_title(panel.title.clone())
        .with_title_wrap(70)
        .with_x_label(panel.x.label.clone())
        .with_y_label(panel.y.label.clone())
        .with_x_tick_format(ticks(&panel.x))
        .with_y_tick_format(ticks(&panel.y))
        .with_width(860.0)
        .with_height(400.0)
        .with_legend_position(LegendPosition::OutsideRightTop);
    if panel.x.is_log {
        layout = layout.with_log_x();
    }
    if panel.y.is_log {
        layout = layout.with_log_y();
    }
    if let Some(bound) = panel.bound {
        layout = layout
            .with_reference_line(ReferenceLine::horizontal(bound).with_color("#cc0000").with_label("bound"));
    }
    draw(render_multiple(plots, layout), &panel.title)
}

fn line(panel: &Panel, curve: &Curve, place: usize) -> LinePlot {
    let is_drawn = |p: &&[f64; 2]| !(panel.x.is_log && p[0] <= 0.0 || panel.y.is_log && p[1] <= 0.0);
    let points = curve.points.iter().filter(is_drawn).map(|p| (p[0], p[1]));
    let plot = LinePlot::new().with_data(points).with_legend(curve.name.clone());
    let pick = |colors: &[&str]| colors[place % colors.len()].to_string();
    match curve.role {
        Role::Default => plot.with_color(PALETTE[0]).with_stroke_width(3.0),
        Role::Ours => plot.with_color(pick(&["#56b4e9", "#009e73", "#8888dd"])).with_stroke_width(1.8),
        Role::Baseline => plot
            .with_color(pick(&["#d55e00", "#e69f00", "#cc79a7", "#a05020", "#f0b0a0"]))
            .with_stroke_width(1.8)
            .with_line_style(LineStyle::Dashed),
        Role::Truth => plot.with_color(pick(&["#000000", "#555555"])).with_stroke_width(1.4),
        Role::Estimate => {
            let plot = plot.with_color(pick(&["#7f7f7f", "#b0a030", "#70a0a0"])).with_stroke_width(1.4);
            plot.with_line_style(LineStyle::Dotted)
        }
    }
}

fn ticks(axis: &Axis) -> TickFormat {
    if axis.is_log { powers() } else { TickFormat::Auto }
}

/// 0.5, 2, 10, 200, 5k.
fn plain_ticks() -> TickFormat {
    TickFormat::Custom(Arc::new(|x| if x < 1e3 { format!("{x}") } else { format!("{}k", x / 1e3) }))
}

/// Numbers near 1 as they are, others as powers of ten.
fn powers() -> TickFormat {
    TickFormat::Custom(Arc::new(|x: f64| {
        if (0.01..1e4).contains(&x) { format!("{}", (x * 1e6).round() / 1e6) } else { format!("{x:e}") }
    }))
}

fn draw(scene: Scene, title: &str) -> Result<Drawing, PlotError> {
    let svg = SvgBackend.render_scene(&scene);
    let png = PngBackend::new().with_scale(2.0).render_scene(&scene);
    let png = png.map_err(|why| PlotError { title: title.into(), why })?;
    Ok(Drawing { svg, png })
}
