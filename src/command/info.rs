//! `oblate info`.

use super::print;
use crate::check::Wrong;
use crate::content::open;
use crate::description::FileOptions;
use crate::progress::Console;
use crate::summary::Summary;
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;

/// Says what a file holds: dims, counts, bounds, values; proposes an iso-value for a volume.
#[derive(Args)]
pub(crate) struct InfoArgs {
    /// Any file that render takes, but no scene file
    file: PathBuf,
    #[command(flatten)]
    options: FileOptions,
    /// Writes one JSON object
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &InfoArgs) -> Result<()> {
    args.options.check().map_err(Wrong::option)?;
    let name = args.file.display().to_string();
    let (opened, uses) = open(&args.file, &args.options, Console { quiet: args.json })?;
    args.options.check_use(uses).map_err(|wrong| wrong.option().context(name.clone()))?;
    let summary = Summary::new(name, &opened);
    print(&if args.json { serde_json::to_string(&summary)? + "\n" } else { summary.to_string() })
}
