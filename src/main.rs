//! `oblate`: meshes, volumes, point clouds, depth images and trained splats in one picture, from the command line.

mod assemble;
mod built_in;
mod check;
mod command;
mod content;
mod depth_inputs;
mod description;
mod detail;
mod draw;
mod finish;
mod framing;
mod inputs;
mod notation;
mod output;
mod peers;
mod picture;
mod points;
mod progress;
mod scene_file;
mod stats;
mod summary;
mod transfer;
mod volume_looks;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Draws meshes, volumes, point clouds, depth images and trained splats as Gaussian splats, all in one correct picture.
#[derive(Parser)]
#[command(version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Render(Box<command::render::RenderArgs>),
    Info(command::info::InfoArgs),
    Pick(Box<command::pick::PickArgs>),
    Convert(Box<command::convert::ConvertArgs>),
    Extract(Box<command::extract::ExtractArgs>),
    Warp(Box<command::warp::WarpArgs>),
    Compare(command::compare::CompareArgs),
    Chart(command::chart::ChartArgs),
}

fn main() -> ExitCode {
    // Clap itself exits with 2 on options that it can't read.
    let result = match Cli::parse().command {
        Command::Render(args) => command::render::run(*args).map(|()| ExitCode::SUCCESS),
        Command::Info(args) => command::info::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Pick(args) => command::pick::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Convert(args) => command::convert::run(*args).map(|()| ExitCode::SUCCESS),
        Command::Extract(args) => command::extract::run(*args).map(|()| ExitCode::SUCCESS),
        Command::Warp(args) => command::warp::run(*args).map(|()| ExitCode::SUCCESS),
        Command::Compare(args) => command::compare::run(&args),
        Command::Chart(args) => command::chart::run(&args).map(|()| ExitCode::SUCCESS),
    };
    result.unwrap_or_else(|error| {
        progress::complain(format_args!("error: {}", one_line(&error)));
        ExitCode::from(2)
    })
}

/// An error and its causes on one line; a cause that its effect has already named is left out.
fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(|cause| cause.to_string().trim().replace('\n', "; ")) {
        if line.is_empty() {
            line = cause;
        } else if !line.contains(&cause) {
            line = format!("{line}: {cause}");
        }
    }
    line
}
