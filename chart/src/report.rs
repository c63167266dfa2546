//! Everything that was found on one page, which needs no network.

use crate::front::Standing;
use crate::measure::{Errors, Measured, Picture, Row};
use crate::methods::{Family, LEVEL};
use crate::plot::{Drawing, PlotError, chart, panel};
use crate::stability::{Bound, Case, Findings};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;
use std::collections::HashSet;
use std::fmt::Write;
use std::iter::once;

/// Where and by what it was measured.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// The processor's name.
    pub processor: String,
    /// Threads that drew.
    pub threads: usize,
    /// The widest instructions that were used.
    pub instructions: String,
    /// Operating system and architecture.
    pub system: String,
    /// Of oblate.
    pub version: String,
    /// The command.
    pub command: String,
}

/// A case of the stability suite and what it found.
pub type Found = (Case, Findings);

/// What a report is of.
#[derive(Clone, Copy, Debug)]
pub struct Report<'a> {
    /// Where and by what it was measured.
    pub machine: &'a Machine,
    /// Subjects.
    pub measured: &'a [Measured],
    /// Cases.
    pub failures: &'a [Found],
}

/// A file beside the report.
#[derive(Clone, Debug)]
pub struct File {
    /// Its name.
    pub name: String,
    /// What is in it.
    pub content: Vec<u8>,
}

impl Report<'_> {
    /// The page `report.html`, all charts as SVG and PNG, and all numbers as `chart.json`. Subjects of one name are numbered.
    ///
    /// # Errors
    /// When a chart can't be drawn.
    pub fn files(&self) -> Result<Vec<File>, PlotError> {
        let all = uniquely_named(self.measured);
        let mut files = Vec::new();
        let mut page = head(self.machine);
        if !all.is_empty() {
            page += WORDS;
            page += &advice(&all);
            if all.len() > 1 {
                page += &kept(&mut files, "overview", crate::plot::overview(&all)?);
            }
        }
        for measured in &all {
            page += &subject(measured, &mut files)?;
        }
        if !self.failures.is_empty() {
            page += &summary_of_cases(self.failures);
        }
        for (case, findings) in self.failures {
            page += &failures(case, findings, &mut files)?;
        }
        page += "</main></body></html>\n";
        files.push(File { name: "report.html".into(), content: page.into_bytes() });
        files.push(File { name: "chart.json".into(), content: self.json(&all) });
        Ok(files)
    }

    fn json(&self, subjects: &[Measured]) -> Vec<u8> {
        #[derive(Serialize)]
        struct All<'a> {
            format: u32,
            machine: &'a Machine,
            subjects: &'a [Measured],
            cases: Vec<CaseFound<'a>>,
        }
        #[derive(Serialize)]
        struct CaseFound<'a> {
            number: u8,
            title: &'a str,
            criterion: &'a str,
            #[serde(flatten)]
            findings: &'a Findings,
        }
        let found = |(case, findings): &'_ Found| (case.number, case.title, case.criterion, findings.clone());
        let owned: Vec<_> = self.failures.iter().map(found).collect();
        let cases = owned.iter().map(|(number, title, criterion, findings)| CaseFound {
            number: *number,
            title,
            criterion,
            findings,
        });
        let all = All { format: 1, machine: self.machine, subjects, cases: cases.collect() };
        serde_json::to_vec_pretty(&all).unwrap_or_default()
    }
}

/// Subjects under names that differ, and so do their files', where capitals are no difference: `scene`, `scene-2`.
fn uniquely_named(all: &[Measured]) -> Vec<Measured> {
    let mut taken = HashSet::new();
    let named = |measured: &Measured| {
        let numbered = (2..).map(|number| format!("{}-{number}", measured.name));
        let mut names = once(measured.name.clone()).chain(numbered);
        let name = names.find(|name| taken.insert(file_name(name).to_ascii_lowercase()));
        Measured { name: name.unwrap_or_default(), ..measured.clone() }
    };
    all.iter().map(named).collect()
}

/// Keeps a chart's files, and gives the chart for the page.
fn kept(files: &mut Vec<File>, name: &str, drawing: Drawing) -> String {
    let figure = format!("<figure>{}</figure>\n", drawing.svg);
    files.push(File { name: format!("{name}.svg"), content: drawing.svg.into_bytes() });
    files.push(File { name: format!("{name}.png"), content: drawing.png });
    figure
}

