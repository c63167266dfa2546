//! Transfer functions as text.
//!
//! ```text
//! # everything after a hash is a comment
//! transfer 1                  the format and its version, first
//! strength opacity_per_unit   or: extinction
//! color srgb                  or: linear
//! gradient 2 20               optional: extinction rises over these gradient magnitudes
//! # value  red green blue  strength
//! 0        0 0 0           0
//! 20       0.45 0.5 0.6    0.006
//! ```

use std::fmt::{self, Display, Formatter};
use std::str::FromStr;

use thiserror::Error;

use crate::transfer::{ColorSpace, ControlPoint, GradientRamp, StrengthKind, TransferFunction, check_point};

/// Names of the kinds of strength in text.
const STRENGTHS: [(&str, StrengthKind); 2] =
    [("extinction", StrengthKind::Extinction), ("opacity_per_unit", StrengthKind::OpacityPerUnit)];
/// Names of the colour spaces in text.
const COLOR_SPACES: [(&str, ColorSpace); 2] = [("srgb", ColorSpace::Srgb), ("linear", ColorSpace::Linear)];

/// What is wrong with a transfer function's text, and what would be right.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("line {line}: {message}")]
pub struct TransferTextError {
    /// The line, from 1; the one after the last when something is missing.
    pub line: usize,
    /// What is wrong and what would be right.
    pub message: String,
}

impl FromStr for TransferFunction {
    type Err = TransferTextError;

    fn from_str(text: &str) -> Result<Self, TransferTextError> {
        let mut parsed = Parsed::default();
        // Some programs begin texts with a mark of UTF-8.
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        for (index, line) in text.lines().enumerate() {
            let words: Vec<&str> =
                line.split('#').next().unwrap_or_default().split_ascii_whitespace().collect();
            if !words.is_empty() {
                parsed.line(&words).map_err(|message| TransferTextError { line: index + 1, message })?;
            }
        }
        parsed.finish().map_err(|message| TransferTextError { line: text.lines().count() + 1, message })
    }
}

#[derive(Default)]
struct Parsed {
    versioned: bool,
    strength: Option<StrengthKind>,
    color_space: Option<ColorSpace>,
    gradient: Option<GradientRamp>,
    points: Vec<ControlPoint>,
}

impl Parsed {
    fn line(&mut self, words: &[&str]) -> Result<(), String> {
        if !self.versioned {
            return match words {
                ["transfer", "1"] => {
                    self.versioned = true;
                    Ok(())
                }
                ["transfer", version] => Err(format!("version `{version}`; this reads `transfer 1`")),
                _ => Err("a transfer function begins with the line `transfer 1`".into()),
            };
        }
        match *words {
            ["strength", name] if self.points.is_empty() => set(&mut self.strength, named(name, &STRENGTHS)?),
            ["color", name] if self.points.is_empty() => {
                set(&mut self.color_space, named(name, &COLOR_SPACES)?)
            }
            ["gradient", low, high] => {
                let ramp = GradientRamp { low: number(low)?, high: number(high)? };
                set(&mut self.gradient, ramp.checked().map_err(|e| e.to_string())?)
            }
            ["strength" | "color", _] => Err(format!("`{}` must come before the control points", words[0])),
            ["gradient", ..] => Err("`gradient` takes two magnitudes: `gradient LOW HIGH`".into()),
            ["strength" | "color", ..] => Err(format!("`{}` takes one name", words[0])),
            [value, red, green, blue, strength] => {
                let (kind, _) = self.header()?;
                let color = [number(red)?, number(green)?, number(blue)?];
                self.points.push(ControlPoint { value: number(value)?, color, strength: number(strength)? });
                check_point(&self.points, self.points.len() - 1, kind).map_err(|e| e.to_string())
            }
            _ => Err(format!(
                "`{}` is not a line of a transfer function; a control point is five numbers: \
                 value red green blue strength",
                words.join(" ")
            )),
        }
    }

    fn header(&self) -> Result<(StrengthKind, ColorSpace), String> {
        let strength = self.strength.ok_or(
            "the kind of strength is not said; add `strength extinction` or `strength opacity_per_unit` \
             before the control points",
        )?;
        let color_space = self.color_space.ok_or(
            "the colour space is not said; add `color srgb` or `color linear` before the control points",
        )?;
        Ok((strength, color_space))
    }

    fn finish(self) -> Result<TransferFunction, String> {
        if !self.versioned {
            return Err("a transfer function begins with the line `transfer 1`".into());
        }
        let (strength, color_space) = self.header()?;
        let function =
            TransferFunction::new(self.points, strength, color_space).map_err(|e| e.to_string())?;
        match self.gradient {
            Some(ramp) => function.with_gradient(ramp).map_err(|e| e.to_string()),
            None => Ok(function),
        }
    }
}

fn set<T>(slot: &mut Option<T>, value: T) -> Result<(), String> {
    if slot.replace(value).is_some() {
        return Err("this was said before; say it once".into());
    }
    Ok(())
}

fn number(word: &str) -> Result<f32, String> {
    word.parse().map_err(|_| format!("`{word}` is not a number"))
}

fn named<T: Copy>(word: &str, names: &[(&str, T); 2]) -> Result<T, String> {
    names
        .iter()
        .find(|(name, _)| *name == word)
        .map(|(_, value)| *value)
        .ok_or_else(|| format!("`{word}` is not known; it is `{}` or `{}`", names[0].0, names[1].0))
}

fn name_of<T: PartialEq>(value: T, names: &[(&'static str, T); 2]) -> &'static str {
    if names[0].1 == value { names[0].0 } else { names[1].0 }
}

/// The text format; parsing it gives the same function again, bit for bit.
impl Display for TransferFunction {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "transfer 1")?;
        writeln!(f, "strength {}", name_of(self.strength(), &STRENGTHS))?;
        writeln!(f, "color {}", name_of(self.color_space(), &COLOR_SPACES))?;
        if let Some(GradientRamp { low, high }) = self.gradient() {
            writeln!(f, "gradient {low} {high}")?;
        }
        writeln!(f, "# value red green blue strength")?;
        for ControlPoint { value, color: [r, g, b], strength } in self.points() {
            writeln!(f, "{value} {r} {g} {b} {strength}")?;
        }
        Ok(())
    }
}
