//! Points as text, a line each: XYZ, XYZRGB, PTS, ASC, and tables with commas or semicolons.
//!
//! These formats have no standard. Values are separated by spaces, tabs, commas or semicolons (commas between digits beside
//! other separators are refused: they may be decimal ones); lines that are empty or begin with
//! `#` or `//` are skipped, and so is the first other line if it doesn't begin with a number: it names the columns, and is
//! not understood but of seven. A first line of one whole number is the number of points (PTS), which must be right. How many columns there
//! are, the same in all lines, tells what they mean:
//!
//! | columns | mean |
//! |---|---|
//! | 3 | x y z |
//! | 4 | x y z intensity |
//! | 6 | x y z red green blue; or a normal, in files named `.xyzn` and where one of the last three is negative anywhere |
//! | 7 | x y z intensity red green blue (PTS), or x y z red green blue intensity |
//! | 9 | x y z red green blue, and a normal |
//!
//! Of seven columns the intensity is the last where a line above the points names colours before it, or, without such a line,
//! where the three before it are integers up to 255 everywhere and it isn't. What is taken is noted, but for PTS with its count.
//!
//! Colours are sRGB-encoded; a negative one is refused, since the columns are others then. White is 1 where none is above 1, else 255, else 65535.

use super::{Gather, Has, Point};
use crate::file::{File, quoted};
use crate::{ImportError, Note, Opened, Place};
use glam::{DVec3, Vec3};

/// The most columns of a line that is understood.
const COLUMNS: usize = 9;

/// Reads points.
pub(crate) fn read(file: &File) -> Result<Opened, ImportError> {
    let text = file.text();
    let mut rows = Rows { file, lines: text.split(|&b| b == b'\n').enumerate() };
    let mut declared = None;
    let Some((mut line, mut first)) = rows.data(true)? else {
        return Err(file.malformed(Place::Whole, "there are no points in it, at least one is needed"));
    };
    if let [count] = first.values()
        && count.fract() == 0.0
        && *count >= 0.0
    {
        declared = Some((line, *count));
        let next = rows.data(false)?;
        (line, first) = next.ok_or_else(|| {
            file.malformed(Place::Line(line), format!("{count} points are said to follow; none does"))
        })?;
    }
    let columns = first.length;
    let named_normals = file.path.extension().is_some_and(|name| name.eq_ignore_ascii_case("xyzn"));
    let (intensity, color, normal) = match columns {
        3 => (None, None, None),
        4 => (Some(3), None, None),
        6 if named_normals || !all(&rows, &first, |row| !row.iter().skip(3).any(|value| *value < 0.0))? => {
            (None, None, Some(3))
        }
        6 => (None, Some(3), None),
        7 if declared.is_none() && scalar_is_last(text, &rows, &first)? => (Some(6), Some(3), None),
        7 => (Some(3), Some(4), None),
        9 => (None, Some(3), Some(6)),
        _ => {
            let feature = format!("{columns} columns; lines of 3, 4, 6, 7 and 9 numbers are understood");
            return Err(file.unsupported(Place::Line(line), feature));
        }
    };
    let has = Has {
        colors: color.is_some(),
        intensities: intensity.is_some(),
        normals: normal.is_some(),
        radii: false,
    };
    // At least a digit for each value and what ends it.
    let most = text.len() / (2 * columns) + 1;
    let lines = text.iter().filter(|&&b| b == b'\n').count() + 1;
    let mut gather = Gather::new(most.min(lines), has);
    let mut count = 0_usize;
    let mut next = Some((line, first));
    while let Some((line, row)) = next {
        if row.length != columns {
            if row.length == 1 && declared.is_some() {
                let problem = format!(
                    "one number among points, as if {} more followed: the first line's count of points is for all of a file; \
                     several scans are not read from one",
                    row.numbers[0]
                );
                return Err(file.unsupported(Place::Line(line), problem));
            }
            let problem = format!("{} values; the first point has {columns}", row.length);
            return Err(file.malformed(Place::Line(line), problem));
        }
        let three = |at: usize| [row.numbers[at], row.numbers[at + 1], row.numbers[at + 2]];
        gather.put(&Point {
            position: DVec3::from(three(0)),
            color: color.map_or([0.0; 3], |at| three(at).map(|c| c as f32)),
            intensity: intensity.map_or(0.0, |at| row.numbers[at] as f32),
            normal: normal.map_or(Vec3::ZERO, |at| Vec3::from(three(at).map(|c| c as f32))),
            radius: 0.0,
        });
        count += 1;
        next = rows.data(false)?;
    }
    if let Some((line, declared)) = declared.filter(|(_, declared)| *declared != count as f64) {
        let problem = format!("{declared} points are said to follow; {count} do");
        return Err(file.malformed(Place::Line(line), problem));
    }
    if normal == Some(3) && !named_normals {
        let what =
            "the last three of six columns are normals, since one is negative; otherwise they are colours";
        gather.notes.push(Note::Assumed(what.into()));
    }
    if columns == 7 && declared.is_none() {
        let last = intensity == Some(6);
        let order = if last { "red green blue intensity" } else { "intensity red green blue" };
        gather.notes.push(Note::Assumed(format!("seven columns are x y z {order}")));
    }
    if has.colors {
        let (darkest, brightest) = (gather.darkest(), gather.brightest());
        if darkest < 0.0 {
            let problem = format!(
                "a colour is {darkest}; {columns} columns are taken for {}",
                match (columns, intensity) {
                    (7, Some(6)) => "x y z r g b intensity",
                    (7, _) => "x y z intensity r g b",
                    _ => "x y z r g b and a normal",
                }
            );
            return Err(file.malformed(Place::Whole, problem));
        }
        let white = [1.0, 255.0, 65535.0].into_iter().find(|&white| brightest <= white);
        let white = white.ok_or_else(|| {
            file.malformed(Place::Whole, format!("a colour is {brightest}; they go up to 1, 255 or 65535"))
        })?;
        gather.notes.push(Note::Assumed(format!("colours go up to {white}")));
        gather.decode_colors(Some(white));
    }
    gather.finish(file)
}

