//! Stage `raster`: a tile's records to amplitudes at its pixels, eight pixels at a time.
//!
//! A record is drawn strip by strip: columns of eight pixels, down the rows that its ellipse meets. In the affine
//! form e^{−r/2} is a Gaussian of the row, so from one row to the next it is multiplied by a ratio, and the ratio by
//! a constant: two exponentials a strip, two multiplications a row. The exact form takes its formula row by row.

mod ellipse;
mod exact;
mod recurrence;
mod surfel;

pub(crate) use ellipse::StripRows;
pub(crate) use exact::{ExactRows, ray_lengths};
pub(crate) use recurrence::Recurrence;
pub(crate) use surfel::{Sample, SurfelRaster};