fn head(machine: &Machine) -> String {
    let Machine { processor, threads, instructions, system, version, command } = machine;
    let (processor, system, command) = (escaped(processor), escaped(system), escaped(command));
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>oblate: speed against accuracy</title>\n\
         <meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style></head><body><main>\n\
         <h1>Speed against accuracy</h1>\n\
         <p>oblate {version} on {threads} threads of {processor} ({instructions}; {system}): <code>{command}</code></p>\n\
         <p>Each scene is drawn in every way that has a meaning for it, in turns; times are medians of a whole picture, the quickest and the slowest \
         beside them. Errors are those of a channel, where white is 1, in the space in which the scene is blended. <b>R1</b> integrates the same \
         filtered splats exactly along each pixel's ray (trained splats are defined by sorted centres: it puts them there): it shows what order, overlap \
         and footprint cost. <b>R2</b> takes the splats as they are and many rays a pixel: it also shows the error of filtering each splat separately. In charts \
         both axes are logarithmic, and lower left is better; the dashed line at 1/255 is one step of an 8-bit picture. A way is among the best, on the grey line and in blue rows, \
         if no other is no worse in both time and error and better by a tenth in one. It is named in the chart, and its row is of a stronger blue, if that would still \
         be so had it taken longer by as much as the times of this run vary; else another run may find otherwise.</p>\n"
    )
}