/// The numbers of a line.
#[derive(Clone, Copy)]
struct Row {
    numbers: [f64; COLUMNS],
    length: usize,
}

impl Row {
    fn values(&self) -> &[f64] {
        self.numbers.get(..self.length).unwrap_or_default()
    }
}

#[derive(Clone)]
struct Rows<'a, L> {
    file: &'a File,
    lines: L,
}

impl<'a, L: Iterator<Item = (usize, &'a [u8])>> Rows<'a, L> {
    /// The next line with numbers, and its own. The first of a file may be one of words.
    fn data(&mut self, mut first: bool) -> Result<Option<(usize, Row)>, ImportError> {
        for (index, line) in self.lines.by_ref() {
            let line = line.trim_ascii();
            if line.is_empty() || line.starts_with(b"#") || line.starts_with(b"//") {
                continue;
            }
            let mut row = Row { numbers: [0.0; COLUMNS], length: 0 };
            let separates = |b: &u8| b.is_ascii_whitespace() || matches!(b, b',' | b';');
            let mut wrong = None;
            for word in line.split(separates).filter(|word| !word.is_empty()) {
                match std::str::from_utf8(word).ok().and_then(|word| word.parse().ok()) {
                    None => wrong = wrong.or(Some((row.length, word))),
                    Some(number) if row.length < COLUMNS => row.numbers[row.length] = number,
                    Some(_) => {}
                }
                row.length += 1;
            }
            match wrong {
                None if has_decimal_commas(line) => {
                    let problem =
                        "commas between digits beside other separators: decimals are written with points";
                    return Err(self.file.malformed(Place::Line(index + 1), problem));
                }
                None if row.length == 0 => {}
                None => return Ok(Some((index + 1, row))),
                Some((0, _)) if first => {}
                Some((_, word)) => {
                    let problem = format!("{} is no number", quoted(&String::from_utf8_lossy(word)));
                    return Err(self.file.malformed(Place::Line(index + 1), problem));
                }
            }
            first = false;
        }
        Ok(None)
    }
}

/// Whether commas stand between digits although something else separates numbers: `1,5;2,5` would be four numbers.
fn has_decimal_commas(line: &[u8]) -> bool {
    let between = |part: &[u8]| part[0].is_ascii_digit() && part[1] == b',' && part[2].is_ascii_digit();
    let words = || line.split(|b| b.is_ascii_whitespace() || *b == b';').filter(|word| !word.is_empty());
    line.contains(&b',') && words().nth(1).is_some() && line.windows(3).any(between)
}

/// Whether all lines pass a test, of which this is the first.
fn all<'a, L: Iterator<Item = (usize, &'a [u8])> + Clone>(
    rows: &Rows<'a, L>,
    first: &Row,
    test: impl Fn(&[f64]) -> bool,
) -> Result<bool, ImportError> {
    let mut rows = rows.clone();
    if !test(first.values()) {
        return Ok(false);
    }
    while let Some((_, row)) = rows.data(false)? {
        if !test(row.values()) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Whether the last of seven columns is the intensity, behind colours: as a line above the points says, else where the three
/// before it look like colours, and it doesn't look like one everywhere.
fn scalar_is_last<'a, L: Iterator<Item = (usize, &'a [u8])> + Clone>(
    text: &[u8],
    rows: &Rows<'a, L>,
    first: &Row,
) -> Result<bool, ImportError> {
    if let Some(place) = named_colors(text) {
        return Ok(place == 3);
    }
    let is_byte = |value: &f64| value.fract() == 0.0 && (0.0..=255.0).contains(value);
    Ok(all(rows, first, |row| row.iter().skip(3).take(3).all(is_byte))?
        && !all(rows, first, |row| row.iter().skip(6).all(is_byte))?)
}

/// The column of red, where a line above the points names that, green and blue, and x, y, z first.
fn named_colors(text: &[u8]) -> Option<usize> {
    for line in text.split(|&b| b == b'\n').map(<[u8]>::trim_ascii).filter(|line| !line.is_empty()) {
        let is_comment = line.starts_with(b"#") || line.starts_with(b"//");
        let line = String::from_utf8_lossy(line).to_ascii_lowercase();
        let separates = |c: char| c.is_whitespace() || matches!(c, ',' | ';' | '#' | '/');
        let words: Vec<&str> = line.split(separates).filter(|word| !word.is_empty()).collect();
        let starts = |at: usize, names: [&[&str]; 3]| {
            let found = words.get(at..at + 3);
            found.is_some_and(|words| words.iter().zip(names).all(|(word, names)| names.contains(word)))
        };
        if starts(0, [&["x"], &["y"], &["z"]]) {
            let colors = [&["r", "red", "rf"][..], &["g", "green", "gf"], &["b", "blue", "bf"]];
            return (3..words.len()).find(|at| starts(*at, colors));
        }
        if !is_comment {
            return None;
        }
    }
    None
}
