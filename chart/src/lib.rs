//! What oblate's ways of drawing cost and how far they are from the truth, and where ways of drawing fail.
//!
//! [`scenes`] are made by the program itself, or by who calls; [`methods`] are the ways in which one can be drawn; [`measure`] draws them in turns and holds
//! them against references; [`front`] finds the best; [`plot`] and [`mod@report`] show all. [`rgba`] says how far pictures with an alpha channel are apart.
//!
//! [`stability`] holds fifteen cases in which such methods break: each gives curves and verdicts, of ours and of what others do.
//! [`baselines`] are what others do with depth images.
//!
//! Nothing here reads a clock, a file or the network.

pub mod baselines;
pub mod curves;
pub mod front;
pub mod measure;
pub mod methods;
pub mod plot;
pub mod report;
pub mod rgba;
pub mod scenes;
pub mod stability;
mod windows;
