//! `--transfer`: presets and files.

use crate::description::Transfer;
use anyhow::{Context, Result};
use oblate::volumes::{PRESETS, TransferFunction, Volume, preset};
use std::fmt::Write;

/// Whether a preset has this name.
pub(crate) fn is_preset(name: &str) -> bool {
    preset(name).is_some()
}

/// The transfer function that is meant for the volume: presets are fitted to it, files read; `None` is the
/// first preset.
pub(crate) fn resolve(wanted: Option<&Transfer>, volume: &Volume) -> Result<TransferFunction> {
    let name = match wanted {
        Some(Transfer::Made(function)) => return Ok(function.clone()),
        Some(Transfer::Named(name)) => Some(name.as_str()),
        None => None,
    };
    let fitted = name.map_or(PRESETS.first(), preset);
    if let Some(preset) = fitted {
        return Ok(preset.fit(volume)?);
    }
    let path = name.unwrap_or_default();
    let text = std::fs::read_to_string(path).with_context(|| {
        let names: Vec<&str> = PRESETS.iter().map(|p| p.name).collect();
        format!(
            "transfer function {path}: neither a preset ({}) nor a file that can be read",
            names.join(", ")
        )
    })?;
    text.parse().with_context(|| path.to_owned())
}

/// The presets, a line each.
pub(crate) fn list() -> String {
    let mut text = String::new();
    for preset in &PRESETS {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{:<8}{}", preset.name, preset.description);
    }
    text
}