/// The names of ways and the options that ask for them.
const WORDS: &str = "<details><summary>What the ways are, and the options for them</summary><table>\
    <tr><td>default; tolerance t</td><td>nothing, 1/255; <code>--tolerance t</code></td><td>order and form are found by trial, so that errors stay within t</td></tr>\
    <tr><td>centers</td><td><code>--order centers</code></td><td>splats one after the other, sorted by their centres, as most programs do</td></tr>\
    <tr><td>per pixel</td><td><code>--order per-pixel</code></td><td>sorted in each pixel</td></tr>\
    <tr><td>slabs xσ</td><td><code>--slab-thickness x</code></td><td>summed in layers as thick as x times the kernels' median σ, and the layers composited</td></tr>\
    <tr><td>layers</td><td></td><td>surfaces alone, which need no order: samples of one sheet are averaged</td></tr>\
    <tr><td>points, affine, exact; each its form</td><td><code>--footprint point|affine|exact|auto</code></td><td>round spots; ellipses; \
    true perspective of a splat; what each splat's own bound asks for</td></tr>\
    <tr><td>cut off at ρ</td><td></td><td>splats end at √ρ σ; 12.25 unless something is said, beyond that where the default finds it needed; every splat drawn</td></tr>\
    <tr><td>low-pass v px²</td><td><code>--low-pass v</code></td><td>variance of the pixel's filter, 0.3 by default; every splat drawn</td></tr>\
    <tr><td>every splat; budget</td><td><code>--level-of-detail off</code>; <code>--budget N</code></td><td>no levels of detail; so many splats at most</td></tr>\
    <tr><td>α = τ, uncorrected, axis sheets</td><td></td><td>how others do it: opacity by Taylor's series, slabs without their own spread taken off, sheets of the grid</td></tr>\
    </table></details>\n";

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;color:#222;background:#fff;margin:0}main{max-width:1120px;margin:auto;padding:1em}\
    table{border-collapse:collapse;margin:1em 0;font-size:13px}td,th{padding:.15em .7em;text-align:right;border-bottom:1px solid #ddd}\
    td:first-child,th:first-child{text-align:left}tr.best{background:#dcecff}tr.close{background:#f3f8ff}tr.first{font-weight:bold}.fails{color:#b00}.passes{color:#070}\
    figure{margin:1em 0;display:inline-block}figure svg{max-width:100%;height:auto}.pictures figure{margin:0 .6em .6em 0;font-size:13px}\
    .pictures img{image-rendering:pixelated;display:block;width:260px}details summary{cursor:pointer}code{font-size:13px}";

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Which way to draw each scene.
fn advice(all: &[Measured]) -> String {
    let mut text = String::from(
        "<h2>Which way to draw</h2>\n<p>Errors to R1 of 999 pixels in 1000 of its windows; the default's is green where it keeps to 1/255, red where it \
         does not, and beside it stands its error to the second reference. The quickest is the fastest way within 1/255; the most accurate is the quickest of those that \
         come within a fifth of the least error. oblate chooses the default by drawing small windows first: this takes the time in the last column, once for a scene.</p>\n\
         <table><tr><th>scene</th><th>the default is</th><th>ms</th><th>error to R1</th><th>to the second</th>\
         <th>quickest within 1/255</th><th>ms</th><th>error</th><th>most accurate</th><th>ms</th><th>error</th><th>trial, ms</th></tr>\n",
    );
    for measured in all {
        // What a reference of the same splats says; a known picture holds what splats cannot.
        let ours = |row: &&Row| !matches!(row.family, Family::LowPass | Family::Peer | Family::Other);
        let error = |row: &Row| row.errors[0].map_or(f64::INFINITY, |errors| errors.p999);
        let within = measured.rows.iter().filter(ours).filter(|row| error(row) <= LEVEL);
        let quickest = within.min_by(|a, b| a.median_ms.total_cmp(&b.median_ms));
        let least = measured.rows.iter().filter(ours).map(error).fold(f64::INFINITY, f64::min);
        let close = measured.rows.iter().filter(ours).filter(|row| error(row) <= 1.2 * least);
        let closest = close.min_by(|a, b| a.median_ms.total_cmp(&b.median_ms));
        let Some(default) = measured.rows.first() else { continue };
        let cells = |row: Option<&Row>| match row {
            Some(row) => format!(
                "<td>{}</td><td>{}</td><td>{}</td>",
                escaped(&row.method),
                milliseconds(row.median_ms),
                small(error(row))
            ),
            None => "<td>none</td><td></td><td></td>".into(),
        };
        let class = if error(default) <= LEVEL { "passes" } else { "fails" };
        let _ = writeln!(
            text,
            "<tr><td><a href=\"#{0}\">{0}</a></td><td>{5}</td><td>{1}</td><td class=\"{class}\">{2}</td><td>{7}</td>{3}{4}<td>{6}</td></tr>",
            escaped(&measured.name),
            milliseconds(default.median_ms),
            small(error(default)),
            cells(quickest),
            cells(closest),
            default.settled.as_ref().map_or(String::new(), |(way, _)| escaped(way)),
            default.settled.as_ref().map_or(String::new(), |(_, ms)| milliseconds(*ms)),
            default.errors[1].map_or(String::new(), |errors| small(errors.p999)),
        );
    }
    text + "</table>\n"
}

fn subject(measured: &Measured, files: &mut Vec<File>) -> Result<String, PlotError> {
    let name = escaped(&measured.name);
    let [parts_of_first, parts_of_second] = measured.windows.each_ref().map(|windows| match &windows[..] {
        [[.., width, height]] => format!("{width}×{height} pixels"),
        [[.., width, height], ..] => format!("{} windows of {width}×{height} pixels", windows.len()),
        [] => "no pixels".into(),
    });
    let mut text = format!(
        "<h2 id=\"{name}\">{name}</h2>\n<p>{}</p>\n<p>{} splats in the scene, {}×{} pixels; {} in {parts_of_first}, {} in {parts_of_second}.</p>\n",
        escaped(&measured.about),
        measured.splats,
        measured.size[0],
        measured.size[1],
        escaped(&measured.references[0]),
        escaped(&measured.references[1]),
    );
    text += "<div class=\"pictures\">";
    for picture in &measured.pictures {
        let image = STANDARD.encode(png(picture));
        let _ = write!(
            text,
            "<figure><img alt=\"\" src=\"data:image/png;base64,{image}\"><figcaption>{}</figcaption></figure>",
            escaped(&picture.name)
        );
    }
    text += "</div>\n";
    for (which, suffix) in ["r1", "r2"].into_iter().enumerate() {
        text += &kept(files, &format!("{}-{suffix}", file_name(&measured.name)), chart(measured, which)?);
    }
    let [first, second] = measured.references.each_ref().map(|name| escaped(name));
    let _ = writeln!(
        text,
        "<details open><summary>All ways of drawing</summary><table><tr><th>way</th><th>ms</th><th>quickest, slowest</th><th>splats drawn</th>\
         <th>{first}: PSNR</th><th>99.9 %</th><th>largest</th><th>SSIM</th><th>{second}: PSNR</th><th>99.9 %</th><th>largest</th><th>SSIM</th></tr>"
    );
    for (place, row) in measured.rows.iter().enumerate() {
        let class = match row.standing[0] {
            Standing::Best => "best",
            Standing::Close => "close",
            Standing::Beaten => "",
        };
        let first = if place == 0 { "first " } else { "" };
        let [quickest, slowest] = row.spread_ms.map(milliseconds);
        let splats = row.visible.map_or(String::new(), |[visible, _]| visible.to_string());
        let _ = writeln!(
            text,
            "<tr class=\"{first}{class}\"><td>{}{}</td><td>{}</td><td>{quickest}, {slowest}</td><td>{splats}</td>{}{}</tr>",
            escaped(&row.method),
            row.settled.as_ref().map_or(String::new(), |(way, _)| format!(" ({})", escaped(way))),
            milliseconds(row.median_ms),
            errors(row.errors[0]),
            errors(row.errors[1])
        );
    }
    Ok(text + "</table></details>\n")
}

fn errors(errors: Option<Errors>) -> String {
    match errors {
        None => "<td></td><td></td><td></td><td></td>".into(),
        Some(errors) => {
            let psnr = errors.psnr_db.map_or("∞".into(), |db| format!("{db:.1} dB"));
            let [p999, max] = [errors.p999, errors.max].map(small);
            format!("<td>{psnr}</td><td>{p999}</td><td>{max}</td><td>{:.5}</td>", errors.ssim)
        }
    }
}

fn summary_of_cases(all: &[Found]) -> String {
    let mut text = String::from(
        "<h2>Where methods fail</h2>\n<p>Fifteen cases in which drawing by splats breaks. In each the default is held to a bound; others are run beside \
         it.</p>\n<table><tr><th>case</th><th>default</th><th>exceptions</th><th>baselines that fail</th></tr>\n",
    );
    for (case, findings) in all {
        let ours = |fails: bool| {
            findings
                .verdicts
                .iter()
                .filter(move |verdict| !verdict.role.is_of_others() && verdict.passes() != fails)
                .count()
        };
        let of_others = findings.verdicts.iter().filter(|verdict| verdict.role.is_of_others());
        let failing = of_others.clone().filter(|verdict| !verdict.passes()).count();
        let (passing, exceptions) = (ours(false), ours(true));
        let class = if exceptions == 0 { "passes" } else { "fails" };
        let _ = writeln!(
            text,
            "<tr><td><a href=\"#case-{0}\">{0}. {1}</a></td><td>{passing} figures pass</td><td class=\"{class}\">{exceptions}</td><td>{failing} of {2}</td></tr>",
            case.number,
            escaped(case.title),
            of_others.count(),
        );
    }
    text + "</table>\n"
}

fn failures(case: &Case, findings: &Findings, files: &mut Vec<File>) -> Result<String, PlotError> {
    let mut text = format!(
        "<h3 id=\"case-{0}\">{0}. {1}</h3>\n<p>{2}</p>\n",
        case.number,
        escaped(case.title),
        escaped(case.criterion)
    );
    for (place, curves) in findings.panels.iter().enumerate() {
        let name = format!("case-{:02}-{}", case.number, place + 1);
        text += &kept(files, &name, panel(curves)?);
    }
    text += "<table><tr><th>method</th><th>figure</th><th>found</th><th>bound</th><th></th></tr>\n";
    for verdict in &findings.verdicts {
        let bound = match verdict.bound {
            Bound::AtMost(bound) => format!("≤ {}", small(bound)),
            Bound::AtLeast(bound) => format!("≥ {}", small(bound)),
        };
        let says = if verdict.passes() { "passes" } else { "fails" };
        let _ = writeln!(
            text,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{bound}</td><td class=\"{says}\">{says}</td></tr>",
            escaped(&verdict.method),
            escaped(&verdict.figure),
            small(verdict.found)
        );
    }
    Ok(text + "</table>\n")
}

/// Letters and digits of a name.
fn file_name(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect()
}

fn milliseconds(ms: f64) -> String {
    if ms < 100.0 { format!("{ms:.1}") } else { format!("{ms:.0}") }
}

/// Three figures.
fn small(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size if size < 1e-3 => format!("{value:.1e}"),
        size if size < 1.0 => format!("{value:.4}"),
        size if size < 100.0 => format!("{value:.2}"),
        _ => format!("{value:.0}"),
    }
}

/// A picture as a PNG file.
fn png(picture: &Picture) -> Vec<u8> {
    let bytes: Vec<u8> =
        picture.values.as_flattened().iter().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
    let mut file = Vec::new();
    let [width, height] = picture.size.map(|side| side as u32);
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    // Memory takes what is written; a picture is never empty.
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&bytes));
    debug_assert!(written.is_ok(), "{written:?}");
    file
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subjects_of_one_name_are_numbered() {
        let named = |name: &str| Measured {
            name: name.into(),
            about: String::new(),
            splats: 0,
            size: [1; 2],
            references: ["R1".into(), "R2".into()],
            windows: [vec![], vec![]],
            variation: 1.1,
            rows: vec![],
            pictures: vec![],
        };
        let all = ["scene", "head", "scene", "a b", "a-b", "scene-2", "Head", "scene"].map(named);
        let names: Vec<String> = uniquely_named(&all).into_iter().map(|one| one.name).collect();
        assert_eq!(names, ["scene", "head", "scene-2", "a b", "a-b-2", "scene-2-2", "Head-2", "scene-3"]);
    }
}
